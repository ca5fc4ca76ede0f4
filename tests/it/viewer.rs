//! The viewer of frames in a real browser: what it shows, how that came about, and what it remembers.

use crate::{
    support::{
        browser::Page,
        service::{TestService, reader},
    },
    traces::at_rest,
    web::{has, measured, plain, report_ids},
};
use afterimage::sequence::Sequence;
use serde_json::json;

/// The stage's pixels beside those of the service's own picture of an image: the largest difference of a byte.
fn largest_difference(page: &mut Page, png: &str) -> f64 {
    page.number(&format!(
        "(async () => {{
            const picture = await createImageBitmap(await (await fetch('{png}')).blob());
            const {{width, height}} = picture;
            const bytes = async (source) => {{
                const c = new OffscreenCanvas(width, height).getContext('2d');
                c.imageSmoothingEnabled = false;
                c.drawImage(source, 0, 0, source.width, source.height, 0, 0, width, height);
                return c.getImageData(0, 0, width, height).data;
            }};
            const [a, b] = [await bytes(picture), await bytes(document.getElementById('canvas'))];
            return Math.max(...a.map((byte, i) => Math.abs(byte - b[i])));
        }})()"
    ))
}

#[test]
fn the_viewer_shows_what_the_service_pictures() {
    let (service, job) = measured();
    let ids = report_ids(&job);
    let base = format!("/api/v1/reports/{}/frames/7", ids[0]);
    let mut page = Page::open();
    page.resize(800, 900, false);
    for (renderer, name) in [("2d", "2d"), ("gl", "webgl2")] {
        for image in ["output", "reference", "input", "flip", "error"] {
            let query = format!("mode=one&a={image}&renderer={renderer}");
            page.go(&service.url(&format!("/reports/{}/frames/7?{query}", ids[0])));
            page.until("document.getElementById('stage').dataset.draws > 0");
            assert_eq!(page.text("document.getElementById('stage').dataset.renderer"), name);
            // The stage becomes as large as eight times the image, so that every pixel of it can be found again.
            page.value("Object.assign(document.getElementById('stage').style, {width: '514px', height: '386px'})");
            page.until(
                "document.getElementById('canvas').width == 512 && document.getElementById('stage').dataset.zoom == 8",
            );
            let file = if image == "error" {
                "error.png?max=0.1".to_owned()
            } else {
                format!("{image}.png")
            };
            let found = largest_difference(&mut page, &format!("{base}/{file}"));
            // A half has 11 bits: next to a step of the 256, a value may fall to its other side.
            let bound = if image == "flip" || image == "error" { 4.0 } else { 1.0 };
            assert!(found <= bound, "{renderer} {image}: {found}");
            let other = largest_difference(&mut page, &format!("{}/{file}", base.replace("/7", "/2")));
            assert!(other > 2.0 * bound, "another frame looks like it: {other}");
            page.is_well();
        }
    }
}

/// What a recipe kept of its history and where its work was skipped, over HTTP and in the viewer.
#[test]
fn the_viewer_shows_how_a_frame_came_about() {
    let service = TestService::with_gpu();
    let client = service.client();
    let folder = at_rest();
    let mut archive = Vec::new();
    Sequence::open(folder.path(), &reader())
        .unwrap()
        .pack(&mut archive)
        .unwrap();
    assert_eq!(client.put("resting", &archive).status, 201);
    let job = json!({"sequence": "resting", "metrics": ["psnr"], "skip": "exact",
                     "presets": [{"preset": "ema", "parameters": {"current_weight": 0.5}}, "none"]});
    let id = client.start_job(&job);
    let ids = report_ids(&client.wait_for(id, &["done"]));
    let frames = format!("/api/v1/reports/{}/frames", ids[0]);
    let mut page = Page::open();
    page.resize(800, 900, false);
    for (renderer, image) in [
        ("2d", "history"),
        ("2d", "skipped"),
        ("gl", "history"),
        ("gl", "skipped"),
    ] {
        let query = format!("mode=one&a={image}&renderer={renderer}");
        page.go(&service.url(&format!("/reports/{}/frames/7?{query}", ids[0])));
        page.until("document.getElementById('stage').dataset.draws > 0");
        page.value("Object.assign(document.getElementById('stage').style, {width: '490px', height: '298px'})");
        page.until(
            "document.getElementById('canvas').width == 488 && document.getElementById('stage').dataset.zoom == 8",
        );
        let found = largest_difference(&mut page, &format!("{frames}/7/{image}.png"));
        assert!(found <= 4.0, "{renderer} {image}: {found}");
        // Nothing is skipped, and nothing comes of a history, in the first frame.
        let first = largest_difference(&mut page, &format!("{frames}/0/{image}.png"));
        assert!(first > 64.0, "{renderer} {image}: as in the first frame");
        page.is_well();
    }
    let viewer = plain(&service, &format!("/reports/{}/frames/7?a=history&b=skipped", ids[0]));
    has(&viewer, &["/frames/7/history.png", "/frames/7/skipped.png"]);
    // Whoever asks for what is not there is told why.
    let refused = |report: &str, path: &str, why: &str| {
        let answer = client.get(&format!("/reports/{report}/frames/{path}"));
        assert_eq!(answer.status, 404, "{path}");
        has(answer.json()["detail"].as_str().unwrap(), &[why]);
    };
    refused(&ids[0], "99/history.png", "no image of frame 99");
    refused(&ids[0], "99/skipped.exr", "no image of frame 99");
    refused(&ids[1], "7/history.png", "blends no history by a weight");
    let viewer = plain(&service, &format!("/reports/{}/frames/7", ids[1]));
    assert!(
        !viewer.contains("history.png"),
        "a recipe without a history has a share of it"
    );
}

