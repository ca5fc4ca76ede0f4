//! Answers that the service keeps: given again, and never after they stopped being true.

use crate::{
    posting::report,
    store_lines::external,
    support::service::{Idle, TestService},
};
use afterimage::store::Store;
use serde_json::json;
use std::{
    sync::atomic::{AtomicBool, Ordering::Relaxed},
    thread,
};

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
    // Behind the service's back, which no client can do: what it still says is what it kept.
    let behind = async {
        let database = service.data.path().join("afterimage.sqlite");
        let store = Store::open(&database).await.unwrap();
        store.ingest().report(external("main", "c2", &[1.0])).await.unwrap();
        store.close().await;
    };
    tokio::runtime::Runtime::new().unwrap().block_on(behind);
    assert_eq!(asked(), first);
    assert_eq!(client.get("/reports?limit=2").json()["reports"][0]["commit"], "c2");
    client.posted("/reports", &report(json!({"commit": "c3"})));
    let last = asked();
    assert_eq!(last.0, "c3");
    assert_ne!(last.1, first.1);
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
