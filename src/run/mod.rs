//! `execute(spec, sequence, gpu, observer) -> Report`: the one path from frames to numbers, used by the CLI and by the
//! service's worker alike. Knows neither HTTP nor SQL.

mod comparison;
mod pipeline;
mod plan;
pub mod report;
mod scoring;
mod times;
mod until;
mod validation;

use crate::{
    gpu::{Gpu, GpuError},
    image::Image,
    metrics::{Metric, Picture, gpu::GpuMetricError},
    sequence::{Sequence, SequenceError, frame::Rgb},
    taa::{PRESETS, Precision, Preset, Skip},
};
pub use comparison::{Comparison, compare_outputs};
use plan::Plan;
pub use plan::{MAX_REPEAT, Unfit, admits};
use report::Report;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use times::{process_cpu_ms, summary as time_summary};
pub use until::Until;

/// One preset of a run, with overridden parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PresetSpec {
    /// Preset id, such as `karis2014`.
    pub preset: String,
    /// Recipe parameters that replace the preset's, by name.
    #[serde(default)]
    pub parameters: serde_json::Map<String, serde_json::Value>,
}

/// What to run on a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunSpec {
    /// Which systems.
    pub presets: Vec<PresetSpec>,
    /// Which metrics; left out where the sequence has no reference.
    pub metrics: Vec<Metric>,
    /// How history is stored.
    pub history: Precision,
    /// Run only the first so many frames.
    pub n_frames: Option<usize>,
    /// How often each GPU pass of a frame is timed, 1 to 100.
    pub repeat: u32,
    /// Where metrics are computed.
    #[serde(default)]
    pub metrics_on: MetricsOn,
    /// Which work may be left out.
    #[serde(default)]
    pub skip: Skip,
    /// Ends the run before its last frame where that is enough.
    #[serde(default)]
    pub until: Option<Until>,
    /// Whether the adapter is held against the twin on the CPU.
    #[serde(default)]
    pub validate: Validate,
}

/// Whether the adapter's results are held against the twin's, pass by pass. Slow: the twin computes in f64 on the CPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Validate {
    /// Not at all.
    #[default]
    No,
    /// Every pass of every frame.
    Yes,
    /// And where anything disagrees, each pass is swapped for its twin to find which one is wrong.
    Bisect,
}

impl Validate {
    /// As the command line and jobs ask for it, in two flags of which the second includes the first.
    pub fn asked(validate: bool, bisect: bool) -> Self {
        match (validate, bisect) {
            (_, true) => Self::Bisect,
            (true, false) => Self::Yes,
            (false, false) => Self::No,
        }
    }
}

/// Where metrics are computed: the values agree, the times do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MetricsOn {
    /// On the GPU where the adapter is one, else on the CPU.
    #[default]
    Auto,
    /// On the CPU, in f64.
    Cpu,
    /// On the adapter, in f32.
    Gpu,
}

impl RunSpec {
    /// A folder name for each preset's images: its id, and a number from the second of the same preset on.
    pub fn folders(&self) -> Vec<String> {
        let ids: Vec<_> = self.presets.iter().map(|spec| spec.preset.as_str()).collect();
        ids.iter()
            .enumerate()
            .map(
                |(index, id)| match ids[..index].iter().filter(|earlier| *earlier == id).count() {
                    0 => (*id).to_owned(),
                    n_earlier => format!("{id}-{}", n_earlier + 1),
                },
            )
            .collect()
    }
}

/// What is kept of how an image came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trace {
    /// The share of history in each pixel's blend, 0 to 1, before anything is sharpened or blurred; 0 where there was none.
    HistoryShare,
    /// A pixel a tile of [`TILE`](crate::taa::TILE) by as many pixels: 1 where nothing was computed, because it would have been what is there.
    SkippedTiles,
}

impl Trace {
    /// Each.
    pub const ALL: [Self; 2] = [Self::HistoryShare, Self::SkippedTiles];

    /// Stored id; never changes.
    pub fn id(self) -> &'static str {
        match self {
            Self::HistoryShare => "history",
            Self::SkippedTiles => "skipped",
        }
    }
}

