//! The service from outside: a real listener, a real client, and for whole jobs a real worker on a GPU. What only the
//! worker's reactions need (failures, cancelling, stopping) runs scripted jobs instead.

use crate::{
    posting::report,
    support::service::{Answer, Client, Idle, Scripted, TestService, endless, fixture, packed},
};
use afterimage::{
    run::{Observer, RunError, RunSpec},
    taa,
};
use serde_json::{Value, json};
use std::{
    io::{BufRead, BufReader, Write},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering::SeqCst},
    },
    thread,
    time::{Duration, Instant},
};

const EVERY_PRESET: [&str; 5] = ["none", "ema", "inside", "karis2014", "salvi2016"];

#[test]
fn a_job_from_upload_to_trend() {
    let service = TestService::with_gpu();
    let client = service.client();
    let put = client.put("pan", &packed("pan"));
    assert_eq!(put.status, 201, "{}", put.text());
    let sequence = put.json();
    let n_frames = sequence["n_frames"].as_u64().unwrap();

    let job = json!({"sequence": "pan", "presets": EVERY_PRESET, "metrics": ["psnr", "ssim", "mse"], "repeat": 2,
                     "branch": "main", "commit": "c0ffee", "label": "first"});
    let id = client.start_job(&job);
    let events = follow(&service, id);
    assert_eq!(events.first().unwrap().0, "progress");
    assert_eq!(events.last().unwrap().0, "done", "{:?}", events.last());
    let counts: Vec<i64> = events.iter().map(|(_, job)| job["n_done"].as_i64().unwrap()).collect();
    assert!(counts.is_sorted(), "{counts:?}");

    let job = client.get(&format!("/jobs/{id}")).json();
    assert_eq!(job["n_done"], n_frames * 5);
    assert_eq!(job["sequence_hash"], sequence["hash"]);
    let reports = job["reports"].as_array().unwrap();
    let presets: Vec<_> = reports
        .iter()
        .map(|report| report["preset"].as_str().unwrap())
        .collect();
    assert_eq!(presets, EVERY_PRESET);
    for report in reports {
        let psnr = report["values"]["psnr"].as_f64().unwrap();
        assert!((10.0..80.0).contains(&psnr), "{report}");
        assert_eq!(report["values"]["psnr"], report["summary"]["psnr"]["mean"]);
        assert!(report["gpu_time_ms"].as_f64().unwrap() > 0.0, "{report}");
        assert_eq!(
            (&report["commit"], &report["branch"]),
            (&json!("c0ffee"), &json!("main"))
        );
    }
    check_rows(&client, &reports[3], n_frames);
    check_images(&client, &reports[3], sequence["hash"].as_str().unwrap());
    check_series(&client, &reports[3]);
}

/// Names and data of a job's events until the stream ends.
fn follow(service: &TestService, id: i64) -> Vec<(String, Value)> {
    let response = ureq::get(service.url(&format!("/api/v1/jobs/{id}/events")))
        .call()
        .unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let mut events = Vec::new();
    let mut name = String::new();
    for line in BufReader::new(response.into_body().into_reader()).lines() {
        let line = line.unwrap();
        if let Some(value) = line.strip_prefix("event: ") {
            name = value.to_owned();
        } else if let Some(data) = line.strip_prefix("data: ") {
            events.push((name.clone(), serde_json::from_str(data).unwrap()));
        }
    }
    events
}

fn check_rows(client: &Client, report: &Value, n_frames: u64) {
    let path = format!("/reports/{}/frames", report["id"]);
    let frames = client.get(&path).json()["frames"].clone();
    let frames = frames.as_array().unwrap();
    assert_eq!(frames.len() as u64, n_frames);
    assert!(frames.iter().enumerate().all(|(i, frame)| frame["index"] == i));
    assert!(frames[1]["times_ms"]["resolve"].is_f64(), "{}", frames[1]);

    let csv = client.get(&format!("{path}?format=csv"));
    let accepted = client.send("GET", &path, &[("accept", "text/csv")], &[]);
    assert_eq!(csv.body, accepted.body);
    assert!(csv.header("content-type").starts_with("text/csv"));
    let mut lines = csv.text().lines();
    let columns: Vec<_> = lines.next().unwrap().split(',').collect();
    let psnr = columns.iter().position(|&column| column == "psnr").unwrap();
    assert!(columns.contains(&"resolve_ms"), "{columns:?}");
    for (line, frame) in lines.zip(frames) {
        let value: f64 = line.split(',').nth(psnr).unwrap().parse().unwrap();
        assert_eq!(Some(value), frame["metrics"]["psnr"].as_f64());
    }
}

