//! Who may do what.

use crate::support::service::{Answer, Idle, TestService, config, packed, reader};
use afterimage::{
    server::{Running, ServeError},
    store::{NewToken, Scope, Store, Timestamp},
};
use serde_json::json;
use std::{path::Path, process::Command, time::Duration};

/// Makes a token as the command line does, in the folder of a service that may be running.
fn token(data: &Path, scopes: &[Scope], rate_per_minute: Option<u32>, expires_at: Option<Timestamp>) -> (i64, String) {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let store = Store::open(&data.join("afterimage.sqlite")).await.unwrap();
        let new = NewToken {
            name: "test".to_owned(),
            scopes: scopes.iter().copied().collect(),
            rate_per_minute,
            expires_at,
        };
        let (text, token) = store.create_token(&new, Timestamp::now()).await.unwrap();
        store.close().await;
        (token.id, text)
    })
}

fn with(service: &TestService, token: &str, method: &str, path: &str) -> Answer {
    service
        .client()
        .send(method, path, &[("authorization", &format!("Bearer {token}"))], &[])
}

#[test]
fn each_scope_opens_what_it_says() {
    let service = TestService::start(Idle, &["--require-tokens"]);
    let data = service.data.path();
    let [(_, read), (_, submit), (_, approve), (_, admin)] =
        [Scope::Read, Scope::Submit, Scope::Approve, Scope::Admin].map(|scope| token(data, &[scope], None, None));
    // Method, path, and whether read, submit, approve and admin may.
    for (method, path, may) in [
        ("GET", "/jobs", [true, false, false, true]),
        ("GET", "/alerts", [true, false, false, true]),
        ("DELETE", "/jobs/1", [false, true, false, true]),
        ("POST", "/reports", [false, true, false, true]),
        ("HEAD", "/blobs/0", [false, true, false, true]),
        ("POST", "/alerts/1/dismiss", [false, false, true, true]),
        ("GET", "/tokens", [false, false, false, true]),
        ("POST", "/webhooks", [false, false, false, true]),
        ("GET", "/health", [true, true, true, true]),
        ("GET", "/openapi.json", [true, true, true, true]),
    ] {
        for (token, may) in [&read, &submit, &approve, &admin].into_iter().zip(may) {
            let answer = with(&service, token, method, path);
            assert_eq!(answer.status != 403, may, "{method} {path}: {}", answer.status);
        }
    }
    with(&service, &read, "DELETE", "/jobs/1").is_problem(403, "forbidden", None, "`submit`");
    let refused = service.client().get("/jobs");
    refused.is_problem(401, "unauthorised", None, "`read`");
    assert!(refused.headers.get_all("www-authenticate").iter().count() == 2);
    assert_eq!(service.client().get("/health").status, 200);
    let wrong = format!("{}0", &read[..read.len() - 1]);
    let wrong = if wrong == read {
        format!("{}1", &read[..read.len() - 1])
    } else {
        wrong
    };
    with(&service, &wrong, "GET", "/jobs").is_problem(401, "unauthorised", None, "unknown");
    with(&service, "", "GET", "/jobs").is_problem(401, "unauthorised", None, "");
    // Pages ask a browser for a token.
    let page = ureq::Agent::from(ureq::Agent::config_builder().http_status_as_error(false).build())
        .get(service.url("/"))
        .call()
        .unwrap();
    assert_eq!(page.status(), 401);
    for path in ["/healthz", "/readyz"] {
        assert_eq!(ureq::get(service.url(path)).call().unwrap().status(), 200);
    }
    let listed = with(&service, &admin, "GET", "/tokens");
    for text in [&read, &submit, &approve, &admin] {
        assert!(!listed.text().contains(text.as_str()), "a token's text is shown");
    }
    for entry in std::fs::read_dir(data).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap_or_default();
        assert!(
            !bytes.windows(read.len()).any(|window| window == read.as_bytes()),
            "a token's text is stored"
        );
    }
}

#[test]
fn tokens_end_and_are_slowed_down() {
    let service = TestService::start(Idle, &["--require-tokens"]);
    let data = service.data.path();
    let (_, expired) = token(data, &[Scope::Read], None, Some(Timestamp(1)));
    with(&service, &expired, "GET", "/jobs").is_problem(401, "unauthorised", None, "expired");
    let (id, revoked) = token(data, &[Scope::Read], None, None);
    assert_eq!(with(&service, &revoked, "GET", "/jobs").status, 200);
    let (_, admin) = token(data, &[Scope::Admin], None, None);
    assert_eq!(with(&service, &admin, "DELETE", &format!("/tokens/{id}")).status, 204);
    with(&service, &admin, "DELETE", &format!("/tokens/{id}")).is_problem(404, "not_found", None, "not revoked");
    std::thread::sleep(Duration::from_millis(2100));
    with(&service, &revoked, "GET", "/jobs").is_problem(401, "unauthorised", None, "revoked");
    // Six a minute: one at once, the next in ten seconds.
    let (_, slow) = token(data, &[Scope::Read], Some(6), None);
    assert_eq!(with(&service, &slow, "GET", "/jobs").status, 200);
    let refused = with(&service, &slow, "GET", "/jobs");
    refused.is_problem(429, "rate_limited", None, "6 requests a minute");
    let wait: u64 = refused.header("retry-after").parse().unwrap();
    assert!((1..=10).contains(&wait), "{wait}");
}

