//! Rules, baselines, changes, silence and alerts.

use crate::support::service::{Client, Idle, TestService};
use afterimage::{
    store::{AlertFilter, KeptAnswer, Store, Timestamp},
    verdict::{ChangeRule, Tolerance, change::change_points},
};
use serde_json::{Value, json};
use std::time::Duration;

/// A report of `value` at a commit, with three frames around it.
fn report(commit: &str, value: f64, change: Value) -> Value {
    let frame = |index: usize, offset: f64| json!({"index": index, "metrics": {"psnr": value + offset}});
    let mut report = json!({"sequence": "ship", "system": "engine", "branch": "main", "commit": commit,
        "frames": [frame(0, 1.0), frame(1, -2.0), frame(2, 1.0)]});
    report
        .as_object_mut()
        .unwrap()
        .extend(change.as_object().unwrap().clone());
    report
}

fn judged(client: &Client, commit: &str, value: f64, rules: &Value) -> Value {
    client.posted("/reports", &report(commit, value, json!({"rules": rules})))["judgement"].clone()
}

fn open_alerts(client: &Client) -> Vec<Value> {
    client.get("/alerts?status=open").json()["alerts"]
        .as_array()
        .unwrap()
        .clone()
}

#[test]
fn a_limit_that_breaks_is_one_alert_that_names_commits_and_frames() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "psnr*", "sequence": "sh?p", "min": 30}]});
    assert_eq!(judged(&client, "good", 31.0, &rules)["outcome"], "ok");
    let bad = judged(&client, "bad", 29.0, &rules);
    assert_eq!((&bad["outcome"], &bad["alerts"]), (&json!("regression"), &json!([1])));
    let worse = judged(&client, "worse", 28.0, &rules);
    assert_eq!(worse["alerts"], json!([]), "the same fault is the same alert");
    let alert = client.get("/alerts/1").json();
    assert_eq!(
        (&alert["status"], &alert["kind"], &alert["metric"]),
        (&json!("open"), &json!("limit"), &json!("psnr"))
    );
    let finding = &alert["finding"];
    assert_eq!(
        (&finding["first_bad_commit"], &finding["last_good_commit"]),
        (&json!("bad"), &json!("good"))
    );
    assert_eq!(
        (&finding["value"], &finding["effect"], &finding["worst_frames"][0]),
        (&json!(28.0), &json!(-2.0), &json!(1))
    );
    let thresholds = client.get("/thresholds").json();
    assert_eq!(thresholds["thresholds"][0]["rules"]["rule"][0]["min"], 30.0);
    let page = ureq::get(service.url("/alerts"))
        .call()
        .unwrap()
        .body_mut()
        .read_to_string()
        .unwrap();
    assert!(
        page.contains("ship") && page.contains("good") && page.contains("worst frames"),
        "{page}"
    );

    // Since the commit, and since a later one.
    assert_eq!(
        client.get("/alerts?since=bad").json()["alerts"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
    assert_eq!(client.get("/alerts?since=worse").json()["alerts"], json!([]));
    client
        .get("/alerts?project=nowhere")
        .is_problem(422, "unknown_project", Some("project"), "nowhere");
    client
        .get("/alerts?since=nowhere")
        .is_problem(422, "unknown_commit", Some("since"), "nowhere");

    assert_eq!(judged(&client, "fixed", 32.0, &rules)["outcome"], "ok");
    assert_eq!(open_alerts(&client).len(), 0);
    let closed = client.get("/alerts/1").json();
    assert_eq!(
        (&closed["status"], &closed["closed_why"]),
        (&json!("resolved"), &json!("the check holds again"))
    );
}

#[test]
fn a_rule_that_is_removed_takes_its_alerts_along() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    judged(
        &client,
        "c",
        20.0,
        &json!({"rule": [{"metric": "psnr", "min": 30}, {"metric": "psnr", "max": 10}]}),
    );
    assert_eq!(open_alerts(&client).len(), 1);
    let none = judged(&client, "d", 20.0, &json!({"rule": [{"metric": "ssim*", "min": 0.5}]}));
    assert_eq!(
        (&none["outcome"], &none["checks"]),
        (&json!("unknown"), &json!([])),
        "nothing was checked"
    );
    assert_eq!(client.get("/alerts/1").json()["closed_why"], "its rule was removed");
    let unmeasured = judged(
        &client,
        "e",
        20.0,
        &json!({"rule": [{"metric": "psnr", "min": 10}, {"metric": "ssim", "min": 0.5}]}),
    );
    assert_eq!(unmeasured["outcome"], "unknown");
    assert_eq!(
        unmeasured["checks"][1]["detail"].as_str().unwrap().split(';').next(),
        Some("was not measured, or in warm-up only")
    );
}

