//! Pages as they look, against pictures of them: `fixtures/pages`. Text is boxes there, so that layout, charts and colours are
//! judged and no font is; a missing picture fails, and `BLESS=1` alone writes.

use crate::{
    support::{
        browser::Page,
        service::{Idle, TestService},
    },
    web::{measured, report_ids},
};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Pictures are compared by the means of squares of this many pixels: where an edge is smoothed differently, by another
/// version of the browser or its rasteriser, a mean hardly changes.
const SQUARE_PX: u32 = 8;
/// How far apart two means may be, of 255 levels. A line of a chart that changes its colour changes its squares by 20 and more.
const MAX_APART: f64 = 12.0;
/// The share of squares that may be farther apart: a number that has a digit more, and so a box. That is 16 of 640×800 pixels.
const MAX_SHARE: f64 = 2e-3;

/// The share of squares whose means are too far apart, and how far they are each.
fn difference(a: &RgbImage, b: &RgbImage) -> (f64, RgbImage) {
    assert_eq!(a.dimensions(), b.dimensions());
    let (columns, rows) = (a.width().div_ceil(SQUARE_PX), a.height().div_ceil(SQUARE_PX));
    let mean = |image: &RgbImage, column: u32, row: u32, channel: usize| {
        let [x, y] = [column * SQUARE_PX, row * SQUARE_PX];
        let [right, low] = [(x + SQUARE_PX).min(image.width()), (y + SQUARE_PX).min(image.height())];
        let pixels = (y..low).flat_map(|y| (x..right).map(move |x| (x, y)));
        let sum: f64 = pixels.map(|(x, y)| f64::from(image.get_pixel(x, y)[channel])).sum();
        sum / f64::from((right - x) * (low - y))
    };
    let apart = |column, row| {
        let of = |channel| (mean(a, column, row, channel) - mean(b, column, row, channel)).abs();
        (0..3).map(of).fold(0.0, f64::max)
    };
    let mut n_beyond = 0;
    let drawn = RgbImage::from_fn(columns, rows, |column, row| {
        let apart = apart(column, row);
        n_beyond += u32::from(apart > MAX_APART);
        Rgb([(apart * 4.0).min(255.0) as u8; 3])
    });
    (f64::from(n_beyond) / f64::from(columns * rows), drawn)
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/pages/{name}.png"))
}

/// Holds a page against its picture; leaves expected, actual and difference where they differ.
#[track_caller]
fn looks_as_before(page: &mut Page, name: &str) {
    let actual = page.picture();
    let path = golden(name);
    if std::env::var_os("BLESS").is_some() {
        return actual.save(&path).unwrap();
    }
    let expected = image::open(&path).unwrap_or_else(|error| panic!("{}: {error}; BLESS=1 writes it", path.display()));
    let expected = expected.to_rgb8();
    let (share, drawn) = difference(&expected, &actual);
    if share > MAX_SHARE {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pages");
        fs::create_dir_all(&folder).unwrap();
        for (what, image) in [("expected", &expected), ("actual", &actual), ("difference", &drawn)] {
            image.save(folder.join(format!("{name}.{what}.png"))).unwrap();
        }
        panic!(
            "{name} looks different in {:.2} % of its squares: {}",
            100.0 * share,
            folder.display()
        );
    }
}

/// Two results of thirty frames, and a page that stands still.
fn posted() -> (TestService, Page) {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for shift in [0.0, 1.5] {
        let frames: Vec<Value> = (0..30)
            .map(|i| {
                let psnr = 30.0 + shift + f64::from(i % 7) / 5.0 - if i == 17 { 6.0 } else { 0.0 };
                json!({"index": i, "warmup": i < 4, "reset": i == 0 || i == 15, "metrics": {"psnr": psnr},
                       "times_ms": {"prepare": 0.1, "resolve": 0.4 + f64::from(i % 3) / 10.0}})
            })
            .collect();
        let body =
            json!({"sequence": "ship", "system": "ours", "frames": frames, "commit": "c0ffee", "branch": "main"});
        client.posted("/reports", &body);
    }
    let other = json!({"sequence": "bistro", "system": "theirs", "values": {"psnr": 33.5}, "commit": "c0ffee", "branch": "main"});
    client.posted("/reports", &other);
    let mut page = Page::open();
    page.stand_still();
    (service, page)
}

fn open_report(service: &TestService, page: &mut Page) {
    page.resize(640, 1500, false);
    page.go(&service.url("/reports/2?with=1"));
    page.until("document.body.dataset.charts == 2");
}

#[test]
fn pages_of_numbers_look_as_before() {
    let (service, mut page) = posted();
    open_report(&service, &mut page);
    looks_as_before(&mut page, "report");
    page.resize(640, 800, true);
    page.go(&service.url("/"));
    looks_as_before(&mut page, "overview");
    page.resize(360, 740, false);
    page.go(&service.url("/jobs/new?kind=stress"));
    page.until("document.getElementById('count').textContent > 0");
    looks_as_before(&mut page, "new_stress");
    page.is_well();
}