#[test]
fn an_open_service_answers_this_machine_only() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    client
        .send("GET", "/jobs", &[("host", "evil.example")], &[])
        .is_problem(421, "wrong_host", None, "--require-tokens");
    assert_eq!(
        client.send("GET", "/jobs", &[("host", "localhost:99")], &[]).status,
        200
    );
    // A token that is sent counts where none is needed.
    client
        .send("GET", "/jobs", &[("authorization", "Bearer nonsense")], &[])
        .is_problem(401, "unauthorised", None, "unknown");
    client
        .send("GET", "/jobs", &[("authorization", "nonsense")], &[])
        .is_problem(401, "unauthorised", None, "Bearer TOKEN");
}

#[test]
fn nobody_listens_to_the_network_without_tokens() {
    let data = tempfile::tempdir().unwrap();
    let start = |arguments: &[&str]| {
        let mut config = config(data.path(), arguments);
        config.listen = "0.0.0.0:0".parse().unwrap();
        let runtime = tokio::runtime::Runtime::new().unwrap();
        runtime.block_on(async {
            let running = Running::start(config, reader(), Idle, Err("none".to_owned())).await?;
            running.stop_token().cancel();
            running.run().await
        })
    };
    let refused = start(&[]).unwrap_err();
    assert!(
        matches!(refused, ServeError::Config(_)) && refused.to_string().contains("afterimage token"),
        "{refused}"
    );
    start(&["--insecure"]).unwrap();
    token(data.path(), &[Scope::Read], None, Some(Timestamp(1)));
    assert!(start(&[]).is_err(), "an expired token lets nobody in");
    token(data.path(), &[Scope::Read], None, None);
    start(&[]).unwrap();
}

#[test]
fn the_command_line_makes_tokens_while_the_service_runs() {
    let service = TestService::start(Idle, &["--require-tokens"]);
    let run = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_afterimage"))
            .args(["token", "--data", service.data.path().to_str().unwrap()])
            .args(arguments)
            .output()
            .unwrap();
        (
            output.status.code(),
            String::from_utf8(output.stdout).unwrap(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    let (status, text, note) = run(&[
        "create",
        "nightly",
        "--scopes",
        "read,submit",
        "--expires-days",
        "7",
        "--rate",
        "6000",
    ]);
    assert_eq!(status, Some(0), "{note}");
    let text = text.trim();
    assert!(
        text.starts_with("aft_") && text.len() == 68 && note.contains("not shown again"),
        "{text} {note}"
    );
    let put = service.client().send(
        "PUT",
        "/sequences/pan",
        &[("authorization", &format!("Bearer {text}"))],
        &packed("pan"),
    );
    assert_eq!(put.status, 201, "{}", put.text());
    let (_, list, _) = run(&["list"]);
    assert!(
        list.contains("nightly")
            && list.contains("read,submit")
            && list.contains(&text[..12])
            && !list.contains(&text[..16]),
        "{list}"
    );
    assert_eq!(run(&["revoke", "1"]).0, Some(0));
    assert_eq!(run(&["revoke", "1"]).0, Some(2));
    let (status, _, complaint) = run(&["create", "x", "--scopes", "write"]);
    assert!(status == Some(2) && complaint.contains("submit"), "{complaint}");
}

#[test]
fn an_approval_bears_the_tokens_name() {
    let service = TestService::start(Idle, &["--require-tokens"]);
    let (_, both) = token(service.data.path(), &[Scope::Submit, Scope::Approve], None, None);
    let client = service.client();
    let bearer = format!("Bearer {both}");
    let headers = [("authorization", bearer.as_str())];
    let report = json!({"sequence": "s", "system": "e", "values": {"psnr": 30}});
    assert_eq!(client.post_with("/reports", &report, &headers).status, 201);
    let decided = client.post_with(
        "/reports/1/decisions",
        &json!({"decision": "approved", "why": "fine", "who": "somebody else"}),
        &headers,
    );
    assert_eq!((decided.status, &decided.json()["who"]), (201, &json!("test")));
}
