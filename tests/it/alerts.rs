//! Alerts as a line goes on: what they name, and what opens, moves and closes them.

use crate::support::service::{Client, Idle, TestService};
use serde_json::{Value, json};

/// Posts one value of a commit; the report's number and what its rules say.
fn post(client: &Client, commit: &str, value: Value, more: Value) -> (i64, Value) {
    let mut report = json!({"sequence": "ship", "system": "engine", "branch": "main", "commit": commit,
        "values": {"psnr": value}, "rules": {"rule": [{"metric": "psnr", "change": {"min_effect": 0.2}}]}});
    report
        .as_object_mut()
        .unwrap()
        .extend(more.as_object().unwrap().clone());
    let posted = client.posted("/reports", &report);
    (posted["id"].as_i64().unwrap(), posted["judgement"].clone())
}

/// Posts commits from `first` on, 34 dB each up to `m19`, then 33.
fn nights(client: &Client, first: usize, end: usize) {
    for i in first..end {
        let noise = 0.02 * ((i * 7) % 5) as f64;
        let level = if i < 20 { 34.0 } else { 33.0 };
        post(client, &format!("m{i}"), json!(level + noise), json!({}));
    }
}

fn listed(client: &Client, query: &str) -> Vec<Value> {
    let alerts = client.get(&format!("/alerts?{query}")).json()["alerts"].clone();
    alerts.as_array().unwrap().clone()
}

#[test]
fn an_alert_moves_with_what_is_known() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    nights(&client, 0, 28);
    let alert = &listed(&client, "status=open")[0];
    assert_eq!(
        (
            &alert["finding"]["first_bad_commit"],
            &alert["finding"]["last_good_commit"]
        ),
        (&json!("m20"), &json!("m19"))
    );
    assert_eq!(alert["report_id"], 21);
    assert_eq!(
        (listed(&client, "since=m20").len(), listed(&client, "since=m21").len()),
        (1, 0)
    );

    // The last good result is no answer to it.
    let approve = |id: i64| {
        let decision = json!({"decision": "approved", "why": "looked at it", "who": "jane"});
        client.posted(&format!("/reports/{id}/decisions"), &decision)
    };
    approve(20);
    assert_eq!(listed(&client, "status=open").len(), 1);

    let reason = json!({"why": "expected", "who": "jane"});
    client.posted(&format!("/alerts/{}/dismiss", alert["id"]), &reason);
    nights(&client, 28, 34);
    assert_eq!(listed(&client, "status=open").len(), 0, "it was dismissed");
}

#[test]
fn an_approval_answers_for_its_branch_alone() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    nights(&client, 0, 28);
    let topic = json!({"branch": "topic", "from": {"branch": "main", "commit": "m10"}});
    let (id, judgement) = post(&client, "t1", json!(34.0), topic);
    assert_eq!(judgement["outcome"], "ok", "main fell after they parted");
    let decision = json!({"decision": "approved", "why": "good", "who": "jane"});
    client.posted(&format!("/reports/{id}/decisions"), &decision);
    assert_eq!(listed(&client, "status=open").len(), 1);
    nights(&client, 28, 30);
    assert_eq!(listed(&client, "status=open").len(), 1);
    client.posted("/reports/28/decisions", &decision);
    assert_eq!(listed(&client, "status=open").len(), 0);
    nights(&client, 30, 32);
    assert_eq!(listed(&client, "status=open").len(), 0);
    // Taken back, it answers for nothing.
    let rejection = json!({"decision": "rejected", "why": "a mistake", "who": "jane"});
    client.posted("/reports/28/decisions", &rejection);
    nights(&client, 32, 33);
    let alert = &listed(&client, "status=open")[0];
    assert_eq!(alert["finding"]["first_bad_commit"], "m20");
}

