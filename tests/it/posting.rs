//! Results measured elsewhere, and how the API treats clients that ask again, ask for a page, or ask for less.

use crate::support::service::{Client, Idle, TestService, packed};
use serde_json::{Value, json};
use std::io::Read as _;

/// A report of three frames.
pub fn report(change: Value) -> Value {
    let mut report = json!({"sequence": "bistro", "system": "engine", "branch": "main", "commit": "c1",
        "frames": [
            {"index": 0, "warmup": true, "reset": true, "metrics": {"psnr": 10, "mine": 5}},
            {"index": 1, "metrics": {"psnr": 30.5, "mine": 1}, "times_ms": {"taa": 0.5, "post": 0.25}},
            {"index": 2, "metrics": {"psnr": "inf", "mine": 3}, "times_ms": {"taa": 0.7, "post": 0.25}}]});
    report
        .as_object_mut()
        .unwrap()
        .extend(change.as_object().unwrap().clone());
    report
}

#[test]
fn a_posted_report_is_read_like_any_other() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let origin = json!({"project": "demo", "parent": "c0", "pull_request": "17", "engine_version": "5.4", "label": "night",
        "labels": {"map": "day"}, "environment": {"adapter": {"name": "RTX", "driver": "nv", "driver_version": "1"}, "os": "win", "clocks": "locked"},
        "parameters": {"quality": "high"}, "metric_versions": {"mine": 3}});
    let answer = client.post("/reports", &report(origin));
    assert_eq!(answer.status, 201, "{}", answer.text());
    let id = answer.json()["id"].as_i64().unwrap();
    assert_eq!(answer.header("location"), format!("/api/v1/reports/{id}"));

    let stored = client.get(&format!("/reports/{id}")).json();
    assert_eq!(
        (&stored["kind"], &stored["preset"], &stored["sequence_name"]),
        (&json!("external"), &json!("engine"), &json!("bistro"))
    );
    assert_eq!(
        (&stored["job_id"], &stored["sequence_hash"], &stored["complete"]),
        (&Value::Null, &Value::Null, &json!(true))
    );
    assert_eq!(
        (&stored["project"], &stored["parent"], &stored["labels"]["map"]),
        (&json!("demo"), &json!("c0"), &json!("day"))
    );
    assert_eq!(
        (&stored["adapter"]["name"], &stored["os"], &stored["clocks"]),
        (&json!("RTX"), &json!("win"), &json!("locked"))
    );
    assert_eq!(stored["values"]["mine"], 2.0, "warm-up is left out");
    assert_eq!(
        (&stored["summary"]["psnr"]["infinite"], &stored["values"]["psnr"]),
        (&json!(1), &json!(30.5))
    );
    assert_eq!(
        (&stored["metric_versions"]["mine"], &stored["metric_versions"]["psnr"]),
        (&json!(3), &json!(1))
    );
    assert_eq!(stored["gpu_time_ms"], 0.85, "0.6 of taa and 0.25 of post");

    let frames = client.get(&format!("/reports/{id}/frames")).json();
    assert_eq!(frames["frames"][2]["metrics"]["psnr"], "inf");
    let csv = client.get(&format!("/reports/{id}/frames?format=csv"));
    assert!(
        csv.text()
            .starts_with("frame,reset,warmup,repaired_texels,non_finite_pixels,mine,psnr,post_ms,taa_ms\n")
    );
    let parquet = client.get(&format!("/reports/{id}/frames?format=parquet"));
    assert_eq!(parquet.header("content-type"), "application/vnd.apache.parquet");
    assert_eq!(
        (&parquet.body[..4], &parquet.body[parquet.body.len() - 4..]),
        (&b"PAR1"[..], &b"PAR1"[..])
    );

    let series = stored["series_id"].as_i64().unwrap();
    assert_eq!(
        client.get(&format!("/series/{series}")).json()["parameters"]["quality"],
        "high"
    );
    let points = client
        .get(&format!("/series/{series}/points?metric=mine&branch=main"))
        .json();
    assert_eq!(
        (
            &points["n_points"],
            &points["points"][0]["commit"],
            &points["points"][0]["value"]
        ),
        (&json!(1), &json!("c1"), &json!(2.0))
    );
    let table = client.send(
        "GET",
        &format!("/series/{series}/points?metric=psnr"),
        &[("accept", "text/csv")],
        &[],
    );
    assert!(
        table
            .text()
            .starts_with("report,job,created_at,branch,commit,metric_version,value\n"),
        "{}",
        table.text()
    );
    assert!(table.text().trim_end().ends_with(",main,c1,1,30.5"), "{}", table.text());
    assert_eq!(client.get("/projects").json()["projects"], json!(["default", "demo"]));
    assert_eq!(
        client.get("/projects/demo/branches").json()["branches"][0]["name"],
        "main"
    );
    assert_eq!(
        client.get("/environments").json()["environments"][0]["adapter"]["name"],
        "RTX"
    );
    let page = ureq::get(service.url(&format!("/reports/{id}")))
        .call()
        .unwrap()
        .body_mut()
        .read_to_string()
        .unwrap();
    assert!(page.contains("engine") && page.contains("30.50"), "{page}");
}

