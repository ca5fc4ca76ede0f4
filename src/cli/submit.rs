//! `afterimage submit`: the API's client. Puts sequences, posts a job for each, follows them, and shows the reports.

use super::{JsonTarget, print, progress_bar, run::What, run::file_reader, table};
use afterimage::{
    image::files::Backend,
    metrics::{Metric, Value as MetricValue},
    run::{RunSpec, Validate},
    sequence::Sequence,
};
use anyhow::{Context, bail};
use serde_json::{Value, json};
use std::{
    io::{BufRead, BufReader, Seek},
    path::{Path, PathBuf},
};

/// Send sequences to a service, run presets on them there, and show the reports
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage submit http://127.0.0.1:8080 fixtures/pan --preset inside,karis2014
  afterimage submit http://127.0.0.1:8080 dumps/*/ --preset all --branch main --commit $(git rev-parse HEAD)
  afterimage submit http://127.0.0.1:8080 dump.tar --preset ema --no-wait")]
pub struct Arguments {
    /// Address of the service, such as http://127.0.0.1:8080
    url: String,
    /// Sequences: folders with a manifest.json, manifests, or archives
    #[arg(required = true, value_name = "MANIFEST")]
    manifests: Vec<PathBuf>,
    #[command(flatten)]
    what: What,
    /// Branch that the frames were made from, for trends
    #[arg(long, value_name = "NAME")]
    branch: Option<String>,
    /// Commit that the frames were made from, for trends
    #[arg(long, value_name = "COMMIT")]
    commit: Option<String>,
    /// Free text, kept with the reports
    #[arg(long, value_name = "TEXT")]
    label: Option<String>,
    /// Only queue the jobs
    #[arg(long)]
    no_wait: bool,
    /// Write the jobs with their reports as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let service = Service::new(&arguments.url);
    let mut jobs = Vec::new();
    for manifest in &arguments.manifests {
        let job = service.submit(arguments, manifest);
        jobs.push(job.with_context(|| manifest.display().to_string())?);
    }
    if !arguments.no_wait {
        for job in &mut jobs {
            *job = service.follow(job)?;
        }
    }
    if let Some(target) = &arguments.json {
        target.write(&jobs)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        print(&show(&jobs, &arguments.what.metrics, &service));
    }
    let reports = |job: &Value| job["reports"].as_array().cloned().unwrap_or_default();
    let agrees = |job: &Value| {
        !reports(job)
            .iter()
            .any(|report| report["validation"]["agrees"] == false)
    };
    let ended_well = |job: &Value| arguments.no_wait || job["status"] == "done" && agrees(job);
    Ok(jobs.iter().all(ended_well))
}

/// The service, spoken to over HTTP.
struct Service {
    url: String,
    agent: ureq::Agent,
}

impl Service {
    fn new(url: &str) -> Self {
        // Problems come as JSON bodies, which are worth more than the status alone.
        let config = ureq::Agent::config_builder().http_status_as_error(false).build();
        Self {
            url: url.trim_end_matches('/').to_owned(),
            agent: config.into(),
        }
    }

    fn api(&self, path: &str) -> String {
        format!("{}/api/v1/{path}", self.url)
    }

    /// The answer's JSON, or the problem it describes.
    fn answer(&self, response: Result<ureq::http::Response<ureq::Body>, ureq::Error>) -> anyhow::Result<Value> {
        let mut response = response.with_context(|| format!("no answer from {}; is the service running?", self.url))?;
        let status = response.status();
        let body: Value = response
            .body_mut()
            .read_json()
            .with_context(|| format!("{status} from {}", self.url))?;
        if status.is_success() {
            return Ok(body);
        }
        let text = |key: &str| body[key].as_str().unwrap_or_default().to_owned();
        bail!("the service refused ({status}, {}): {}", text("code"), text("detail"))
    }

    /// Sends a sequence and queues a job for it.
    fn submit(&self, arguments: &Arguments, manifest: &Path) -> anyhow::Result<Value> {
        let sequence = Sequence::open(manifest, &file_reader(Backend::Auto))?;
        let spec = arguments.what.spec(&sequence)?;
        let hash = self.put(&sequence)?;
        self.post(arguments, &spec, &hash)
    }