#[test]
fn what_is_measured_again_stays_where_it_was() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    nights(&client, 0, 30);
    for commit in ["m10", "m11", "m12", "m13"] {
        assert_eq!(
            post(&client, commit, json!(34.0), json!({})).1["outcome"],
            "ok",
            "it is good"
        );
    }
    assert_eq!(post(&client, "m25", json!(33.0), json!({})).1["outcome"], "regression");
    assert_eq!(listed(&client, "status=open")[0]["finding"]["first_bad_commit"], "m20");

    // Limits: an old commit that is bad opens nothing, and names what was before it.
    let rules = json!({"rules": {"rule": [{"metric": "psnr", "min": 33.5}]}, "branch": "limits"});
    for (commit, value) in [("a", 34.0), ("b", 33.0), ("c", 34.0)] {
        post(&client, commit, json!(value), rules.clone());
    }
    let check = post(&client, "b", json!(33.0), rules).1["checks"][0].clone();
    assert_eq!(
        (
            &check["finding"]["first_bad_commit"],
            &check["finding"]["last_good_commit"]
        ),
        (&json!("b"), &json!("a"))
    );
    assert_eq!(listed(&client, "status=open&branch=limits").len(), 0);
}

#[test]
fn a_bisection_moves_what_alerts_name() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let night = |i: usize, rules: &Value| {
        let level = if i < 19 { 34.0 } else { 33.0 };
        let parent = json!({"parent": format!("m{}", i as i64 - 1), "rules": rules});
        post(&client, &format!("m{i}"), json!(level), parent)
    };
    let rules = json!({"rule": [{"metric": "psnr", "min": 33.5, "change": {}}]});
    for i in (0..30).filter(|i| !(18..20).contains(i)) {
        night(i, &rules);
    }
    let named = || {
        let open = listed(&client, "status=open");
        let name = |alert: &Value| (alert["kind"].clone(), alert["finding"]["first_bad_commit"].clone());
        open.iter().map(name).collect::<Vec<_>>()
    };
    assert_eq!(
        named(),
        [(json!("change"), json!("m20")), (json!("limit"), json!("m20"))]
    );
    // Rules of an old commit do not judge the branch as it is now.
    night(
        19,
        &json!({"rule": [{"metric": "psnr", "min": 30, "change": {"min_effect": 5}}]}),
    );
    assert_eq!(
        named(),
        [(json!("change"), json!("m19")), (json!("limit"), json!("m19"))]
    );
    night(18, &rules);
    let last_good = |alert: Value| alert["finding"]["last_good_commit"].clone();
    let last_good: Vec<Value> = listed(&client, "status=open").into_iter().map(last_good).collect();
    assert_eq!(last_good, [json!("m18"), json!("m18")]);
    // To approve what is good before a change, however late it was measured, says nothing of the change.
    let approve = |report: i64| {
        let decision = json!({"decision": "approved", "why": "seen", "who": "me"});
        client.posted(&format!("/reports/{report}/decisions"), &decision);
    };
    approve(30);
    assert_eq!(named().len(), 2);
    night(31, &rules);
    assert_eq!(named().len(), 2);
    approve(29);
    assert_eq!(named(), [(json!("limit"), json!("m19"))]);
    night(32, &rules);
    assert_eq!(named(), [(json!("limit"), json!("m19"))]);
}

#[test]
fn an_alert_is_not_moved_to_what_was_dismissed() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let mut commit = 0;
    let mut nights = |level: f64| {
        for _ in 0..10 {
            commit += 1;
            let noise = 0.02 * ((commit * 7) % 5) as f64;
            post(&client, &format!("m{commit}"), json!(level + noise), json!({}));
        }
    };
    nights(34.0);
    nights(33.0);
    client.posted("/alerts/1/dismiss", &json!({"why": "wanted", "who": "me"}));
    nights(31.0);
    let open = listed(&client, "status=open");
    assert_eq!(
        (open.len(), &open[0]["finding"]["first_bad_commit"]),
        (1, &json!("m21"))
    );
    nights(33.0);
    assert_eq!(listed(&client, "status=open").len(), 0);
    assert_eq!(client.get("/alerts/2").json()["closed_why"], "the check holds again");
}

