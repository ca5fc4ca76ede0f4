//! Structural similarity: `ssim`, `ssim.y`, `ssim.u8`. Wang, Bovik, Sheikh and Simoncelli, "Image Quality Assessment:
//! From Error Visibility to Structural Similarity", 2004: an 11×11 Gaussian window, σ 1.5, population covariance, mean
//! over the windows that lie wholly inside the image.
//!
//! In terms of the sum S = T + R and the difference D = T − R the index is
//!
//! ```text
//! (μS² − μD² + 2 C1) (σS² − σD² + 2 C2)
//! ─────────────────────────────────────
//! (μS² + μD² + 2 C1) (σS² + σD² + 2 C2)
//! ```
//!
//! which needs four filtered planes instead of five, is symmetric to the last bit, and is exactly 1 for equal images.
//! Windows are separable: each column of a tile is filtered over a ring of the last eleven rows, then the row.

use super::{Better, Definition, Domain, MetricInfo, Quantity, Shown, Sums};
use crate::image::{Extent, Image};
use rayon::prelude::*;
use std::{ops::Range, sync::LazyLock};

/// Side of the window in pixels.
pub(super) const WINDOW: usize = 11;
const HALF: usize = WINDOW / 2;
const SIGMA: f64 = 1.5;

/// Columns of windows in a tile; with the ring it fits the first-level cache.
const TILE: usize = 64;
const TILE_INPUT: usize = TILE + WINDOW - 1;
/// Rows of windows that one thread takes at a time.
pub(super) const BAND: usize = 64;

pub(super) const SSIM: Definition = ssim("ssim", Domain::Display, "Structural similarity of display RGB");
pub(super) const SSIM_Y: Definition = ssim("ssim.y", Domain::Luma, "Structural similarity of Rec. 709 luma");
pub(super) const SSIM_U8: Definition = ssim(
    "ssim.u8",
    Domain::U8,
    "Structural similarity of display RGB rounded to 8 bits",
);

const fn ssim(id: &'static str, domain: Domain, description: &'static str) -> Definition {
    Definition {
        info: MetricInfo {
            id,
            unit: "",
            better: Better::Higher,
            version: 1,
            description,
        },
        quantity: Quantity::Ssim(domain),
        value: Sums::mean,
        relative_mse: None,
    }
}

/// Weights of the window's centre and of the pixels 1 to 5 away from it; the eleven sum to 1.
pub(super) static WEIGHTS: LazyLock<[f64; HALF + 1]> = LazyLock::new(|| {
    let gauss: [f64; HALF + 1] = std::array::from_fn(|i| libm::exp(-0.5 * (i as f64 / SIGMA) * (i as f64 / SIGMA)));
    let sum = gauss[0] + 2.0 * gauss[1..].iter().sum::<f64>();
    gauss.map(|weight| weight / sum)
});

/// The constants C1 and C2 that keep flat windows stable, for values up to `peak`.
pub(super) fn stabilisers(peak: f64) -> [f64; 2] {
    [(0.01 * peak) * (0.01 * peak), (0.03 * peak) * (0.03 * peak)]
}

/// Sums the index over all windows and channels, in an order that does not depend on the number of threads.
pub(super) fn measure(domain: Domain, reference: &Shown, test: &Shown) -> Sums {
    let valid = valid_extent(reference.extent());
    let (width, height) = (valid.width as usize, valid.height as usize);
    let bands: Vec<f64> = (0..height.div_ceil(BAND) * domain.n_channels())
        .into_par_iter()
        .map(|i| {
            let (channel, first) = (i % domain.n_channels(), i / domain.n_channels() * BAND);
            let mut total = 0.0;
            let rows = first..height.min(first + BAND);
            let images = [reference, test].map(|shown| Channel { shown, domain, channel });
            let stabilisers = stabilisers(domain.peak());
            Pair::new(images).for_each_run(rows, width, |_, _, windows| {
                total += windows.indices(stabilisers).sum::<f64>();
            });
            total
        })
        .collect();
    Sums {
        total: bands.iter().sum(),
        n: width * height * domain.n_channels(),
        ..Sums::default()
    }
}

/// The index of every window, averaged over the channels of display RGB: pixel (x, y) is the window centred five pixels
/// further right and down.
pub(super) fn map(reference: &Shown, test: &Shown) -> Image<f32> {
    let valid = valid_extent(reference.extent());
    let width = valid.width as usize;
    let mut map = Image::filled(valid, 0.0);
    let bands = map.pixels_mut().par_chunks_mut(width * BAND).enumerate();
    bands.for_each(|(band, pixels)| {
        let first = band * BAND;
        for channel in 0..3 {
            let rows = first..first + pixels.len() / width;
            let images = [reference, test].map(|shown| Channel {
                shown,
                domain: Domain::Display,
                channel,
            });
            let stabilisers = stabilisers(Domain::Display.peak());
            Pair::new(images).for_each_run(rows, width, |x, y, windows| {
                let run = &mut pixels[(y - first) * width + x..][..windows.n];
                for (pixel, index) in run.iter_mut().zip(windows.indices(stabilisers)) {
                    *pixel += (index / 3.0) as f32;
                }
            });
        }
    });
    map
}

/// How many windows fit in each axis.
pub(super) fn valid_extent(extent: Extent) -> Extent {
    Extent::new(extent.width - 2 * HALF as u32, extent.height - 2 * HALF as u32)
}

/// The planes that are filtered, over one row of a tile: S, D, S², D².
type Row = [[f64; TILE_INPUT]; 4];

