//! The dashboard in a real browser: every page has its data in the document, and scripts do what only they can do.

use crate::support::{
    browser::Page,
    service::{Client, Idle, Scripted, TestService, endless, packed},
};
use serde_json::{Value, json};

/// A page as whoever has no scripts reads it.
pub fn plain(service: &TestService, path: &str) -> String {
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let mut answer = agent.get(service.url(path)).call().unwrap();
    answer.body_mut().read_to_string().unwrap()
}

#[track_caller]
pub fn has(page: &str, texts: &[&str]) {
    for text in texts {
        assert!(page.contains(text), "`{text}` is not on the page:\n{page}");
    }
}

/// A service with one job over the sequence `pan`, twice done.
pub fn measured() -> (TestService, Value) {
    let service = TestService::with_gpu();
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let job = json!({"sequence": "pan", "presets": ["ema", {"preset": "karis2014", "parameters": {"current_weight": 0.2}}],
                     "metrics": ["psnr", "ssim", "flip"], "commit": "c0ffee", "branch": "topic",
                     "label": "</script><script>document.title='owned'</script>"});
    for _ in 0..2 {
        let id = client.start_job(&job);
        client.wait_for(id, &["done"]);
    }
    let job = client.get("/jobs/2").json();
    (service, job)
}

pub fn report_ids(job: &Value) -> Vec<String> {
    let reports = job["reports"].as_array().unwrap().iter();
    reports.map(|report| report["id"].to_string()).collect()
}

/// Posts a night: a value a metric, on `main`.
fn night(client: &Client, sequence: &str, system: &str, commit: usize, psnr: f64) -> i64 {
    let body = json!({"sequence": sequence, "system": system, "branch": "main", "commit": format!("{commit:08x}"),
                      "environment": {"adapter": {"name": "Test GPU"}}, "values": {"psnr": psnr}});
    client.posted("/reports", &body)["id"].as_i64().unwrap()
}

#[test]
fn every_page_shows_its_data_without_scripts() {
    let empty = TestService::start(Idle, &[]);
    has(&plain(&empty, "/"), &["Nothing has been measured yet", "curl"]);
    has(&plain(&empty, "/sequences"), &["There is no sequence yet"]);
    let (service, job) = measured();
    let psnr = format!("{:.2}", job["reports"][1]["values"]["psnr"].as_f64().unwrap());
    let report = &job["reports"][1]["id"];
    let hash = job["sequence_hash"].as_str().unwrap();
    let name = "karis2014, current_weight 0.2";
    has(
        &plain(&service, "/"),
        &[
            "Overview",
            ">pan<",
            &psnr,
            name,
            "class=\"spark\"",
            "Recent jobs",
            "No open alert",
        ],
    );
    has(
        &plain(&service, "/trends"),
        &[&psnr, "same", "<noscript><img", "c0ffee", "topic"],
    );
    has(
        &plain(&service, "/trends?metric=ssim&branch=nowhere"),
        &["No report has this metric"],
    );
    let page = plain(&service, "/jobs/2");
    has(
        &page,
        &[
            &psnr,
            "Frame by frame",
            "Stages of the whole job",
            "Run again",
            "/frames/11\"",
        ],
    );
    assert!(!page.contains("<script>document.title"), "a label became a script");
    has(
        &plain(&service, &format!("/reports/{report}")),
        &[&psnr, "Worst frames", "output.png?width=160", "warm-up"],
    );
    let viewer = plain(&service, &format!("/reports/{report}/frames/7?map=flip"));
    has(
        &viewer,
        &[
            "/frames/7/output.png",
            "/frames/7/input.png",
            "/frames/7/reference.png",
            "/frames/7/flip.png",
            "Next frame",
        ],
    );
    has(
        &plain(&service, &format!("/sequences/{hash}")),
        &["What its engine wrote", "64×48", "reference.png", &psnr],
    );
    has(
        &plain(&service, "/sequences"),
        &[">pan<", "reference.png?width=320", "12 frames"],
    );
    has(&plain(&service, "/jobs"), &["#1", "#2", "done", "/jobs/new?from=2"]);
    has(
        &plain(&service, "/jobs/new?from=2"),
        &["&quot;karis2014&quot;", "curl", "c0ffee"],
    );
    has(&plain(&service, "/nowhere"), &["Not here", "/nowhere"]);
    has(
        &plain(&service, &format!("/reports/{report}/frames/99")),
        &["there is no frame 99"],
    );
}