#[test]
fn a_name_means_the_stored_sequence_where_there_is_one() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let before = client.posted("/reports", &report(json!({"sequence": "pan"})));
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let posted = client.posted("/reports", &report(json!({"sequence": "pan"})));
    let stored = client.get(&format!("/reports/{}", posted["id"])).json();
    assert_eq!(stored["sequence_hash"], client.get("/sequences/pan").json()["hash"]);
    let image = client.get(&format!("/reports/{}/frames/1/reference.png", posted["id"]));
    assert_eq!(image.status, 200);
    client
        .get(&format!("/reports/{}/frames/1/output.png", posted["id"]))
        .is_problem(404, "not_found", None, "only numbers");
    let unknown = client.posted("/reports", &report(json!({})));
    client
        .get(&format!("/reports/{}/frames/1/reference.png", unknown["id"]))
        .is_problem(404, "not_found", None, "known by name only");
    // A chart of the name goes back to before the sequence was put.
    let trends = ureq::get(service.url("/trends?sequence=pan")).call().unwrap();
    let trends = trends.into_body().read_to_string().unwrap();
    let shows = |posted: &Value| trends.contains(&format!("href=\"/reports/{}\"", posted["id"]));
    assert_eq!([&before, &posted, &unknown].map(shows), [true, true, false]);
    // Another name for the same content shows in what was read before.
    let job = client.start_job(&json!({"sequence": "pan", "presets": ["ema"]}));
    client.wait_for(job, &["failed"]);
    let names = || {
        let name = |path: String, list: &str| client.get(&path).json().pointer(list).cloned();
        [
            name(format!("/reports/{}", posted["id"]), "/sequence_name"),
            name("/reports?sequence=pan&limit=1".to_owned(), "/reports/0/sequence_name"),
            name(format!("/jobs/{job}"), "/sequence_name"),
            name("/jobs?limit=1".to_owned(), "/jobs/0/sequence_name"),
        ]
    };
    assert_eq!(names(), [(); 4].map(|()| Some(json!("pan"))));
    assert_eq!(client.put("panorama", &packed("pan")).status, 200);
    assert_eq!(names(), [(); 4].map(|()| Some(json!("panorama"))));
}