fn check_images(client: &Client, report: &Value, hash: &str) {
    let size = |answer: &Answer| {
        let png = image::load_from_memory(&answer.body).unwrap();
        (png.width(), png.height())
    };
    let base = format!("/reports/{}/frames/5", report["id"]);
    for (name, n_channels) in [
        ("input", 3),
        ("output", 3),
        ("reference", 3),
        ("error", 1),
        ("flip", 1),
        ("ssim.y", 1),
    ] {
        let png = client.get(&format!("{base}/{name}.png"));
        assert_eq!((png.status, png.header("content-type")), (200, "image/png"), "{name}");
        assert_eq!(size(&png), (64, 48), "{name}");
        let exr = client.get(&format!("{base}/{name}.exr"));
        assert_eq!((exr.status, exr.header("content-type")), (200, "image/x-exr"), "{name}");
        assert_eq!(exr.body[..4], [0x76, 0x2f, 0x31, 0x01], "{name}");
        let halves = client.get(&format!("{base}/{name}.f16"));
        assert_eq!(
            halves.header("x-afterimage-size"),
            format!("64x48x{n_channels}"),
            "{name}"
        );
        assert_eq!(halves.body.len(), 64 * 48 * n_channels * 2, "{name}");
        assert_eq!(
            halves.header("x-afterimage-scale").is_empty(),
            n_channels == 3,
            "{name}"
        );
        assert_eq!(
            size(&client.get(&format!("{base}/{name}.png?width=32"))),
            (32, 24),
            "{name}"
        );
    }
    client
        .get(&format!("{base}/output.png?width=5"))
        .is_problem(400, "bad_query", Some("width"), "16 to 4096");
    let of_sequence = client.get(&format!("/sequences/{hash}/frames/5/reference.png"));
    assert_eq!(of_sequence.body, client.get(&format!("{base}/reference.png")).body);
    let error = client.get(&format!("{base}/error.png?max=0.5"));
    assert_eq!(error.header("x-afterimage-error-max"), "0.5");
    assert_ne!(
        error.body,
        client.get(&format!("{base}/error.png")).body,
        "the scale changes the picture"
    );

    client
        .get(&format!("{base}/depth.png"))
        .is_problem(404, "not_found", None, "output, reference, error");
    client
        .get(&format!("{base}/psnr.moving.png"))
        .is_problem(404, "not_found", None, "`psnr.moving` has no map");
    client
        .get(&format!("{base}/error.png?max=0"))
        .is_problem(400, "bad_query", Some("max"), "above 0");
    let beyond = format!("/reports/{}/frames/999/output.png", report["id"]);
    client.get(&beyond).is_problem(404, "not_found", None, "frame 999");
}

