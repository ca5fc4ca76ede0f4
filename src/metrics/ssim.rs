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
    Better, MetricInfo, Picture,
    mask::{self, ByClass, Classes},
    metric::Definition,
    plane::Plane,
    quantity::{Domain, Quantity, Sums},
    reference::Pair,
    rows::{code, luma},
    same::{self, Same},
    shown::{Shown, Strip, View},
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
/// And columns, where the values that they see are made for them: these fit the second-level cache.
pub(super) const BLOCK: usize = 2 * TILE;
/// How many values that is of a channel.
pub(super) const N_SEEN: usize = (BLOCK + WINDOW - 1) * (BAND + WINDOW - 1);
/// Room for them, of each channel of reference and image under test.
pub(super) type Seen = [[Plane; 3]; 2];
/// How a reference is kept: all that a tile sees in one strip.
pub(super) const STRIP: Strip = Strip {
    width: TILE,
    beyond: WINDOW - 1,
};
const _: () = assert!(TILE == same::TILE, "what is found to be the same is a strip wide");

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
        let (first, n_rows) = (band * BAND, pixels.len() / width);
        let mut means = vec![0.0; n_windows * n_rows];
        let mut seen_planes = pair.reference.room_for_windows(true);
        for x in (0..n_windows).step_by(BLOCK) {
            let images = (pair.reference.shown(), pair.test);
            let pixels = [x..n_windows.min(x + BLOCK), first..first + n_rows];
            let block = Block::new(images, &pair.same, pixels, &mut seen_planes);
            block.for_each_run(domain, |x, y, indices| {
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

/// A part of two images, and the windows that begin there.
pub(super) struct Block<'a> {
    columns: Range<usize>,
    rows: Range<usize>,
    same: &'a Same,
    /// What is seen of the reference and of the image under test; nothing if that is the same.
    views: [View<'a>; 2],
}

impl<'a> Block<'a> {
    /// The windows that begin at `pixels`, columns and rows.
    pub fn new(
        (reference, test): (&'a Shown, &Picture),
        same: &'a Same,
        pixels: [Range<usize>; 2],
        seen_planes: &'a mut Seen,
    ) -> Self {
        let size = [test.extent().width, test.extent().height].map(|side| side as usize);
        let valid = valid_extent(test.extent());
        let seen = match is_same(same, &pixels, 0) {
            true => [0..0, 0..0],
            false => std::array::from_fn(|axis| {
                let Range { start, end } = pixels[axis];
                start..size[axis].min(end + WINDOW - 1)
            }),
        };
        let [of_reference, of_test] = seen_planes;
        let views = [
            reference.view(seen.clone(), of_reference),
            View::of(test, seen, of_test),
        ];
        let [columns, rows] = pixels;
        Self {
            columns: columns.start..columns.end.min(valid.width as usize),
            rows: rows.start..rows.end.min(valid.height as usize),
            same,
            views,
        }
    }

    /// What reference and image under test show.
    pub fn views(&self) -> &[View<'a>; 2] {
        &self.views
    }

    /// Adds the index of each window and channel to the sums of the class of the pixel in its middle.
    pub fn add(&self, domain: Domain, classes: Option<&Classes>, sums: &mut ByClass<Sums>) {
        let mut totals = ByClass::default();
        self.for_each_run(domain, |x, y, indices| {
            let classes = centres(classes, x, y, indices.len());
            mask::add(indices, classes, &mut totals);
            match classes {
                None => sums[0].n += indices.len() as f64,
                Some(classes) => classes.iter().for_each(|class| sums[usize::from(*class)].n += 1.0),
            }
        });
        for (sums, total) in sums.iter_mut().zip(totals) {
            sums.terms[0] += total;
        }
    }

    /// Calls `f` as [`Windows::for_each_run`] does, for one channel after the other.
    fn for_each_run(&self, domain: Domain, mut f: impl FnMut(usize, usize, &[f64])) {
        // The image's last rows may be too few for a window.
        if self.rows.is_empty() {
            return;
        }
        for channel in 0..domain.n_channels() {
            let images = self.views.each_ref().map(|view| Channel { view, domain, channel });
            let mut windows = Windows::new(images, stabilisers(domain.peak()), self.same, 0);
            windows.for_each_run(self.columns.clone(), self.rows.clone(), Part::Whole, &mut f);
        }
    }
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
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut Vec<f64>) -> &'a [f64];
}

struct Channel<'a> {
    view: &'a View<'a>,
    domain: Domain,
    channel: usize,
}

impl Rows for Channel<'_> {
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut Vec<f64>) -> &'a [f64] {
        scratch.resize(columns.len(), 0.0);
        match self.domain {
            Domain::Display => return self.view.row(self.channel, y, columns),
            Domain::Luma => luma(self.view.rows(y, columns), scratch),
            Domain::U8 => code([self.view.row(self.channel, y, columns); 3], scratch),
            Domain::Linear => unreachable!("no metric compares neighbours of linear values"),
        }
        scratch
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
    scratch: [Vec<f64>; 2],
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

    /// Calls `f(x, y, indices)` for every run of at most [`TILE`] of the windows in `columns` and `rows`. The index is 1 wherever
    /// the images are the same, and nothing is filtered there.
    pub(super) fn for_each_run(
        &mut self,
        columns: Range<usize>,
        rows: Range<usize>,
        part: Part,
        mut f: impl FnMut(usize, usize, &[f64]),
    ) {
        let mut means = [Row([0.0; MOMENTS * TILE]); 2];
        let mut indices = [0.0; TILE];
        for x in columns.clone().step_by(TILE) {
            let n = TILE.min(columns.end - x);
            if is_same(self.same, &[x..x + n, rows.clone()], self.scale) {
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

/// Whether all that these windows see is the same in both images, halved `scale` times. Halving may move pixels by one, each time.
fn is_same(same: &Same, windows: &[Range<usize>; 2], scale: u32) -> bool {
    let seen = |windows: &Range<usize>| windows.start.saturating_sub(1) << scale..(windows.end + WINDOW) << scale;
    let [columns, rows] = windows;
    same.covers(seen(columns), seen(rows))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::{Display, Metric, Reference};

    /// Noise; `test` differs from the reference in the first 70 columns only.
    fn picture(extent: Extent, test: bool) -> Picture {
        let noise = |n: u32| (n.wrapping_mul(0x9e37_79b9) >> 8) as f32 / 16_777_216.0;
        let pixel = |x: u32, y: u32| {
            let base = x.wrapping_mul(7919) ^ y.wrapping_mul(104_729);
            let added = if test && x < 70 { 0.2 * noise(!base) } else { 0.0 };
            [0, 1, 2].map(|channel| noise(base.wrapping_add(channel)) + added)
        };
        Picture::linear(Image::from_fn(extent, pixel), Display::default())
    }

    /// The mean over all windows and channels of the index as it is printed.
    fn by_definition(extent: Extent, pictures: [&Picture; 2]) -> f64 {
        let [width, height] = [extent.width, extent.height].map(|side| side as usize);
        let [r, t] = pictures.map(|picture| {
            let mut planes = [(); 3].map(|()| vec![0.0; width * height]);
            picture.show([0..width, 0..height], planes.each_mut().map(Vec::as_mut_slice));
            planes
        });
        let weight = |i: usize, j: usize| WEIGHTS[i.abs_diff(HALF)] * WEIGHTS[j.abs_diff(HALF)];
        let [c1, c2] = stabilisers(1.0);
        let (mut sum, mut n) = (0.0, 0.0);
        for (r, t) in r.iter().zip(&t) {
            for y in 0..=height - WINDOW {
                for x in 0..=width - WINDOW {
                    let mean = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                        let pixels = (0..WINDOW * WINDOW).map(|k| (k % WINDOW, k / WINDOW));
                        pixels
                            .map(|(i, j)| {
                                let at = (y + j) * width + x + i;
                                weight(i, j) * f(r[at], t[at])
                            })
                            .sum()
                    };
                    let (mr, mt) = (mean(&|r, _| r), mean(&|_, t| t));
                    let variances = mean(&|r, t| (r - mr) * (r - mr) + (t - mt) * (t - mt));
                    let covariance = mean(&|r, t| (r - mr) * (t - mt));
                    sum +=
                        (2.0 * mr * mt + c1) * (2.0 * covariance + c2) / ((mr * mr + mt * mt + c1) * (variances + c2));
                    n += 1.0;
                }
            }
        }
        sum / n
    }

    #[test]
    fn every_size_is_cut_without_a_seam() {
        let sizes = [
            (11, 11),
            (64, 12),
            (65, 11),
            (74, 13),
            (75, 27),
            (138, 11),
            (139, 20),
            (20, 139),
            (130, 130),
            (203, 141),
        ];
        for (width, height) in sizes {
            let extent = Extent::new(width, height);
            let [reference, test] = [false, true].map(|test| picture(extent, test));
            let values = |metrics: &[Metric]| {
                Reference::new(reference.clone(), metrics)
                    .evaluate(&test)
                    .unwrap()
                    .values
            };
            let both = values(&[Metric::SSIM, Metric::PSNR]);
            let found = ["ssim", "psnr"].map(|id| both[id].0);
            let expected = [
                by_definition(extent, [&reference, &test]),
                values(&[Metric::PSNR])["psnr"].0,
            ];
            let errors: [f64; 2] = std::array::from_fn(|i| (found[i] - expected[i]).abs());
            assert!(
                errors[0] < 1e-12 && errors[1] < 1e-11,
                "{extent}: {found:?} instead of {expected:?}"
            );
        }
    }
}