#[test]
fn nothing_comes_from_elsewhere() {
    let service = TestService::start(Idle, &[]);
    let mut response = ureq::get(service.url("/trends")).call().unwrap();
    let policy = response.headers()["content-security-policy"]
        .to_str()
        .unwrap()
        .to_owned();
    assert!(
        policy.starts_with("default-src 'none'") && !policy.contains("unsafe"),
        "{policy}"
    );
    let page = response.body_mut().read_to_string().unwrap();
    let addresses = page
        .split(['"', '\''])
        .filter(|text| text.starts_with("http") || text.starts_with("//"));
    assert_eq!(addresses.collect::<Vec<_>>(), Vec::<&str>::new());
    for asset in page.split('"').filter(|text| text.starts_with("/assets/")) {
        let answer = ureq::get(service.url(asset)).call().unwrap();
        assert!(
            answer.headers()["cache-control"]
                .to_str()
                .unwrap()
                .contains("immutable"),
            "{asset}"
        );
    }
}

#[test]
fn the_overview_says_what_got_worse_since_when() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for commit in 0..12 {
        night(
            &client,
            "ship",
            "inside",
            commit,
            if commit < 8 { 31.0 } else { 30.0 } + 0.01 * (commit % 3) as f64,
        );
        night(&client, "bistro", "inside", commit, 33.0);
    }
    let mut page = Page::open();
    page.go(&service.url("/"));
    assert_eq!(page.number("document.querySelectorAll('#regressed').length"), 0.0);
    assert_eq!(page.number("document.querySelectorAll('.cell').length"), 2.0);
    assert_eq!(
        page.number("[...document.querySelectorAll('.mark')].filter(e => e.textContent == 'no rule').length"),
        2.0
    );
    let rules = json!({"rule": [{"metric": "psnr", "change": {"min_effect": 0.5, "min_segment": 3}}]});
    let judged = client.posted("/verdicts", &json!({"reports": [23, 24], "rules": rules}));
    assert_eq!(judged["outcome"], "regression", "{judged}");
    page.go(&service.url("/"));
    let row = page.text("document.querySelector('#regressed tbody').innerText");
    has(&row, &["ship", "inside", "changed", "00000008", "00000007"]);
    assert!(!row.contains("bistro"), "{row}");
    let grid = page.text("document.querySelector('#grid').innerText");
    has(&grid, &["✗ changed", "✓ holds"]);
    page.click("#regressed a[href*='/trends']");
    page.until("document.querySelector('.chart')?.dataset.changes == 1");
    page.is_well();
}

#[test]
fn trends_zoom_filter_and_open_reports() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for commit in 0..40 {
        night(&client, "ship", "ours", commit, if commit < 20 { 30.0 } else { 32.0 });
        night(&client, "ship", "theirs", commit, 31.0);
    }
    client.posted(
        "/reports/1/decisions",
        &json!({"decision": "approved", "who": "me", "why": "good"}),
    );
    let mut page = Page::open();
    page.go(&service.url("/trends"));
    page.until("document.querySelector('.chart').dataset.points == 80");
    page.until(
        "document.querySelector('.chart').dataset.changes == 1 && document.querySelector('.chart').dataset.levels == 1",
    );
    assert_eq!(page.text("document.querySelector('.chart').dataset.drawn"), "2");

    // Zoomed by dragging; the range is in the address and survives a reload.
    let [x, y] = page.middle(".chart .u-over");
    let width = page.number("document.querySelector('.u-over').clientWidth");
    page.drag([x - 0.2 * width, y], [x + 0.2 * width, y]);
    page.until("location.search.includes('from=') && document.querySelector('.chart').dataset.points < 60");
    let zoomed = page.text("document.querySelector('.chart').dataset.points");
    let address = page.text("location.href");
    page.go(&address);
    page.until("document.querySelector('.chart').dataset.points > 0");
    assert_eq!(page.text("document.querySelector('.chart').dataset.points"), zoomed);
    page.click("#range button");
    page.until("document.querySelector('.chart').dataset.points == 80 && !location.search.includes('from=')");

    // Hovered and clicked by keys.
    page.value("document.querySelector('.chart').focus()");
    page.key("ArrowRight");
    page.until("document.querySelector('.tip')?.innerText.includes('00000000')");
    page.click("details.rows summary");
    page.until("document.querySelectorAll('details.rows tbody tr').length == 80");

    page.click("form.difference button");
    page.until("document.querySelector('.chart.minus').dataset.drawn == 1");
    assert!(page.text("location.search").contains("minus.psnr=0-1"));

    // Filtered by a tick.
    page.click("details.pick:nth-of-type(3) summary");
    page.click("input[name=recipe][value=theirs]");
    page.click("form.filters > button");
    page.until("location.search.includes('recipe=theirs') && document.querySelector('.chart')?.dataset.points == 40");
    page.value("document.querySelector('.chart').focus()");
    page.key("ArrowRight");
    page.key("Enter");
    page.until("location.pathname == '/reports/2'");
    page.is_well();
}

