//! A cubic quasi-interpolator with its recursive prefilter: the twin of the filter `quasi_cubic`.
//!
//! Sacht and Nehab ("Optimized Quasi-Interpolators for Image Reconstruction", 2015) choose a kernel φ of piecewise cubics
//! and a recursive digital filter 1/P together, so that the pair errs least over all frequencies of an image and not only at
//! the lowest, and give up interpolation for it. So is this pair chosen; the numbers are ours, for another use: history is
//! resampled again and again, and a pair that is best once may amplify what it resamples a hundred times.
//!
//! - φ = β³ + λ β³″, for even kernels of four pixels that can reproduce cubic polynomials are those and no others.
//! - P = d0 + d1 (z + 1/z) + d2 (z² + 1/z²) with d0 + 2 d1 + 2 d2 = 1 and d1 + 4 d2 = 1/6 + λ, for then cubic polynomials
//!   come back as they were.
//! - Of the two numbers left, λ and d2, those for which resampling by no shift amplifies any frequency, and of these the
//!   pair with the least mean squared error over all shifts and frequencies of an image whose spectrum falls like 1/ω²:
//!   (0.041, 1/400), rounded here to (1/25, 1/400). d2 = 0 and λ = 0 would be the interpolating cubic B-spline.

use super::{
    color::Color,
    real::Real,
    sampling::{Position, separable, split},
};
use crate::image::{Extent, Image};

const LAMBDA: f64 = 1.0 / 25.0;
const D2: f64 = 1.0 / 400.0;
const D1: f64 = 1.0 / 6.0 + LAMBDA - 4.0 * D2;
const D0: f64 = 1.0 - 2.0 * D1 - 2.0 * D2;

/// How far beyond the image the kernel reaches, texels.
const MARGIN: usize = 2;
/// So far away nothing of a texel is left in f64.
const FORGOTTEN: usize = 40;

/// The coefficients of each row, for [`MARGIN`] texels beyond the edges as well; there the image continues as its nearest edge
/// texel.
pub fn along_rows<R: Real>(image: &Image<Color<R>>) -> Image<Color<R>> {
    let Extent { width, height } = image.extent();
    let padding = FORGOTTEN + MARGIN;
    let rows: Vec<Vec<Color<R>>> = (0..height)
        .map(|y| {
            let padded = (0..width as usize + 2 * padding).map(|i| image.clamped(i as i64 - padding as i64, y.into()));
            filtered(padded.collect())
        })
        .collect();
    let extent = Extent::new(width + 2 * MARGIN as u32, height);
    Image::from_fn(extent, |x, y| rows[y as usize][x as usize + FORGOTTEN])
}

/// The second half of finding coefficients: of those along rows, those of the image.
pub fn along_columns<R: Real>(rows: &Image<Color<R>>) -> Image<Color<R>> {
    transposed(&along_rows(&transposed(rows)))
}

/// The kernel over an image's coefficients. May be negative.
pub fn sample<R: Real>(coefficients: &Image<Color<R>>, position: Position<R>) -> Color<R> {
    let margin = R::new(MARGIN as f64);
    let position = position.map(|s| s + margin);
    let (_, fractions) = split(position);
    separable(coefficients, position, fractions.map(weights))
}

/// φ at the distances 1 + f, f, 1 - f and 2 - f.
fn weights<R: Real>(f: R) -> [R; 4] {
    let c = R::new;
    let lambda = c(LAMBDA);
    let near = |x: R| c(2.0 / 3.0) + x * x * (c(0.5) * x - c(1.0)) + lambda * (c(3.0) * x - c(2.0));
    // Of the distance to where the kernel ends.
    let far = |x: R| x * (x * x / c(6.0) + lambda);
    let g = c(1.0) - f;
    [far(g), near(f), near(g), far(f)]
}

/// The poles of 1/P within the unit circle. With u = z + 1/z, P is d2 u² + d1 u + d0 - 2 d2.
fn poles() -> [f64; 2] {
    let root = (D1 * D1 - 4.0 * D2 * (D0 - 2.0 * D2)).sqrt();
    [root, -root].map(|root| {
        let u = (root - D1) / (2.0 * D2);
        0.5 * (u + (u * u - 4.0).sqrt())
    })
}

