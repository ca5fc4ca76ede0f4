//! What a job may be asked beside its presets: to be answered from the store, and to validate its adapter.

use crate::support::service::{TestService, packed};
use serde_json::json;
use std::fs;

#[test]
fn what_was_asked_before_is_answered_from_the_store() {
    let service = TestService::with_gpu();
    let client = service.client();
    client.put("pan", &packed("pan"));
    let job =
        json!({"sequence": "pan", "presets": ["none"], "metrics": ["psnr"], "images": "none", "commit": "c0ffee"});
    let id = client.start_job(&job);
    // While it is not done there is nothing to answer with.
    let first = client.wait_for(id, &["done"]);
    assert!(first.get("answered_from_store").is_none());
    let again = client.post_job(&job);
    assert_eq!(again.status, 200, "{}", again.text());
    assert_eq!(again.header("location"), format!("/api/v1/jobs/{id}"));
    let again = again.json();
    assert_eq!(
        (&again["id"], &again["answered_from_store"]),
        (&json!(id), &json!(true))
    );
    assert_eq!(again["reports"], first["reports"]);
    // Whatever results follow from, if it differs: run.
    for (field, value) in [
        ("force", json!(true)),
        ("presets", json!(["ema"])),
        ("metrics", json!(["ssim"])),
        ("history", json!("f32")),
        ("frames", json!(4)),
        ("skip", json!("exact")),
        ("commit", json!("decaf")),
    ] {
        let mut other = job.clone();
        other[field] = value;
        let answer = client.post_job(&other);
        assert_eq!(answer.status, 202, "{field}: {}", answer.text());
        client.wait_for(answer.json()["id"].as_i64().unwrap(), &["done"]);
    }
    // Another content under the same name is another sequence.
    client.put("pan", &packed("static"));
    assert_eq!(client.post_job(&job).status, 202);
}

#[test]
fn a_job_can_validate_its_adapter() {
    let service = TestService::with_gpu();
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let job = json!({"sequence": "pan", "presets": ["inside"], "frames": 3, "history": "f32", "validate": true});
    let id = client.start_job(&job);
    client.wait_for(id, &["done"]);
    let job = client.get(&format!("/jobs/{id}")).json();
    assert_eq!((&job["n_done"], &job["spec"]["validate"]), (&json!(6), &json!("yes")));
    let found = &job["reports"][0]["validation"];
    assert_eq!(found["agrees"], true, "{found}");
    assert_eq!(found["passes"][1]["name"], "resolve");
    assert!(found.get("frames").is_none(), "the list of a job stays short");
    let report = job["reports"][0]["id"].as_i64().unwrap();
    let full = client.get(&format!("/reports/{report}/validation")).json();
    assert_eq!(full["frames"].as_array().unwrap().len(), 3);
    assert_eq!(full["frames"][2]["passes"][1]["pass"], "resolve");
    assert_eq!(full["passes"], found["passes"]);
    let page = ureq::get(service.url(&format!("/jobs/{id}")))
        .call()
        .unwrap()
        .body_mut()
        .read_to_string();
    let page = page.unwrap();
    assert!(page.contains("Validation") && page.contains("agrees"), "{page}");

    let plain = client.start_job(&json!({"sequence": "pan", "presets": ["none"], "frames": 1}));
    client.wait_for(plain, &["done"]);
    let report = client.get(&format!("/jobs/{plain}")).json()["reports"][0].clone();
    assert!(report["validation"].is_null());
    let absent = client.get(&format!("/reports/{}/validation", report["id"]));
    assert_eq!(absent.status, 404);
    assert!(absent.text().contains("was not validated"), "{}", absent.text());
}

/// Nice values of this process' threads whose names begin so.
fn nice_values(name: &str) -> Vec<i32> {
    let threads = fs::read_dir("/proc/self/task")
        .unwrap()
        .map(|thread| thread.unwrap().path());
    let stats = threads.filter_map(|thread| fs::read_to_string(thread.join("stat")).ok());
    let nice = |stat: String| {
        let (head, tail) = stat.rsplit_once(')')?;
        let is_one = head.split_once('(')?.1.starts_with(name);
        is_one.then(|| tail.split_whitespace().nth(16)?.parse().ok()).flatten()
    };
    stats.filter_map(nice).collect()
}

#[test]
fn jobs_give_way_to_requests() {
    let service = TestService::with_gpu();
    let client = service.client();
    client.put("pan", &packed("pan"));
    let id = client.start_job(&json!({"sequence": "pan", "presets": ["ema"]}));
    client.wait_for(id, &["done"]);
    let expected = (nice_values("tokio").into_iter().max().unwrap() + 5).min(19);
    let jobs = nice_values("worker");
    assert!(
        !jobs.is_empty() && jobs.iter().all(|&nice| nice == expected),
        "{jobs:?}, not {expected}"
    );
    // Another test's device may be in this process, too.
    let device = nice_values("llvmpipe");
    assert!(
        device.is_empty() || device.contains(&expected),
        "{device:?}, not {expected}"
    );
}
