//! `afterimage ci` and `afterimage regressions`, as a CI calls them.

use crate::support::service::{Idle, TestService};
use serde_json::{Value, json};
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

fn afterimage(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_afterimage"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A rules file in `folder`.
fn rules(folder: &Path, content: &str) -> String {
    let path = folder.join("afterimage.toml");
    fs::write(&path, content).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn a_run_without_a_service_is_judged_by_limits_and_an_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let run = |rules: &str, more: &[&str]| {
        let fixed = [
            "ci",
            "run",
            "fixtures/pan",
            "--preset",
            "ema",
            "--frames",
            "4",
            "--rules",
            rules,
        ];
        afterimage(&[&fixed, more].concat())
    };
    let baseline_rules = rules(folder.path(), "[[rule]]\nmetric = 'psnr'\nbaseline = 0.01");
    let first = run(&baseline_rules, &["--json", &path("first.json")]);
    assert_eq!(
        first.status.code(),
        Some(2),
        "nothing is approved: {}",
        text(&first.stdout)
    );
    assert!(
        text(&first.stdout).contains("could not tell"),
        "{}",
        text(&first.stdout)
    );
    assert_eq!(run(&baseline_rules, &["--allow-unknown"]).status.code(), Some(0));
    let again = run(&baseline_rules, &["--baseline", &path("first.json"), "--runs", "2"]);
    assert_eq!(
        again.status.code(),
        Some(0),
        "{}{}",
        text(&again.stdout),
        text(&again.stderr)
    );
    // What was approved was better.
    let mut better: Value = serde_json::from_str(&fs::read_to_string(path("first.json")).unwrap()).unwrap();
    let psnr = &mut better["reports"][0]["values"]["psnr"];
    *psnr = json!(psnr.as_f64().unwrap() + 1.0);
    fs::write(path("better.json"), better.to_string()).unwrap();
    let (approved, junit, summary) = (path("better.json"), path("junit.xml"), path("summary.md"));
    let worse = run(
        &baseline_rules,
        &["--baseline", &approved, "--junit", &junit, "--markdown", &summary],
    );
    assert_eq!(
        worse.status.code(),
        Some(1),
        "{}{}",
        text(&worse.stdout),
        text(&worse.stderr)
    );
    let junit = fs::read_to_string(path("junit.xml")).unwrap();
    assert!(
        junit.contains("classname=\"pan.ema\" name=\"psnr baseline\"") && junit.contains("<failure"),
        "{junit}"
    );
    assert!(
        fs::read_to_string(path("summary.md"))
            .unwrap()
            .contains("| pan | ema | psnr | regression |")
    );

    let mut other: Value = serde_json::from_str(&fs::read_to_string(path("first.json")).unwrap()).unwrap();
    other["reports"][0]["adapter"]["driver_version"] = json!("another");
    fs::write(path("other.json"), other.to_string()).unwrap();
    let elsewhere = run(&baseline_rules, &["--baseline", &path("other.json")]);
    assert_eq!(elsewhere.status.code(), Some(2));
    assert!(
        text(&elsewhere.stdout).contains("environment differs"),
        "{}",
        text(&elsewhere.stdout)
    );

    let limits = rules(
        folder.path(),
        "[[rule]]\nmetric = 'psnr'\nmin = 5\n[[rule]]\nmetric = 'psnr'\nsequence = 'p*'\nmin = 90",
    );
    let bad = run(&limits, &[]);
    assert_eq!(bad.status.code(), Some(1));
    assert!(
        text(&bad.stdout).contains("below the least allowed, 90"),
        "{}",
        text(&bad.stdout)
    );
    let broken = rules(folder.path(), "[[rule]]\nmetric = 'psnr'\nmim = 5");
    let refused = run(&broken, &[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("mim"), "{}", text(&refused.stderr));
}

#[test]
fn a_run_on_a_service_is_judged_by_its_history() {
    let service = TestService::with_gpu();
    let folder = tempfile::tempdir().unwrap();
    let rules = rules(
        folder.path(),
        "[[rule]]\nmetric = 'psnr'\nbaseline = 0.01\n[[rule]]\nmetric = 'ssim'\nmin = 0.01",
    );
    let summary = folder.path().join("summary.md");
    let url = service.url("");
    let run = |commit: &str, set: &str| {
        afterimage(&[
            "ci",
            "run",
            "fixtures/pan",
            "--preset",
            "ema",
            "--frames",
            "4",
            "--set",
            set,
            "--rules",
            &rules,
            "--server",
            &url,
            "--branch",
            "main",
            "--commit",
            commit,
            "--runs",
            "2",
            "--markdown",
            summary.to_str().unwrap(),
        ])
    };
    let first = run("c1", "current_weight=0.1");
    assert_eq!(
        first.status.code(),
        Some(2),
        "{}{}",
        text(&first.stdout),
        text(&first.stderr)
    );
    let approve = afterimage(&[
        "ci", "approve", "--server", &url, "--report", "1", "--why", "first", "--who", "jane",
    ]);
    assert!(approve.status.success(), "{}", text(&approve.stderr));
    assert_eq!(run("c2", "current_weight=0.1").status.code(), Some(0));
    assert_eq!(
        service.client().get("/reports").json()["reports"]
            .as_array()
            .unwrap()
            .len(),
        4,
        "two runs each"
    );
    // Other parameters are another line, which has no baseline: not a failure, and not an approval.
    assert_eq!(run("c3", "current_weight=0.9").status.code(), Some(2));
    let summary = fs::read_to_string(summary).unwrap();
    assert!(
        summary.contains("could not tell") && summary.contains(&format!("]({url}/jobs/")),
        "{summary}"
    );
}

#[test]
fn posted_results_are_judged_and_what_is_open_is_listed() {
    let service = TestService::start(Idle, &[]);
    let folder = tempfile::tempdir().unwrap();
    let rules = rules(folder.path(), "[[rule]]\nmetric = 'psnr'\nmin = 30");
    let url = service.url("");
    for (commit, value) in [("good", 31.0), ("bad", 20.0)] {
        let report = json!({"sequence": "ship", "system": "engine", "branch": "main", "commit": commit, "values": {"psnr": value}});
        service.client().posted("/reports", &report);
    }
    let judge = |id: &str| afterimage(&["ci", "judge", "--server", &url, "--report", id, "--rules", &rules]);
    let list = |more: &[&str]| afterimage(&[&["regressions", url.as_str()], more].concat());
    assert_eq!(judge("1").status.code(), Some(0));
    assert_eq!(list(&[]).status.code(), Some(0));
    let bad = judge("2");
    assert_eq!(bad.status.code(), Some(1));
    assert!(text(&bad.stdout).contains("good..bad"), "{}", text(&bad.stdout));
    let open = list(&["--since", "bad", "--json"]);
    assert_eq!(open.status.code(), Some(1));
    let alerts: Value = serde_json::from_slice(&open.stdout).unwrap();
    assert_eq!(alerts[0]["finding"]["last_good_commit"], "good");
    let table = list(&["--branch", "main"]);
    assert!(text(&table.stdout).contains("ship"), "{}", text(&table.stdout));
    assert_eq!(list(&["--since", "nowhere"]).status.code(), Some(2));
    assert_eq!(judge("99").status.code(), Some(2));
}

#[test]
fn a_service_that_is_not_there_is_tried_again_and_named() {
    let start = std::time::Instant::now();
    let output = afterimage(&["regressions", "http://127.0.0.1:1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("is the service running"),
        "{}",
        text(&output.stderr)
    );
    assert!(start.elapsed().as_secs() >= 5, "it was not tried again");
}
