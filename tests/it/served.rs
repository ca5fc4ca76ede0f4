//! The program itself, serving.

use crate::support::service::{Client, Idle, TestService, packed};
use serde_json::json;
use std::{
    fs,
    io::{Read as _, Write as _},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

/// A process that serves a folder, until it is dropped.
struct Served {
    process: Child,
    client: Client,
}

impl Served {
    fn start(data: &Path) -> Self {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let process = Command::new(env!("CARGO_BIN_EXE_afterimage"))
            .args(["serve", "--listen", &port.to_string(), "--data", data.to_str().unwrap()])
            .env_remove("LP_NUM_THREADS")
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let served = Self {
            process,
            client: Client(port),
        };
        let deadline = Instant::now() + Duration::from_secs(20);
        while ureq::get(format!("http://{port}/api/v1/health")).call().is_err() {
            assert!(Instant::now() < deadline, "the service does not answer");
            thread::sleep(Duration::from_millis(50));
        }
        served
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // SIGKILL, as a crash.
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

#[test]
fn a_killed_service_takes_its_job_up_again() {
    let data = tempfile::tempdir().unwrap();
    let served = Served::start(data.path());
    assert_eq!(served.client.put("pan", &packed("pan")).status, 201);
    let presets = ["none", "ema", "inside", "karis2014", "salvi2016"];
    let job = json!({"sequence": "pan", "presets": presets, "repeat": 100, "history": "f32"});
    let id = served.client.start_job(&job);
    let deadline = Instant::now() + Duration::from_secs(30);
    loop {
        let job = served.client.wait_for(id, &["running"]);
        if job["n_done"].as_i64() > Some(0) {
            break;
        }
        assert!(Instant::now() < deadline, "{job}");
        thread::sleep(Duration::from_millis(20));
    }
    drop(served);

    let served = Served::start(data.path());
    let job = served.client.wait_for(id, &["done", "failed"]);
    assert_eq!((&job["status"], &job["attempts"]), (&json!("done"), &json!(2)), "{job}");
    assert_eq!(job["reports"].as_array().unwrap().len(), 5);
}

#[test]
fn the_service_gives_lavapipe_four_threads_a_core() {
    let data = tempfile::tempdir().unwrap();
    let served = Served::start(data.path());
    let environment = fs::read_to_string(format!("/proc/{}/environ", served.process.id())).unwrap();
    let n_threads = environment
        .split('\0')
        .find_map(|it| it.strip_prefix("LP_NUM_THREADS="));
    let n_cores = thread::available_parallelism().unwrap().get();
    assert_eq!(n_threads, Some((4 * n_cores).to_string().as_str()));
}

#[test]
fn a_client_that_sends_nothing_more_is_let_go() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let path = format!("/blobs/{}", "0".repeat(64));
    let begun = Instant::now();
    let mut silent = TcpStream::connect(service.address).unwrap();
    silent.write_all(b"GET /api/v1/rep").unwrap();
    let mut upload = TcpStream::connect(service.address).unwrap();
    let head = format!("PUT /api/v1{path} HTTP/1.1\r\nhost: localhost\r\ncontent-length: 9\r\n\r\nhalf");
    upload.write_all(head.as_bytes()).unwrap();
    for stream in [&silent, &upload] {
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    }
    while client.send("HEAD", &path, &[], &[]).status != 204 {
        assert!(begun.elapsed() < Duration::from_secs(15), "the upload does not begin");
        thread::sleep(Duration::from_millis(20));
    }
    client
        .send("PUT", &path, &[], b"")
        .is_problem(409, "upload_in_progress", None, "somebody else");
    let mut answer = String::new();
    upload.read_to_string(&mut answer).unwrap();
    assert!(answer.contains("upload_broken"), "{answer}");
    // Whoever sent it may go on with it.
    let offset = client.send("HEAD", &path, &[], &[]);
    assert_eq!((offset.status, offset.header("upload-offset")), (204, "4"));
    client
        .send("PUT", &path, &[("content-range", "bytes 4-8/9")], b"other")
        .is_problem(422, "wrong_hash", Some("sha256"), "SHA-256");
    assert_eq!(silent.read(&mut [0]).unwrap(), 0);
    assert!(begun.elapsed() > Duration::from_secs(15), "nobody was waited for");
}

#[test]
fn a_client_that_sends_nothing_more_does_not_keep_a_service_from_stopping() {
    let mut service = TestService::start(Idle, &[]);
    let mut silent = TcpStream::connect(service.address).unwrap();
    silent.write_all(b"GET /api/v1/rep").unwrap();
    let mut upload = TcpStream::connect(service.address).unwrap();
    upload
        .write_all(b"PUT /api/v1/sequences/a HTTP/1.1\r\nhost: localhost\r\ncontent-length: 9\r\n\r\nhalf")
        .unwrap();
    // What nobody has read yet is no request, and is dropped at once.
    thread::sleep(Duration::from_millis(500));
    let stop = Instant::now();
    let ended = thread::spawn(move || service.end());
    while !ended.is_finished() {
        assert!(stop.elapsed() < Duration::from_secs(20), "the service does not stop");
        thread::sleep(Duration::from_millis(50));
    }
    assert!(stop.elapsed() > Duration::from_secs(5), "nobody was waited for");
}

/// A pool must not give the next request to a connection that closes.
#[test]
fn what_was_not_read_is_read_or_ends_the_connection() {
    let service = TestService::start(Idle, &["--require-tokens"]);
    let connect = |head: &str, n_bytes: usize| {
        let mut stream = TcpStream::connect(service.address).unwrap();
        write!(
            stream,
            "{head} HTTP/1.1\r\nhost: localhost\r\ncontent-length: {n_bytes}\r\n\r\n"
        )
        .unwrap();
        stream
    };
    for head in ["POST /api/v1/reports", "DELETE /healthz"] {
        // The body never comes.
        let mut answer = String::new();
        connect(head, 10).read_to_string(&mut answer).unwrap();
        assert!(
            answer.to_lowercase().contains("\r\nconnection: close\r\n"),
            "{head}: {answer}"
        );
        // It comes, later, and behind it another request.
        let mut stream = connect(head, 10);
        thread::sleep(Duration::from_millis(20));
        write!(
            stream,
            "{:10}GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n",
            ""
        )
        .unwrap();
        let mut answers = String::new();
        stream.read_to_string(&mut answers).unwrap();
        assert!(answers.contains("HTTP/1.1 200"), "{head}: {answers}");
    }
}
