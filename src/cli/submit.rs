//! `afterimage submit`: the API's client. Puts sequences, posts a job for each, follows them, and shows the reports.

use super::{
    JsonTarget,
    client::{Client, TokenOption},
    note, print, progress_bar,
    run::What,
    run::file_reader,
    table,
};
use afterimage::{
    image::files::Backend,
    metrics::{Metric, Value as MetricValue},
    run::{RunSpec, Validate},
    sequence::Sequence,
};
use anyhow::Context;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

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
    #[command(flatten)]
    token: TokenOption,
    /// Branch that the frames were made from, for trends
    #[arg(long, value_name = "NAME")]
    branch: Option<String>,
    /// Commit that the frames were made from, for trends
    #[arg(long, value_name = "COMMIT")]
    commit: Option<String>,
    /// Free text, kept with the reports
    #[arg(long, value_name = "TEXT")]
    label: Option<String>,
    /// Run what was run before, too
    #[arg(long)]
    force: bool,
    /// Only queue the jobs
    #[arg(long)]
    no_wait: bool,
    /// Write the jobs with their reports as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let client = Client::new(&arguments.url, &arguments.token);
    let mut jobs = Vec::new();
    for manifest in &arguments.manifests {
        let job = submit(&client, arguments, manifest);
        jobs.push(job.with_context(|| manifest.display().to_string())?);
    }
    if !arguments.no_wait {
        for job in &mut jobs {
            *job = follow(&client, job)?;
        }
    }
    if let Some(target) = &arguments.json {
        target.write(&jobs)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        print(&show(&jobs, &arguments.what.metrics, &client));
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

/// Sends a sequence and queues a job for it.
fn submit(client: &Client, arguments: &Arguments, manifest: &Path) -> anyhow::Result<Value> {
    let sequence = Sequence::open(manifest, &file_reader(Backend::Auto))?;
    let spec = arguments.what.spec(&sequence)?;
    let hash = put(client, &sequence)?;
    let mut job = job(&spec, &hash);
    job["branch"] = json!(arguments.branch);
    job["commit"] = json!(arguments.commit);
    job["label"] = json!(arguments.label);
    job["force"] = json!(arguments.force);
    let job = client.post("jobs", &job)?;
    if job["answered_from_store"] == true {
        note(&format!("{}: was run before; --force runs it again", sequence.name()));
    }
    Ok(job)
}

/// Sends a sequence; its content hash.
pub fn put(client: &Client, sequence: &Sequence) -> anyhow::Result<String> {
    let mut archive = tempfile::tempfile()?;
    sequence.pack(&mut archive)?;
    let stored = client.put(&format!("sequences/{}", plain_name(sequence.name())), &archive)?;
    Ok(stored["hash"].as_str().context("the service named no hash")?.to_owned())
}

/// The body of a job.
pub fn job(spec: &RunSpec, hash: &str) -> Value {
    json!({
        "sequence": hash,
        "presets": spec.presets,
        "metrics": spec.metrics,
        "history": spec.history,
        "repeat": spec.repeat,
        "frames": spec.n_frames,
        "validate": spec.validate != Validate::No,
        "bisect": spec.validate == Validate::Bisect,
        "skip": spec.skip,
        "until": spec.until,
    })
}

/// Watches a job until it ends; the job with its reports.
pub fn follow(client: &Client, job: &Value) -> anyhow::Result<Value> {
    let bar = progress_bar(job["sequence_name"].as_str().unwrap_or_default(), 0);
    let job = client.follow(&job["id"], |state| {
        bar.set_length(state["n_total"].as_u64().unwrap_or_default());
        bar.set_position(state["n_done"].as_u64().unwrap_or_default());
    })?;
    bar.finish_and_clear();
    Ok(job)
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

fn show(jobs: &[Value], metrics: &[Metric], client: &Client) -> String {
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
        rest += &format!("{}/jobs/{}\n", client.url, job["id"]);
    }
    format!("{table}\n{rest}")
}