    /// Sends a sequence; its content hash.
    fn put(&self, sequence: &Sequence) -> anyhow::Result<String> {
        let mut archive = tempfile::tempfile()?;
        sequence.pack(&mut archive)?;
        archive.rewind()?;
        let url = self.api(&format!("sequences/{}", plain_name(sequence.name())));
        let stored = self.answer(self.agent.put(url).send(archive))?;
        Ok(stored["hash"].as_str().context("the service named no hash")?.to_owned())
    }

    /// Queues a job.
    fn post(&self, arguments: &Arguments, spec: &RunSpec, hash: &str) -> anyhow::Result<Value> {
        let body = json!({
            "sequence": hash,
            "presets": spec.presets,
            "metrics": spec.metrics,
            "history": spec.history,
            "repeat": spec.repeat,
            "frames": spec.n_frames,
            "validate": spec.validate != Validate::No,
            "bisect": spec.validate == Validate::Bisect,
            "branch": arguments.branch,
            "commit": arguments.commit,
            "label": arguments.label,
        });
        self.answer(self.agent.post(self.api("jobs")).send_json(body))
    }

    /// Watches a job until it ends; the job with its reports.
    fn follow(&self, job: &Value) -> anyhow::Result<Value> {
        let url = self.api(&format!("jobs/{}", job["id"]));
        let bar = progress_bar(job["sequence_name"].as_str().unwrap_or_default(), 0);
        loop {
            // A stream that breaks off before the end (the service was restarted) is opened again.
            let mut stream = self.agent.get(format!("{url}/events")).call()?;
            for line in BufReader::new(stream.body_mut().as_reader()).lines() {
                let Ok(line) = line else { break };
                if let Some(data) = line.strip_prefix("data:") {
                    let state: Value = serde_json::from_str(data)?;
                    bar.set_length(state["n_total"].as_u64().unwrap_or_default());
                    bar.set_position(state["n_done"].as_u64().unwrap_or_default());
                }
            }
            let job = self.answer(self.agent.get(&url).call())?;
            if !matches!(job["status"].as_str(), Some("queued" | "running")) {
                bar.finish_and_clear();
                return Ok(job);
            }
            std::thread::sleep(std::time::Duration::from_secs(1));
        }
    }
}

/// The service takes plain names only; what else there is becomes a dash.
fn plain_name(name: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let name: String = name
        .chars()
        .map(|c| if is_plain(c) { c } else { '-' })
        .take(100)
        .collect();
    if name.is_empty() { "sequence".to_owned() } else { name }
}

fn show(jobs: &[Value], metrics: &[Metric], service: &Service) -> String {
    let mut header = vec!["sequence".to_owned(), "preset".to_owned()];
    header.extend(metrics.iter().map(|metric| metric.id().to_owned()));
    header.push("GPU ms".to_owned());
    let mut table = table::new(header, 2);
    let mut rest = String::new();
    for job in jobs {
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let reports = job["reports"].as_array().map_or(&[][..], Vec::as_slice);
        for report in reports {
            let mut row = vec![text(&job["sequence_name"]), text(&report["preset"])];
            row.extend(metrics.iter().map(|metric| {
                let mean = report["summary"][metric.id()]["mean"].clone();
                serde_json::from_value::<MetricValue>(mean).map_or_else(|_| "–".to_owned(), table::value)
            }));
            row.push(
                report["gpu_time_ms"]
                    .as_f64()
                    .map_or_else(|| "–".to_owned(), |ms| format!("{ms:.3}")),
            );
            table.add_row(row);
            if report["validation"]["agrees"] == false {
                let fault = match report["validation"]["bisection"]["pass"].as_str() {
                    Some(pass) => format!(": `{pass}` is wrong"),
                    None => String::new(),
                };
                rest += &format!(
                    "{}: the adapter disagrees with the twin{fault}\n",
                    text(&report["preset"])
                );
            }
        }
        if reports.is_empty() {
            let status = text(&job["status"]);
            let cause = text(&job["error"]["message"]);
            rest += &format!("{}: {status} {cause}\n", text(&job["sequence_name"]));
        }
        rest += &format!("{}/jobs/{}\n", service.url, job["id"]);
    }
    format!("{table}\n{rest}")
}