#[test]
fn the_viewer_looks_as_before() {
    let (service, job) = measured();
    let ids = report_ids(&job);
    let mut page = Page::open();
    page.stand_still();
    page.resize(640, 800, true);
    page.go(&service.url(&format!("/reports/{}/frames/7?a=output&b=error&renderer=2d", ids[0])));
    page.until("document.getElementById('stage').dataset.draws > 0");
    looks_as_before(&mut page, "viewer");
    page.is_well();
}

/// What a step is likely to need is fetched before it is asked for, in the direction of the last one.
#[test]
fn the_viewer_fetches_where_steps_lead() {
    let (service, job) = measured();
    let ids = report_ids(&job);
    let mut page = Page::open();
    let until_fetched = |page: &mut Page, frames: &str| {
        page.until(&format!(
            "performance.getEntriesByType('resource').map(({{name}}) => name.match(/frames.(\\d+).output.f16/)?.[1])
                .filter(Boolean).join() == '{frames}'"
        ));
    };
    page.go(&service.url(&format!("/reports/{}/frames/6", ids[0])));
    until_fetched(&mut page, "6,7,8,9,5");
    page.key("ArrowLeft");
    until_fetched(&mut page, "6,7,8,9,5,4,3,2");
    page.key("Home");
    until_fetched(&mut page, "6,7,8,9,5,4,3,2,0,1");
    page.is_well();
}

/// What steps lead to is drawn out of sight, and is what would have been drawn; a look that changed since is drawn anew.
#[test]
fn a_step_shows_what_was_drawn_ahead() {
    let (service, job) = measured();
    let ids = report_ids(&job);
    let mut page = Page::open();
    let frame =
        |index: usize, look: &str| service.url(&format!("/reports/{}/frames/{index}?mode=difference{look}", ids[0]));
    let fetched = |index: usize| {
        format!(
            "performance.getEntriesByType('resource').some(({{name}}) => name.endsWith('/frames/{index}/output.f16'))"
        )
    };
    let canvas = "document.getElementById('canvas').toDataURL()";
    page.go(&frame(6, ""));
    // Frame 7 was drawn before frame 8 was asked for.
    page.until(&fetched(8));
    page.value(
        "(() => {
            const { prototype } = WebGL2RenderingContext, blit = prototype.blitFramebuffer;
            window.blits = 0;
            prototype.blitFramebuffer = function (...to) { window.blits++; return blit.apply(this, to); };
        })()",
    );
    page.key("ArrowRight");
    page.until("document.getElementById('stage').dataset.frame == 7");
    assert_eq!(page.number("blits"), 1.0);
    let ahead = page.text(canvas);
    page.until(&fetched(10));
    page.value("document.getElementById('white').value = 0.5, document.getElementById('white').dispatchEvent(new Event('change'))");
    page.until("location.search.includes('white=0.5')");
    page.key("ArrowRight");
    page.until("document.getElementById('stage').dataset.frame == 8");
    assert_eq!(page.number("blits"), 1.0);
    let anew = page.text(canvas);
    for (index, look, shown) in [(7, "", &ahead), (8, "&white=0.5", &anew)] {
        page.go(&frame(index, look));
        page.until("document.getElementById('stage').dataset.ms");
        assert!(page.text(canvas) == *shown, "frame {index}");
    }
    assert_ne!(ahead, anew);
    page.is_well();
}

/// Limits and changes are found after a chart's points are drawn: whoever is at a point by then stays there.
#[test]
fn marks_leave_the_cursor_where_it_is() {
    let (service, mut page) = posted();
    page.send(
        "Page.addScriptToEvaluateOnNewDocument",
        &json!({"source": "
            const [now, found] = [fetch, new Promise((resolve) => (window.find = resolve))];
            window.fetch = async (...of) => (`${of[0]}`.includes('/marks') && (await found), now(...of));
        "}),
    );
    page.go(&service.url("/trends"));
    page.until("document.querySelector('.chart').dataset.points > 0");
    page.value("document.querySelector('.chart').focus()");
    page.key("ArrowRight");
    let tip = "document.querySelector('.tip:not([hidden])')?.innerText ?? ''";
    let told = page.text(tip);
    assert!(told.contains("report"), "{told}");
    assert_eq!(
        page.value("document.querySelector('.chart').dataset.changes"),
        Value::Null
    );
    page.value("window.find()");
    page.until("document.querySelector('.chart').dataset.changes !== undefined");
    assert_eq!(page.text(tip), told);
    page.is_well();
}

/// A picture tells a page from one that lacks a chart, has lines of other colours, or is moved a little.
#[test]
fn a_changed_page_looks_different() {
    let (service, mut page) = posted();
    open_report(&service, &mut page);
    let whole = page.picture();
    assert_eq!(difference(&whole, &page.picture()).0, 0.0, "the same page twice");
    for change in [
        "document.querySelector('.chart canvas').remove()",
        "document.querySelector('.chart canvas').style.filter = 'hue-rotate(120deg)'",
        "document.querySelector('main').style.marginTop = '12px'",
    ] {
        open_report(&service, &mut page);
        page.value(change);
        let (share, _) = difference(&whole, &page.picture());
        assert!(share > MAX_SHARE, "{change}: {share}");
    }
}