#[test]
fn every_mistake_of_a_report_is_named() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let post = |change: Value| client.post("/reports", &report(change));
    post(json!({"frames": []})).is_problem(422, "invalid_field", Some("frames"), "no numbers");
    post(json!({"values": {"psnr": 1}})).is_problem(422, "invalid_field", Some("values"), "computed from frames");
    post(json!({"frames": [{"index": 1}]})).is_problem(422, "invalid_field", Some("frames"), "no numbers");
    let twice = json!({"index": 1, "metrics": {"psnr": 1}});
    post(json!({"frames": [twice, twice]})).is_problem(422, "invalid_field", Some("frames"), "twice");
    for (metrics, passes) in [
        (json!({"frame": 1}), json!({})),
        (json!({"taa_ms": 1}), json!({"taa": 1})),
        (json!({"gpu_time_ms": 1}), json!({"taa": 1})),
    ] {
        let frame = json!({"index": 0, "metrics": metrics, "times_ms": passes});
        post(json!({"frames": [frame]})).is_problem(422, "invalid_field", Some("frames"), "have it already");
    }
    post(json!({"frames": 1})).is_problem(422, "invalid_field", Some("frames"), "expected an array");
    client.post("/reports", &json!({"sequence": "ship"})).is_problem(
        422,
        "missing_field",
        Some("system"),
        "missing field",
    );
    let named_twice = |body: &str, path: &str, field: &str| {
        let json = [("content-type", "application/json")];
        client.send("POST", path, &json, body.as_bytes()).is_problem(
            422,
            "invalid_field",
            Some(field),
            "appears twice",
        );
    };
    let frame = r#"{"sequence": "a", "system": "b", "frames": [{"index": 0, "metrics": {"flip": 0.1, "flip": 0.2}}]}"#;
    named_twice(frame, "/reports", "frames[0].metrics");
    named_twice(
        r#"{"a": {"b": {"value": 1}, "b": {"value": 2}}}"#,
        "/reports/bencher",
        "a",
    );
    post(json!({"frames": [{"index": 1, "metrics": {"a b": 1}}]})).is_problem(
        422,
        "invalid_field",
        Some("frames[0].metrics"),
        "no id",
    );
    post(json!({"frames": [{"index": 0, "times_ms": {"taa": -1}}]})).is_problem(
        422,
        "invalid_field",
        Some("frames[0].times_ms"),
        "at least 0",
    );
    post(json!({"frames": [{"index": 0, "metrics": {"psnr": "big"}}]})).is_problem(
        422,
        "invalid_field",
        Some("frames[0].metrics.psnr"),
        "-inf",
    );
    post(json!({"frames": [{"idx": 0}]})).is_problem(422, "unknown_field", Some("frames[0].idx"), "idx");
    post(json!({"frams": []})).is_problem(422, "unknown_field", Some("frams"), "frames");
    post(json!({"sequence": "no spaces"})).is_problem(422, "invalid_field", Some("sequence"), "letters");
    post(json!({"sequence": "a".repeat(64)})).is_problem(422, "unknown_sequence", Some("sequence"), "hash");
    post(json!({"system": ""})).is_problem(422, "invalid_field", Some("system"), "letters");
    post(json!({"project": "../x"})).is_problem(422, "invalid_field", Some("project"), "letters");
    post(json!({"commit": "x".repeat(300)})).is_problem(422, "invalid_field", Some("commit"), "200");
    post(json!({"from": {"branch": "x".repeat(300)}})).is_problem(422, "invalid_field", Some("from.branch"), "200");
    post(json!({"environment": {"os": "x".repeat(300)}})).is_problem(422, "invalid_field", Some("environment"), "200");
    post(json!({"rules": {"rule": [{"metric": "psnr"}]}})).is_problem(
        422,
        "invalid_rules",
        Some("rules.rule[0].metric"),
        "asks for nothing",
    );
    client
        .post("/reports", &json!({"sequence": "a"}))
        .is_problem(422, "missing_field", Some("system"), "missing");
    client
        .post("/reports/1/frames", &json!({"frames": [{"index": 0}]}))
        .is_problem(404, "not_found", None, "report 1");
    client.post("/reports/1/frames", &json!({"frames": []})).is_problem(
        422,
        "invalid_field",
        Some("frames"),
        "at least one",
    );
    client
        .post("/reports/1/close", &json!({}))
        .is_problem(404, "not_found", None, "report 1");
    client.get("/series/1").is_problem(404, "not_found", None, "series 1");
    client
        .get("/series/1/points?metric=psnr")
        .is_problem(404, "not_found", None, "series 1");
    client
        .get("/series/1/points?metric=psnr&max_points=1")
        .is_problem(400, "bad_query", Some("max_points"), "4 to");
    client
        .get("/series/1/points?metric=psnr&limit=0")
        .is_problem(400, "bad_query", Some("limit"), "1 to");
    client
        .get("/projects/none/branches")
        .is_problem(404, "not_found", None, "none");
    assert_eq!(
        client.get("/reports").json()["reports"],
        json!([]),
        "nothing was stored"
    );
}

#[test]
fn frames_come_one_by_one_and_count_once_the_report_is_closed() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let opened = client.posted(
        "/reports",
        &json!({"sequence": "live", "system": "engine", "open": true}),
    );
    let id = opened["id"].as_i64().unwrap();
    assert_eq!(opened["complete"], false);
    for index in 0..5 {
        let frame = json!({"frames": [{"index": index, "metrics": {"psnr": 30 + index}}]});
        assert_eq!(client.posted(&format!("/reports/{id}/frames"), &frame)["n_frames"], 1);
    }
    client.posted(
        &format!("/reports/{id}/frames"),
        &json!({"frames": [{"index": 4, "metrics": {"ssim": 0.5}}]}),
    );
    assert_eq!(client.get("/reports").json()["reports"], json!([]));
    assert_eq!(client.get(&format!("/reports/{id}")).json()["complete"], false);
    assert_eq!(client.get("/series?metric=psnr").json()["series"], json!([]));
    assert_eq!(
        client.posted(&format!("/reports/{id}/close"), &json!({}))["complete"],
        true
    );
    let stored = client.get(&format!("/reports/{id}")).json();
    assert_eq!(
        (&stored["values"]["psnr"], &stored["values"]["ssim"]),
        (&json!(32.0), &json!(0.5))
    );
    assert_eq!(
        client.get("/series?metric=psnr").json()["series"][0]["points"][0]["value"],
        32.0
    );
    client
        .post(&format!("/reports/{id}/close"), &json!({}))
        .is_problem(409, "report_complete", None, "complete");
    let late = json!({"frames": [{"index": 9, "metrics": {"psnr": 1}}]});
    client
        .post(&format!("/reports/{id}/frames"), &late)
        .is_problem(409, "report_complete", None, "complete");
}