#[test]
fn a_report_has_a_chart_a_metric_and_its_worst_frames_first() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let frames: Vec<Value> = (0..30)
        .map(|i| {
            let psnr = if i == 17 { 20.0 } else { 30.0 + f64::from(i) / 10.0 };
            json!({"index": i, "warmup": i < 4, "reset": i == 0 || i == 15, "metrics": {"psnr": psnr, "my-metric": 1},
                   "times_ms": {"prepare": 0.1, "resolve": 0.4}})
        })
        .collect();
    let body = json!({"sequence": "ship", "system": "ours", "frames": frames, "commit": "aa"});
    let first = client.posted("/reports", &body)["id"].clone();
    let second = client.posted("/reports", &body)["id"].clone();
    let mut page = Page::open();
    page.go(&service.url(&format!("/reports/{second}?with={first}")));
    page.until("document.body.dataset.charts == 3");
    assert_eq!(page.text("document.getElementById('chart-psnr').dataset.drawn"), "2");
    assert_eq!(page.text("document.getElementById('chart-times').dataset.drawn"), "2");
    has(
        &page.text("document.querySelector('ol.worst li').innerText"),
        &["frame 17", "20.00"],
    );
    // One cursor for all.
    let [x, y] = page.middle("#chart-psnr .u-over");
    let moved = json!({"type": "mouseMoved", "x": x, "y": y});
    page.send("Input.dispatchMouseEvent", &moved);
    page.until("document.querySelector('#chart-times .tip').innerText.includes('all 0.500 ms')");
    page.is_well();
}

#[test]
fn a_job_is_made_watched_and_made_again() {
    let service = TestService::with_gpu();
    let client = service.client();
    client.put("pan", &packed("pan"));
    let mut page = Page::open();
    page.go(&service.url("/jobs/new"));
    page.click("button.main");
    page.until("document.getElementById('trouble').innerText.includes('presets')");
    page.click("[data-preset=ema] input[data-tick=preset]");
    page.click("[data-preset=ema] summary");
    page.until("document.querySelector('[data-preset=ema] input[name=current_weight]')");
    page.value(
        "{ const input = document.querySelector('[data-preset=ema] input[name=current_weight]'); input.value = '0.25';
           input.dispatchEvent(new Event('input', {bubbles: true})); }",
    );
    let curl = page.text("document.getElementById('curl').textContent");
    has(
        &curl,
        &["\"current_weight\": 0.25", "/api/v1/jobs", &service.address.to_string()],
    );
    page.click("button.main");
    page.until("location.pathname == '/jobs/1'");
    page.until("document.querySelector('.status.done')");
    let spec = client.get("/jobs/1").json()["spec"]["presets"].clone();
    assert_eq!(spec, json!([{"preset": "ema", "parameters": {"current_weight": 0.25}}]));
    page.until("document.querySelector('.chart')?.dataset.drawn == 1");

    page.go(&service.url("/jobs/new?from=1"));
    page.until("document.querySelector('[data-preset=ema] input[name=current_weight]')?.value == '0.25'");
    page.value("{ document.querySelector('[name=repeat]').value = 100; document.querySelector('[name=validate]').checked = true; }");
    page.click("button.main");
    page.until("location.pathname == '/jobs/2'");
    page.until("document.querySelector('.status.done')");
    let again = client.get("/jobs/2").json()["spec"].clone();
    assert_eq!((&again["repeat"], &again["presets"]), (&json!(100), &spec));
    page.is_well();
}

#[test]
fn a_job_moves_on_the_list_and_is_cancelled_there() {
    let service = TestService::start(Scripted(endless), &[]);
    let client = service.client();
    client.put("pan", &packed("pan"));
    let id = client.start_job(&json!({"sequence": "pan", "presets": ["ema"]}));
    let mut page = Page::open();
    page.go(&service.url(&format!("/jobs/{id}")));
    page.until("document.getElementById('progress')?.value > 0");
    page.go(&service.url("/jobs"));
    let row = |selector| format!("[data-job=\"{id}\"] {selector}");
    page.until(&format!("document.querySelector('{}')?.value > 1", row("progress")));
    page.click(&row("button"));
    page.until(&format!("document.querySelector('{}')", row(".status.cancelled")));
    page.is_well();
}

