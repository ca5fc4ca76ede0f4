//! `afterimage ci`: what a CI calls. Runs sequences here or on a service, holds the results against the rules file, and
//! says so on the screen, in JUnit's XML and in Markdown. Exit status: 0 good, 1 a regression, 2 could not tell.

mod local;
mod output;

use super::{
    JsonTarget,
    client::{Client, TokenOption},
    run::{What, file_reader},
    submit,
};
use afterimage::{
    image::files::Backend,
    metrics::Value as MetricValue,
    run::report::AdapterInfo,
    sequence::Sequence,
    taa::{Precision, Skip},
    verdict::{Check, Outcome, Rules, overall},
};
use anyhow::{Context, bail, ensure};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Judge results by a rules file: status 0 good, 1 a regression, 2 could not tell
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage ci run dumps/*/ --preset all --rules afterimage.toml --junit afterimage.xml
  afterimage ci run dumps/*/ --preset taau --server https://afterimage.example --branch main --commit $(git rev-parse HEAD)
  afterimage ci judge --server http://127.0.0.1:8080 --report 41 --report 42 --rules afterimage.toml
  afterimage ci approve --server http://127.0.0.1:8080 --report 41 --why 'the new sharpening'")]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Subcommand)]
enum Action {
    /// Run sequences, here or on a service, and judge the results
    #[command(after_help = "Examples:
  afterimage ci run dumps/*/ --preset all --rules afterimage.toml --baseline last-good.json --json results.json
  afterimage ci run dumps/*/ --preset taau --server https://afterimage.example --from main --pull-request 17 --runs 3")]
    Run(Box<RunArguments>),
    /// Judge reports that a service has
    #[command(after_help = "Examples:
  afterimage ci judge --server http://127.0.0.1:8080 --report 41 --rules afterimage.toml")]
    Judge(JudgeArguments),
    /// Approve reports into their lines' baselines
    #[command(after_help = "Examples:
  afterimage ci approve --server http://127.0.0.1:8080 --report 41 --why 'the new sharpening' --who jane")]
    Approve(ApproveArguments),
}

#[derive(clap::Args)]
struct RunArguments {
    /// Sequences: folders with a manifest.json, manifests, or archives
    #[arg(required = true, value_name = "MANIFEST")]
    manifests: Vec<PathBuf>,
    #[command(flatten)]
    what: What,
    /// Repeat each run so often and judge the median
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    runs: u32,
    /// Run on this service and judge by its history [default: run here]
    #[arg(long, env = "AFTERIMAGE_SERVER", value_name = "URL")]
    server: Option<String>,
    #[command(flatten)]
    token: TokenOption,
    #[command(flatten)]
    origin: Origin,
    /// Without a service: results of an earlier `ci run --json` that count as approved
    #[arg(long, value_name = "FILE", conflicts_with = "server")]
    baseline: Option<PathBuf>,
    #[command(flatten)]
    judging: Judging,
}

/// Which state of the code was measured.
#[derive(clap::Args)]
struct Origin {
    /// Project
    #[arg(long, value_name = "NAME")]
    project: Option<String>,
    /// Branch that the frames were made from
    #[arg(long, value_name = "NAME")]
    branch: Option<String>,
    /// Commit that the frames were made from
    #[arg(long, value_name = "COMMIT")]
    commit: Option<String>,
    /// The commit before
    #[arg(long, value_name = "COMMIT")]
    parent: Option<String>,
    /// Branch that this one left: its history counts up to there
    #[arg(long, value_name = "BRANCH")]
    from: Option<String>,
    /// The last commit that both branches share
    #[arg(long, value_name = "COMMIT", requires = "from")]
    from_commit: Option<String>,
    /// Number or address of the pull request
    #[arg(long, value_name = "TEXT")]
    pull_request: Option<String>,
    /// Version of the engine that rendered
    #[arg(long, value_name = "TEXT")]
    engine_version: Option<String>,
}

