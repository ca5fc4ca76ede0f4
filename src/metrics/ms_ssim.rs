//! Structural similarity over five scales: `ms_ssim.y`. Wang, Simoncelli and Bovik, "Multi-scale Structural Similarity
//! for Image Quality Assessment", 2003: contrast and structure at every scale, brightness at the coarsest alone, each
//! raised to its weight and multiplied. A scale's mean below 0 counts as 0.

use super::{
    Better, Definition, Domain, MetricInfo, Quantity, Shown, Sums,
    ssim::{BAND, Pair, Rows, WINDOW, stabilisers},
};
use rayon::prelude::*;
use std::ops::Range;

/// Of each scale, from the finest on.
const WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

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
    value: Sums::mean,
    relative_mse: None,
};

/// Luma at every scale, from the finest on.
pub(super) struct Pyramid(Vec<Plane>);

/// One scale.
struct Plane {
    width: usize,
    values: Vec<f64>,
}

impl Pyramid {
    pub(super) fn new(shown: &Shown) -> Self {
        let extent = shown.extent();
        let width = extent.width as usize;
        let mut values = vec![0.0; extent.n_pixels()];
        values
            .par_chunks_mut(width)
            .enumerate()
            .for_each_init(Vec::new, |scratch, (y, row)| {
                row.copy_from_slice(shown.row(Domain::Luma, 0, y, 0..width, scratch));
            });
        let mut scales = vec![Plane { width, values }];
        for _ in 1..WEIGHTS.len() {
            scales.push(scales[scales.len() - 1].halved());
        }
        Self(scales)
    }
}

impl Plane {
    fn height(&self) -> usize {
        self.values.len() / self.width
    }

    /// Means of 2×2 pixels. A side of odd length is first given a zero in front, as in pytorch-msssim, which other
    /// packages measure themselves against; it weighs the image's first row or column by half.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height().div_ceil(2));
        let (left, top) = (self.width % 2, self.height() % 2);
        let at = |x: usize, y: usize| match (x.checked_sub(left), y.checked_sub(top)) {
            (Some(x), Some(y)) => self.values[y * self.width + x],
            _ => 0.0,
        };
        let mut values = vec![0.0; width * height];
        values.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let [x, y] = [2 * x, 2 * y];
                *value = 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
            }
        });
        Self { width, values }
    }
}

impl Rows for &Plane {
    fn row<'a>(&'a self, y: usize, columns: Range<usize>, _: &'a mut Vec<f64>) -> &'a [f64] {
        &self.values[y * self.width..][columns]
    }
}

/// The product over the scales, as the sum of one sample.
pub(super) fn measure(reference: &Shown, test: &Shown) -> Sums {
    let test = Pyramid::new(test);
    let scales = reference.pyramid().0.iter().zip(&test.0).zip(WEIGHTS).enumerate();
    let powers = scales.map(|(scale, ((reference, test), weight))| {
        let is_coarsest = scale + 1 == WEIGHTS.len();
        libm::pow(mean([reference, test], is_coarsest).max(0.0), weight)
    });
    Sums {
        total: powers.product(),
        n: 1,
        ..Sums::default()
    }
}

/// The mean over all windows of the index, with or without its brightness.
fn mean(images: [&Plane; 2], with_brightness: bool) -> f64 {
    let width = images[0].width - (WINDOW - 1);
    let height = images[0].height() - (WINDOW - 1);
    let stabilisers = stabilisers(Domain::Luma.peak());
    let bands = (0..height.div_ceil(BAND)).into_par_iter().map(|band| {
        let rows = band * BAND..height.min((band + 1) * BAND);
        let mut total = 0.0;
        Pair::new(images).for_each_run(rows, width, |_, _, windows| {
            total += match with_brightness {
                true => windows.indices(stabilisers).sum::<f64>(),
                false => windows.contrasts(stabilisers).sum::<f64>(),
            };
        });
        total
    });
    bands.collect::<Vec<f64>>().iter().sum::<f64>() / (width * height) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_halve_and_an_odd_side_starts_with_zero() {
        let plane = Plane {
            width: 3,
            values: vec![4.0, 8.0, 12.0, 0.0, 4.0, 8.0],
        };
        let half = plane.halved();
        assert_eq!((half.width, half.values), (2, vec![1.0, 8.0]));
    }
}
