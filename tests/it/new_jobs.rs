//! The forms of benchmarks and matrices in a real browser: what they send is what the API takes, and jobs come back into them.

use crate::support::{
    browser::Page,
    service::{Idle, TestService, packed},
};
use serde_json::{Value, json};

/// The request that stands below the form, without what `curl` needs around it.
fn shown(page: &mut Page) -> Value {
    let curl = page.text("document.getElementById('curl').textContent");
    let body = curl.split_once("-d '").unwrap().1.strip_suffix('\'').unwrap();
    serde_json::from_str(body).unwrap()
}

/// Writes into a control, as a keyboard would.
fn write(page: &mut Page, selector: &str, value: &str) {
    page.value(&format!(
        "{{ const input = document.querySelector({selector:?}); input.value = {value:?};
           input.dispatchEvent(new Event('input', {{bubbles: true}})); }}"
    ));
}

fn tick(page: &mut Page, selector: &str) {
    page.value(&format!("document.querySelector({selector:?}).click()"));
}

/// Starts the job of the form, and opens the form that runs it again.
fn start_and_return(page: &mut Page, service: &TestService, id: i64) {
    page.click("button.main");
    page.until(&format!("location.pathname == '/jobs/{id}'"));
    page.go(&service.url(&format!("/jobs/new?from={id}")));
}

#[test]
fn a_benchmark_is_made_and_made_again() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let hash = client.put("pan", &packed("pan")).json()["hash"].clone();
    let mut page = Page::open();
    page.go(&service.url("/jobs/new?kind=bench&sequence=pan"));
    page.click("button.main");
    page.until("document.getElementById('trouble').innerText.includes('bench.presets: name at least one')");
    for preset in ["ema", "inside"] {
        tick(&mut page, &format!("[data-preset={preset}] [data-tick=preset]"));
    }
    tick(&mut page, "[data-knob=history] input[value='\"f32\"']");
    tick(&mut page, "[data-knob=history] input[value='\"f16\"']");
    tick(&mut page, "[data-knob=reproject] input[value='false']");
    write(&mut page, "[data-knob=current_weight] input", "0.05, .1,0.2");
    write(&mut page, "[name='bench.n_timed']", "30");
    assert_eq!(page.text("document.getElementById('count').textContent"), "12");
    let wanted = json!({"sequence": hash, "bench": {
        "presets": [{"preset": "ema"}, {"preset": "inside"}], "metrics": ["psnr"], "metric": "psnr", "n_timed": 30,
        "knobs": {"history": ["f16", "f32"], "current_weight": [0.05, 0.1, 0.2], "reproject": [false]}}});
    assert_eq!(shown(&mut page), wanted);
    // What is wrong is said by its place.
    write(&mut page, "[name='bench.metric']", "ssim");
    page.click("button.main");
    page.until("document.getElementById('trouble').innerText.includes('`ssim` is not among the metrics')");
    write(&mut page, "[name='bench.metric']", "psnr");
    start_and_return(&mut page, &service, 1);
    assert_eq!(
        client.get("/jobs/1").json()["spec"]["bench"]["knobs"],
        wanted["bench"]["knobs"]
    );
    assert_eq!(shown(&mut page), wanted);
    page.is_well();
}

#[test]
fn a_matrix_is_made_and_made_again() {
    let service = TestService::start(Idle, &[]);
    let mut page = Page::open();
    page.go(&service.url("/jobs/new?kind=stress"));
    assert_eq!(shown(&mut page), json!({"stress": {"quick": true}}));
    tick(&mut page, "[data-preset=ema] [data-tick=preset]");
    page.value("document.querySelector('[data-preset=ema] details').open = true");
    page.until("document.querySelector('[data-preset=ema] input[name=current_weight]')");
    write(&mut page, "[data-preset=ema] input[name=current_weight]", "0.5");
    for hazard in ["motion", "motion.nan", "texel.nan"] {
        tick(&mut page, &format!("#hazards input[value='{hazard}']"));
    }
    tick(&mut page, "[name='stress.precisions'][value=f16]");
    tick(&mut page, "[name='stress.guards'][value=off]");
    write(&mut page, "[name='stress.size.0']", "64");
    write(&mut page, "[name='stress.size.1']", "0");
    write(&mut page, "[name=branch]", "topic");
    // All of a family and one of another; two ways to guard.
    let family = page.number("Number(document.querySelector(\"#hazards input[value=motion]\").dataset.n)");
    assert_eq!(
        page.number("Number(document.getElementById('count').textContent)"),
        2.0 * (family + 1.0)
    );
    page.value("document.getElementById('job').noValidate = true");
    page.click("button.main");
    page.until("/size.*must be 1 to 16384/.test(document.getElementById('trouble').innerText)");
    write(&mut page, "[name='stress.size.1']", "48");
    let wanted = json!({"branch": "topic", "stress": {
        "presets": [{"preset": "ema", "parameters": {"current_weight": 0.5}}], "quick": true, "precisions": ["f32"],
        "guards": ["on", "off"], "hazards": shown(&mut page)["stress"]["hazards"], "size": [64, 48]}});
    assert_eq!(shown(&mut page), wanted);
    start_and_return(&mut page, &service, 1);
    page.until("document.querySelector('[data-preset=ema] input[name=current_weight]')");
    assert_eq!(shown(&mut page), wanted);
    page.is_well();
}

/// Every kind has its form, and the pages of results lead to theirs.
#[test]
fn forms_are_found() {
    let service = TestService::start(Idle, &[]);
    let mut page = Page::open();
    for (from, kind) in [
        ("/bench", "bench"),
        ("/stress", "stress"),
        ("/jobs", "bench"),
        ("/jobs", "stress"),
    ] {
        page.go(&service.url(from));
        page.click(&format!("a.button[href='/jobs/new?kind={kind}']"));
        page.until(&format!(
            "location.search == '?kind={kind}' && document.getElementById('count')"
        ));
        page.resize(360, 740, false);
        let width = page.number("document.documentElement.scrollWidth");
        assert!(width <= 360.0, "{kind} is {width} pixels wide");
        page.is_well();
    }
    page.click("nav.kinds a[href='/jobs/new?kind=comparison']");
    page.until("document.querySelector('textarea')?.value.includes('outputs')");
    page.until("document.body.innerText.includes('PUT /blobs')");
}
