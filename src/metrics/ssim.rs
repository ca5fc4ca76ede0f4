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
//! which needs four filtered values instead of five, is symmetric to the last bit, and is exactly 1 for equal images.
//! Windows are separable: each row of a tile is filtered once, each column over a ring of the last eleven rows.

use super::{
    Better, MetricInfo,
    mask::{self, ByClass, Classes},
    metric::Definition,
    quantity::{Domain, Quantity, Sums},
    reference::Pair,
    same::Same,
    shown::{RowScratch, Shown},
    vector::vectorised,
};
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
pub(super) const BAND: usize = 128;

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
        value: |sums| Some(sums.mean()),
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
pub(super) fn measure(pair: &Pair, domain: Domain) -> ByClass<Sums> {
    let valid = valid_extent(pair.reference.extent());
    let (width, height) = (valid.width as usize, valid.height as usize);
    let bands = (0..height.div_ceil(BAND) * domain.n_channels())
        .into_par_iter()
        .map(|i| {
            let (channel, first) = (i % domain.n_channels(), i / domain.n_channels() * BAND);
            let [mut totals, mut n] = [ByClass::default(); 2];
            let rows = first..height.min(first + BAND);
            let mut windows = windows_of(pair, domain, channel);
            windows.for_each_run(rows, width, Part::Whole, |x, y, indices| {
                let classes = centres(pair.reference.classes(), x, y, indices.len());
                mask::add(indices, classes, &mut totals);
                match classes {
                    None => n[0] += indices.len() as f64,
                    Some(classes) => classes.iter().for_each(|class| n[usize::from(*class)] += 1.0),
                }
            });
            [totals, n]
        });
    let bands: Vec<[ByClass<f64>; 2]> = bands.collect();
    std::array::from_fn(|class| {
        let [total, n] = std::array::from_fn(|i| bands.iter().map(|band| band[i][class]).sum());
        Sums::new(n, [total])
    })
}

/// The class of the pixel in the middle of each window of a run.
fn centres(classes: Option<&Classes>, x: usize, y: usize, n: usize) -> Option<&[mask::Class]> {
    Some(classes?.row(y + HALF, x + HALF..x + HALF + n))
}

/// The index of the window around each pixel, averaged over channels; NaN where it leaves the image.
pub(super) fn map(pair: &Pair, domain: Domain) -> Image<f32> {
    let extent = pair.reference.extent();
    let (width, n_windows) = (extent.width as usize, valid_extent(extent).width as usize);
    let mut map = Image::filled(extent, f32::NAN);
    let inner = HALF * width..map.pixels().len() - HALF * width;
    let bands = map.pixels_mut()[inner].par_chunks_mut(width * BAND).enumerate();
    bands.for_each(|(band, pixels)| {
        let first = band * BAND;
        let mut means = vec![0.0; n_windows * (pixels.len() / width)];
        for channel in 0..domain.n_channels() {
            let rows = first..first + pixels.len() / width;
            let mut windows = windows_of(pair, domain, channel);
            windows.for_each_run(rows, n_windows, Part::Whole, |x, y, indices| {
                let run = &mut means[(y - first) * n_windows + x..][..indices.len()];
                for (mean, index) in run.iter_mut().zip(indices) {
                    *mean += index / domain.n_channels() as f64;
                }
            });
        }
        for (row, means) in pixels.chunks_mut(width).zip(means.chunks(n_windows)) {
            for (pixel, mean) in row[HALF..].iter_mut().zip(means) {
                *pixel = *mean as f32;
            }
        }
    });
    map
}

fn windows_of<'a>(pair: &'a Pair, domain: Domain, channel: usize) -> Windows<'a, Channel<'a>> {
    let images = [pair.reference.shown(), pair.shown()].map(|shown| Channel { shown, domain, channel });
    Windows::new(images, stabilisers(domain.peak()), &pair.same, 0)
}

/// How many windows fit in each axis.
pub(super) fn valid_extent(extent: Extent) -> Extent {
    Extent::new(extent.width - 2 * HALF as u32, extent.height - 2 * HALF as u32)
}

