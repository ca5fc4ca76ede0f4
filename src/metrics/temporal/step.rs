//! From one frame of the reference to the next: its motion, where that can be trusted, and how the reference changed.

use super::{Shown, Sums, sum_in_rows};
use crate::{
    image::{Extent, Image},
    metrics::Domain,
};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// The largest difference in luma between a pixel and where it came from.
const REPROJECTS_WITHIN: f64 = 0.05;
/// Below this share of its largest possible value the fit's determinant is rounding: both patterns are one.
const SINGULAR: f64 = 1e-12;

/// Two frames of the reference.
pub(in super::super) struct Step {
    previous: Arc<Shown>,
    warp: Option<Warp>,
    patterns: OnceLock<Option<Patterns>>,
}

impl Step {
    /// To `current`, along `motion_px` where it is known.
    pub(in super::super) fn new(previous: Arc<Shown>, current: &Shown, motion_px: Option<&Image<[f32; 2]>>) -> Self {
        Self {
            warp: motion_px.map(|motion| Warp::new(&previous, current, motion)),
            previous,
            patterns: OnceLock::new(),
        }
    }

    /// Whether neither previous frame has a non-finite pixel.
    pub(in super::super) fn is_finite(&self, previous_test: &Shown) -> bool {
        self.previous.count_non_finite(previous_test) == 0
    }

    pub(super) fn warp(&self) -> Option<&Warp> {
        self.warp.as_ref()
    }

    /// Σ (ΔT − ΔR)² of display RGB, where Δ is the change since the previous frame.
    pub(super) fn squared_error(&self, reference: &Shown, test: &Shown, previous_test: &Shown) -> Sums {
        let extent = reference.extent();
        let images = [test, previous_test, reference, &self.previous];
        let total = sum_in_rows(extent, |pixels| {
            let errors = (0..3).map(|channel| {
                let [t, t0, r, r0] = images.map(|image| &image.plane(Domain::Display, channel)[pixels.clone()]);
                let squares = (0..r.len()).map(|i| {
                    let error = (t[i] - t0[i]) - (r[i] - r0[i]);
                    error * error
                });
                squares.sum::<f64>()
            });
            [errors.sum()]
        });
        Sums {
            total: total[0],
            n: 3 * extent.n_pixels(),
            ..Sums::default()
        }
    }

    /// Σ of the luma error, minus the previous frame's.
    pub(super) fn mean_error(&self, reference: &Shown, test: &Shown, previous_test: &Shown) -> Sums {
        let extent = reference.extent();
        let [t, t0, r, r0] = [test, previous_test, reference, &self.previous].map(Shown::luma);
        let [total] = sum_in_rows(extent, |pixels| [pixels.map(|i| (t[i] - r[i]) - (t0[i] - r0[i])).sum()]);
        Sums {
            total,
            n: extent.n_pixels(),
            ..Sums::default()
        }
    }

    /// The factors of ghosting (as `total`) and blur (as `reference`) that explain the luma error best.
    pub(super) fn fit(&self, reference: &Shown, test: &Shown) -> Option<Sums> {
        let patterns = self.patterns.get_or_init(|| Patterns::new(&self.previous, reference));
        let [ghost, blur] = patterns.as_ref()?.fit(reference, test);
        Some(Sums {
            total: ghost,
            reference: blur,
            n: 1,
            ..Sums::default()
        })
    }
}

/// The luma errors that a ghost of the previous frame and a blur would make.
struct Patterns {
    ghost: Vec<f64>,
    blur: Vec<f64>,
    /// Inverse of the matrix of their products: its two diagonal elements and the one beside.
    inverse: [f64; 3],
}

impl Patterns {
    /// `None` where the reference does not change, or is flat: the factors are undefined then.
    fn new(previous: &Shown, current: &Shown) -> Option<Self> {
        let extent = current.extent();
        let (y, y0) = (current.luma(), previous.luma());
        let ghost: Vec<f64> = (0..y.len()).into_par_iter().map(|i| y0[i] - y[i]).collect();
        let blur: Vec<f64> = (0..y.len())
            .into_par_iter()
            .map(|i| box3(y, extent, i) - y[i])
            .collect();
        let [gg, bb, gb] = sum_in_rows(extent, |pixels| {
            pixels.fold([0.0; 3], |[gg, bb, gb], i| {
                let (g, b) = (ghost[i], blur[i]);
                [gg + g * g, bb + b * b, gb + g * b]
            })
        });
        let determinant = gg * bb - gb * gb;
        (determinant > SINGULAR * gg * bb).then(|| Self {
            ghost,
            blur,
            inverse: [bb, gg, -gb].map(|element| element / determinant),
        })
    }

