//! Telling others of verdicts.

use crate::support::service::{Client, Idle, TestService};
use hmac::{Hmac, Mac as _};
use serde_json::{Value, json};
use std::{
    io::{BufRead as _, BufReader, Read as _, Write as _},
    net::TcpListener,
    sync::mpsc,
    time::Duration,
};

fn judged(client: &Client, commit: &str, value: f64, rules: &Value) {
    let report = json!({"sequence": "ship", "system": "engine", "branch": "main", "commit": commit,
        "values": {"psnr": value}, "rules": rules});
    client.posted("/reports", &report);
}

/// Takes one HTTP request and answers with a status; its headers and body.
fn take(listener: &TcpListener, status: &str) -> (Vec<String>, String) {
    let (stream, _) = listener.accept().unwrap();
    let mut reader = BufReader::new(stream.try_clone().unwrap());
    let (mut headers, mut length) = (Vec::new(), 0);
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
            length = value.trim().parse().unwrap();
        }
        match line.trim_end() {
            "" => break,
            line => headers.push(line.to_owned()),
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).unwrap();
    (&stream)
        .write_all(format!("HTTP/1.1 {status}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n").as_bytes())
        .unwrap();
    (headers, String::from_utf8(body).unwrap())
}

#[test]
fn webhooks_hear_of_verdicts_signed_and_again_if_they_were_deaf() {
    let service = TestService::start(Idle, &["--private-webhooks"]);
    let client = service.client();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/hook", listener.local_addr().unwrap());
    let made = client.post("/webhooks", &json!({"url": url}));
    assert_eq!(made.status, 201, "{}", made.text());
    let secret = made.json()["secret"].as_str().unwrap().to_owned();
    assert!(
        !client.get("/webhooks").text().contains(&secret),
        "a secret is shown once"
    );
    let (sender, requests) = mpsc::channel();
    let thread = std::thread::spawn(move || sender.send(take(&listener, "500 Oh")).unwrap());
    judged(&client, "bad", 20.0, &json!({"rule": [{"metric": "psnr", "min": 30}]}));
    let (headers, body) = requests.recv_timeout(Duration::from_secs(20)).unwrap();
    thread.join().unwrap();
    let header = |name: &str| {
        let line = headers.iter().find(|line| line.to_lowercase().starts_with(name));
        line.and_then(|line| line.split_once(": "))
            .map(|(_, value)| value.to_owned())
            .unwrap_or_default()
    };
    let signature = header("x-afterimage-signature");
    let (seconds, hex) = signature.strip_prefix("t=").unwrap().split_once(",v1=").unwrap();
    let mut mac = Hmac::<sha2::Sha256>::new_from_slice(secret.as_bytes()).unwrap();
    mac.update(format!("{seconds}.{body}").as_bytes());
    let expected: String = mac
        .finalize()
        .into_bytes()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    assert_eq!(hex, expected);
    let payload: Value = serde_json::from_str(&body).unwrap();
    assert_eq!(
        (
            &payload["outcome"],
            &payload["commit"],
            &payload["regressions"][0]["metric"]
        ),
        (&json!("regression"), &json!("bad"), &json!("psnr"))
    );
    assert_eq!(header("x-afterimage-event"), "verdict");
    let deadline = std::time::Instant::now() + Duration::from_secs(10);
    let delivery = loop {
        let delivery = client.get("/webhooks/1/deliveries").json()["deliveries"][0].clone();
        if delivery["attempts"] == 1 {
            break delivery;
        }
        assert!(std::time::Instant::now() < deadline, "{delivery}");
    };
    assert_eq!(delivery["status"], "waiting", "it is tried again");
    assert!(delivery["last_error"].as_str().unwrap().contains("500"), "{delivery}");
    assert_eq!(client.send("DELETE", "/webhooks/1", &[], &[]).status, 204);
    client
        .send("DELETE", "/webhooks/1", &[], &[])
        .is_problem(404, "not_found", None, "webhook 1");
    client
        .get("/webhooks/1/deliveries")
        .is_problem(404, "not_found", None, "webhook 1");
}

#[test]
fn a_webhook_that_does_not_answer_holds_up_no_other() {
    let service = TestService::start(Idle, &["--private-webhooks"]);
    let client = service.client();
    let listeners = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    for listener in &listeners {
        let url = format!("http://{}/hook", listener.local_addr().unwrap());
        assert_eq!(client.post("/webhooks", &json!({"url": url})).status, 201);
    }
    let rules = json!({"rule": [{"metric": "psnr", "min": 30}]});
    judged(&client, "one", 20.0, &rules);
    judged(&client, "two", 20.0, &rules);
    let commits = [(); 2].map(|()| take(&listeners[1], "200 OK").1).map(|body| {
        let body: Value = serde_json::from_str(&body).unwrap();
        body["commit"].clone()
    });
    assert_eq!(commits, ["one", "two"]);
    let deliveries = client.get("/webhooks/1/deliveries").json();
    assert_eq!(
        deliveries["deliveries"][1]["attempts"], 0,
        "the first is still under way"
    );
}

#[test]
fn webhooks_do_not_lead_into_this_machine() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for url in [
        "http://127.0.0.1:1/",
        "http://localhost/",
        "http://169.254.169.254/",
        "http://[::1]/",
        "ftp://93.184.216.34/",
        "nonsense",
    ] {
        let answer = client.post("/webhooks", &json!({"url": url}));
        assert_eq!(
            (answer.status, answer.json()["code"].as_str()),
            (422, Some("invalid_url")),
            "{url}: {}",
            answer.text()
        );
    }
    assert_eq!(client.get("/webhooks").json()["webhooks"], json!([]));
}
