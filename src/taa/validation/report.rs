//! What a validation found: every frame, and over all of them.

use super::{Agreement, Bounds, Worst};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A recipe over a sequence, on the adapter and on its twin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Validation {
    /// Every pass of every frame agrees, and every frame shown.
    pub agrees: bool,
    /// What is allowed of each pass, given the same inputs as its twin.
    pub pass_bounds: Bounds,
    /// What is allowed of the frames shown; none where they are measured only, as with a 16-bit history that decides more
    /// than a blend.
    pub frame_bounds: Option<Bounds>,
    /// The frames shown, against a twin that runs by itself.
    pub shown: Overview,
    /// In their order, against a twin of the GPU's own inputs.
    pub passes: Vec<Overview>,
    /// Which pass is wrong, where that was asked for and any is.
    pub bisection: Option<Bisection>,
    /// In their order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frames: Vec<FrameAgreement>,
}

/// One frame on both sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameAgreement {
    /// Position in the sequence, from 0.
    pub index: usize,
    /// History was dropped before it.
    pub reset: bool,
    /// What is shown.
    pub shown: Agreement,
    /// In their order.
    pub passes: Vec<PassAgreement>,
}

impl FrameAgreement {
    /// What is shown, and every pass.
    pub fn agrees(&self) -> bool {
        self.shown.agrees && self.passes.iter().all(|pass| pass.agreement.agrees)
    }
}

/// What one pass wrote.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PassAgreement {
    /// Its name.
    pub pass: String,
    /// All its images together.
    #[serde(flatten)]
    pub agreement: Agreement,
}

/// Over all frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Overview {
    /// The pass; `shown` of frames.
    pub name: String,
    /// Every frame does.
    pub agrees: bool,
    /// The largest distance of a pixel.
    pub max: f64,
    /// The largest mean of a frame.
    pub mean: f64,
    /// Pixels beyond the bound, in all frames.
    pub n_beyond: u64,
    /// The largest share of a frame's.
    pub share_beyond: f64,
    /// Pixels beyond it that 32-bit arithmetic does not determine, in all frames.
    pub n_undetermined: u64,
    /// Pixels that are not finite on the GPU, in all frames.
    pub non_finite_gpu: u64,
    /// And in the twin.
    pub non_finite_twin: u64,
    /// How many frames disagree.
    pub n_disagreeing_frames: usize,
    /// The first that does.
    pub first_disagreeing_frame: Option<usize>,
    /// The frame with the worst pixel; none where all are equal.
    pub worst_frame: Option<usize>,
    /// That pixel.
    pub worst: Option<Worst>,
}

impl Overview {
    /// Of the same thing in every frame.
    pub fn of<'a>(name: &str, frames: impl Iterator<Item = (usize, &'a Agreement)> + Clone) -> Self {
        let all = frames.clone().map(|(_, agreement)| agreement);
        let largest = |of: fn(&Agreement) -> f64| all.clone().map(of).fold(0.0, f64::max);
        let sum = |of: fn(&Agreement) -> u64| all.clone().map(of).sum();
        let disagreeing = frames.clone().filter(|(_, agreement)| !agreement.agrees);
        let badness = |agreement: &Agreement| (agreement.non_finite_gpu + agreement.non_finite_twin, agreement.max);
        let worst = frames.filter(|(_, agreement)| agreement.worst.is_some());
        let worst = worst.reduce(|a, b| if badness(b.1) > badness(a.1) { b } else { a });
        Self {
            name: name.to_owned(),
            agrees: disagreeing.clone().next().is_none(),
            max: largest(|agreement| agreement.max),
            mean: largest(|agreement| agreement.mean),
            n_beyond: sum(|agreement| agreement.n_beyond),
            share_beyond: largest(|agreement| agreement.share_beyond),
            n_undetermined: sum(|agreement| agreement.n_undetermined),
            non_finite_gpu: sum(|agreement| agreement.non_finite_gpu),
            non_finite_twin: sum(|agreement| agreement.non_finite_twin),
            n_disagreeing_frames: disagreeing.clone().count(),
            first_disagreeing_frame: disagreeing.map(|(index, _)| index).next(),
            worst_frame: worst.map(|(index, _)| index),
            worst: worst.and_then(|(_, agreement)| agreement.worst.clone()),
        }
    }
}

/// Each pass in turn computed by its twin, and the rest on the GPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bisection {
    /// The first pass that disagrees with its twin, in the first frame in which any does; none where every pass does its
    /// part and only their errors add up.
    pub pass: Option<String>,
    /// That frame.
    pub frame: Option<usize>,
    /// The frames shown with one pass swapped, by that pass's name.
    pub swaps: Vec<Overview>,
}

impl Validation {
    /// Of all frames.
    pub fn new((pass_bounds, frame_bounds): (Bounds, Option<Bounds>), frames: Vec<FrameAgreement>) -> Self {
        let n_passes = frames.first().map_or(0, |frame| frame.passes.len());
        let passes: Vec<_> = (0..n_passes)
            .map(|i| {
                let of_pass = frames.iter().map(|frame| (frame.index, &frame.passes[i].agreement));
                Overview::of(&frames[0].passes[i].pass, of_pass)
            })
            .collect();
        let shown = shown("shown", &frames);
        Self {
            agrees: shown.agrees && passes.iter().all(|pass| pass.agrees),
            pass_bounds,
            frame_bounds,
            shown,
            passes,
            bisection: None,
            frames,
        }
    }

    /// The first frame in which a pass disagrees, and the first pass of it that does.
    pub fn first_fault(&self) -> Option<(usize, &str)> {
        self.frames.iter().find_map(|frame| {
            let wrong = frame.passes.iter().find(|pass| !pass.agreement.agrees)?;
            Some((frame.index, wrong.pass.as_str()))
        })
    }
}

/// The frames shown.
pub fn shown(name: &str, frames: &[FrameAgreement]) -> Overview {
    Overview::of(name, frames.iter().map(|frame| (frame.index, &frame.shown)))
}