fn check_series(client: &Client, report: &Value) {
    let series = client.get("/series?metric=psnr&sequence=pan&branch=main").json();
    let lines = series["series"].as_array().unwrap();
    assert_eq!(lines.len(), 5);
    let karis = lines.iter().find(|line| line["preset"] == "karis2014").unwrap();
    let point = &karis["points"][0];
    assert_eq!(
        (&point["report_id"], &point["value"]),
        (&report["id"], &report["values"]["psnr"])
    );
    assert_eq!(
        client.get("/series?metric=psnr&branch=other").json()["series"],
        json!([])
    );
    assert_eq!(
        client.get("/series?metric=gpu_time_ms&preset=ema").json()["series"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
    assert_eq!(
        client.get("/reports?preset=ema&sequence=pan").json()["reports"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
}

#[test]
fn equal_content_is_one_sequence_whatever_its_container() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let tar = packed("pan");
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(&tar).unwrap();
    let first = client.put("pan", &tar);
    let again = client.put("also-pan", &gz.finish().unwrap());
    assert_eq!((first.status, again.status), (201, 200));
    assert_eq!(first.json()["hash"], again.json()["hash"]);
    let listed = client.get("/sequences").json();
    assert_eq!(listed["sequences"].as_array().unwrap().len(), 1);
    let hash = first.json()["hash"].as_str().unwrap().to_owned();
    assert_eq!(client.get(&format!("/sequences/{hash}")).json()["name"], "also-pan");
    assert_eq!(client.get("/sequences/also-pan").json()["hash"], hash);
    // Another content may get the name.
    let kept = |name: &str| {
        let image = client.get(&format!("/sequences/{name}/frames/0/input.png"));
        image.header("cache-control").to_owned()
    };
    assert!(kept(&hash).contains("immutable"));
    assert_eq!(kept("also-pan"), "private, no-cache");
    assert_eq!(std::fs::read_dir(service.data.path().join("spool")).unwrap().count(), 0);
}

#[test]
fn what_is_no_sequence_leaves_nothing_behind() {
    let service = TestService::start(Idle, &["--max-archive-mib", "1"]);
    let client = service.client();
    client
        .put("a", b"neither tar nor zip")
        .is_problem(422, "invalid_archive", None, "neither tar");
    client
        .put("no%20spaces", b"")
        .is_problem(422, "invalid_name", Some("name"), "letters");
    client
        .put("%2e%2e", b"")
        .is_problem(422, "invalid_name", Some("name"), "only dots");
    let large = vec![0; 2 << 20];
    client
        .put("a", &large)
        .is_problem(413, "archive_too_large", None, "1 MiB");

    let manifest = std::fs::read_to_string(fixture("pan").join("manifest.json")).unwrap();
    let broken = manifest.replacen("\"schema\"", "\"shema\"", 1);
    let problem = client.put("a", &tar_of("manifest.json", broken.as_bytes()));
    assert_eq!(
        (problem.status, problem.json()["code"].as_str()),
        (422, Some("invalid_sequence"))
    );
    assert!(
        problem.json()["field"]
            .as_str()
            .is_some_and(|field| field.contains("shema")),
        "{}",
        problem.text()
    );
    let no_files = client.put("a", &tar_of("manifest.json", manifest.as_bytes()));
    no_files.is_problem(422, "invalid_sequence", None, "missing");
    assert!(
        !no_files.text().contains("spool"),
        "paths of the server are nobody's business: {}",
        no_files.text()
    );

    assert_eq!(client.get("/sequences").json()["sequences"], json!([]));
    for folder in ["spool", "sequences"] {
        assert_eq!(
            std::fs::read_dir(service.data.path().join(folder)).unwrap().count(),
            0,
            "{folder}"
        );
    }
}

/// A tar with one file.
fn tar_of(name: &str, content: &[u8]) -> Vec<u8> {
    let mut header = tar::Header::new_gnu();
    header.set_size(content.len() as u64);
    header.set_mode(0o644);
    let mut archive = tar::Builder::new(Vec::new());
    archive.append_data(&mut header, name, content).unwrap();
    archive.into_inner().unwrap()
}

#[test]
fn every_mistake_has_its_code_and_names_its_field() {
    let service = TestService::start(Idle, &["--max-json-kib", "4"]);
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let job = |change: Value| {
        let mut job = json!({"sequence": "pan", "presets": ["ema"]});
        job.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        client.post_job(&job)
    };
    let parameters = |parameters: Value| job(json!({"presets": ["none", {"preset": "ema", "parameters": parameters}]}));
    job(json!({"sequence": "pam"})).is_problem(422, "unknown_sequence", Some("sequence"), "pam");
    job(json!({"presets": []})).is_problem(422, "invalid_field", Some("presets"), "1 to");
    job(json!({"presets": ["karis"]})).is_problem(422, "unknown_preset", Some("presets[0].preset"), "karis2014");
    job(json!({"presets": [7]})).is_problem(422, "invalid_field", Some("presets[0]"), "preset's id");
    job(json!({"presets": [{"preset": "ema", "x": 1}]})).is_problem(422, "unknown_field", Some("presets[0].x"), "x");
    let unknown = Some("presets[1].parameters.curent_weight");
    parameters(json!({"curent_weight": 0.2})).is_problem(422, "invalid_parameter", unknown, "current_weight");
    let wrong = Some("presets[1].parameters.current_weight");
    parameters(json!({"current_weight": 7})).is_problem(422, "invalid_parameter", wrong, "");
    job(json!({"metrics": ["psrn"]})).is_problem(422, "invalid_field", Some("metrics[0]"), "psnr");
    job(json!({"history": "f64"})).is_problem(422, "invalid_field", Some("history"), "f16");
    job(json!({"repeat": 0})).is_problem(422, "invalid_field", Some("repeat"), "1 to");
    job(json!({"frames": 1000})).is_problem(422, "invalid_field", Some("frames"), "number of frames");
    job(json!({"images": "all"})).is_problem(422, "invalid_field", Some("images"), "half");
    job(json!({"label": "x".repeat(300)})).is_problem(422, "invalid_field", Some("label"), "200");
    job(json!({"seqence": "pan"})).is_problem(422, "unknown_field", Some("seqence"), "seqence");
    client
        .post_job(&json!({"sequence": "pan"}))
        .is_problem(422, "invalid_field", Some("presets"), "1 to");
    client
        .post_job(&json!({"presets": ["ema"]}))
        .is_problem(422, "missing_field", Some("sequence"), "missing");
    client.post_text("{").is_problem(400, "bad_json", None, "line 1");
    client
        .post_text("{} {}")
        .is_problem(422, "missing_field", Some("sequence"), "missing");
    client
        .post_text(&" ".repeat(8000))
        .is_problem(413, "body_too_large", None, "--max-json-kib");
    client
        .send("POST", "/jobs", &[], b"{}")
        .is_problem(415, "not_json", None, "application/json");
    assert_eq!(client.get("/jobs").json()["jobs"], json!([]), "nothing was queued");

    client.get("/nothing").is_problem(404, "not_found", None, "/nothing");
    client.get("/jobs/1").is_problem(404, "not_found", None, "job 1");
    client.get("/jobs/one").is_problem(404, "not_found", None, "one");
    client.get("/jobs/1/events").is_problem(404, "not_found", None, "job 1");
    client.get("/reports/1").is_problem(404, "not_found", None, "report 1");
    client.get("/sequences/nope").is_problem(404, "not_found", None, "nope");
    client
        .get("/sequences/pan/frames/99/reference.png")
        .is_problem(404, "not_found", None, "frame 99");
    client
        .get("/jobs?status=lost")
        .is_problem(400, "bad_query", Some("status"), "lost");
    client
        .get("/jobs?lmit=3")
        .is_problem(400, "bad_query", Some("lmit"), "lmit");
    client
        .get("/jobs?limit=many")
        .is_problem(400, "bad_query", Some("limit"), "invalid digit");
    client
        .get("/series?metric=psrn")
        .is_problem(422, "unknown_metric", Some("metric"), "psnr");
    client
        .send("DELETE", "/jobs/1", &[], &[])
        .is_problem(404, "not_found", None, "job 1");
    client
        .send("DELETE", "/presets", &[], &[])
        .is_problem(405, "method_not_allowed", None, "DELETE");
    client
        .get("/adapter")
        .is_problem(503, "no_adapter", None, "no adapter in this test");
    assert_eq!(client.get("/health").json()["status"], "ok");
    assert_eq!(
        client.get("/presets").json().as_array().unwrap().len(),
        taa::PRESETS.len()
    );
    assert!(
        client
            .get("/metrics")
            .json()
            .as_array()
            .unwrap()
            .iter()
            .any(|metric| metric["id"] == "psnr")
    );
}

#[test]
fn failures_are_told_apart_and_only_the_device_is_tried_again() {
    let starts = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&starts);
    let runner = Scripted(move |spec: &RunSpec, _: &dyn Observer| {
        counted.fetch_add(1, SeqCst);
        match spec.repeat {
            1 => Err(RunError::Device("the driver is gone".to_owned())),
            2 => Err(RunError::Input("frame 3 is black".to_owned())),
            _ => panic!("a mistake in the run"),
        }
    });
    let service = TestService::start(runner, &[]);
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    for (repeat, kind, code, words, n_starts) in [
        (2, "input", "invalid_input", "frame 3 is black", 1),
        (3, "internal", "internal", "a mistake in the run", 1),
        (1, "device", "gpu_failed", "the driver is gone", 3),
    ] {
        starts.store(0, SeqCst);
        let id = client.start_job(&json!({"sequence": "pan", "presets": ["ema"], "repeat": repeat}));
        let job = client.wait_for(id, &["failed"]);
        assert_eq!(
            (&job["error"]["kind"], &job["error"]["code"]),
            (&json!(kind), &json!(code))
        );
        assert!(job["error"]["message"].as_str().unwrap().contains(words), "{job}");
        assert_eq!(starts.load(SeqCst), n_starts);
        assert_eq!(follow(&service, id).last().unwrap().0, "failed");
    }
}

#[test]
fn what_is_nowhere_is_named_in_full() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    for path in ["/nope", "/", "/jobs/one"] {
        client
            .get(path)
            .is_problem(404, "not_found", None, &format!("there is nothing at /api/v1{path}"));
    }
}

#[test]
fn a_running_job_can_be_cancelled_and_a_stopped_service_gives_it_back() {
    let service = TestService::start(Scripted(endless), &[]);
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let job = json!({"sequence": "pan", "presets": ["ema"]});
    let (running, queued) = (client.start_job(&job), client.start_job(&job));
    client.wait_for(running, &["running"]);
    let cancel = |id| client.send("DELETE", &format!("/jobs/{id}"), &[], &[]);
    assert_eq!(cancel(queued).status, 200);
    assert_eq!(cancel(running).status, 202);
    assert_eq!(follow(&service, running).last().unwrap().0, "cancelled");
    assert_eq!(follow(&service, queued).last().unwrap().0, "cancelled");
    cancel(running).is_problem(409, "job_ended", None, "ended");

    let left = client.start_job(&job);
    client.wait_for(left, &["running"]);
    let data = service.stop();
    let service = TestService::start_in(data, Scripted(endless), &[]);
    let job = service.client().wait_for(left, &["running"]);
    assert_eq!(job["attempts"], 1, "handing back costs no attempt");
}

#[test]
fn a_full_queue_says_when_to_come_back() {
    let service = TestService::start(Scripted(endless), &["--max-queued-jobs", "1"]);
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let job = json!({"sequence": "pan", "presets": ["ema"]});
    let running = client.start_job(&job);
    client.wait_for(running, &["running"]);
    client.start_job(&job);
    let refused = client.post_job(&job);
    refused.is_problem(503, "busy", None, "--max-queued-jobs");
    assert_eq!(refused.header("retry-after"), "30");
}

#[test]
fn a_client_that_heard_an_event_is_not_told_it_again() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let id = client.start_job(&json!({"sequence": "pan", "presets": ["ema"]}));
    client.wait_for(id, &["failed"]);
    let path = format!("/jobs/{id}/events");
    let first = client.get(&path);
    let last_id = first.text().lines().rev().find_map(|line| line.strip_prefix("id: "));
    let last_id = last_id.unwrap().to_owned();
    assert_eq!(
        client.send("GET", &path, &[("last-event-id", &last_id)], &[]).status,
        204
    );
    let other = client.send("GET", &path, &[("last-event-id", "progress-0-0-0")], &[]);
    assert!(other.text().contains("event: failed"), "{}", other.text());
}