#[test]
fn a_past_result_of_no_branch_closes_nothing() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let night = |i: usize| {
        let level = if i < 10 { 34.0 } else { 33.0 };
        post(&client, &format!("m{i}"), json!(level), json!({"branch": ""})).1["outcome"].clone()
    };
    (0..20).for_each(|i| drop(night(i)));
    assert_eq!(listed(&client, "status=open").len(), 1);
    assert_eq!(night(5), "ok");
    assert_eq!(listed(&client, "status=open").len(), 1);
}

/// What a metric was last may be older than the line's newest result.
#[test]
fn the_newest_results_are_judged_metric_by_metric() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "psnr", "min": 30}, {"metric": "flip", "max": 0.2}]});
    let night =
        |commit: &str, values: Value| post(&client, commit, json!(0), json!({"values": values, "rules": rules}));
    night("m0", json!({"psnr": 36, "flip": 0.1}));
    night("m1", json!({"psnr": 36, "flip": 0.1}));
    night("m2", json!({"psnr": 27}));
    assert_eq!(listed(&client, "status=open").len(), 1);
    night("m0", json!({"psnr": 36, "flip": 0.1}));
    assert_eq!(listed(&client, "status=open").len(), 1);
}

#[test]
fn a_change_that_an_alert_is_open_of_is_drawn_however_old() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rules": {"rule": [{"metric": "psnr", "change": {"min_effect": 0.2, "window": 20}}]}});
    for i in 0..70 {
        let level = if i < 20 { 34.0 } else { 33.0 };
        let noise = 0.02 * ((i * 7) % 5) as f64;
        post(&client, &format!("m{i}"), json!(level + noise), rules.clone());
    }
    let marks = client.get("/series/1/marks?metric=psnr&branch=main").json();
    let drawn = marks["changes"].as_array().unwrap();
    assert_eq!(drawn.len(), 1, "{marks}");
    assert_eq!((&drawn[0]["commit"], &drawn[0]["worse"]), (&json!("m20"), &json!(true)));
    let levels = [&drawn[0]["before"], &drawn[0]["after"]].map(|level| level.as_f64().unwrap());
    assert_eq!(levels, [34.04, 33.04]);
}

#[test]
fn results_are_ordered_by_their_parents() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let mut last = Value::Null;
    // Every commit but the first is posted before its neighbour.
    for i in (0..15).flat_map(|pair| [2 * pair + 1, 2 * pair]) {
        let level = if i < 20 { 34.0 } else { 33.0 };
        let parent = json!({"parent": format!("m{}", i as i64 - 1)});
        last = post(&client, &format!("m{i}"), json!(level), parent).1["checks"][0].clone();
    }
    assert_eq!(
        (
            &last["finding"]["first_bad_commit"],
            &last["finding"]["last_good_commit"]
        ),
        (&json!("m20"), &json!("m19"))
    );
}

#[test]
fn a_branch_may_be_told_of_its_past_later() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let topic = json!({"branch": "topic", "from": {"branch": "main", "commit": "m11"}});
    post(&client, "t0", json!(34.0), topic.clone());
    nights(&client, 0, 12);
    for i in 1..8 {
        post(&client, &format!("t{i}"), json!(30.0), topic.clone());
    }
    let branches = client.get("/projects/default/branches").json();
    let found = branches["branches"]
        .as_array()
        .unwrap()
        .iter()
        .find(|branch| branch["name"] == "topic");
    assert_eq!(found.unwrap()["parent"], "main", "{branches}");
    let alert = &listed(&client, "status=open")[0];
    assert_eq!(alert["finding"]["first_bad_commit"], "t1");
}

