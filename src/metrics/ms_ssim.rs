//! Structural similarity over five scales: `ms_ssim.y`. Wang, Simoncelli and Bovik, "Multi-scale Structural Similarity
//! for Image Quality Assessment", 2003: contrast and structure at every scale, brightness at the coarsest alone, each
//! raised to its weight and multiplied. A scale's mean below 0 counts as 0.

use super::{
    Better, MetricInfo,
    mask::{self, ByClass, Classes, N_CLASSES},
    metric::Definition,
    quantity::{Domain, Quantity, Sums},
    reference::Pair,
    ssim::{BAND, Part, Rows, WINDOW, Windows, stabilisers},
};
use crate::image::{Extent, Image};
use rayon::prelude::*;
use std::ops::Range;

pub(super) const N_SCALES: usize = 5;
/// Of each scale, from the finest on.
const WEIGHTS: [f64; N_SCALES] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// Fewest pixels in either axis: eleven must be left at the coarsest scale.
pub(super) const SMALLEST: u32 = ((WINDOW as u32 - 1) << (WEIGHTS.len() - 1)) + 1;

pub(super) const MS_SSIM_Y: Definition = Definition {
    info: MetricInfo {
        id: "ms_ssim.y",
        unit: "",
        better: Better::Higher,
        version: 1,
        description: "Structural similarity of Rec. 709 luma over five scales",
    },
    quantity: Quantity::MsSsim,
    value: product,
    relative_mse: None,
};

/// Luma at every scale but the finest, which is the image itself.
pub(super) struct Pyramid {
    coarser: Vec<Plane>,
    /// At every scale, what share of a pixel is of each class; none where no mask is asked for.
    shares: Option<Vec<[Plane; N_CLASSES]>>,
}

/// One scale.
struct Plane {
    width: usize,
    values: Vec<f64>,
}

impl Pyramid {
    pub(super) fn new(luma: &[f64], extent: Extent, classes: Option<&Classes>) -> Self {
        Self {
            coarser: halvings(luma, extent.width as usize),
            shares: classes.map(|classes| shares(classes, extent)),
        }
    }
}

/// Every scale but the finest.
fn halvings(values: &[f64], width: usize) -> Vec<Plane> {
    let mut scales = vec![halved(values, width)];
    for _ in 2..N_SCALES {
        let Plane { values, width } = &scales[scales.len() - 1];
        scales.push(halved(values, *width));
    }
    scales
}

fn shares(classes: &Classes, extent: Extent) -> Vec<[Plane; N_CLASSES]> {
    let width = extent.width as usize;
    let by_class: [Vec<Plane>; N_CLASSES] = std::array::from_fn(|class| {
        let is_class = classes
            .all()
            .iter()
            .map(|of| f64::from(u8::from(usize::from(*of) == class)));
        let finest = Plane {
            width,
            values: is_class.collect(),
        };
        let coarser = halvings(&finest.values, width);
        [finest].into_iter().chain(coarser).collect()
    });
    let mut by_class = by_class.map(Vec::into_iter);
    let scale = || {
        by_class
            .each_mut()
            .map(|scales| scales.next().expect("as many as there are scales"))
    };
    std::iter::repeat_with(scale).take(N_SCALES).collect()
}

/// Means of 2×2 pixels. A side of odd length is first given a zero in front, as in pytorch-msssim, which other packages
/// measure themselves against; it weighs the image's first row or column by half.
fn halved(values: &[f64], width: usize) -> Plane {
    let height = values.len() / width;
    let (left, top) = (width % 2, height % 2);
    let new_width = width.div_ceil(2);
    let mut half = vec![0.0; new_width * height.div_ceil(2)];
    half.par_chunks_mut(new_width).enumerate().for_each(|(y, half)| {
        let row = |y: usize| Some(&values[y.checked_sub(top)? * width..][..width]);
        for row in [row(2 * y), row(2 * y + 1)].into_iter().flatten() {
            let (first, pairs) = row.split_at(left);
            let (half_first, half_pairs) = half.split_at_mut(left);
            half_first
                .iter_mut()
                .zip(first)
                .for_each(|(half, value)| *half += 0.25 * value);
            for (half, [a, b]) in half_pairs.iter_mut().zip(pairs.as_chunks().0) {
                *half += 0.25 * (a + b);
            }
        }
    });
    Plane {
        width: new_width,
        values: half,
    }
}

/// A scale of an image, in memory of its own or not.
#[derive(Clone, Copy)]
struct Scale<'a> {
    width: usize,
    values: &'a [f64],
}

impl Rows for Scale<'_> {
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, _: &'a mut Vec<f64>) -> &'a [f64] {
        &self.values[y * self.width..][columns]
    }
}

/// Both images at every scale.
fn scales<'a>(pair: &'a Pair, coarser: &'a [Plane]) -> Vec<[Scale<'a>; 2]> {
    let width = pair.reference.extent().width as usize;
    let finest = [pair.reference.luma(), pair.luma()].map(|values| Scale { width, values });
    let coarser = pair.reference.pyramid().coarser.iter().zip(coarser);
    let coarser = coarser.map(|(r, t)| {
        [r, t].map(|plane| Scale {
            width: plane.width,
            values: &plane.values,
        })
    });
    [finest].into_iter().chain(coarser).collect()
}