/// By what to judge and where to say so.
#[derive(clap::Args)]
struct Judging {
    /// The rules file
    #[arg(long, value_name = "FILE", default_value = "afterimage.toml")]
    rules: PathBuf,
    /// Status 0 where nothing is wrong but something could not be told
    #[arg(long)]
    allow_unknown: bool,
    /// Write JUnit XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write a summary in Markdown, for a step summary or a comment; added to what the file has
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Write results and checks as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
}

#[derive(clap::Args)]
struct JudgeArguments {
    /// Address of the service
    #[arg(long, env = "AFTERIMAGE_SERVER", value_name = "URL")]
    server: String,
    #[command(flatten)]
    token: TokenOption,
    /// Number of a report, of one branch all; those of one line are repeats
    #[arg(long = "report", required = true, value_name = "ID")]
    reports: Vec<i64>,
    #[command(flatten)]
    judging: Judging,
}

#[derive(clap::Args)]
struct ApproveArguments {
    /// Address of the service
    #[arg(long, env = "AFTERIMAGE_SERVER", value_name = "URL")]
    server: String,
    #[command(flatten)]
    token: TokenOption,
    /// Number of a report
    #[arg(long = "report", required = true, value_name = "ID")]
    reports: Vec<i64>,
    /// Why
    #[arg(long, value_name = "TEXT")]
    why: String,
    /// Who says so, where no token says it
    #[arg(long, value_name = "NAME")]
    who: Option<String>,
    /// Reject instead
    #[arg(long)]
    reject: bool,
}

/// What was measured of one line, repeats taken together.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Measured {
    sequence: String,
    recipe: String,
    #[serde(flatten)]
    settings: Settings,
    adapter: AdapterInfo,
    /// Medians, by metric.
    values: BTreeMap<String, MetricValue>,
    metric_versions: BTreeMap<String, u32>,
    /// Where to look at it.
    #[serde(default)]
    page: Option<String>,
    /// Number on the service.
    #[serde(default)]
    report: Option<i64>,
}

/// What else must be equal for results to compare.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Settings {
    /// All of the recipe's, or what was posted as such.
    parameters: Value,
    history: Option<Precision>,
    skip: Option<Skip>,
    /// Over how many frames, from the first; none for all of them.
    n_frames: Option<usize>,
}

/// The whole outcome.
#[derive(Debug, Serialize, Deserialize)]
struct Results {
    outcome: Outcome,
    checks: Vec<Check>,
    reports: Vec<Measured>,
    /// Address of the service.
    #[serde(default)]
    server: Option<String>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.action {
        Action::Run(arguments) => {
            let rules = read_rules(&arguments.judging.rules)?;
            let results = match &arguments.server {
                Some(url) => on_service(arguments, url, &rules)?,
                None => local::run(arguments, &rules)?,
            };
            finish(&results, &arguments.judging)
        }
        Action::Judge(arguments) => {
            let rules = read_rules(&arguments.judging.rules)?;
            let client = Client::new(&arguments.server, &arguments.token);
            let results = judge(&client, &arguments.reports, &rules)?;
            finish(&results, &arguments.judging)
        }
        Action::Approve(arguments) => approve(arguments),
    }
}

fn read_rules(path: &Path) -> anyhow::Result<Rules> {
    let text = fs::read_to_string(path).with_context(|| format!("--rules {}", path.display()))?;
    Rules::parse(&text).with_context(|| format!("--rules {}", path.display()))
}

fn finish(results: &Results, judging: &Judging) -> anyhow::Result<Outcome> {
    output::write(results, judging)?;
    Ok(match results.outcome {
        Outcome::Unknown if judging.allow_unknown => Outcome::Ok,
        outcome => outcome,
    })
}