/// One channel of an image, to be read by rows.
pub(super) trait Rows {
    /// The `columns` of row `y`, which may be put into `scratch`.
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut Vec<f64>) -> &'a [f64];
}

struct Channel<'a> {
    shown: &'a Shown,
    domain: Domain,
    channel: usize,
}

impl Rows for Channel<'_> {
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut Vec<f64>) -> &'a [f64] {
        self.shown.row(self.domain, self.channel, y, columns, scratch)
    }
}

/// A channel of two images, reference and test, and room to filter them.
pub(super) struct Pair<R> {
    images: [R; 2],
    scratch: [Vec<f64>; 2],
    ring: Box<[Row; WINDOW]>,
}

impl<R: Rows> Pair<R> {
    pub(super) fn new(images: [R; 2]) -> Self {
        Self {
            images,
            scratch: Default::default(),
            ring: Box::new([[[0.0; TILE_INPUT]; 4]; WINDOW]),
        }
    }

    /// Calls `f(x, y, windows)` for every run of at most [`TILE`] windows in `rows`, `width` windows to a row.
    pub(super) fn for_each_run(&mut self, rows: Range<usize>, width: usize, mut f: impl FnMut(usize, usize, &Windows)) {
        let mut columns = [[0.0; TILE_INPUT]; 4];
        let mut windows = Windows {
            planes: [[0.0; TILE]; 4],
            n: 0,
        };
        for x in (0..width).step_by(TILE) {
            windows.n = TILE.min(width - x);
            for y in rows.start..rows.start + WINDOW - 1 {
                self.load(x, windows.n, y);
            }
            for y in rows.clone() {
                self.load(x, windows.n, y + WINDOW - 1);
                filter_columns(&self.ring, y, &mut columns);
                filter_row(&columns, &mut windows.planes);
                f(x, y, &windows);
            }
        }
    }

    /// Puts row `y` of the images into the ring; columns beyond the image keep what they held and are not read.
    fn load(&mut self, x: usize, n: usize, y: usize) {
        let [scratch_r, scratch_t] = &mut self.scratch;
        let columns = x..x + n + WINDOW - 1;
        let [reference, test] = &self.images;
        let r = reference.row(y, columns.clone(), scratch_r);
        let t = test.row(y, columns, scratch_t);
        let [s, d, ss, dd] = &mut self.ring[y % WINDOW];
        for (i, (r, t)) in r.iter().zip(t).enumerate() {
            (s[i], d[i]) = (t + r, t - r);
            (ss[i], dd[i]) = (s[i] * s[i], d[i] * d[i]);
        }
    }
}

/// The weighted means of a run of windows.
pub(super) struct Windows {
    /// Of the planes in [`Row`]; whatever lies beyond the run has no meaning.
    planes: [[f64; TILE]; 4],
    /// How many windows.
    n: usize,
}

impl Windows {
    /// The index of each window.
    pub(super) fn indices(&self, [c1, c2]: [f64; 2]) -> impl Iterator<Item = f64> {
        let [s, d, ss, dd] = &self.planes;
        let indices: [f64; TILE] = std::array::from_fn(|i| {
            let (mean_s, mean_d) = (s[i] * s[i], d[i] * d[i]);
            let (var_s, var_d) = (ss[i] - mean_s, dd[i] - mean_d);
            let above = (mean_s - mean_d + 2.0 * c1) * (var_s - var_d + 2.0 * c2);
            let below = (mean_s + mean_d + 2.0 * c1) * (var_s + var_d + 2.0 * c2);
            above / below
        });
        indices.into_iter().take(self.n)
    }

    /// The part of each index that compares contrast and structure, and leaves out brightness.
    pub(super) fn contrasts(&self, [_, c2]: [f64; 2]) -> impl Iterator<Item = f64> {
        let [s, d, ss, dd] = &self.planes;
        let contrasts: [f64; TILE] = std::array::from_fn(|i| {
            let (var_s, var_d) = (ss[i] - s[i] * s[i], dd[i] - d[i] * d[i]);
            (var_s - var_d + 2.0 * c2) / (var_s + var_d + 2.0 * c2)
        });
        contrasts.into_iter().take(self.n)
    }
}

/// The Gaussian over the eleven rows from `first` on.
fn filter_columns(ring: &[Row; WINDOW], first: usize, filtered: &mut Row) {
    for (plane, filtered) in filtered.iter_mut().enumerate() {
        gaussian(std::array::from_fn(|i| &ring[(first + i) % WINDOW][plane]), filtered);
    }
}

/// The Gaussian along a row.
fn filter_row(row: &Row, filtered: &mut [[f64; TILE]; 4]) {
    for (plane, filtered) in row.iter().zip(filtered) {
        let tap = |i: usize| plane[i..].first_chunk().expect("a tile and its borders fill the row");
        gaussian(std::array::from_fn(tap), filtered);
    }
}

/// The weighted sum of eleven arrays. Pairs at equal distance share a weight, and one pass over all of them keeps every
/// partial sum in a register.
fn gaussian<const N: usize>(taps: [&[f64; N]; WINDOW], sums: &mut [f64; N]) {
    let [w0, w1, w2, w3, w4, w5] = *WEIGHTS;
    let [l5, l4, l3, l2, l1, centre, r1, r2, r3, r4, r5] = taps;
    for i in 0..N {
        let near = w0 * centre[i] + w1 * (l1[i] + r1[i]) + w2 * (l2[i] + r2[i]);
        let far = w3 * (l3[i] + r3[i]) + w4 * (l4[i] + r4[i]) + w5 * (l5[i] + r5[i]);
        sums[i] = near + far;
    }
}
