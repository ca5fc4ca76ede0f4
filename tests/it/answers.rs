//! Answers that the service keeps: given again, and never after they stopped being true.

use crate::{
    posting::report,
    store,
    store_lines::external,
    support::service::{Idle, TestService, packed},
};
use afterimage::store::{NewJob, Store, Timestamp};
use serde_json::json;
use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering::Relaxed},
    thread,
};

/// Writes behind the service's back, which no client can do: what it still says is what it kept.
fn behind(data: &Path, write: impl AsyncFnOnce(&Store)) {
    let work = async {
        let store = Store::open(&data.join("afterimage.sqlite")).await.unwrap();
        write(&store).await;
        store.close().await;
    };
    tokio::runtime::Runtime::new().unwrap().block_on(work);
}

#[test]
fn answers_are_given_again_until_something_is_written() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    client.posted("/reports", &report(json!({})));
    let asked = || {
        let answer = client.get("/reports?limit=1");
        let tag = answer.header("etag").to_owned();
        assert_eq!(answer.header("content-type"), "application/json");
        (answer.json()["reports"][0]["commit"].clone(), tag)
    };
    let first = asked();
    assert_eq!(first.0, "c1");
    let is_given_again = |commit: &str| {
        let before = asked();
        behind(service.data.path(), async |store| {
            store.ingest().report(external("main", commit, &[1.0])).await.unwrap();
        });
        asked() == before
    };
    // The worker, which looks for jobs now and then, may write in between.
    let behind_its_back = ["b1", "b2", "b3", "b4", "b5"];
    let newest = behind_its_back.into_iter().find(|commit| is_given_again(commit));
    let other = client.get("/reports?limit=2").json();
    assert_eq!(other["reports"][0]["commit"], newest.expect("nothing is given again"));
    client.posted("/reports", &report(json!({"commit": "c3"})));
    let last = asked();
    assert_eq!(last.0, "c3");
    assert_ne!(last.1, first.1);
}

#[test]
fn posted_results_leave_what_was_said_of_jobs() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let n_jobs = || client.get("/jobs").json()["jobs"].as_array().unwrap().len();
    let survives = || {
        let before = n_jobs();
        behind(service.data.path(), async |store| {
            let job = NewJob {
                sequence_id: None,
                ..store::job(0, &["ema"])
            };
            let id = store.enqueue(&job, Timestamp::now()).await.unwrap();
            store.cancel(id, Timestamp::now()).await.unwrap();
        });
        client.posted("/reports", &report(json!({})));
        n_jobs() == before
    };
    // The worker, which looks for jobs now and then, may write in between.
    let n_written = 1 + (0..5).position(|_| survives()).expect("posts forget jobs");
    client.put("pan", &packed("pan"));
    assert_eq!(n_jobs(), n_written);
}

#[test]
fn an_open_report_has_the_frames_that_were_just_posted() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let open = json!({"sequence": "room", "system": "engine", "open": true});
    let path = format!("/reports/{}", client.posted("/reports", &open)["id"]);
    for n in 1..=3 {
        let frame = json!({"index": n, "metrics": {"psnr": 30}});
        client.posted(&format!("{path}/frames"), &json!({"frames": [frame]}));
        let frames = client.get(&format!("{path}/frames")).json()["frames"].clone();
        assert_eq!(frames.as_array().unwrap().len(), n);
    }
    assert_eq!(client.get(&path).json()["complete"], false);
    client.posted(&format!("{path}/close"), &json!({}));
    assert_eq!(client.get(&path).json()["complete"], true);
}

/// Says that it is done however that came about.
struct Done<'a>(&'a AtomicBool);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

#[test]
fn who_posted_is_never_given_an_answer_from_before() {
    let service = TestService::start(Idle, &[]);
    let (client, is_done) = (service.client(), AtomicBool::new(false));
    let first = client.posted("/reports", &report(json!({})));
    let series = client.get(&format!("/reports/{}", first["id"])).json()["series_id"].clone();
    let points = format!("/series/{series}/points?metric=psnr&limit=1");
    thread::scope(|scope| {
        // Others ask for the same meanwhile, so that each answer is there before and made while something is written.
        for path in ["/reports?limit=1", &points] {
            scope.spawn(|| {
                let client = service.client();
                while !is_done.load(Relaxed) {
                    assert_eq!(client.get(path).status, 200);
                }
            });
        }
        let _done = Done(&is_done);
        for i in 0..100 {
            let id = client.posted("/reports", &report(json!({"commit": i.to_string()})))["id"].clone();
            let seen = [
                client.get("/reports?limit=1").json()["reports"][0]["id"].clone(),
                client.get(&points).json()["points"][0]["report_id"].clone(),
            ];
            assert_eq!(seen, [id.clone(), id], "post {i}");
        }
    });
}