#[test]
fn a_request_with_a_key_is_done_once() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let body = report(json!({}));
    let post = |body: &Value, key: &str| client.post_with("/reports", body, &[("idempotency-key", key)]);
    // Two clients race with the same key: whoever comes second hears the same answer, or to ask again in a moment.
    let answers: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..8)
            .map(|_| scope.spawn(|| Client(service.address).post_with("/reports", &body, &[("idempotency-key", "k1")])))
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    for answer in &answers {
        match answer.status {
            201 => {}
            409 => {
                answer.is_problem(409, "request_in_progress", None, "in a moment");
                assert_eq!(answer.header("retry-after"), "1");
            }
            other => panic!("{other}: {}", answer.text()),
        }
    }
    assert!(answers.iter().any(|answer| answer.status == 201));
    assert_eq!(client.get("/reports").json()["reports"].as_array().unwrap().len(), 1);
    let again = post(&body, "k1");
    let first = answers.iter().find(|answer| answer.status == 201).unwrap();
    assert_eq!(
        (again.status, again.header("idempotency-replayed"), &again.body),
        (201, "true", &first.body)
    );
    assert_eq!(again.header("location"), first.header("location"));
    assert_eq!(again.header("content-type"), "application/json");
    post(&report(json!({"commit": "c2"})), "k1").is_problem(
        422,
        "idempotency_key_reused",
        Some("idempotency-key"),
        "of its own",
    );
    client
        .post_with("/verdicts", &body, &[("idempotency-key", "k1")])
        .is_problem(
            422,
            "idempotency_key_reused",
            Some("idempotency-key"),
            "another request",
        );
    // What was refused was not done, and may be corrected.
    post(&json!({"sequence": "a"}), "k2").is_problem(422, "missing_field", Some("system"), "missing");
    assert_eq!(post(&body, "k2").status, 201);
    let broken = [
        ("content-type", "application/json"),
        ("content-encoding", "gzip"),
        ("idempotency-key", "k9"),
    ];
    client
        .send("POST", "/reports", &broken, b"no gzip")
        .is_problem(400, "bad_body", None, "");
    post(&body, "two words").is_problem(400, "bad_idempotency_key", Some("idempotency-key"), "printable");
    // A restart forgets nothing.
    let service = TestService::start_in(service.stop(), Idle, &[]);
    let again = service
        .client()
        .post_with("/reports", &body, &[("idempotency-key", "k1")]);
    assert_eq!((again.status, &again.body), (201, &first.body));
}

