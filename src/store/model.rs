//! What a report says of where it came from. Two reports are comparable where project, subject, system and environment
//! are equal: they are then points of one [`super::Series`]. Branch, commit and labels place a point; they do not part lines.

use crate::{
    metrics::{Summary, Value},
    run::report::{AdapterInfo, FrameReport, TimeSummary},
    taa::{Precision, Skip, validation::Validation},
    verdict::better,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The id under which a series of GPU times is asked for, beside the metrics' own.
pub const GPU_TIME: &str = "gpu_time_ms";

/// The project of whoever names none.
pub const DEFAULT_PROJECT: &str = "default";

/// Who measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema, sqlx::Type)]
#[serde(rename_all = "snake_case")]
#[sqlx(rename_all = "snake_case")]
pub enum SystemKind {
    /// A preset, run here.
    Recipe,
    /// A program run elsewhere, which posted its results.
    External,
}

/// What machine measured. Numbers compare only between equal environments.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub struct Environment {
    /// Adapter and driver.
    pub adapter: AdapterInfo,
    /// Operating system and its version, such as `debian 12`; empty where unknown.
    #[serde(default)]
    pub os: String,
    /// How clocks are held, such as `locked 1410 MHz`; empty where they are not.
    #[serde(default)]
    pub clocks: String,
}

/// Where a branch left another.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Departure {
    /// The branch that it left.
    pub branch: String,
    /// The last commit they share; the newest known one where it is left out.
    #[serde(default)]
    pub commit: Option<String>,
}

/// Which state of the submitter's code was measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Provenance {
    /// Branch.
    pub branch: Option<String>,
    /// Where the branch left another; only its first report needs to say so.
    pub from: Option<Departure>,
    /// Commit.
    pub commit: Option<String>,
    /// The commit before.
    pub parent: Option<String>,
    /// Number or address of the pull request.
    pub pull_request: Option<String>,
    /// Version of the engine that rendered.
    pub engine_version: Option<String>,
    /// Free text.
    pub label: Option<String>,
    /// Free names and values.
    pub labels: BTreeMap<String, String>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Subject {
    /// The stored sequence of this row.
    Sequence(i64),
    /// A sequence whose images are elsewhere.
    Named(String),
}

/// Who measured, with what settings.
#[derive(Clone, Debug, PartialEq)]
pub struct System {
    /// Here or elsewhere.
    pub kind: SystemKind,
    /// Preset id, or the external system's name.
    pub name: String,
    /// How history was stored; none where unknown.
    pub history: Option<Precision>,
    /// Which work was left out; none where unknown.
    pub skip: Option<Skip>,
    /// Over how many frames, from the first; none for all of them.
    pub n_frames: Option<usize>,
    /// All settings.
    pub parameters: serde_json::Value,
    /// The ones that the submitter changed.
    pub overrides: serde_json::Value,
}

/// A metric of a report: its version and summary.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MetricSummary {
    /// Version of the metric.
    pub version: u32,
    /// Over the frames that count.
    #[serde(flatten)]
    pub summary: Summary,
}

/// A report to be stored.
#[derive(Clone, Debug)]
pub struct NewReport {
    /// The job it came from, and its place there.
    pub job: Option<(i64, usize)>,
    /// Project by name; made at its first report.
    pub project: String,
    /// What was measured.
    pub subject: Subject,
    /// Who measured.
    pub system: System,
    /// On what.
    pub environment: Environment,
    /// Of which code.
    pub provenance: Provenance,
    /// Git revision of the build that ran.
    pub revision: String,
    /// What a reader must know to trust the numbers.
    pub notes: Vec<String>,
    /// Wall time of each stage of the whole job, milliseconds.
    pub stages_ms: BTreeMap<String, f64>,
    /// By metric.
    pub metrics: BTreeMap<String, MetricSummary>,
    /// By pass, milliseconds.
    pub times_ms: BTreeMap<String, TimeSummary>,
    /// Every frame.
    pub frames: Vec<FrameReport>,
    /// How far the adapter is from the twin, where that was asked.
    pub validation: Option<Validation>,
    /// Whether it is whole; else frames follow, and [`super::Ingest::close`] ends it.
    pub complete: bool,
}

impl NewReport {
    /// GPU time of one frame, milliseconds.
    pub fn gpu_time_ms(&self) -> Option<f64> {
        gpu_time_ms(&self.metrics, &self.times_ms)
    }
}

/// The sum of the passes' medians, or what was measured under that name; `None` where nothing was timed.
pub(super) fn gpu_time_ms(
    metrics: &BTreeMap<String, MetricSummary>,
    times_ms: &BTreeMap<String, TimeSummary>,
) -> Option<f64> {
    let of_passes = times_ms.values().map(|time| time.median).reduce(|a, b| a + b);
    of_passes.or_else(|| Some(metrics.get(GPU_TIME)?.summary.mean.0))
}

/// The numbers that a report has in the trends: metric, value and version.
pub(super) fn points(
    metrics: &BTreeMap<String, MetricSummary>,
    gpu_time_ms: Option<f64>,
) -> impl Iterator<Item = (&str, Value, u32)> {
    let metrics = metrics.iter().filter(|(metric, _)| *metric != GPU_TIME);
    let values = metrics.map(|(metric, found)| {
        let value = found.summary.headline(better(metric));
        (metric.as_str(), value, found.version)
    });
    values.chain(gpu_time_ms.map(|ms| (GPU_TIME, Value(ms), 0)))
}

/// Times of a frame that are not a GPU's.
const HOST_STAGES: [&str; 5] = ["decode", "host_cpu", "metrics", "readback", "upload"];

/// Condenses frames that came without summaries: every metric and pass over the frames after warm-up.
pub fn condense(
    frames: &[FrameReport],
    versions: &BTreeMap<String, u32>,
) -> (BTreeMap<String, MetricSummary>, BTreeMap<String, TimeSummary>) {
    let mut values: BTreeMap<&String, Vec<Value>> = BTreeMap::new();
    let mut times: BTreeMap<&String, Vec<f64>> = BTreeMap::new();
    for frame in frames.iter().filter(|frame| !frame.warmup) {
        for (metric, value) in &frame.metrics {
            values.entry(metric).or_default().push(*value);
        }
        for (pass, time_ms) in &frame.times_ms {
            if !HOST_STAGES.contains(&pass.as_str()) {
                times.entry(pass).or_default().push(*time_ms);
            }
        }
    }
    let metrics = values.into_iter().map(|(metric, values)| {
        let version = versions.get(metric).copied().unwrap_or_else(|| known_version(metric));
        let summary = Summary::of(metric, values);
        (metric.clone(), MetricSummary { version, summary })
    });
    let times = times
        .into_iter()
        .filter_map(|(pass, ms)| Some((pass.clone(), crate::run::time_summary(&ms)?)));
    (metrics.collect(), times.collect())
}

/// The version of a metric that is known here; 0 of others.
pub fn known_version(metric: &str) -> u32 {
    metric
        .parse::<crate::metrics::Metric>()
        .map_or(0, |metric| metric.info().version)
}
