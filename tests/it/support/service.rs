//! A running service and its client, for the tests that speak to it from outside.

use afterimage::{
    config::Config,
    image::files::{Backend, FileReader, Limits},
    run::{
        Observer, RunError, RunSpec,
        report::{AdapterInfo, Report},
    },
    sequence::Sequence,
    server::{Running, ServeError},
    worker::{GpuRunner, Runner},
};
use clap::Parser;
use serde_json::Value;
use std::{
    net::SocketAddr,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};
use tempfile::TempDir;
use tokio_util::sync::CancellationToken;

#[derive(Parser)]
struct Serve {
    #[command(flatten)]
    config: Config,
}

pub fn config(data: &Path, arguments: &[&str]) -> Config {
    let data = data.to_str().unwrap();
    let fixed = ["serve", "--listen", "127.0.0.1:0", "--data", data];
    Serve::parse_from(fixed.iter().chain(arguments)).config
}

pub fn reader() -> FileReader {
    FileReader::new(Backend::Auto, Limits::default())
}

/// A service in this process, on a free port and in a folder of its own.
pub struct TestService {
    pub address: SocketAddr,
    pub data: TempDir,
    pub stop: CancellationToken,
    pub thread: Option<thread::JoinHandle<Result<(), ServeError>>>,
}

impl TestService {
    /// With a worker that runs jobs on the GPU.
    pub fn with_gpu() -> Self {
        let (runner, adapter) = GpuRunner::new(None, reader());
        let adapter = adapter.expect("these tests need a Vulkan driver: install mesa-vulkan-drivers");
        Self::start_on(tempfile::tempdir().unwrap(), runner, &[], Ok(adapter))
    }

    pub fn start(runner: impl Runner + 'static, arguments: &[&str]) -> Self {
        Self::start_in(tempfile::tempdir().unwrap(), runner, arguments)
    }

    pub fn start_in(data: TempDir, runner: impl Runner + 'static, arguments: &[&str]) -> Self {
        Self::start_on(data, runner, arguments, Err("no adapter in this test".to_owned()))
    }

    pub fn start_on(
        data: TempDir,
        runner: impl Runner + 'static,
        arguments: &[&str],
        adapter: Result<AdapterInfo, String>,
    ) -> Self {
        let config = config(data.path(), arguments);
        let (started, address) = std::sync::mpsc::channel();
        let thread = thread::spawn(move || {
            tokio::runtime::Runtime::new().unwrap().block_on(async {
                let running = Running::start(config, reader(), runner, adapter).await?;
                started.send((running.address, running.stop_token())).unwrap();
                running.run().await
            })
        });
        let (address, stop) = address.recv().expect("the service starts");
        Self {
            address,
            data,
            stop,
            thread: Some(thread),
        }
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    pub fn client(&self) -> Client {
        Client(self.address)
    }

    /// Stops as SIGTERM would and gives the data folder back.
    pub fn stop(mut self) -> TempDir {
        self.end();
        std::mem::replace(&mut self.data, tempfile::tempdir().unwrap())
    }

    pub fn end(&mut self) {
        self.stop.cancel();
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap().unwrap();
        }
    }
}

impl Drop for TestService {
    fn drop(&mut self) {
        if !thread::panicking() {
            self.end();
        }
    }
}

/// Speaks to `/api/v1`.
pub struct Client(pub SocketAddr);

pub struct Answer {
    pub status: u16,
    pub headers: ureq::http::HeaderMap,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("not JSON: {}", self.text()))
    }

    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.body).unwrap()
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    /// Asserts a problem of this status, code and field whose detail has `words`.
    #[track_caller]
    pub fn is_problem(&self, status: u16, code: &str, field: Option<&str>, words: &str) {
        let problem = self.json();
        let found = (self.status, problem["code"].as_str(), problem["field"].as_str());
        assert_eq!(found, (status, Some(code), field), "{problem}");
        assert_eq!(self.header("content-type"), "application/problem+json");
        assert_eq!(problem["status"], status);
        assert!(problem["title"].is_string() && problem["type"].is_string());
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(words), "`{detail}` does not say `{words}`");
    }
}