#[test]
fn an_older_result_leaves_alerts_alone() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "psnr", "min": 30}]});
    judged(&client, "good", 31.0, &rules);
    judged(&client, "bad", 29.0, &rules);
    let judge =
        |report: i64| client.posted("/verdicts", &json!({"reports": [report], "rules": rules}))["outcome"].clone();
    assert_eq!(judge(1), "ok");
    let others = json!({"rule": [{"metric": "psnr", "max": 50}]});
    client.posted("/verdicts", &json!({"reports": [1], "rules": others}));
    assert_eq!(open_alerts(&client).len(), 1);
    // Of several results of a commit, each may be judged.
    judged(&client, "bad", 31.0, &rules);
    judge(3);
    assert_eq!(open_alerts(&client).len(), 0);
    judge(2);
    assert_eq!(open_alerts(&client).len(), 1);
    judged(&client, "fixed", 31.0, &rules);
    assert_eq!(judge(2), "regression");
    assert_eq!(open_alerts(&client).len(), 0);
}

#[test]
fn a_gpu_time_may_be_posted_as_a_value() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "gpu_time_ms", "max": 5}]});
    for (measured, value, outcome) in [
        (json!({"values": {"gpu_time_ms": 4}}), 4.0, "ok"),
        (
            json!({"frames": [{"index": 0, "metrics": {"gpu_time_ms": 6}}]}),
            6.0,
            "regression",
        ),
    ] {
        let mut report = json!({"sequence": "ship", "system": "engine", "branch": "main", "rules": rules});
        report
            .as_object_mut()
            .unwrap()
            .extend(measured.as_object().unwrap().clone());
        let check = client.posted("/reports", &report)["judgement"]["checks"][0].clone();
        assert_eq!(
            (&check["outcome"], &check["finding"]["value"]),
            (&json!(outcome), &json!(value))
        );
    }
    let line = client.get("/series?metric=gpu_time_ms").json()["series"][0].clone();
    assert_eq!(line["points"].as_array().unwrap().len(), 2);
}

