//! The dashboard in a real browser: every page has its data in the document, and the scripts have drawn what only they
//! can draw.

use crate::support::service::{Client, TestService, packed};
use serde_json::json;
use std::process::Command;

/// Debian's name for the browser, or Ubuntu's.
fn browser() -> &'static str {
    let runs = |name: &&&str| Command::new(name).arg("--version").output().is_ok();
    let found = ["chromium", "chromium-browser"].iter().find(runs);
    found.expect("this test needs a browser: install the package `chromium`")
}

/// The document after scripts ran.
fn dom(service: &TestService, path: &str) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser())
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
        ])
        .args([
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
        ])
        .args(["--window-size=1280,900", "--virtual-time-budget=5000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(service.url(path))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[track_caller]
fn has(page: &str, texts: &[&str]) {
    for text in texts {
        assert!(page.contains(text), "`{text}` is not on the page:\n{page}");
    }
}

#[test]
fn every_page_shows_its_data() {
    let service = TestService::with_gpu();
    let client = Client(service.address);
    has(&dom(&service, "/"), &["Nothing has been measured yet", "curl"]);
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let hostile = "</script><script>document.title='owned'</script>";
    for _ in 0..2 {
        let job = json!({"sequence": "pan", "presets": ["ema", {"preset": "karis2014", "parameters": {"current_weight": 0.2}}],
                         "commit": "c0ffee", "branch": "topic", "label": hostile});
        let id = client.start_job(&job);
        client.wait_for(id, &["done"]);
    }
    let job = client.get("/jobs/2").json();
    let psnr = format!("{:.2}", job["reports"][1]["values"]["psnr"].as_f64().unwrap());

    let home = dom(&service, "/");
    has(
        &home,
        &[
            "Latest reports",
            ">pan<",
            &psnr,
            "karis2014, current_weight 0.2",
            "c0ffee",
            "topic",
            "class=\"spark\"",
        ],
    );

    let trends = dom(&service, "/trends");
    has(&trends, &[&psnr, "same", "data-drawn=\"2\"", "<canvas", "u-legend"]);
    has(&dom(&service, "/trends?sequence=pan"), &["data-drawn=\"2\""]);
    has(
        &dom(&service, "/trends?metric=ssim&branch=nowhere"),
        &["No report has this metric"],
    );

    let page = dom(&service, "/jobs/2");
    has(
        &page,
        &[
            &psnr,
            "Frame by frame",
            "data-drawn=\"2\"",
            "<canvas",
            "Stages of the whole job",
            "EXR",
        ],
    );
    has(
        &page,
        &[
            "/frames/11/output.png",
            "/frames/11/reference.png",
            "/frames/11/error.png?max=0.1",
            "frame 11 of 11",
        ],
    );
    assert!(!page.contains("<title>owned"), "a label was run as a script");

    let hash = job["sequence_hash"].as_str().unwrap();
    has(
        &dom(&service, &format!("/sequences/{hash}")),
        &["What its engine wrote", "64×48", "reference.png", &psnr],
    );
    has(&dom(&service, "/jobs"), &["#1", "#2", "done"]);
    has(&dom(&service, "/nowhere"), &["Not here", "/nowhere"]);
}

#[test]
fn nothing_comes_from_elsewhere() {
    let service = TestService::with_gpu();
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
