//! The OpenAPI document, and the Python client that is made of it.

use crate::support::service::{Idle, TestService};
use serde_json::Value;
use std::{collections::BTreeSet, fs, process::Command};

fn document() -> Value {
    afterimage::server::document().clone()
}

/// Every `$ref` in a value.
fn references(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                match value {
                    Value::String(target) if name == "$ref" => drop(found.insert(target.clone())),
                    value => references(value, found),
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|item| references(item, found)),
        _ => {}
    }
}

#[test]
fn the_document_holds_together() {
    let document = document();
    assert_eq!(document["openapi"], "3.1.0");
    let mut found = BTreeSet::new();
    references(&document, &mut found);
    assert!(found.len() > 30, "{found:?}");
    for reference in found {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(document.pointer(pointer).is_some(), "{reference} leads nowhere");
    }
    let mut ids = BTreeSet::new();
    for (path, methods) in document["paths"].as_object().unwrap() {
        for (method, operation) in methods.as_object().unwrap() {
            let name = format!("{method} {path}");
            assert!(
                ids.insert(operation["operationId"].as_str().unwrap().to_owned()),
                "{name}: its id is there twice"
            );
            let responses = operation["responses"].as_object().unwrap();
            assert!(responses.contains_key("default") && responses.len() > 1, "{name}");
            let parameters = operation["parameters"].as_array().unwrap();
            let in_path = parameters.iter().filter(|parameter| parameter["in"] == "path").count();
            assert_eq!(in_path, path.matches('{').count(), "{name}");
            let takes_key = parameters
                .iter()
                .any(|parameter| parameter["name"] == "Idempotency-Key");
            assert_eq!(takes_key, method == "post", "{name}");
            assert!(
                operation["summary"].as_str().is_some_and(|text| !text.is_empty()),
                "{name}"
            );
        }
    }
    assert!(ids.len() >= 45, "{ids:?}");
}

#[test]
fn what_is_written_and_what_is_read_are_told_apart() {
    let document = document();
    let schemas = &document["components"]["schemas"];
    let required = |name: &str| schemas[name]["required"].as_array().cloned().unwrap_or_default();
    assert!(
        required("Report").contains(&"series_id".into()),
        "flattened fields are there"
    );
    assert_eq!(
        required("ReportRequest"),
        ["sequence", "system"],
        "defaults may be left out"
    );
    assert_eq!(schemas["ReportRequest"]["additionalProperties"], false);
    assert_eq!(required("FrameRequest"), ["index"]);
}

#[test]
fn the_service_serves_it_and_its_page_shows_all() {
    let service = TestService::start(Idle, &[]);
    assert_eq!(service.client().get("/openapi.json").json(), document());
    let page = ureq::get(service.url("/api"))
        .call()
        .unwrap()
        .body_mut()
        .read_to_string()
        .unwrap();
    for (path, methods) in document()["paths"].as_object().unwrap() {
        for (_, operation) in methods.as_object().unwrap() {
            assert!(
                page.contains(&format!("id=\"{}\"", operation["operationId"].as_str().unwrap())),
                "{path}"
            );
        }
    }
    for schema in document()["components"]["schemas"].as_object().unwrap().keys() {
        assert!(page.contains(&format!("id=\"schema-{schema}\"")), "{schema}");
    }
    for attribute in ["src=\"http", "href=\"http", "action=\"http"] {
        assert!(!page.contains(attribute), "nothing comes from elsewhere");
    }
}

fn python(arguments: &[&str]) -> (bool, String) {
    let output = Command::new("python3")
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(arguments)
        .output();
    let output = output.expect("this test needs python3");
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8(text).unwrap())
}

#[test]
fn the_python_client_is_that_of_this_document() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("openapi.json");
    fs::write(&path, document().to_string()).unwrap();
    let made = folder.path().join("afterimage_client.py");
    let (done, text) = python(&[
        "script/make_python_client",
        path.to_str().unwrap(),
        made.to_str().unwrap(),
    ]);
    assert!(done, "{text}");
    let kept = concat!(env!("CARGO_MANIFEST_DIR"), "/clients/python/afterimage_client.py");
    if std::env::var_os("BLESS").is_some() {
        fs::copy(&made, kept).unwrap();
    }
    let is_same = fs::read_to_string(kept).unwrap_or_default() == fs::read_to_string(&made).unwrap();
    assert!(
        is_same,
        "the API has changed: run this test with BLESS=1 and commit clients/python"
    );
}

#[test]
fn the_python_client_speaks_to_a_service() {
    let service = TestService::start(Idle, &[]);
    let (done, text) = python(&["clients/python/test_client.py", &service.url("")]);
    assert!(done, "{text}");
    let reports = service.client().get("/reports").json();
    assert_eq!(reports["reports"][0]["commit"], "from-python");
}