/// S, D, S² and D² of a pixel, or their means over a window. They lie side by side: what a filter adds up is then always a
/// whole number of vectors away, and is never read across two cache lines.
const MOMENTS: usize = 4;

/// One row of a tile.
#[repr(align(64))]
struct Input([f64; MOMENTS * TILE_INPUT]);
/// The same, filtered along the row.
#[repr(align(64))]
#[derive(Clone, Copy)]
struct Row([f64; MOMENTS * TILE]);
/// Windows of two rows are filtered at once, since they share all but one row each.
const RING: usize = WINDOW + 1;
type Ring = [Row; RING];

/// One channel of an image, to be read by rows.
pub(super) trait Rows {
    /// The `columns` of row `y`, which may be put into `scratch`.
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut RowScratch) -> &'a [f64];
}

struct Channel<'a> {
    shown: &'a Shown,
    domain: Domain,
    channel: usize,
}

impl Rows for Channel<'_> {
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut RowScratch) -> &'a [f64] {
        self.shown.row(self.domain, self.channel, y, columns, scratch)
    }
}

/// What is compared.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Brightness, contrast and structure.
    Whole,
    /// Contrast and structure.
    Contrast,
}

/// The windows of a channel of two images, reference and test, and room to filter them.
pub(super) struct Windows<'a, R> {
    images: [R; 2],
    stabilisers: [f64; 2],
    same: &'a Same,
    /// How often the images were halved since `same` was found.
    scale: u32,
    scratch: [RowScratch; 2],
    input: Box<Input>,
    /// The last rows, filtered along themselves.
    ring: Box<Ring>,
}

impl<'a, R: Rows> Windows<'a, R> {
    pub(super) fn new(images: [R; 2], stabilisers: [f64; 2], same: &'a Same, scale: u32) -> Self {
        Self {
            images,
            stabilisers,
            same,
            scale,
            scratch: Default::default(),
            input: Box::new(Input([0.0; MOMENTS * TILE_INPUT])),
            ring: Box::new([Row([0.0; MOMENTS * TILE]); RING]),
        }
    }

    /// Calls `f(x, y, indices)` for every run of at most [`TILE`] windows in `rows`, `width` windows to a row. The index is 1
    /// wherever the images are the same, and nothing is filtered there.
    pub(super) fn for_each_run(
        &mut self,
        rows: Range<usize>,
        width: usize,
        part: Part,
        mut f: impl FnMut(usize, usize, &[f64]),
    ) {
        let mut means = [Row([0.0; MOMENTS * TILE]); 2];
        let mut indices = [0.0; TILE];
        for x in (0..width).step_by(TILE) {
            let n = TILE.min(width - x);
            if self.is_same(x..x + n, rows.clone()) {
                rows.clone().for_each(|y| f(x, y, &[1.0; TILE][..n]));
                continue;
            }
            for y in rows.start..rows.start + WINDOW - 1 {
                self.load(x, n, y);
            }
            for first in rows.clone().step_by(2) {
                let pair = first..rows.end.min(first + 2);
                pair.clone().for_each(|y| self.load(x, n, y + WINDOW - 1));
                filter_columns(&self.ring, first, &mut means);
                for (y, means) in pair.zip(&means) {
                    match part {
                        Part::Whole => compare(means, self.stabilisers, &mut indices),
                        Part::Contrast => compare_contrast(means, self.stabilisers, &mut indices),
                    }
                    f(x, y, &indices[..n]);
                }
            }
        }
    }

    /// Whether all that these windows see is the same in both images. Halving may move pixels by one, each time.
    fn is_same(&self, x: Range<usize>, y: Range<usize>) -> bool {
        let seen =
            |windows: Range<usize>| windows.start.saturating_sub(1) << self.scale..(windows.end + WINDOW) << self.scale;
        self.same.covers(seen(x), seen(y))
    }

