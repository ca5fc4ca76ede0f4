//! What a stress run returns: plain data, the same for the command line's JSON, the API and the store.

use super::growth::Growth;
use crate::{
    image::Extent,
    metrics::Value,
    run::report::AdapterInfo,
    taa::{Precision, recipe::Guards},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Every cell of a matrix.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct StressReport {
    /// What ran it.
    pub adapter: AdapterInfo,
    /// Git revision of the build that ran.
    pub revision: String,
    /// What noise and places were chosen by.
    pub seed: u32,
    /// Hazard by hazard, then recipe by recipe, then by precision.
    pub cells: Vec<Cell>,
}

/// How a recipe stood a hazard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "StressVerdict")]
pub enum Verdict {
    /// The hazard means nothing for the recipe, or the adapter cannot hold it; the reason says which.
    NotRun,
    /// Everything asked holds.
    Pass,
    /// Finite, bounded and recovered, but beyond what is promised.
    Degrades,
    /// A value that is not finite, an error without bound, or one that nothing explains.
    Fails,
}

impl Verdict {
    /// Every verdict, from no to the worst news.
    pub const ALL: [Self; 4] = [Self::NotRun, Self::Pass, Self::Degrades, Self::Fails];

    /// Its name in JSON.
    pub const fn id(self) -> &'static str {
        match self {
            Self::NotRun => "not_run",
            Self::Pass => "pass",
            Self::Degrades => "degrades",
            Self::Fails => "fails",
        }
    }
}

/// A hazard, a recipe, a precision, an adapter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Cell {
    /// Id of the hazard.
    pub hazard: String,
    /// Preset, with what was changed of it.
    pub recipe: String,
    /// Of stored history.
    pub precision: Precision,
    /// Whether the recipe keeps what makes it stable.
    pub guards: Guards,
    /// The adapter's name.
    pub adapter: String,
    /// How it stood.
    pub verdict: Verdict,
    /// Why, in words.
    pub reason: String,
    /// The largest difference from the f64 twin, in display units: 1 is the display's range.
    pub max_error: Value,
    /// The largest difference in steps of the history's precision at the twin's value.
    pub max_error_ulps: Value,
    /// The frame that had the largest error, or where it failed.
    pub frame: Option<usize>,
    /// Frames from the disturbance until the image was as if nothing had been; none where there was no disturbance, or no end.
    pub recovered_after: Option<usize>,
    /// The error by frame; of many frames some, each the worst of those since the one before.
    pub course: Vec<ErrorAt>,
    /// How the largest error of a frame changed from frame to frame.
    pub growth: Option<Growth>,
    /// What theory allows, where it says something.
    pub bound: Option<Bound>,
    /// The frames of its picture, in the order of the rows: the first, the worst and a disturbed one with those
    /// beside them, the last.
    #[serde(default)]
    pub pictured: Vec<usize>,
    /// Of the input.
    pub size: Extent,
    /// Frames that ran.
    pub n_frames: usize,
    /// SHA-256, in hexadecimal, over the last image shown, bit for bit: what is promised to be equal has an equal one.
    pub digest: String,
}

/// The largest error of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorAt {
    /// Which frame.
    pub frame: usize,
    /// Display units.
    pub error: Value,
    /// Steps of the history's precision at the twin's value.
    pub error_ulps: Value,
}

/// At most so many of a cell are kept.
const COURSE_LENGTH: usize = 24;

/// Every error, or where there are many the worst of each stretch of them.
pub fn thinned(errors: &[ErrorAt]) -> Vec<ErrorAt> {
    let stretch = errors.len().div_ceil(COURSE_LENGTH).max(1);
    let worst = |a: ErrorAt, b: &ErrorAt| if a.error.0 >= b.error.0 { a } else { *b };
    let stretches = errors.chunks(stretch);
    stretches.map(|of| of[1..].iter().fold(of[0], worst)).collect()
}

/// A limit that theory gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bound {
    /// In the unit that the formula has.
    pub value: f64,
    /// The same in letters.
    pub formula: String,
    /// What was measured of it.
    pub measured: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_of_each_stretch_is_kept() {
        let errors: Vec<_> = (0..1000)
            .map(|frame| ErrorAt {
                frame,
                error: Value(if frame == 437 { 1.0 } else { frame as f64 * 1e-9 }),
                error_ulps: Value(0.0),
            })
            .collect();
        let kept = thinned(&errors);
        assert!(
            kept.len() <= COURSE_LENGTH && kept.len() > COURSE_LENGTH / 2,
            "{}",
            kept.len()
        );
        assert!(kept.iter().any(|at| at.frame == 437));
        assert_eq!(kept.last().map(|at| at.frame), Some(999));
        assert_eq!(thinned(&errors[..5]), errors[..5]);
        assert!(thinned(&[]).is_empty());
    }
}