/// 1/P: each pole forth and back, starting as if the ends went on for ever.
fn filtered<R: Real>(mut line: Vec<Color<R>>) -> Vec<Color<R>> {
    for pole in poles() {
        let (pole, gain) = (R::new(pole), R::new(1.0 - pole));
        let recursion = |texel: &mut Color<R>, last: &mut Color<R>| {
            *texel = *texel * gain + *last * pole;
            *last = *texel;
        };
        let mut last = line[0];
        line.iter_mut().for_each(|texel| recursion(texel, &mut last));
        last = line[line.len() - 1];
        line.iter_mut().rev().for_each(|texel| recursion(texel, &mut last));
    }
    line
}

fn transposed<R: Real>(image: &Image<Color<R>>) -> Image<Color<R>> {
    let Extent { width, height } = image.extent();
    Image::from_fn(Extent::new(height, width), |x, y| image.at(y, x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn coefficients(image: &Image<Color<f64>>) -> Image<Color<f64>> {
        along_columns(&along_rows(image))
    }

    #[test]
    fn cubic_polynomials_come_back_as_they_were() {
        let polynomial = |x: f64, y: f64| {
            let (x, y) = (x / 32.0 - 2.0, y / 32.0 - 2.0);
            0.5 + x * (0.7 - x * (0.3 + 0.4 * x)) + y * (0.2 + y * (0.6 - 0.5 * y)) + x * y * (0.3 + 0.2 * x * y * y)
        };
        // Its edges are so far away that their extension does not reach the middle.
        let image = Image::from_fn(Extent::new(129, 129), |x, y| {
            Color::splat(polynomial(f64::from(x) + 0.5, f64::from(y) + 0.5))
        });
        let coefficients = coefficients(&image);
        for [x, y] in [[64.5, 64.5], [64.0, 65.0], [63.3, 66.125], [65.9, 62.7]] {
            let found = sample(&coefficients, [x, y]).0[0];
            let expected = polynomial(x, y);
            assert!((found - expected).abs() < 1e-10, "at {x}, {y}: {found}, not {expected}");
        }
        // It is no interpolator: detail at the limit of the grid is not kept even where it was sampled.
        let stripes = Image::from_fn(Extent::new(129, 1), |x, _| Color::splat(f64::from(x % 2)));
        let found = sample(&self::coefficients(&stripes), [64.5, 0.5]).0[0];
        let expected = 0.5 - 0.5 * (1.0 - 4.0 * (1.0 / 6.0 + LAMBDA)) / (1.0 - 4.0 * D1);
        assert!(
            (found - expected).abs() < 1e-10 && found > 0.05,
            "{found}, not {expected}"
        );
    }

    /// What shifting does to a frequency, for all shifts: nothing grows, however often it is done.
    #[test]
    fn no_shift_amplifies_any_frequency() {
        let mut largest: f64 = 0.0;
        for (shift, step) in (0..=50).flat_map(|shift| (1..=200).map(move |step| (shift, step))) {
            let (shift, omega) = (f64::from(shift) / 50.0, PI * f64::from(step) / 200.0);
            let (mut re, mut im) = (0.0, 0.0);
            for (tap, weight) in (-1..3).zip(weights(shift)) {
                re += weight * libm::cos(omega * f64::from(tap));
                im += weight * libm::sin(omega * f64::from(tap));
            }
            let p = D0 + 2.0 * D1 * libm::cos(omega) + 2.0 * D2 * libm::cos(2.0 * omega);
            largest = largest.max((re * re + im * im).sqrt() / p);
        }
        assert!((0.999..=1.0 + 1e-12).contains(&largest), "{largest}");
    }

    #[test]
    fn flat_stays_flat_up_to_the_edge() {
        for extent in [Extent::new(1, 1), Extent::new(5, 3)] {
            let coefficients = coefficients(&Image::filled(extent, Color::splat(0.7)));
            for [x, y] in [
                [0.0, 0.0],
                [0.5, 1.0],
                [f64::from(extent.width), f64::from(extent.height)],
            ] {
                assert!((sample(&coefficients, [x, y]).0[0] - 0.7).abs() < 1e-12);
            }
        }
    }
}