#[test]
fn posts_wait_for_others_while_a_job_runs() {
    const DISTANCE: Duration = Duration::from_millis(40);
    let service = TestService::start(Scripted(endless), &[]);
    let client = service.client();
    client.put("pan", &packed("pan"));
    let id = client.start_job(&json!({"sequence": "pan", "presets": ["none"]}));
    while client.wait_for(id, &["running"])["n_done"] == 0 {
        thread::sleep(Duration::from_millis(20));
    }
    let start = Instant::now();
    for _ in 0..4 {
        client.posted("/reports", &report(json!({})));
    }
    assert!(start.elapsed() >= 3 * DISTANCE, "{:?}", start.elapsed());
}

/// The check of a sequence, once it is there.
fn wait_for_check(client: &Client, sequence: &str) -> Value {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let check = client.get(&format!("/sequences/{sequence}")).json()["check"].clone();
        if check["status"] != "pending" {
            return check;
        }
        assert!(Instant::now() < deadline, "not checked after a minute");
        thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn every_new_sequence_is_checked_and_its_page_warns() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let wrong = crate::sequence::copy_of("pan");
    crate::sequence::edit(&wrong, |manifest| manifest["motion"]["y"] = json!("down"));
    let mut archive = Vec::new();
    let sequence = afterimage::sequence::Sequence::open(wrong.path(), &crate::sequence::reader()).unwrap();
    sequence.pack(&mut archive).unwrap();
    for (name, archive) in [("right", packed("pan")), ("wrong", archive)] {
        assert_eq!(client.put(name, &archive).status, 201);
    }
    let right = wait_for_check(&client, "right");
    assert_eq!(
        (&right["status"], &right["n_warnings"]),
        (&json!("done"), &json!(0)),
        "{right}"
    );
    let found = wait_for_check(&client, "wrong");
    assert_eq!(
        (&found["findings"][0]["id"], &found["n_warnings"]),
        (&json!("motion.y"), &json!(1)),
        "{found}"
    );
    assert!(client.get("/sequences").json()["sequences"][0].get("check").is_none());

    let page = |name: &str| {
        let mut response = ureq::get(service.url(&format!("/sequences/{name}"))).call().unwrap();
        response.body_mut().read_to_string().unwrap()
    };
    assert!(page("wrong").contains("motion y looks flipped"));
    assert!(!page("right").contains("notice bad") && page("right").contains("Confirmed by the pixels"));

    // What was found outlives the service; nothing is checked again.
    let checked_at = found["checked_at"].clone();
    let data = service.stop();
    let service = TestService::start_in(data, Idle, &[]);
    assert_eq!(wait_for_check(&service.client(), "wrong")["checked_at"], checked_at);
}