/// The product over scales of what the window nearest to each pixel contributes. Its mean is not the metric, which is a
/// product of means; it shows where the metric is lost.
pub(super) fn map(pair: &Pair) -> Image<f32> {
    let extent = pair.reference.extent();
    let coarser = halvings(pair.luma(), extent.width as usize);
    let mut product = Image::filled(extent, 1.0_f32);
    for (i, images) in scales(pair, &coarser).into_iter().enumerate() {
        let [width, height] = [images[0].width, images[0].values.len() / images[0].width].map(|n| n - (WINDOW - 1));
        let part = if i + 1 == N_SCALES { Part::Whole } else { Part::Contrast };
        let mut factors = vec![0.0; width * height];
        factors
            .par_chunks_mut(width * BAND)
            .enumerate()
            .for_each(|(band, factors)| {
                let rows = band * BAND..band * BAND + factors.len() / width;
                let mut windows = Windows::new(images, stabilisers(Domain::Luma.peak()), &pair.same, i as u32);
                windows.for_each_run(0..width, rows, part, |x, y, indices| {
                    let run = &mut factors[(y - band * BAND) * width + x..];
                    for (factor, index) in run.iter_mut().zip(indices) {
                        *factor = libm::pow(index.max(0.0), WEIGHTS[i]) as f32;
                    }
                });
            });
        let nearest = |at: u32, n: usize| ((at as usize >> i).saturating_sub(WINDOW / 2)).min(n - 1);
        product = Image::from_fn(extent, |x, y| {
            product.at(x, y) * factors[nearest(y, height) * width + nearest(x, width)]
        });
    }
    product
}

/// The windows' sums at each scale, then their weights; at the coarsest scale of the whole index, at others of contrasts.
pub(super) fn measure(pair: &Pair) -> ByClass<Sums> {
    let coarser = halvings(pair.luma(), pair.reference.extent().width as usize);
    let mut sums = [Sums::default(); N_CLASSES];
    for (i, images) in scales(pair, &coarser).into_iter().enumerate() {
        let shares = pair.reference.pyramid().shares.as_ref().map(|shares| &shares[i]);
        let [totals, weights] = totals(pair, images, i, shares);
        for class in 0..N_CLASSES {
            (sums[class].terms[i], sums[class].terms[N_SCALES + i]) = (totals[class], weights[class]);
            sums[class].n = weights[class];
        }
    }
    sums
}

/// Of all windows of a scale: the sums of what they compare, and of their weights.
fn totals(pair: &Pair, images: [Scale; 2], scale: usize, shares: Option<&[Plane; N_CLASSES]>) -> [ByClass<f64>; 2] {
    let width = images[0].width - (WINDOW - 1);
    let height = images[0].values.len() / images[0].width - (WINDOW - 1);
    let part = if scale + 1 == N_SCALES {
        Part::Whole
    } else {
        Part::Contrast
    };
    let bands = (0..height.div_ceil(BAND)).into_par_iter().map(|band| {
        let rows = band * BAND..height.min((band + 1) * BAND);
        let [mut totals, mut weights] = [ByClass::default(); 2];
        let mut windows = Windows::new(images, stabilisers(Domain::Luma.peak()), &pair.same, scale as u32);
        windows.for_each_run(0..width, rows, part, |x, y, indices| match shares {
            None => {
                mask::add(indices, None, &mut totals);
                weights[0] += indices.len() as f64;
            }
            Some(shares) => {
                for (class, share) in shares.iter().enumerate() {
                    let share = &share.values[(y + WINDOW / 2) * share.width + x + WINDOW / 2..];
                    for (index, share) in indices.iter().zip(share) {
                        totals[class] += index * share;
                        weights[class] += share;
                    }
                }
            }
        });
        [totals, weights]
    });
    let bands: Vec<[ByClass<f64>; 2]> = bands.collect();
    std::array::from_fn(|i| std::array::from_fn(|class| bands.iter().map(|band| band[i][class]).sum()))
}

/// Of the scales' means, each to the power of its weight. `None` where a scale has no window.
fn product(sums: &Sums) -> Option<f64> {
    let (totals, weights) = sums.terms.split_at(N_SCALES);
    let means = totals.iter().zip(weights).zip(WEIGHTS);
    let powers = means.map(|((total, windows), weight)| {
        // A mean that is NaN stays so, as it would not through `max`.
        let mean = total / windows;
        (*windows != 0.0).then(|| libm::pow(if mean < 0.0 { 0.0 } else { mean }, weight))
    });
    powers.product()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_halve_and_an_odd_side_starts_with_zero() {
        let half = halved(&[4.0, 8.0, 12.0, 0.0, 4.0, 8.0], 3);
        assert_eq!((half.width, half.values), (2, vec![1.0, 8.0]));
    }
}