    /// Puts row `y` of the images into the ring, filtered; columns beyond the image are not read from it.
    fn load(&mut self, x: usize, n: usize, y: usize) {
        let [scratch_r, scratch_t] = &mut self.scratch;
        let columns = x..x + n + WINDOW - 1;
        let [reference, test] = &self.images;
        let r = reference.row(y, columns.clone(), scratch_r);
        let t = test.row(y, columns, scratch_t);
        filter_row(r, t, &mut self.input, &mut self.ring[y % RING]);
    }
}

vectorised! {
    /// Filters a row of both images; beyond `r` and `t`, `input` keeps what it held.
    fn filter_row<'a>(r: &'a [f64], t: &'a [f64], input: &'a mut Input, filtered: &'a mut Row) {
        let (pixels, _) = input.0.as_chunks_mut::<MOMENTS>();
        for ((moments, r), t) in pixels.iter_mut().zip(r).zip(t) {
            let (s, d) = (t + r, t - r);
            *moments = [s, d, s * s, d * d];
        }
        let weights = *WEIGHTS;
        let mut pixels: [&[f64; MOMENTS * TILE]; WINDOW] = [input.0.first_chunk().expect("a tile is no wider than its input"); WINDOW];
        for (i, pixel) in pixels.iter_mut().enumerate() {
            *pixel = input.0[MOMENTS * i..].first_chunk().expect("a tile and its borders fill the row");
        }
        for i in 0..MOMENTS * TILE {
            filtered.0[i] = weigh(weights, &pixels, i);
        }
    }

    /// The weighted means of the windows whose first row is `first`, and of those below.
    fn filter_columns<'a>(ring: &'a Ring, first: usize, means: &'a mut [Row; 2]) {
        let weights = *WEIGHTS;
        let [above, below] = means;
        let mut rows = [&ring[0].0; RING];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = &ring[(first + i) % RING].0;
        }
        let upper = rows.first_chunk().expect("all but the last");
        let lower = rows.last_chunk().expect("all but the first");
        for i in 0..MOMENTS * TILE {
            above.0[i] = weigh(weights, upper, i);
            below.0[i] = weigh(weights, lower, i);
        }
    }

    /// The index of each window.
    fn compare<'a>(means: &'a Row, stabilisers: [f64; 2], indices: &'a mut [f64; TILE]) {
        let [c1, c2] = stabilisers;
        for (index, [s, d, ss, dd]) in indices.iter_mut().zip(means.0.as_chunks().0) {
            let (mean_s, mean_d) = (s * s, d * d);
            let (var_s, var_d) = (ss - mean_s, dd - mean_d);
            let above = (mean_s - mean_d + 2.0 * c1) * (var_s - var_d + 2.0 * c2);
            let below = (mean_s + mean_d + 2.0 * c1) * (var_s + var_d + 2.0 * c2);
            *index = above / below;
        }
    }

    /// The part of each index that compares contrast and structure, and leaves out brightness.
    fn compare_contrast<'a>(means: &'a Row, stabilisers: [f64; 2], indices: &'a mut [f64; TILE]) {
        let [_, c2] = stabilisers;
        for (index, [s, d, ss, dd]) in indices.iter_mut().zip(means.0.as_chunks().0) {
            let (var_s, var_d) = (ss - s * s, dd - d * d);
            *index = (var_s - var_d + 2.0 * c2) / (var_s + var_d + 2.0 * c2);
        }
    }
}

/// The weighted sum at `i` of a window's pixels or rows. Pairs at equal distance share a weight.
#[inline(always)]
fn weigh<const N: usize>([w0, w1, w2, w3, w4, w5]: [f64; HALF + 1], taps: &[&[f64; N]; WINDOW], i: usize) -> f64 {
    let [l5, l4, l3, l2, l1, centre, r1, r2, r3, r4, r5] = taps;
    let near = w2.mul_add(l2[i] + r2[i], w1.mul_add(l1[i] + r1[i], w0 * centre[i]));
    let far = w5.mul_add(l5[i] + r5[i], w4.mul_add(l4[i] + r4[i], w3 * (l3[i] + r3[i])));
    near + far
}