/// Watches a run from outside. Called from the run's own threads. Whoever has no method sees nothing, and `()` has none.
pub trait Observer: Sync {
    /// `n_done` of `n_total` frame × preset pairs have their metrics; as many again are validated, where that was asked for.
    fn progress(&self, _n_done: usize, _n_total: usize) {}
    /// Whether `output` should be called.
    fn wants_output(&self) -> bool {
        false
    }
    /// The shown image of one frame of `spec.presets[preset_index]`, linear RGB.
    fn output(&self, _preset_index: usize, _frame_index: usize, _image: &Image<Rgb>) -> Result<(), std::io::Error> {
        Ok(())
    }
    /// How that image came about.
    fn trace(
        &self,
        _preset_index: usize,
        _frame_index: usize,
        _trace: Trace,
        _image: &Image<f32>,
    ) -> Result<(), std::io::Error> {
        Ok(())
    }
    /// The same image beside its reference, where the run has metrics.
    fn compared(
        &self,
        _preset_index: usize,
        _frame_index: usize,
        _reference: &Picture,
        _test: &Picture,
    ) -> Result<(), std::io::Error> {
        Ok(())
    }
    /// Asked between frames; `true` ends the run with [`RunError::Cancelled`].
    fn cancelled(&self) -> bool {
        false
    }
}

impl Observer for () {}

/// Why a run gave no report.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The user's sequence or spec is at fault; trying again will not help.
    #[error("{0}")]
    Input(String),
    /// The adapter failed; another try may help.
    #[error("GPU: {0}")]
    Device(String),
    /// Our fault, or the machine's (a full disk).
    #[error("{0}")]
    Internal(String),
    /// The observer asked for the end.
    #[error("cancelled")]
    Cancelled,
}

impl From<GpuError> for RunError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Pass { .. } => Self::Internal(error.to_string()),
            _ => Self::Device(error.to_string()),
        }
    }
}

impl From<GpuMetricError> for RunError {
    fn from(error: GpuMetricError) -> Self {
        match error {
            GpuMetricError::Metric(error) => Self::Input(error.to_string()),
            GpuMetricError::Gpu(error) => error.into(),
        }
    }
}

impl From<SequenceError> for RunError {
    fn from(error: SequenceError) -> Self {
        Self::Input(error.to_string())
    }
}

/// Checks everything about `spec` that can be known without running it: preset ids, parameter names and values, and
/// that the sequence has the inputs they need.
pub fn validate(spec: &RunSpec, sequence: &Sequence) -> Result<(), RunError> {
    Plan::new(spec, sequence).map(drop)
}

/// Checks what [`compare_outputs`] would refuse before it reads an image.
pub fn validate_comparison(metrics: &[Metric], sequence: &Sequence) -> Result<(), RunError> {
    if !sequence.available().reference {
        let message = "outputs: the sequence has no reference to compare them with";
        return Err(RunError::Input(message.to_owned()));
    }
    plan::check_metrics(metrics, sequence)
}

/// The presets that can run on `sequence`, and why the others cannot.
pub fn admitted(sequence: &Sequence) -> (Vec<&'static Preset>, Vec<(&'static Preset, Unfit)>) {
    const ALL: &[Preset] = &PRESETS;
    let (mut admitted, mut refused) = (Vec::new(), Vec::new());
    for preset in ALL {
        match plan::admits(sequence, &preset.recipe) {
            Ok(()) => admitted.push(preset),
            Err(reason) => refused.push((preset, reason)),
        }
    }
    (admitted, refused)
}

/// Runs every preset of `spec` over `sequence`. Decoding, the GPU and the metrics overlap; frames arrive in order.
pub fn execute(spec: &RunSpec, sequence: &Sequence, gpu: &Gpu, observer: &dyn Observer) -> Result<Report, RunError> {
    let plan = Plan::new(spec, sequence)?;
    let mut report = pipeline::run(&plan, spec, sequence, gpu, observer)?;
    if spec.validate != Validate::No {
        let found = validation::validate(&plan, spec, sequence, gpu, observer)?;
        for (preset, validation) in report.reports.iter_mut().zip(found) {
            preset.validation = Some(validation);
        }
    }
    Ok(report)
}
