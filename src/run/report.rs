//! What a run returns, and what the service stores: plain data, the same for the CLI's JSON and the API's.

use crate::{
    image::{Extent, Image},
    metrics::{Summary, Value},
    taa::validation::Validation,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Every preset of one run over one sequence.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Report {
    /// What was resolved.
    pub sequence: SequenceInfo,
    /// What resolved it.
    pub adapter: AdapterInfo,
    /// Git revision of the build that ran.
    pub revision: String,
    /// Version of each metric used, by id.
    pub metric_versions: BTreeMap<String, u32>,
    /// Wall time of each stage over the whole run, while all overlapped: `decode` (of one of its threads), `upload`, `gpu`,
    /// `readback`, `metrics`, `output` (the observer's images); and of the run, `total`.
    pub stages_ms: BTreeMap<String, f64>,
    /// One entry a preset, in the order asked for.
    pub reports: Vec<PresetReport>,
}

impl Report {
    /// Whether every pixel of every output and reference was finite. A run that is not has failed.
    pub fn is_finite(&self) -> bool {
        let mut frames = self.reports.iter().flat_map(|preset| &preset.frames);
        frames.all(|frame| frame.non_finite_pixels == 0)
    }

    /// Whether the adapter agrees with the twin in whatever was validated.
    pub fn agrees(&self) -> bool {
        let mut validations = self.reports.iter().filter_map(|preset| preset.validation.as_ref());
        validations.all(|validation| validation.agrees)
    }
}

/// Tells of frames whose metrics are no numbers.
pub(super) fn note_of_broken(frames: &[FrameReport]) -> Option<String> {
    let n_broken = frames.iter().filter(|frame| frame.non_finite_pixels > 0).count();
    let of = frames.len();
    (n_broken > 0)
        .then(|| format!("{n_broken} of {of} frames have pixels that are not finite: their metrics are no numbers"))
}

pub(super) fn note_of_repaired(frames: &[FrameReport]) -> Option<String> {
    let repaired = || frames.iter().filter(|frame| frame.repaired_texels > 0);
    let first = repaired().next()?.index;
    let n_texels: u64 = repaired().map(|frame| frame.repaired_texels).sum();
    Some(format!(
        "{n_texels} input texels were repaired, which were not finite, negative or beyond f16, in {} of {} frames; frame {first} is the first",
        repaired().count(),
        frames.len()
    ))
}

/// The sequence a report speaks of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SequenceInfo {
    /// Name from the manifest.
    pub name: String,
    /// Content hash: SHA-256 in hexadecimal over manifest and files.
    pub hash: String,
    /// Size of the engine's frames.
    pub render_size: Extent,
    /// Size of the reference and of the resolved image.
    pub output_size: Extent,
    /// Number of frames that ran.
    pub n_frames: usize,
}

/// The adapter a report was made on. Times compare only between equal ones.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub struct AdapterInfo {
    /// Name as the driver gives it.
    pub name: String,
    /// `Vulkan`, …
    pub backend: String,
    /// `Cpu`, `DiscreteGpu`, …
    pub kind: String,
    /// Driver's name.
    pub driver: String,
    /// Driver's version.
    pub driver_version: String,
}

/// One preset over the sequence.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PresetReport {
    /// Preset id.
    pub preset: String,
    /// The recipe in full: preset and overrides merged.
    pub parameters: serde_json::Value,
    /// What a reader must know to trust the numbers, such as "the input is jittered".
    pub notes: Vec<String>,
    /// How far the adapter is from the twin, where that was asked for.
    #[serde(default)]
    pub validation: Option<Validation>,
    /// Every frame, warm-up included.
    pub frames: Vec<FrameReport>,
    /// By metric id, over frames after warm-up.
    pub summary: BTreeMap<String, Summary>,
    /// By pass, over frames after warm-up and all repeats.
    pub times_ms: BTreeMap<String, TimeSummary>,
    /// What was left out; none where nothing may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skipped: Option<Skipped>,
}

/// The tiles that a preset did not compute because what they would show and store was there already.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Skipped {
    /// Of all tiles of all frames, 0 to 1.
    pub share: f64,
    /// About what the median frame would have taken longer without: its time for each tile, times the tiles kept. None where
    /// nothing is timed or all is kept.
    pub saved_ms: Option<f64>,
    /// About what the median frame would have taken without.
    pub without_ms: Option<f64>,
    /// Columns and rows of tiles of 16×16 pixels.
    pub tiles: Extent,
    /// In which share of the frames each tile was kept, row by row.
    pub kept: Vec<f32>,
}

impl Skipped {
    /// For people: "62 % of tiles kept, 3.1 of 8.4 ms".
    pub fn note(&self) -> String {
        let share = format!("{:.0} % of tiles kept", 100.0 * self.share);
        match (self.saved_ms, self.without_ms) {
            (Some(saved), Some(without)) if without > 0.0 => {
                format!("{share}, about {saved:.1} of {without:.1} ms saved")
            }
            _ => share,
        }
    }

    /// The shares as an image, black for tiles that were always computed and white for those that never were.
    pub fn heatmap(&self) -> Image<[u8; 3]> {
        let shade = |&kept: &f32| [(255.0 * kept).round() as u8; 3];
        let side = 16;
        let shades: Vec<_> = self.kept.iter().map(shade).collect();
        let extent = Extent::new(self.tiles.width * side, self.tiles.height * side);
        Image::from_fn(extent, |x, y| {
            shades[((y / side) * self.tiles.width + x / side) as usize]
        })
    }
}

/// One frame of one preset.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FrameReport {
    /// Position in the sequence, from 0.
    pub index: usize,
    /// History was dropped before this frame.
    pub reset: bool,
    /// The frame lies within the manifest's `warmup_frames` after a reset: stored, but not summarised.
    pub warmup: bool,
    /// Texels whose colour had a non-finite, negative or overflowing component.
    pub repaired_texels: u64,
    /// Pixels of output or reference with a non-finite component. Any at all fails the verdict.
    pub non_finite_pixels: u64,
    /// By metric id.
    pub metrics: BTreeMap<String, Value>,
    /// By pass (`prepare`, `resolve` and others: GPU timestamps, median of the repeats) and host stage (`host_cpu`, `decode`,
    /// `upload`, `readback`, `metrics`: wall time of that stage, `host_cpu`: CPU time of the submitting thread).
    pub times_ms: BTreeMap<String, f64>,
}

impl FrameReport {
    /// A frame of which nothing is known yet.
    pub fn empty(index: usize) -> Self {
        Self {
            index,
            reset: false,
            warmup: false,
            repaired_texels: 0,
            non_finite_pixels: 0,
            metrics: BTreeMap::new(),
            times_ms: BTreeMap::new(),
        }
    }
}

/// Repeated measurements of one pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TimeSummary {
    /// Middle value.
    pub median: f64,
    /// Smallest value: the least disturbed.
    pub min: f64,
    /// Median absolute deviation from the median.
    pub mad: f64,
    /// How many measurements.
    pub n: usize,
}
