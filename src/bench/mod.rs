//! Run time against error: every setting of a sweep over one sequence, each timed beside the others and scored, and the
//! Pareto front of both. Built on [`crate::run`], which scores; the times are measured here, on settings that take turns
//! in random order on the same frames while nothing else runs in the process.

mod chart;
mod clock;
mod copy;
mod csv;
mod front;
mod measure;
pub mod statistics;
mod sweep;
mod tune;

pub use clock::Clock;
pub use csv::csv;
pub use sweep::{MAX_SETTINGS, knobs};
pub use tune::{textured, tune};

use crate::{
    gpu::{Gpu, GpuError},
    metrics::{Metric, Value},
    run::{
        self, MetricsOn, Observer, PresetSpec, RunError, RunSpec, Validate,
        report::{AdapterInfo, SequenceInfo},
    },
    sequence::Sequence,
    taa::Precision,
};
use copy::Copy;
use measure::Measured;
pub use measure::Noise;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::Timing;
use std::collections::BTreeMap;
use sweep::Setting;

/// What to measure on a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchSpec {
    /// Which systems.
    pub presets: Vec<PresetSpec>,
    /// Values to try, by the name of a recipe's parameter, or `history`, `skip` or `workgroup`; all combinations are.
    #[serde(default)]
    pub knobs: BTreeMap<String, Vec<serde_json::Value>>,
    /// Which metrics; none where the sequence has no reference.
    pub metrics: Vec<Metric>,
    /// The metric that the front is drawn on; one of `metrics`.
    pub metric: Metric,
    /// How history is stored unless a knob says so.
    #[serde(default)]
    pub history: Precision,
    /// Only the first so many frames.
    #[serde(default)]
    #[schemars(range(min = 1))]
    pub n_frames: Option<usize>,
    /// The least number of timed frames, 20 to 1000; frames in warm-up do not count.
    #[serde(default = "least_timed")]
    #[schemars(range(min = 20, max = 1000))]
    pub n_timed: usize,
}

/// Fewer timed frames say too little of a median.
pub const LEAST_TIMED: usize = 20;
/// More would not make it better.
pub const MOST_TIMED: usize = 1000;

fn least_timed() -> usize {
    LEAST_TIMED
}

/// What came out of one sequence.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct BenchReport {
    /// Each setting, in the order of presets and knobs.
    pub points: Vec<Point>,
    /// What the same setting measured twice differs by.
    pub noise: Noise,
    /// What the front is drawn on.
    pub metric: Metric,
    /// What was resolved.
    pub sequence: SequenceInfo,
    /// What resolved it.
    pub adapter: AdapterInfo,
    /// Git revision of the build.
    pub revision: String,
    /// What a time is.
    pub clock: Clock,
    /// Bytes read and written a second, 10⁹, by a pass that does nothing but copy a large image, by the same clock. None in
    /// reports older than the figure.
    pub copy_gb_per_s: Option<f64>,
    /// Settings that make no sense or cannot run on this sequence, and why.
    pub left_out: Vec<String>,
}

/// One setting: what it costs and what it gives.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "BenchPoint")]
pub struct Point {
    /// Name of the sequence.
    pub sequence: String,
    /// Preset id.
    pub preset: String,
    /// What differs from the preset: parameters and knobs.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// Of one frame.
    pub time_ms: Timing,
    /// CPU time of the process for bringing a frame to the device, median: comparing it with the one before where tiles may be
    /// skipped, and copying what differs. No part of `time_ms`.
    pub upload_ms: f64,
    /// Median of each pass by timestamps (on a CPU adapter wall time); none where there are none.
    pub passes_ms: BTreeMap<String, f64>,
    /// Mean over frames after warm-up, by metric id.
    pub metrics: BTreeMap<String, Value>,
    /// What the passes must move at the least: each image they bind once, bytes for a pixel of output.
    pub bytes_per_pixel: f64,
    /// How many times as long the frame takes as moving those bytes once would at the speed of a copy. None where that was not
    /// measured.
    pub over_copy: Option<f64>,
    /// Share of the resolve's tiles that had nothing to do, 0 to 1.
    pub skipped: f64,
    /// The most that was allocated on the device at once while this setting ran alone; none where it is not counted.
    pub peak_gpu_bytes: Option<u64>,
    /// The setting that is as fast or faster and as good or better; none on the front.
    pub dominated_by: Option<String>,
}

impl BenchReport {
    /// The same with the front of another metric. Where a point has none of it, nothing beats the point.
    pub fn on(mut self, metric: Metric) -> Self {
        front::dominate(&mut self.points, metric, self.noise.relative);
        self.metric = metric;
        self
    }

    /// Time against the metric as a picture. Fronts of `earlier` benchmarks, the newest first, lie under it, the older the
    /// paler.
    pub fn svg(&self, earlier: &[&Self]) -> String {
        chart::draw(self, earlier)
    }
}

impl Point {
    /// Preset and what differs from it.
    pub fn name(&self) -> String {
        Setting::name(&self.preset, &self.parameters)
    }
}

/// Why a benchmark gave no report.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The request is at fault.
    #[error("{field}: {message}")]
    Input {
        /// Where.
        field: String,
        /// What is wrong and what would be right.
        message: String,
    },
    /// As a run.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl BenchError {
    fn input(field: &str, message: String) -> Self {
        Self::Input {
            field: field.to_owned(),
            message,
        }
    }
}

impl From<GpuError> for BenchError {
    fn from(error: GpuError) -> Self {
        Self::Run(error.into())
    }
}