#[test]
fn a_baseline_is_approved_in_each_environment() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "psnr", "baseline": 0.5}]});
    let outcome = |value: f64, driver: &str| {
        let change = json!({"rules": rules, "environment": {"adapter": {"name": "RTX", "driver_version": driver}}});
        let posted = client.posted("/reports", &report("c", value, change));
        (posted["id"].as_i64().unwrap(), posted["judgement"]["checks"][0].clone())
    };
    let (first, check) = outcome(30.0, "1");
    assert_eq!(check["outcome"], "unknown");
    let decide = |id: i64, decision: &str| {
        client.posted(
            &format!("/reports/{id}/decisions"),
            &json!({"decision": decision, "why": "looked at it", "who": "jane"}),
        )
    };
    assert_eq!(decide(first, "approved")["who"], "jane");
    assert_eq!(outcome(29.6, "1").1["outcome"], "ok");
    let (bad, check) = outcome(29.0, "1");
    assert_eq!(check["outcome"], "regression");
    let elsewhere = outcome(10.0, "2").1;
    assert_eq!(elsewhere["outcome"], "unknown");
    assert!(
        elsewhere["detail"].as_str().unwrap().starts_with("environment differs"),
        "{elsewhere}"
    );
    // The new look is wanted: its approval joins the set and answers the alert.
    assert_eq!(open_alerts(&client).len(), 1);
    decide(bad, "approved");
    assert_eq!(open_alerts(&client).len(), 0);
    assert_eq!(outcome(28.6, "1").1["outcome"], "ok");
    decide(bad, "rejected");
    assert_eq!(
        outcome(28.6, "1").1["outcome"],
        "regression",
        "the last decision counts"
    );
    let listed = client.get(&format!("/baselines?report={bad}")).json();
    let said: Vec<_> = listed["decisions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["decision"].as_str().unwrap())
        .collect();
    assert_eq!(said, ["rejected", "approved"]);
    client
        .post(
            "/reports/999/decisions",
            &json!({"decision": "approved", "why": "x", "who": "y"}),
        )
        .is_problem(404, "not_found", None, "999");
    client
        .post(
            &format!("/reports/{bad}/decisions"),
            &json!({"decision": "approved", "why": "x"}),
        )
        .is_problem(422, "invalid_field", Some("who"), "token");
    client
        .post(
            &format!("/reports/{bad}/decisions"),
            &json!({"decision": "approved", "why": " ", "who": "y"}),
        )
        .is_problem(422, "invalid_field", Some("why"), "why");
    client
        .post(
            &format!("/reports/{bad}/decisions"),
            &json!({"decision": "maybe", "why": "x"}),
        )
        .is_problem(422, "invalid_field", Some("decision"), "approved");
}

#[test]
fn a_step_in_times_is_found_at_its_commit() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let post = |i: usize, ms: f64, branch: &str| {
        let jitter = 1.0 + 0.002 * ((i * 7) % 5) as f64;
        let body = json!({"sequence": "ship", "system": "engine", "branch": branch, "commit": format!("c{i}"),
            "from": {"branch": "main", "commit": "c11"}, "frames": [{"index": 0, "times_ms": {"taa": ms * jitter}}]});
        client.posted("/reports", &body)["id"].as_i64().unwrap()
    };
    for i in 0..12 {
        post(i, 1.0, "main");
    }
    let ids: Vec<i64> = (12..18).map(|i| post(i, 1.1, "topic")).collect();
    let rules = json!({"rule": [{"metric": "gpu_time_ms", "change": {"min_effect": "3 %"}}]});
    let judge = |id: i64| client.posted("/verdicts", &json!({"reports": [id], "rules": rules}));
    let judgement = judge(ids[5]);
    let check = &judgement["checks"][0];
    assert_eq!(
        (&check["outcome"], &check["kind"]),
        (&json!("regression"), &json!("change")),
        "{judgement}"
    );
    let finding = &check["finding"];
    assert_eq!(
        (&finding["first_bad_commit"], &finding["last_good_commit"]),
        (&json!("c12"), &json!("c11")),
        "the parent's past is the branch's"
    );
    let [low, effect, high] = ["effect_low", "effect", "effect_high"].map(|name| finding[name].as_f64().unwrap());
    assert!(
        low <= effect && effect <= high && low > 0.05 && high < 0.15,
        "{finding}"
    );
    // Someone looked at it and it does not matter.
    let id = judgement["alerts"][0].as_i64().unwrap();
    let reason = json!({"why": "expected", "who": "jane"});
    assert_eq!(
        client.posted(&format!("/alerts/{id}/dismiss"), &reason)["status"],
        "dismissed"
    );
    client
        .post(&format!("/alerts/{id}/dismiss"), &reason)
        .is_problem(409, "alert_closed", None, "closed");
    assert_eq!(
        judge(ids[5])["alerts"],
        json!([]),
        "a fault that was dismissed is not told again"
    );
}

