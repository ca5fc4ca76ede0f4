//! Bencher's metric JSON, as its adapters write it.

use crate::support::service::{Idle, TestService};
use serde_json::{Value, json};

#[test]
fn benchers_json_is_taken_as_it_is() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let body = json!({"render::ship (night)": {"latency": {"value": 12.5, "lower_value": 12, "upper_value": 13}}, "b": {"throughput": {"value": 4}}});
    let posted = client.posted("/reports/bencher?branch=main&commit=c1&testbed=lab", &body);
    assert_eq!(posted["ids"].as_array().unwrap().len(), 2);
    let series = client.get("/series?metric=latency").json();
    assert_eq!(series["series"][0]["sequence_name"], "render--ship--night-");
    assert_eq!(
        (
            &series["series"][0]["points"][0]["value"],
            &series["series"][0]["adapter"]["name"]
        ),
        (&json!(12.5), &json!("lab"))
    );
    client
        .post("/reports/bencher", &json!({"b": {"x": {"worth": 1}}}))
        .is_problem(422, "unknown_field", Some("b.x.worth"), "value");
    client
        .post("/reports/bencher", &json!({}))
        .is_problem(422, "invalid_field", None, "1 to 1000");
    // What only the end of a long name tells apart is two lines.
    let long = |end: &str| format!("{}{end}", "module::".repeat(20));
    let posted = client.posted(
        "/reports/bencher",
        &json!({long("fast"): {"latency": {"value": 1}}, long("slow"): {"latency": {"value": 900}}}),
    );
    let lines: Vec<Value> = posted["ids"]
        .as_array()
        .unwrap()
        .iter()
        .map(|id| client.get(&format!("/reports/{id}")).json()["sequence_name"].clone())
        .collect();
    assert_ne!(lines[0], lines[1]);
    assert!(
        lines.iter().all(|name| name.as_str().unwrap().len() == 100),
        "{lines:?}"
    );
    let alike = json!({"a b": {"x": {"value": 1}}, "a/b": {"x": {"value": 2}}});
    client.post("/reports/bencher", &alike).is_problem(
        422,
        "invalid_name",
        None,
        "`a b` and `a/b` would both be called `a-b`",
    );
    client
        .post("/reports/bencher", &json!([{}]))
        .is_problem(422, "invalid_field", None, "must be an object");
    client
        .post("/reports/bencher?bench=1", &json!({}))
        .is_problem(400, "bad_query", Some("bench"), "bench");
}
