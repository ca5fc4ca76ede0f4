//! How far the GPU's images are from the f64 twin's, and how far they may be.
//!
//! A discontinuous decision (a tie, a box's edge) may fall differently and stays in history, so pixels beyond the bound
//! are counted, and must stay under 0.05 % of all.

use super::resolve_on_gpu;
use afterimage::{
    sequence::Frame,
    taa::{Precision, Recipe, reference::Twin},
};

/// In display units (linear through x/(1+x), the range of a display).
#[derive(Debug, Default)]
pub struct Difference {
    pub mean: f64,
    pub beyond: f64,
}

pub const MAX_DIFFERENCE: f64 = 2e-3;
pub const MEAN_DIFFERENCE: f64 = 2e-5;
pub const BEYOND: f64 = 5e-4;

impl Difference {
    pub fn agrees(&self) -> bool {
        self.mean <= MEAN_DIFFERENCE && self.beyond <= BEYOND
    }
}

/// Compares all frames of GPU and twin. Pixels beyond the bound count in `beyond` and not in the mean.
pub fn difference(recipe: &Recipe, precision: Precision, frames: impl Iterator<Item = Frame> + Clone) -> Difference {
    let twin = Twin::<f64>::new(recipe.clone(), precision);
    difference_from(twin, recipe, precision, frames, |frame| frame)
}

/// The same with any twin, which sees each frame as `altered` makes it.
pub fn difference_from(
    mut twin: Twin<f64>,
    recipe: &Recipe,
    precision: Precision,
    frames: impl Iterator<Item = Frame> + Clone,
    altered: impl Fn(Frame) -> Frame,
) -> Difference {
    let (mut sum, mut n, mut n_beyond) = (0.0, 0, 0);
    for (frame, (shown, n_repaired)) in frames.clone().zip(resolve_on_gpu(recipe, precision, frames)) {
        let index = frame.index;
        let expected = twin.resolve(&altered(frame));
        assert_eq!(n_repaired, expected.repaired_texels, "repaired texels of frame {index}");
        assert_eq!(shown.extent(), expected.shown.extent());
        for (a, b) in shown.pixels().iter().zip(expected.shown.pixels()) {
            let display = |x: f64| x / (1.0 + x);
            let worst = (0..3)
                .map(|i| (display(f64::from(a[i])) - display(b[i])).abs())
                .fold(
                    0.0,
                    |worst, d| if d.is_nan() { f64::INFINITY } else { f64::max(worst, d) },
                );
            n += 1;
            if worst > MAX_DIFFERENCE {
                n_beyond += 1;
            } else {
                sum += worst;
            }
        }
    }
    Difference {
        mean: sum / f64::from(n),
        beyond: f64::from(n_beyond) / f64::from(n),
    }
}