impl Client {
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
        let url = format!("http://{}/api/v1{path}", self.0);
        let mut request = ureq::http::Request::builder().method(method).uri(url);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let mut response = agent.run(request.body(body).unwrap()).unwrap();
        Answer {
            status: response.status().as_u16(),
            headers: response.headers().clone(),
            body: response.body_mut().read_to_vec().unwrap(),
        }
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], &[])
    }

    /// Posts JSON with a path, and with headers beside its own.
    pub fn post_with(&self, path: &str, body: &Value, headers: &[(&str, &str)]) -> Answer {
        let all: Vec<_> = [("content-type", "application/json")]
            .iter()
            .chain(headers)
            .copied()
            .collect();
        self.send("POST", path, &all, body.to_string().as_bytes())
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        self.post_with(path, body, &[])
    }

    /// Posts what must be taken; the answer.
    #[track_caller]
    pub fn posted(&self, path: &str, body: &Value) -> Value {
        let answer = self.post(path, body);
        assert!((200..300).contains(&answer.status), "{}", answer.text());
        answer.json()
    }

    pub fn post_job(&self, job: &Value) -> Answer {
        self.post_text(&job.to_string())
    }

    pub fn post_text(&self, body: &str) -> Answer {
        self.send(
            "POST",
            "/jobs",
            &[("content-type", "application/json")],
            body.as_bytes(),
        )
    }

    pub fn put(&self, name: &str, archive: &[u8]) -> Answer {
        self.send("PUT", &format!("/sequences/{name}"), &[], archive)
    }

    /// Posts a job that must be accepted, even if the same ran before; gives its number.
    pub fn start_job(&self, job: &Value) -> i64 {
        let mut job = job.clone();
        job["force"] = Value::from(true);
        let answer = self.post_job(&job);
        assert_eq!(answer.status, 202, "{}", answer.text());
        let id = answer.json()["id"].as_i64().unwrap();
        assert_eq!(answer.header("location"), format!("/api/v1/jobs/{id}"));
        id
    }

    /// The job, once it has one of these statuses.
    pub fn wait_for(&self, id: i64, statuses: &[&str]) -> Value {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            let job = self.get(&format!("/jobs/{id}")).json();
            if statuses.contains(&job["status"].as_str().unwrap()) {
                return job;
            }
            assert!(
                Instant::now() < deadline,
                "job {id} is not {statuses:?} after a minute: {job}"
            );
            thread::sleep(Duration::from_millis(20));
        }
    }
}

/// A worker that no job of a test should reach.
pub struct Idle;

impl Runner for Idle {
    fn run(&mut self, _: &Path, _: &RunSpec, _: &dyn Observer) -> Result<Report, RunError> {
        Err(RunError::Input("no job of this test should run".to_owned()))
    }
}

/// A worker that runs jobs as a test says.
pub struct Scripted<F>(pub F);

impl<F: FnMut(&RunSpec, &dyn Observer) -> Result<Report, RunError> + Send> Runner for Scripted<F> {
    fn run(&mut self, _: &Path, spec: &RunSpec, observer: &dyn Observer) -> Result<Report, RunError> {
        self.0(spec, observer)
    }
}

/// For [`Scripted`]: a job that works until told to stop.
pub fn endless(_: &RunSpec, observer: &dyn Observer) -> Result<Report, RunError> {
    let mut n_done = 0;
    while !observer.cancelled() {
        n_done += 1;
        observer.progress(n_done.min(11), 12);
        thread::sleep(Duration::from_millis(5));
    }
    Err(RunError::Cancelled)
}

pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// A fixture as the tar that `submit` sends.
pub fn packed(name: &str) -> Vec<u8> {
    let mut archive = Vec::new();
    Sequence::open(&fixture(name), &reader())
        .unwrap()
        .pack(&mut archive)
        .unwrap();
    archive
}
