//! From one frame of the reference to the next: its motion, where that can be trusted, and how the reference changed.

use super::{
    super::{
        Metric,
        mask::{ByClass, Class, Classes, DISOCCLUDED, MOVING, sum_rows},
        plane::Plane,
        quantity::{Quantity, Sums, quantities},
        reference::{Pair, Reference},
    },
    Past,
};
use crate::image::{Extent, Image};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// The largest difference in luma between a pixel and where it came from.
pub const REPROJECTS_WITHIN: f64 = 0.05;
/// Motion in pixels from which on a pixel moves.
pub const MOVES_FROM_PX: f32 = 0.01;

/// What is measured between a frame and the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Change {
    /// Σ(ΔT − ΔR)² of display RGB, where Δ is the change since the previous frame.
    Step,
    /// The same of luma along the reference's motion.
    WarpedStep,
    /// Σ of how much more luma changes along the motion.
    WarpExcess,
    /// Σ of the change of the luma error.
    MeanError,
    /// Of the patterns of ghosting g and blur b and the luma error e: Σ gg, Σ bb, Σ gb, Σ ge, Σ be.
    Fit,
}

impl Change {
    /// Whether it is measured along the motion, where that leads back.
    pub const fn follows_motion(self) -> bool {
        matches!(self, Self::WarpedStep | Self::WarpExcess)
    }

    /// Everything but [`Change::Step`], which needs no luma.
    pub fn measure(self, pair: &Pair, past: &Past) -> ByClass<Sums> {
        let step = pair.reference.step().expect("there is a frame before");
        let previous = past.luma().expect("luma is kept from frame to frame");
        match self {
            Self::Step => unreachable!("measured pixel by pixel"),
            Self::WarpedStep => step.along_motion(pair, previous, |t, r| (t - r) * (t - r)),
            Self::WarpExcess => step.along_motion(pair, previous, |t, r| t.abs() - r.abs()),
            Self::MeanError => step.mean_error(pair, previous),
            Self::Fit => step.fit(pair),
        }
    }
}

/// Two frames of the reference.
pub struct Step {
    /// Whether every pixel of the first is.
    pub is_finite: bool,
    /// Where metrics ask for masks.
    pub classes: Option<Classes>,
    /// Of the first.
    luma: Option<Arc<Plane>>,
    warp: Option<Warp>,
    patterns: OnceLock<[ByClass<f64>; 3]>,
}

impl Step {
    /// From `previous` to `current`, along `motion_px` where it is known.
    pub fn new(previous: &Reference, current: &Reference, motion_px: Option<&Arc<Image<[f32; 2]>>>) -> Self {
        let metrics = current.metrics();
        let reads_luma = |quantity: Quantity| quantity.reads_luma() && matches!(quantity, Quantity::Change(_));
        let warp = motion_px.map(|motion_px| Warp::new(previous, current, motion_px));
        Self {
            is_finite: previous.is_finite(),
            classes: match metrics.iter().any(|metric: &Metric| metric.mask().is_some()) {
                true => warp.as_ref().map(Warp::classes),
                false => None,
            },
            luma: quantities(metrics)
                .into_iter()
                .any(reads_luma)
                .then(|| Arc::clone(previous.luma())),
            warp,
            patterns: OnceLock::new(),
        }
    }

    fn luma(&self) -> &[f64] {
        self.luma.as_ref().expect("made for the quantities that read it")
    }

    fn mean_error(&self, pair: &Pair, previous_test: &[f64]) -> ByClass<Sums> {
        let extent = pair.reference.extent();
        let [r, t, r0, t0] = [pair.reference.luma(), pair.luma(), self.luma(), previous_test];
        let [totals] = sum_rows(extent, pair.reference.classes(), |y, [changes]| {
            let start = y * changes.len();
            for (x, change) in changes.iter_mut().enumerate() {
                let i = start + x;
                *change = (t[i] - r[i]) - (t0[i] - r0[i]);
            }
        });
        sums(pair.reference.n_pixels(), [totals])
    }

    /// Sums `f` of the changes of test and reference along the motion.
    fn along_motion(&self, pair: &Pair, previous_test: &[f64], f: impl Fn(f64, f64) -> f64 + Sync) -> ByClass<Sums> {
        let warp = self
            .warp
            .as_ref()
            .expect("the metrics need motion, and the run was planned with it");
        let luma = pair.luma();
        let [totals, n] = sum_rows(warp.extent(), pair.reference.classes(), |y, [values, trusted]| {
            for x in 0..values.len() {
                let i = y * values.len() + x;
                (values[x], trusted[x]) = match source(&warp.motion_px, x, y) {
                    Some(source) if !warp.change[i].is_nan() => (
                        f(luma[i] - source.sample(previous_test, warp.extent()), warp.change[i]),
                        1.0,
                    ),
                    _ => (0.0, 0.0),
                };
            }
        });
        sums(n, [totals])
    }