fn on_service(arguments: &RunArguments, url: &str, rules: &Rules) -> anyhow::Result<Results> {
    let client = Client::new(url, &arguments.token);
    let mut jobs = Vec::new();
    for manifest in &arguments.manifests {
        let sequence = Sequence::open(manifest, &file_reader(Backend::Auto))?;
        let spec = arguments.what.spec(&sequence)?;
        let hash = submit::put(&client, &sequence)?;
        let mut job = submit::job(&spec, &hash);
        arguments.origin.add_to(&mut job);
        // Times are judged, too, and those of an earlier run say nothing of this one.
        job["force"] = json!(true);
        for _ in 0..arguments.runs {
            jobs.push(client.post("jobs", &job)?);
        }
    }
    let mut ids = Vec::new();
    for job in jobs {
        let job = submit::follow(&client, &job)?;
        if job["status"] != "done" {
            bail!("job {} {}: {}", job["id"], job["status"], job["error"]["message"]);
        }
        let reports = job["reports"].as_array().context("the job has no reports")?;
        ids.extend(reports.iter().filter_map(|report| report["id"].as_i64()));
    }
    judge(&client, &ids, rules)
}

impl Origin {
    fn add_to(&self, body: &mut Value) {
        let fields = [
            ("project", &self.project),
            ("branch", &self.branch),
            ("commit", &self.commit),
            ("parent", &self.parent),
            ("pull_request", &self.pull_request),
            ("engine_version", &self.engine_version),
        ];
        for (name, value) in fields {
            if let Some(value) = value {
                body[name] = json!(value);
            }
        }
        if let Some(from) = &self.from {
            body["from"] = json!({"branch": from, "commit": self.from_commit});
        }
    }
}

/// Has a service judge reports that it has.
fn judge(client: &Client, ids: &[i64], rules: &Rules) -> anyhow::Result<Results> {
    let judgement = client.post("verdicts", &json!({"reports": ids, "rules": rules}))?;
    let mut reports = Vec::new();
    for id in ids {
        let report = client.get(&format!("reports/{id}"))?;
        let text = |name: &str| report[name].as_str().unwrap_or_default().to_owned();
        let page = match report["job_id"].as_i64() {
            Some(job) => format!("{}/jobs/{job}?preset={}", client.url, report["preset_index"]),
            None => format!("{}/reports/{id}", client.url),
        };
        let mut values: BTreeMap<String, MetricValue> = serde_json::from_value(report["values"].clone())?;
        if let Some(ms) = report["gpu_time_ms"].as_f64() {
            values.insert("gpu_time_ms".to_owned(), MetricValue(ms));
        }
        reports.push(Measured {
            sequence: text("sequence_name"),
            recipe: text("preset"),
            settings: serde_json::from_value(report.clone())?,
            adapter: serde_json::from_value(report["adapter"].clone())?,
            values,
            metric_versions: serde_json::from_value(report["metric_versions"].clone())?,
            page: Some(page),
            report: Some(*id),
        });
    }
    let checks: Vec<Check> = serde_json::from_value(judgement["checks"].clone())?;
    Ok(Results {
        outcome: overall(&checks),
        checks,
        reports,
        server: Some(client.url.clone()),
    })
}

fn approve(arguments: &ApproveArguments) -> anyhow::Result<Outcome> {
    let client = Client::new(&arguments.server, &arguments.token);
    ensure!(!arguments.why.trim().is_empty(), "--why: say why");
    ensure!(
        arguments.who.is_some() || arguments.token.token.is_some(),
        "--who: say who decides, or use a token, which says it"
    );
    let decision = if arguments.reject { "rejected" } else { "approved" };
    for id in &arguments.reports {
        let mut body = json!({"decision": decision, "why": arguments.why});
        if let Some(who) = &arguments.who {
            body["who"] = json!(who);
        }
        client.post(&format!("reports/{id}/decisions"), &body)?;
        super::note(&format!("report {id} is {decision}"));
    }
    Ok(Outcome::Ok)
}