#[test]
fn a_branch_leaves_another_where_its_parent_was_measured() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    nights(&client, 0, 30);
    // It left `main` before `m20` made it worse, and says so by its parent alone.
    let origin = |parent: &str| json!({"branch": "work", "from": {"branch": "main"}, "parent": parent});
    let (_, judgement) = post(&client, "w0", json!(34.02), origin("m15"));
    assert_eq!(judgement["outcome"], "ok");
    assert_eq!(
        client.get("/reports/31").json()["from"],
        json!({"branch": "main", "commit": "m15"})
    );
    // So it does where the commit that it names was not measured.
    let more = json!({"branch": "other", "from": {"branch": "main", "commit": "a merge"}, "parent": "m15"});
    assert_eq!(post(&client, "o0", json!(34.02), more).1["outcome"], "ok");
    // The parents of its later commits are its own.
    post(&client, "w1", json!(34.02), origin("w0"));
    assert_eq!(client.get("/reports/33").json()["from"]["commit"], "m15");
}

#[test]
fn each_line_has_the_rules_that_it_was_run_with() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = |metric: &str, min: f64| json!({"rule": [{"metric": metric, "min": min}]});
    let run = |sequence: &str, rules: &Value| {
        let more = json!({"sequence": sequence, "values": {"psnr": 30, "ssim": 0.9}, "rules": rules});
        post(&client, "c", json!(30), more).1
    };
    let n_open = || listed(&client, "status=open").len();
    run("ship", &rules("psnr", 40.0));
    run("pan", &rules("psnr", 40.0));
    // Another pipeline of the branch, with a file of its own.
    run("fan", &rules("ssim", 0.95));
    assert_eq!(n_open(), 3);
    let thresholds = client.get("/thresholds").json()["thresholds"].clone();
    let lines: Vec<&Value> = thresholds
        .as_array()
        .unwrap()
        .iter()
        .map(|one| &one["series"])
        .collect();
    assert_eq!(lines, [&json!([1, 2]), &json!([3])]);
    run("ship", &rules("ssim", 0.8));
    let mut open = listed(&client, "status=open");
    open.sort_by_key(|alert| alert["id"].as_i64());
    let of: Vec<&Value> = open.iter().map(|alert| &alert["series"]["sequence_name"]).collect();
    assert_eq!(of, ["pan", "fan"]);
    client
        .get("/alerts?branch=mian")
        .is_problem(422, "unknown_branch", Some("branch"), "mian");
}

#[test]
fn frames_that_are_not_numbers_are_no_good_result() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let rules = json!({"rule": [{"metric": "psnr", "min": 30, "baseline": 0.5}]});
    let outcome = |broken: &Value| {
        let frames: Vec<Value> = (0..12)
            .map(|i| json!({"index": i, "metrics": {"psnr": if i == 7 { broken.clone() } else { json!(34.0) }}}))
            .collect();
        let report =
            json!({"sequence": "ship", "system": "engine", "branch": "main", "frames": frames, "rules": rules});
        let posted = client.posted("/reports", &report);
        let id = posted["id"].as_i64().unwrap();
        let value = client.get(&format!("/reports/{id}")).json()["values"]["psnr"].clone();
        (id, posted["judgement"]["checks"][0].clone(), value)
    };
    let (good, check, _) = outcome(&json!("inf"));
    assert_eq!(check["outcome"], "ok", "an equal frame harms nobody");
    let decision = json!({"decision": "approved", "why": "good", "who": "jane"});
    client.posted(&format!("/reports/{good}/decisions"), &decision);
    for broken in [json!("nan"), json!("-inf")] {
        let (_, check, value) = outcome(&broken);
        assert_eq!((&check["outcome"], &value), (&json!("regression"), &broken));
        assert_eq!(check["finding"]["worst_frames"][0], 7);
    }
    assert_eq!(listed(&client, "status=open").len(), 2, "limit and baseline");
}