    fn fit(&self, reference: &Shown, test: &Shown) -> [f64; 2] {
        let (r, t) = (reference.luma(), test.luma());
        let [g, b] = sum_in_rows(reference.extent(), |pixels| {
            pixels.fold([0.0; 2], |[g, b], i| {
                let error = t[i] - r[i];
                [g + error * self.ghost[i], b + error * self.blur[i]]
            })
        });
        let [first, second, beside] = self.inverse;
        [first * g + beside * b, beside * g + second * b]
    }
}

/// Mean of 3×3 pixels; the image's edge goes on beyond it.
fn box3(luma: &[f64], extent: Extent, i: usize) -> f64 {
    let [width, height] = [extent.width as usize, extent.height as usize];
    let around = |at: usize, size: usize| [at.saturating_sub(1), at, (at + 1).min(size - 1)];
    let rows = around(i / width, height).into_iter();
    let sum: f64 = rows
        .flat_map(|y| around(i % width, width).map(|x| luma[y * width + x]))
        .sum();
    sum / 9.0
}

/// A frame gathered from the previous one, on the pixels where the reference reprojects.
pub(super) struct Warp {
    extent: Extent,
    /// Where each pixel comes from; `None` where its motion cannot be trusted.
    sources: Vec<Option<Source>>,
    /// The reference's luma minus where it came from.
    change: Vec<f64>,
    n_trusted: usize,
}

/// A bilinear sample: index of its upper left pixel and the way to the next, right and down.
#[derive(Clone, Copy)]
struct Source {
    index: usize,
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
            index: y as usize * extent.width as usize + x as usize,
            right: x.fract(),
            down: y.fract(),
        })
    }

    fn sample(self, luma: &[f64], width: usize) -> f64 {
        // On the last row or column the next one weighs nothing, and may not exist.
        let tap = |offset: usize| luma.get(self.index + offset).copied().unwrap_or_default();
        let above = tap(0) + self.right * (tap(1) - tap(0));
        let below = tap(width) + self.right * (tap(width + 1) - tap(width));
        above + self.down * (below - above)
    }
}

impl Warp {
    fn new(previous: &Shown, current: &Shown, motion_px: &Image<[f32; 2]>) -> Self {
        let extent = current.extent();
        let width = extent.width as usize;
        let (luma, luma0) = (current.luma(), previous.luma());
        let gathered: Vec<(Option<Source>, f64)> = motion_px
            .pixels()
            .par_iter()
            .enumerate()
            .map(|(i, motion)| {
                let [x, y] = [(i % width) as f64, (i / width) as f64];
                let source = Source::at(x + f64::from(motion[0]), y + f64::from(motion[1]), extent);
                let change = source.map_or(f64::NAN, |source| luma[i] - source.sample(luma0, width));
                (source.filter(|_| change.abs() <= REPROJECTS_WITHIN), change)
            })
            .collect();
        let (sources, change): (Vec<_>, Vec<_>) = gathered.into_iter().unzip();
        Self {
            extent,
            n_trusted: sources.iter().flatten().count(),
            sources,
            change,
        }
    }

    /// Σ of the squared differences between the changes of test and reference.
    pub(super) fn squared_error(&self, test: &Shown, previous_test: &Shown) -> Option<Sums> {
        self.sum(test, previous_test, |t, r| (t - r) * (t - r))
    }

    /// Σ of |change of the test| − |change of the reference|.
    pub(super) fn excess(&self, test: &Shown, previous_test: &Shown) -> Option<Sums> {
        self.sum(test, previous_test, |t, r| t.abs() - r.abs())
    }

    fn sum(&self, test: &Shown, previous_test: &Shown, f: impl Fn(f64, f64) -> f64 + Sync) -> Option<Sums> {
        let (luma, luma0) = (test.luma(), previous_test.luma());
        let [total] = sum_in_rows(self.extent, |pixels| {
            let changes = pixels.filter_map(|i| {
                let change = luma[i] - self.sources[i]?.sample(luma0, self.extent.width as usize);
                Some(f(change, self.change[i]))
            });
            [changes.sum()]
        });
        (self.n_trusted > 0).then(|| Sums {
            total,
            n: self.n_trusted,
            ..Sums::default()
        })
    }
}