#[test]
fn pages_neither_repeat_nor_hide() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for i in 0..7 {
        client.posted("/reports", &report(json!({"commit": format!("c{i}")})));
    }
    let (mut seen, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = client.get(&format!("/reports?limit=3{cursor}")).json();
        seen.extend(
            page["reports"]
                .as_array()
                .unwrap()
                .iter()
                .map(|report| report["id"].as_i64().unwrap()),
        );
        // What comes meanwhile belongs on no later page.
        client.posted("/reports", &report(json!({})));
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(seen, (1..=7).rev().collect::<Vec<_>>());
    client
        .get("/reports?cursor=7")
        .is_problem(400, "bad_query", Some("cursor"), "next_cursor");
    client
        .get("/reports?limit=0")
        .is_problem(400, "bad_query", Some("limit"), "1 to 1000");
    let of_commit = client.get("/reports?commit=c3").json();
    assert_eq!(of_commit["reports"].as_array().unwrap().len(), 1);
    assert_eq!(client.get("/reports?branch=none").json()["reports"], json!([]));
    assert_eq!(
        client.get("/reports?latest=true").json()["reports"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
}

#[test]
fn long_series_are_thinned_with_their_peaks() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for i in 0..40 {
        let value = if i == 17 { 99.0 } else { f64::from(i % 3) };
        client.posted(
            "/reports",
            &json!({"sequence": "s", "system": "e", "values": {"psnr": value}, "commit": i.to_string()}),
        );
    }
    let points = client.get("/series/1/points?metric=psnr&max_points=10").json();
    assert_eq!(points["n_points"], 40);
    let kept = points["points"].as_array().unwrap();
    assert!(
        kept.len() <= 10 && kept.iter().any(|point| point["value"] == 99.0),
        "{points}"
    );
    assert_eq!(
        (&kept[0]["commit"], &kept[kept.len() - 1]["commit"]),
        (&json!("0"), &json!("39"))
    );
    let until = kept[0]["created_at"].as_str().unwrap();
    assert!(until.ends_with('Z'));
    assert_eq!(
        client.get("/series/1/points?metric=psnr&until_ms=0").json()["points"],
        json!([])
    );
}

#[test]
fn what_a_client_has_is_not_sent_again_and_text_is_compressed() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for path in ["/recipes", "/presets", "/metrics", "/openapi.json", "/reports"] {
        let first = client.get(path);
        let tag = first.header("etag").to_owned();
        assert!(tag.starts_with("W/\""), "{path}");
        let again = client.send("GET", path, &[("if-none-match", &format!("\"other\", {tag}"))], &[]);
        assert_eq!(
            (again.status, again.body.len(), again.header("etag")),
            (304, 0, tag.as_str()),
            "{path}"
        );
        assert_eq!(
            client
                .send("GET", path, &[("if-none-match", "W/\"other\"")], &[])
                .status,
            200
        );
    }
    let tag = client.get("/reports").header("etag").to_owned();
    client.posted("/reports", &report(json!({})));
    assert_eq!(
        client.send("GET", "/reports", &[("if-none-match", &tag)], &[]).status,
        200,
        "it has changed"
    );

    // ureq would unpack it unseen.
    let agent: ureq::Agent = ureq::Agent::config_builder().accept_encoding("identity").build().into();
    let plain = agent
        .get(service.url("/api/v1/recipes"))
        .call()
        .unwrap()
        .body_mut()
        .read_to_vec()
        .unwrap();
    let mut stream = std::net::TcpStream::connect(service.address).unwrap();
    std::io::Write::write_all(
        &mut stream,
        b"GET /api/v1/recipes HTTP/1.1\r\nhost: localhost\r\naccept-encoding: gzip\r\nconnection: close\r\n\r\n",
    )
    .unwrap();
    let mut raw = Vec::new();
    stream.read_to_end(&mut raw).unwrap();
    let head = String::from_utf8_lossy(&raw[..raw.len().min(2000)]).to_lowercase();
    assert!(head.contains("content-encoding: gzip"), "{head}");
    assert!(raw.len() < plain.len() / 3, "{} of {}", raw.len(), plain.len());

    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut packed, report(json!({})).to_string().as_bytes()).unwrap();
    let headers = [("content-type", "application/json"), ("content-encoding", "gzip")];
    assert_eq!(
        client
            .send("POST", "/reports", &headers, &packed.finish().unwrap())
            .status,
        201
    );
    let headers = [("content-type", "application/json"), ("content-encoding", "br")];
    client.send("POST", "/reports", &headers, b"\x0b").is_problem(
        415,
        "unknown_encoding",
        Some("content-encoding"),
        "gzip",
    );
}

#[test]
fn operators_see_how_it_is() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let get = |path: &str| {
        ureq::get(service.url(path))
            .call()
            .unwrap()
            .body_mut()
            .read_to_string()
            .unwrap()
    };
    assert!(get("/healthz").contains("ok"));
    assert!(get("/readyz").contains("no adapter in this test"));
    client.posted("/reports", &report(json!({})));
    let metrics = get("/metrics");
    let line = "afterimage_http_requests_total{method=\"POST\",route=\"/api/v1/reports\",status=\"201\"} 1";
    assert!(metrics.contains(line), "{metrics}");
    assert!(
        metrics.contains("afterimage_http_request_duration_seconds_bucket"),
        "{metrics}"
    );
    assert!(metrics.contains("afterimage_posts_waiting 0"), "{metrics}");
    let answer = client.send("GET", "/health", &[("x-request-id", "mine-1")], &[]);
    assert_eq!(answer.header("x-request-id"), "mine-1");
    assert!(!client.get("/health").header("x-request-id").is_empty());
    assert_ne!(
        client
            .send("GET", "/health", &[("x-request-id", "not mine")], &[])
            .header("x-request-id"),
        "not mine"
    );
}
