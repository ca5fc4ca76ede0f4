//! The API's client: tokens, retries, uploads.

use anyhow::{Context, bail};
use serde_json::Value;
use std::{
    fs::File,
    io::{BufRead, BufReader, Seek},
    thread::sleep,
    time::Duration,
};
use ureq::http::{Response, StatusCode};

/// How to be let in.
#[derive(clap::Args)]
pub struct TokenOption {
    /// Token made by `afterimage token create`
    #[arg(long, env = "AFTERIMAGE_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: Option<String>,
}

/// How often a request is tried, with 0.5, 1, 2, 4 s between, or what the service asks for.
const ATTEMPTS: u32 = 5;
/// A service that asks for more is not waited for.
const MAX_WAIT: Duration = Duration::from_secs(60);

/// The service, spoken to over HTTP.
pub struct Client {
    pub url: String,
    token: Option<String>,
    agent: ureq::Agent,
}

type Answer = Result<Response<ureq::Body>, ureq::Error>;

impl Client {
    pub fn new(url: &str, token: &TokenOption) -> Self {
        // Problems come as JSON bodies, which are worth more than the status alone.
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_connect(Some(Duration::from_secs(10)))
            .build();
        Self {
            url: url.trim_end_matches('/').to_owned(),
            token: token.token.clone(),
            agent: config.into(),
        }
    }

    fn api(&self, path: &str) -> String {
        format!("{}/api/v1/{path}", self.url)
    }

    fn authorised<B>(&self, request: ureq::RequestBuilder<B>) -> ureq::RequestBuilder<B> {
        match &self.token {
            Some(token) => request.header("authorization", format!("Bearer {token}")),
            None => request,
        }
    }

    /// Sends until there is an answer that another try would not change.
    fn retry(&self, mut send: impl FnMut() -> anyhow::Result<Answer>) -> anyhow::Result<Value> {
        let mut wait = Duration::from_millis(500);
        for attempt in 1..=ATTEMPTS {
            let answer = send()?;
            let again = match &answer {
                Ok(answer) => {
                    let asked = answer
                        .headers()
                        .get("retry-after")
                        .and_then(|value| value.to_str().ok()?.parse().ok());
                    let is_busy = answer.status() == StatusCode::TOO_MANY_REQUESTS || answer.status().is_server_error();
                    let in_progress = answer.status() == StatusCode::CONFLICT && asked.is_some();
                    (is_busy || in_progress).then(|| asked.map_or(wait, Duration::from_secs))
                }
                Err(_) => Some(wait),
            };
            match again {
                Some(pause) if attempt < ATTEMPTS && pause <= MAX_WAIT => sleep(pause),
                _ => return self.answer(answer),
            }
            wait *= 2;
        }
        unreachable!("the last attempt returns")
    }

    /// The answer's JSON, or the problem it describes.
    fn answer(&self, response: Answer) -> anyhow::Result<Value> {
        let mut response = response.with_context(|| format!("no answer from {}; is the service running?", self.url))?;
        let status = response.status();
        let body: Value = response
            .body_mut()
            .with_config()
            .limit(1 << 30)
            .read_json()
            .with_context(|| format!("{status} from {}", self.url))?;
        if status.is_success() {
            return Ok(body);
        }
        let text = |key: &str| body[key].as_str().unwrap_or_default().to_owned();
        bail!("the service refused ({status}, {}): {}", text("code"), text("detail"))
    }

    pub fn get(&self, path: &str) -> anyhow::Result<Value> {
        self.retry(|| Ok(self.authorised(self.agent.get(self.api(path))).call()))
    }

    /// Posts once, however often it has to be sent.
    pub fn post(&self, path: &str, body: &Value) -> anyhow::Result<Value> {
        let key = afterimage::store::random_secret("")?;
        self.retry(|| {
            let request = self.authorised(self.agent.post(self.api(path)));
            Ok(request.header("idempotency-key", &key).send_json(body))
        })
    }

    /// Sends a file.
    pub fn put(&self, path: &str, file: &File) -> anyhow::Result<Value> {
        self.retry(|| {
            let mut file = file.try_clone()?;
            file.rewind()?;
            Ok(self.authorised(self.agent.put(self.api(path))).send(file))
        })
    }

    /// Watches a job until it ends; the job with its reports. `seen` hears of every state.
    pub fn follow(&self, id: &Value, mut seen: impl FnMut(&Value)) -> anyhow::Result<Value> {
        let mut last_event = String::new();
        loop {
            // A stream that breaks off before the end (the service was restarted) is opened again.
            let request = self.authorised(self.agent.get(self.api(&format!("jobs/{id}/events"))));
            let stream = request.header("last-event-id", &last_event).call();
            if let Ok(mut stream) = stream {
                for line in BufReader::new(stream.body_mut().as_reader()).lines() {
                    let Ok(line) = line else { break };
                    if let Some(id) = line.strip_prefix("id:") {
                        id.trim().clone_into(&mut last_event);
                    }
                    if let Some(data) = line.strip_prefix("data:") {
                        seen(&serde_json::from_str(data)?);
                    }
                }
            }
            let job = self.get(&format!("jobs/{id}"))?;
            if !matches!(job["status"].as_str(), Some("queued" | "running")) {
                return Ok(job);
            }
            sleep(Duration::from_secs(1));
        }
    }
}