/// Browsers take the context of a page when a driver resets or too many pages have one.
#[test]
fn the_viewer_goes_on_after_its_context_was_lost() {
    let (service, job) = measured();
    let id = report_ids(&job)[0].clone();
    let mut page = Page::open();
    page.go(&service.url(&format!("/reports/{id}/frames/3?mode=one&renderer=gl")));
    page.until("document.getElementById('stage').dataset.ms > 0");
    page.value("lost = document.getElementById('canvas').getContext('webgl2').getExtension('WEBGL_lose_context')");
    let opaque = "(() => {
        const canvas = document.getElementById('canvas');
        const c = new OffscreenCanvas(1, 1).getContext('2d');
        c.drawImage(canvas, canvas.width / 2, canvas.height / 2, 1, 1, 0, 0, 1, 1);
        return c.getImageData(0, 0, 1, 1).data[3] == 255;
    })()";
    page.until(opaque);
    page.value("lost.loseContext()");
    page.until(&format!("!{opaque}"));
    page.key("ArrowRight");
    page.until("document.getElementById('stage').dataset.frame == 4");
    page.value("setTimeout(() => lost.restoreContext())");
    page.until(opaque);
    page.key("ArrowRight");
    page.until("document.getElementById('stage').dataset.frame == 5");
    page.until(opaque);
    page.is_well();
}

#[test]
fn the_viewer_steps_compares_and_keeps_its_address() {
    let (service, job) = measured();
    let ids = report_ids(&job);
    let mut page = Page::open();
    page.go(&service.url(&format!("/reports/{}/frames/3?with={}", ids[0], ids[1])));
    page.until("document.getElementById('stage').dataset.frame == 3");
    has(
        &page.text("document.getElementById('b').selectedOptions[0].textContent"),
        &["karis2014", "output"],
    );
    page.key("ArrowRight");
    page.until("document.getElementById('stage').dataset.frame == 4 && location.pathname.endsWith('/frames/4')");

    // The worst frame comes first, then the second worst.
    let frames = service.client().get(&format!("/reports/{}/frames", ids[0])).json();
    let mut order: Vec<(f64, i64)> = frames["frames"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|frame| frame["warmup"] == false)
        .map(|frame| {
            (
                frame["metrics"]["psnr"].as_f64().unwrap(),
                frame["index"].as_i64().unwrap(),
            )
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    page.go(&service.url(&format!("/reports/{}/frames/0?with={}", ids[0], ids[1])));
    page.until("document.getElementById('stage').dataset.frame == 0");
    for (_, index) in order.iter().take(2) {
        page.click("#worst");
        page.until(&format!("document.getElementById('stage').dataset.frame == {index}"));
    }

    for (key, mode) in [
        ("1", "one"),
        ("3", "side"),
        ("4", "blink"),
        ("5", "difference"),
        ("2", "swipe"),
    ] {
        page.key(key);
        page.until(&format!("document.getElementById('stage').dataset.mode == '{mode}'"));
        if mode == "blink" {
            page.until("document.getElementById('stage').dataset.blinked == 'b'");
            page.until("document.getElementById('stage').dataset.blinked == 'a'");
        }
    }
    // Zoomed to single pixels; the pixel under the pointer is told with both values.
    for _ in 0..4 {
        page.key("+");
    }
    page.key("e");
    let middle = page.middle("#stage");
    page.send(
        "Input.dispatchMouseEvent",
        &json!({"type": "mouseMoved", "x": middle[0] + 9.0, "y": middle[1]}),
    );
    page.until("/\\(32, 24\\).*output.*0\\..*karis2014/.test(document.getElementById('pixel').textContent)");
    page.drag([middle[0] + 40.0, middle[1]], [middle[0] + 240.0, middle[1]]);
    page.until("Number(new URL(location.href).searchParams.get('x')) < 32");
    let address = page.text("location.href");
    has(&address, &["zoom=", "ev=0.5", "mode=swipe", "with="]);
    page.go(&address);
    page.until("document.getElementById('stage').dataset.draws > 0");
    assert_eq!(page.text("location.href"), address);
    assert_eq!(page.text("document.getElementById('ev').value"), "0.5");
    page.key(" ");
    page.until("document.getElementById('play').getAttribute('aria-pressed') == 'true'");
    page.until("document.getElementById('stage').dataset.frame == 11");
    // Stopped and begun again in the midst of frames: it plays on, once, a frame each 100 ms.
    let n_turns = page.number(
        "(async () => {
           const pause = (ms) => new Promise((over) => setTimeout(over, ms));
           const [play, stage] = ['play', 'stage'].map((id) => document.getElementById(id));
           for (let i = 0; i < 20; i++) { play.click(); play.click(); await pause(13); }
           let turns = 0;
           new MutationObserver(() => turns++).observe(stage, {attributeFilter: ['data-frame']});
           await pause(1500);
           return turns;
         })()",
    );
    assert!((1.0..=16.0).contains(&n_turns), "{n_turns} frames in 1.5 s");
    page.is_well();
}