impl From<BenchError> for RunError {
    fn from(error: BenchError) -> Self {
        match error {
            BenchError::Input { .. } => Self::Input(error.to_string()),
            BenchError::Run(error) => error,
        }
    }
}

/// Checks all that can be known without measuring.
pub fn validate(spec: &BenchSpec, sequence: &Sequence) -> Result<(), BenchError> {
    checked(spec, sequence).map(drop)
}

fn checked(spec: &BenchSpec, sequence: &Sequence) -> Result<(Vec<Setting>, Vec<String>), BenchError> {
    if !(LEAST_TIMED..=MOST_TIMED).contains(&spec.n_timed) {
        let message = format!("must be {LEAST_TIMED} to {MOST_TIMED}, not {}", spec.n_timed);
        return Err(BenchError::input("n_timed", message));
    }
    if !spec.metrics.contains(&spec.metric) {
        let message = format!("`{}` is not among the metrics computed", spec.metric);
        return Err(BenchError::input("metric", message));
    }
    let (settings, left_out) = sweep::settings(spec, sequence)?;
    for group in groups(&settings) {
        run::validate(&run_spec(spec, &group), sequence)?;
    }
    Ok((settings, left_out))
}

/// Measures and scores every setting. `observer` hears of progress and may cancel; it gets no images.
pub fn execute(
    spec: &BenchSpec,
    sequence: &Sequence,
    gpu: &Gpu,
    observer: &dyn Observer,
) -> Result<BenchReport, BenchError> {
    let (settings, left_out) = checked(spec, sequence)?;
    let mut copy = Copy::new(gpu)?;
    let (noise, measured) = measure::measure(spec, &settings, sequence, &mut copy, observer)?;
    let copy_bytes_per_ms = copy.bytes_per_ms()?;
    let (metrics, info) = scores(spec, &settings, sequence, gpu, observer)?;
    let mut points: Vec<_> = settings
        .into_iter()
        .zip(measured)
        .zip(metrics)
        .map(|((setting, measured), metrics)| point(sequence, setting, measured, metrics, copy_bytes_per_ms))
        .collect();
    front::dominate(&mut points, spec.metric, noise.relative);
    Ok(BenchReport {
        points,
        noise,
        metric: spec.metric,
        sequence: info,
        adapter: gpu.info(),
        revision: env!("AFTERIMAGE_REVISION").to_owned(),
        clock: Clock::of(gpu),
        copy_gb_per_s: Some(copy_bytes_per_ms * 1e-6),
        left_out,
    })
}

fn point(
    sequence: &Sequence,
    setting: Setting,
    measured: Measured,
    metrics: BTreeMap<String, Value>,
    copy_bytes_per_ms: f64,
) -> Point {
    let time_ms = Timing::new(&measured.frames_ms);
    Point {
        over_copy: Some(time_ms.median / (measured.n_bytes / copy_bytes_per_ms)),
        time_ms,
        sequence: sequence.name().to_owned(),
        preset: setting.preset,
        parameters: setting.parameters,
        upload_ms: measured.upload_ms,
        passes_ms: measured.passes_ms,
        metrics,
        bytes_per_pixel: measured.n_bytes / sequence.output_size().n_pixels() as f64,
        skipped: measured.skipped,
        peak_gpu_bytes: measured.peak_gpu_bytes,
        dominated_by: None,
    }
}

/// The settings that one run can score together, with their places.
fn groups(settings: &[Setting]) -> Vec<Vec<(usize, &Setting)>> {
    let mut groups: Vec<Vec<(usize, &Setting)>> = Vec::new();
    for (index, setting) in settings.iter().enumerate() {
        let same = |group: &&mut Vec<(usize, &Setting)>| {
            let (first, this) = (group[0].1.options, setting.options);
            (first.precision, first.skip) == (this.precision, this.skip) && group.len() < MAX_PRESETS_OF_A_RUN
        };
        match groups.iter_mut().find(same) {
            Some(group) => group.push((index, setting)),
            None => groups.push(vec![(index, setting)]),
        }
    }
    groups
}

/// Bounds the memory of a run.
const MAX_PRESETS_OF_A_RUN: usize = 16;

fn run_spec(spec: &BenchSpec, group: &[(usize, &Setting)]) -> RunSpec {
    RunSpec {
        presets: group.iter().map(|(_, setting)| setting.spec.clone()).collect(),
        metrics: spec.metrics.clone(),
        history: group[0].1.options.precision,
        n_frames: spec.n_frames,
        repeat: 1,
        metrics_on: MetricsOn::Auto,
        skip: group[0].1.options.skip,
        validate: Validate::No,
        until: None,
    }
}

/// The metrics of every setting, each the mean over frames after warm-up.
fn scores(
    spec: &BenchSpec,
    settings: &[Setting],
    sequence: &Sequence,
    gpu: &Gpu,
    observer: &dyn Observer,
) -> Result<(Vec<BTreeMap<String, Value>>, SequenceInfo), BenchError> {
    let mut scores = vec![BTreeMap::new(); settings.len()];
    let mut info = None;
    for group in groups(settings) {
        let report = run::execute(&run_spec(spec, &group), sequence, gpu, &Scoring(observer))?;
        for ((index, _), preset) in group.iter().zip(&report.reports) {
            let means = preset.summary.iter().map(|(id, summary)| (id.clone(), summary.mean));
            scores[*index] = means.collect();
        }
        info = Some(report.sequence);
    }
    Ok((scores, info.expect("a benchmark has settings")))
}

/// Passes on whether to stop; the progress that counts is that of measuring.
struct Scoring<'a>(&'a dyn Observer);

impl Observer for Scoring<'_> {
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}