#[test]
fn pages_fit_narrow_screens_and_both_schemes() {
    let (service, job) = measured();
    let (report, hash) = (&job["reports"][0]["id"], job["sequence_hash"].as_str().unwrap());
    let paths = [
        "/".to_owned(),
        "/trends".to_owned(),
        "/sequences".to_owned(),
        format!("/sequences/{hash}"),
        "/jobs".to_owned(),
        "/jobs/2".to_owned(),
        "/jobs/new?from=2".to_owned(),
        format!("/reports/{report}"),
        format!("/reports/{report}/frames/5"),
        "/alerts".to_owned(),
        "/stress".to_owned(),
    ];
    let mut page = Page::open();
    for path in &paths {
        let mut grounds = Vec::new();
        for dark in [false, true] {
            page.resize(360, 740, dark);
            page.go(&service.url(path));
            let width = page.number("document.documentElement.scrollWidth");
            assert!(width <= 360.0, "{path} is {width} pixels wide");
            // What scrolls is reached by keys: itself, or something in it.
            let unreached = page.number(
                "[...document.querySelectorAll('main *')].filter(e => e.scrollWidth > e.clientWidth + 1 && e.tabIndex < 0
                   && ['auto', 'scroll'].includes(getComputedStyle(e).overflowX)
                   && !e.querySelector('a[href], button, input, select, summary, [tabindex]')).length",
            );
            assert_eq!(unreached, 0.0, "{path} has what scrolls and cannot be reached");
            grounds.push(page.text("getComputedStyle(document.body).backgroundColor"));
        }
        assert_ne!(grounds[0], grounds[1], "{path} has one scheme");
        page.is_well();
    }
    // Chosen against the system, and kept; a view that is saved leads back.
    page.go(&service.url("/trends?metric=ssim"));
    page.value(
        "{ const s = document.getElementById('theme'); s.value = 'light'; s.dispatchEvent(new Event('change')); }",
    );
    page.click("#views summary");
    page.value("document.querySelector('#views input').value = 'my view'");
    page.click("#views form button");
    page.until("document.querySelector('#views li a')");
    page.go(&service.url("/jobs"));
    assert_eq!(
        page.text("getComputedStyle(document.body).backgroundColor"),
        "rgb(251, 251, 250)"
    );
    page.click("#views summary");
    page.until("document.querySelector('#views li a').offsetParent");
    // A menu is told late that it has opened; what is pressed by then must still be there when it is let go.
    let link = page.middle("#views li a");
    page.mouse("mousePressed", link);
    page.value("document.getElementById('views').dispatchEvent(new Event('toggle'))");
    page.mouse("mouseReleased", link);
    page.until("location.search == '?metric=ssim'");
}

#[test]
fn pictures_can_be_embedded() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for (commit, psnr) in [(1, 30.5), (2, 31.25)] {
        night(&client, "ship", "ours", commit, psnr);
    }
    let answer = ureq::get(service.url("/badge.svg?metric=psnr&sequence=ship"))
        .call()
        .unwrap();
    assert_eq!(answer.headers()["content-type"], "image/svg+xml");
    has(
        &plain(&service, "/badge.svg?metric=psnr&sequence=ship"),
        &["<svg", "31.25 dB", "ship · ours psnr"],
    );
    let rules = json!({"rule": [{"metric": "psnr", "baseline": 0.1}]});
    client.posted("/verdicts", &json!({"reports": [2], "rules": rules}));
    // Nothing is approved, so that nothing could be told.
    has(
        &plain(&service, "/badge.svg?metric=psnr&sequence=ship"),
        &["? 31.25 dB"],
    );
    client.posted(
        "/reports/2/decisions",
        &json!({"decision": "approved", "why": "seen", "who": "me"}),
    );
    client.posted("/verdicts", &json!({"reports": [2], "rules": rules}));
    has(
        &plain(&service, "/badge.svg?metric=psnr&sequence=ship"),
        &["✓ 31.25 dB"],
    );
    has(
        &plain(&service, "/badge.svg?metric=psnr&sequence=nowhere"),
        &["no data"],
    );
    let chart = plain(&service, "/chart.svg?metric=psnr");
    has(&chart, &["<path d=\"M62.0", "ours", "31.25"]);
    // The newest is the best, so its end of the line is the higher one.
    let ends: Vec<f64> = chart
        .split("d=\"M")
        .nth(1)
        .unwrap()
        .split('"')
        .next()
        .unwrap()
        .split([' ', 'L'])
        .map(|n| n.parse().unwrap())
        .collect();
    assert!(ends[3] < ends[1], "{ends:?}");
}