#[test]
fn repeats_are_judged_by_their_median() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "psnr", "min": 30}]});
    let ids: Vec<i64> = [31.0, 10.0, 32.0]
        .map(|value| {
            client.posted("/reports", &report("c", value, json!({})))["id"]
                .as_i64()
                .unwrap()
        })
        .to_vec();
    let judge = |ids: &[i64]| client.posted("/verdicts", &json!({"reports": ids, "rules": rules}))["outcome"].clone();
    assert_eq!((judge(&ids), judge(&ids[1..2])), (json!("ok"), json!("regression")));
    client
        .post("/verdicts", &json!({"reports": [], "rules": {}}))
        .is_problem(422, "invalid_field", Some("reports"), "1 to");
    client
        .post("/verdicts", &json!({"reports": [99], "rules": {}}))
        .is_problem(422, "unknown_report", Some("reports"), "99");
    let open = client.posted("/reports", &json!({"sequence": "s", "system": "e", "open": true}))["id"].clone();
    client
        .post("/verdicts", &json!({"reports": [open], "rules": {}}))
        .is_problem(422, "unknown_report", Some("reports"), "close it");
    let other = client.posted("/reports", &report("c", 1.0, json!({"branch": "topic"})))["id"].clone();
    client
        .post("/verdicts", &json!({"reports": [ids[0], other], "rules": {}}))
        .is_problem(422, "several_branches", Some("reports"), "branches");
    client
        .post("/verdicts", &json!({"reports": ids, "rules": {"no_data_nights": 0}}))
        .is_problem(422, "invalid_rules", Some("rules.no_data_nights"), "365");
    client.get("/alerts/99").is_problem(404, "not_found", None, "alert 99");
}

/// Only what should go on can be missed.
#[tokio::test]
async fn what_was_to_end_is_not_silent() {
    let rules = || json!({"no_data_nights": 2, "rule": [{"metric": "psnr", "min": 30}]});
    let service = tokio::task::spawn_blocking(move || {
        let service = TestService::start(Idle, &[]);
        let client = service.client();
        let post = |commit: &str, more: Value| {
            let mut body = more;
            body["rules"] = rules();
            client.posted("/reports", &report(commit, 31.0, body));
        };
        post(
            "old driver",
            json!({"environment": {"adapter": {"name": "A", "driver_version": "1"}}}),
        );
        post(
            "tried once",
            json!({"parameters": {"alpha": 0.5}, "environment": {"adapter": {"name": "A"}}}),
        );
        post("other machine", json!({"environment": {"adapter": {"name": "B"}}}));
        post(
            "last",
            json!({"environment": {"adapter": {"name": "A", "driver_version": "2"}}}),
        );
        post("proposed", json!({"branch": "pr", "pull_request": "17"}));
        post("merged", json!({"branch": "work", "from": {"branch": "main"}}));
        service
    })
    .await
    .unwrap();
    let store = Store::open(&service.data.path().join("afterimage.sqlite"))
        .await
        .unwrap();
    let later = Timestamp::now() + Duration::from_secs(3 * 86_400);
    store.note_silence(later).await.unwrap();
    let filter = AlertFilter {
        limit: 9,
        ..AlertFilter::default()
    };
    let alerts = store.alerts(&filter).await.unwrap();
    let silent: Vec<_> = alerts
        .iter()
        .map(|alert| alert.finding.last_good_commit.as_deref())
        .collect();
    assert_eq!(silent, [Some("last"), Some("other machine")]);
    store.close().await;
    tokio::task::spawn_blocking(move || drop(service)).await.unwrap();
}