    fn fit(&self, pair: &Pair) -> ByClass<Sums> {
        let (extent, classes) = (pair.reference.extent(), pair.reference.classes());
        let [r, r0, t] = [pair.reference.luma(), self.luma(), pair.luma()];
        let [gg, bb, gb] = *self.patterns.get_or_init(|| {
            sum_rows(extent, classes, |y, [gg, bb, gb]| {
                for_each_pattern(r0, r, extent, y, |x, _, ghost, blur| {
                    (gg[x], bb[x], gb[x]) = (ghost * ghost, blur * blur, ghost * blur);
                });
            })
        });
        let [ge, be] = sum_rows(extent, classes, |y, [ge, be]| {
            for_each_pattern(r0, r, extent, y, |x, i, ghost, blur| {
                let error = t[i] - r[i];
                (ge[x], be[x]) = (error * ghost, error * blur);
            });
        });
        sums(pair.reference.n_pixels(), [gg, bb, gb, ge, be])
    }
}

/// `totals` as the terms of `n` samples.
pub fn sums<const N: usize>(n: ByClass<f64>, totals: [ByClass<f64>; N]) -> ByClass<Sums> {
    std::array::from_fn(|class| Sums::new(n[class], totals.map(|by_class| by_class[class])))
}

/// Calls `f(x, index, ghost, blur)` for row `y`: the errors of luma that a ghost of the previous frame and a blur, the mean
/// of 3×3 pixels, would make. The image's edge goes on beyond it.
fn for_each_pattern(
    previous: &[f64],
    luma: &[f64],
    extent: Extent,
    y: usize,
    mut f: impl FnMut(usize, usize, f64, f64),
) {
    let (width, last) = (extent.width as usize, extent.height as usize - 1);
    let row = |y: usize| &luma[y * width..][..width];
    let [above, here, below] = [row(y.saturating_sub(1)), row(y), row((y + 1).min(last))];
    let column = |x: usize| above[x] + here[x] + below[x];
    let (mut left, mut middle) = (column(0), column(0));
    for (x, value) in here.iter().enumerate() {
        let right = column((x + 1).min(width - 1));
        let i = y * width + x;
        f(x, i, previous[i] - value, (left + middle + right) / 9.0 - value);
        (left, middle) = (middle, right);
    }
}

/// A frame gathered from the previous one.
struct Warp {
    motion_px: Arc<Image<[f32; 2]>>,
    /// The reference's luma minus where it came from; NaN where that is outside the image, or is something else.
    change: Plane,
}

/// A bilinear sample: its upper left pixel and the way to the next, right and down.
#[derive(Clone, Copy)]
struct Source {
    x: usize,
    y: usize,
    right: f64,
    down: f64,
}

impl Source {
    /// For the position in pixels from the first one's centre. `None` out of bounds, or where motion is not finite.
    fn at(x: f64, y: f64, extent: Extent) -> Option<Self> {
        let [last_x, last_y] = [extent.width, extent.height].map(|side| f64::from(side - 1));
        if !((0.0..=last_x).contains(&x) && (0.0..=last_y).contains(&y)) {
            return None;
        }
        Some(Self {
            x: x as usize,
            y: y as usize,
            right: x.fract(),
            down: y.fract(),
        })
    }

    fn sample(self, luma: &[f64], extent: Extent) -> f64 {
        // On the last row or column the next one weighs nothing.
        let (width, height) = (extent.width as usize, extent.height as usize);
        let [x, x1] = [self.x, (self.x + 1).min(width - 1)];
        let [row, row1] = [self.y, (self.y + 1).min(height - 1)].map(|y| &luma[y * width..][..width]);
        let above = row[x] + self.right * (row[x1] - row[x]);
        let below = row1[x] + self.right * (row1[x1] - row1[x]);
        above + self.down * (below - above)
    }
}

/// Where a pixel comes from.
fn source(motion_px: &Image<[f32; 2]>, x: usize, y: usize) -> Option<Source> {
    let [dx, dy] = motion_px.at(x as u32, y as u32);
    Source::at(x as f64 + f64::from(dx), y as f64 + f64::from(dy), motion_px.extent())
}

impl Warp {
    fn new(previous: &Reference, current: &Reference, motion_px: &Arc<Image<[f32; 2]>>) -> Self {
        let (luma, luma0, extent) = (current.luma(), previous.luma(), current.extent());
        let width = extent.width as usize;
        let mut change = current.new_plane();
        let rows = change.par_chunks_mut(width).enumerate();
        rows.for_each(|(y, row)| {
            for (x, change) in row.iter_mut().enumerate() {
                let source = source(motion_px, x, y);
                let difference = source.map(|source| luma[y * width + x] - source.sample(luma0, extent));
                *change = difference
                    .filter(|change| change.abs() <= REPROJECTS_WITHIN)
                    .unwrap_or(f64::NAN);
            }
        });
        Self {
            motion_px: Arc::clone(motion_px),
            change,
        }
    }

    fn extent(&self) -> Extent {
        self.motion_px.extent()
    }

    fn classes(&self) -> Classes {
        let pixels = self.motion_px.pixels().par_iter().zip(&self.change[..]);
        let classes = pixels.map(|([x, y], change)| {
            // A vector that is not finite moves.
            let stands = x * x + y * y < MOVES_FROM_PX * MOVES_FROM_PX;
            let moving: Class = if stands { 0 } else { MOVING };
            moving + if change.is_nan() { DISOCCLUDED } else { 0 }
        });
        Classes::new(self.extent(), classes.collect())
    }
}