#[tokio::test]
async fn silence_is_an_alert_until_it_ends() {
    let rules = || json!({"no_data_nights": 2, "rule": [{"metric": "psnr", "min": 30}]});
    let service = tokio::task::spawn_blocking(move || {
        let service = TestService::start(Idle, &[]);
        let client = service.client();
        judged(&client, "last", 31.0, &rules());
        client.posted("/reports", &report("unruled", 31.0, json!({"branch": "other"})));
        service
    })
    .await
    .unwrap();
    let store = Store::open(&service.data.path().join("afterimage.sqlite"))
        .await
        .unwrap();
    let after = |nights: f64| Timestamp::now() + Duration::from_secs_f64(nights * 86_400.0);
    assert!(
        store.note_silence(after(2.4)).await.unwrap().is_empty(),
        "half a night of grace"
    );
    assert_eq!(store.note_silence(after(2.6)).await.unwrap().len(), 1);
    assert!(store.note_silence(after(3.6)).await.unwrap().is_empty(), "told once");
    let filter = AlertFilter {
        limit: 9,
        ..AlertFilter::default()
    };
    let alerts = store.alerts(&filter).await.unwrap();
    assert_eq!(alerts.len(), 1);
    assert!(
        alerts[0].detail.contains("no report for 3 nights"),
        "{}",
        alerts[0].detail
    );
    assert_eq!(alerts[0].finding.last_good_commit.as_deref(), Some("last"));
    tokio::task::spawn_blocking(move || {
        judged(&service.client(), "again", 31.0, &rules());
        drop(service);
    })
    .await
    .unwrap();
    assert_eq!(store.n_open_alerts().await.unwrap(), 0, "it speaks again");
    store.close().await;
}

#[tokio::test]
async fn a_verdict_that_was_not_reached_is_given_to_the_same_request() {
    let post = |client: &Client| {
        let rules = json!({"rules": {"rule": [{"metric": "psnr", "min": 30}]}});
        client.post_with("/reports", &report("c", 20.0, rules), &[("idempotency-key", "night-1")])
    };
    let (service, first) = tokio::task::spawn_blocking(move || {
        let service = TestService::start(Idle, &[]);
        let first = post(&service.client()).json();
        (service, first)
    })
    .await
    .unwrap();
    let store = Store::open(&service.data.path().join("afterimage.sqlite"))
        .await
        .unwrap();
    // As a service leaves it that is killed between the result and its verdict.
    let kept = store.kept_answer(0, "night-1").await.unwrap().unwrap();
    let stored = KeptAnswer {
        status: 102,
        body: format!("[{}]", first["id"]).into_bytes(),
        ..kept
    };
    store.ingest().keep(0, "night-1".to_owned(), stored).await.unwrap();
    tokio::task::spawn_blocking(move || {
        let again = post(&service.client());
        assert_eq!((again.status, &again.json()["id"]), (201, &first["id"]));
        assert_eq!(again.json()["judgement"]["outcome"], "regression");
        let replayed = post(&service.client());
        assert_eq!(
            (replayed.header("idempotency-replayed"), &replayed.body),
            ("true", &again.body)
        );
        let reports = service.client().get("/reports").json();
        assert_eq!(reports["reports"].as_array().unwrap().len(), 1);
    })
    .await
    .unwrap();
    store.close().await;
}

/// Series with known changes, and what `apache-otava` says of them; `script/record_changes` makes the file.
#[test]
fn changes_are_where_otava_finds_them() {
    let file: Value = serde_json::from_str(include_str!("../../fixtures/changes/series.json")).unwrap();
    let (mut n_changes, mut n_agreements, mut n_series) = (0, 0, 0);
    let near = |a: &[usize], b: &[usize]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1);
    for series in file["series"].as_array().unwrap() {
        let values: Vec<f64> = series["values"]
            .as_array()
            .unwrap()
            .iter()
            .map(|value| value.as_f64().unwrap())
            .collect();
        let places = |name: &str| -> Vec<usize> {
            series[name]
                .as_array()
                .unwrap()
                .iter()
                .map(|at| at.as_u64().unwrap() as usize)
                .collect()
        };
        let rule = ChangeRule {
            min_effect: Tolerance::Relative(0.02),
            ..ChangeRule::default()
        };
        let found: Vec<usize> = change_points(&values, &rule).iter().map(|point| point.index).collect();
        let (made, otava) = (places("changes"), places("otava"));
        assert!(
            near(&found, &made),
            "{}: made {made:?}, found {found:?}, otava {otava:?}",
            series["name"]
        );
        n_changes += made.len();
        n_series += 1;
        n_agreements += usize::from(near(&found, &otava));
    }
    assert_eq!((n_changes, n_series), (50, 28), "the fixture is another");
    assert!(n_agreements >= 27, "otava agrees on {n_agreements} series only");
}
