//! How far an image lies beside its reference. Half a pixel is the commonest mistake of a resolve, and looks like blur in
//! every metric.

use super::{Picture, mask::sum_rows, rows::luma};
use crate::image::Extent;
use rayon::prelude::*;

/// Pixels at the edge that are left out: what is moved in from beyond the image is not known.
const MARGIN: usize = 8;
/// Below this share of the larger one, the smaller eigenvalue is rounding: everything varies along one direction, or
/// nothing does.
const SINGULAR: f64 = 1e-9;
/// Steps taken at most, and the step in pixels after which none follows.
const N_STEPS: usize = 8;
const LAST_STEP_PX: f64 = 1e-4;

/// Pixels by which `test` lies to the right of `reference`, and below it: the shift of the reference's luma that leaves a
/// difference without a component along the gradients of both. `None` where the images do not tell.
///
/// Each step solves T − R ≈ −offset · ∇R for what is left after the reference was moved by the steps before. What it
/// divides by are products of one image's gradient with the other's, because the square of either grows with its noise
/// and aliasing, and shrinks with its blur: an offset of a frame of one sample a pixel would be found a quarter too small.
pub fn offset_px(reference: &Picture, test: &Picture) -> Option<[f64; 2]> {
    let extent = reference.extent();
    if extent != test.extent() {
        return None;
    }
    let [r, t] = [reference, test].map(luma_of);
    let mut offset = [0.0; 2];
    for _ in 0..N_STEPS {
        let moved = shifted(&r, extent, offset);
        let step = step_px(&moved, &t, extent)?;
        offset = [offset[0] + step[0], offset[1] + step[1]];
        if offset.iter().any(|offset| offset.abs() > MARGIN as f64 / 2.0) {
            return None; // Too far for gradients to lead anywhere.
        }
        if step.iter().all(|step| step.abs() < LAST_STEP_PX) {
            break;
        }
    }
    Some(offset)
}

/// What is left of the offset between two images.
fn step_px(r: &[f64], t: &[f64], extent: Extent) -> Option<[f64; 2]> {
    let (width, height) = (extent.width as usize, extent.height as usize);
    let sums = sum_rows(extent, None, |y, products| {
        products.iter_mut().for_each(|row| row.fill(0.0));
        if !(MARGIN..height.saturating_sub(MARGIN)).contains(&y) {
            return;
        }
        let [xx, yy, xy, xe, ye] = products;
        for x in MARGIN..width.saturating_sub(MARGIN) {
            let i = y * width + x;
            // Exact for polynomials up to the fourth degree.
            let gradient = |image: &[f64], step: usize| {
                (8.0 * (image[i + step] - image[i - step]) - (image[i + 2 * step] - image[i - 2 * step])) / 12.0
            };
            let [rx, tx] = [r, t].map(|image| gradient(image, 1));
            let [ry, ty] = [r, t].map(|image| gradient(image, width));
            let error = t[i] - r[i];
            (xx[x], yy[x], xy[x]) = (rx * tx, ry * ty, 0.5 * (rx * ty + ry * tx));
            (xe[x], ye[x]) = (0.5 * (rx + tx) * error, 0.5 * (ry + ty) * error);
        }
    });
    let [xx, yy, xy, xe, ye] = sums.map(|by_class| by_class[0]);
    let determinant = xx * yy - xy * xy;
    let known = xx > 0.0 && yy > 0.0 && determinant > SINGULAR * (xx + yy) * (xx + yy);
    known.then(|| [(xy * ye - yy * xe) / determinant, (xy * xe - xx * ye) / determinant])
}

/// The image moved right and down, between pixels the polynomial of the fifth degree through the six around; its edge
/// goes on beyond it.
fn shifted(image: &[f64], extent: Extent, [right, down]: [f64; 2]) -> Vec<f64> {
    let (width, height) = (extent.width as usize, extent.height as usize);
    let (left, x_weights) = taps(right);
    let (up, y_weights) = taps(down);
    let near = |at: usize, by: isize, size: usize| at.saturating_add_signed(by).min(size - 1);
    let mut along_rows = vec![0.0; image.len()];
    along_rows
        .par_chunks_mut(width)
        .zip(image.par_chunks(width))
        .for_each(|(moved, row)| {
            for (x, moved) in moved.iter_mut().enumerate() {
                let taps = x_weights.iter().enumerate();
                *moved = taps
                    .map(|(k, weight)| weight * row[near(x, left + k as isize, width)])
                    .sum();
            }
        });
    let mut both = vec![0.0; image.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(y, moved)| {
        for (k, weight) in y_weights.iter().enumerate() {
            let row = &along_rows[near(y, up + k as isize, height) * width..][..width];
            moved
                .iter_mut()
                .zip(row)
                .for_each(|(moved, value)| *moved += weight * value);
        }
    });
    both
}

/// Where a pixel that moved by `offset` comes from: how far away the first of six pixels lies, and the weight of each.
fn taps(offset: f64) -> (isize, [f64; 6]) {
    let first = (-offset).floor() - 2.0;
    let at = -offset - first;
    let others = |k: usize| (0..6).filter(move |other| *other != k);
    let weight = |k: usize| others(k).map(|j| (at - j as f64) / (k as f64 - j as f64)).product();
    (first as isize, std::array::from_fn(weight))
}

fn luma_of(picture: &Picture) -> Vec<f64> {
    let width = picture.extent().width as usize;
    let mut plane = vec![0.0; picture.extent().n_pixels()];
    plane.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let mut shown = [(); 3].map(|()| vec![0.0; width]);
        picture.show([0..width, y..y + 1], shown.each_mut().map(Vec::as_mut_slice));
        luma(shown.each_ref().map(Vec::as_slice), row);
    });
    plane
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        image::Image,
        metrics::{Display, display::linear_from_srgb},
    };

    /// Waves of several directions, moved right and down.
    fn picture(by: [f64; 2]) -> Picture {
        let shown = move |x: u32, y: u32| {
            let (x, y) = (f64::from(x) - by[0], f64::from(y) - by[1]);
            0.5 + 0.2 * libm::sin(0.6 * x + 0.2 * y) + 0.2 * libm::cos(0.5 * y - 0.1 * x)
        };
        let image = Image::from_fn(Extent::new(97, 61), |x, y| [linear_from_srgb(shown(x, y)) as f32; 3]);
        Picture::linear(image, Display::default())
    }

    #[test]
    fn known_offsets_are_found() {
        for (by, within) in [
            ([0.0, 0.0], 1e-6),
            ([0.05, 0.0], 1e-3),
            ([-0.07, 0.31], 2e-3),
            ([1.0, -1.0], 2e-3),
            ([-1.5, 0.4], 2e-3),
        ] {
            let [x, y] = offset_px(&picture([0.0; 2]), &picture(by)).unwrap();
            let near = (x - by[0]).abs() < within && (y - by[1]).abs() < within;
            assert!(near, "{by:?}: found {x}, {y}");
        }
    }

    /// Noise as strong as the waves makes squares of gradients several times as large; a blur halves them.
    #[test]
    fn neither_noise_nor_blur_hides_an_offset() {
        let by = [0.3, -0.2];
        let hash =
            |x: u32, y: u32| (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0x2c1b_3c6d);
        let pixels = |picture: &Picture| {
            let luma = luma_of(picture);
            move |x: u32, y: u32| luma[(y.min(60) * 97 + x.min(96)) as usize]
        };
        let moved = pixels(&picture(by));
        let of = |shown: &(dyn Fn(u32, u32) -> f64 + Sync)| {
            let image = Image::from_fn(Extent::new(97, 61), |x, y| [linear_from_srgb(shown(x, y)) as f32; 3]);
            offset_px(&picture([0.0; 2]), &Picture::linear(image, Display::default())).unwrap()
        };
        let noisy = of(&|x, y| moved(x, y) + 0.2 * (f64::from(hash(x, y) >> 8) / 16_777_216.0 - 0.5));
        let blurred = of(&|x, y| {
            let around = (0..9).map(|i| moved((x + i % 3).saturating_sub(1), (y + i / 3).saturating_sub(1)));
            around.sum::<f64>() / 9.0
        });
        for (found, within) in [(noisy, 0.02), (blurred, 2e-3)] {
            let near = (found[0] - by[0]).abs() < within && (found[1] - by[1]).abs() < within;
            assert!(near, "found {found:?}");
        }
    }

    #[test]
    fn what_does_not_tell_is_not_guessed() {
        let flat = |value: f32| Picture::linear(Image::filled(Extent::new(20, 20), [value; 3]), Display::default());
        assert_eq!(offset_px(&flat(0.2), &flat(0.3)), None);
        assert_eq!(offset_px(&flat(f32::NAN), &flat(0.3)), None);
        let stripes = |by: u32| {
            let image = Image::from_fn(Extent::new(20, 20), |x, _| [((x + by) % 5) as f32 / 5.0; 3]);
            Picture::linear(image, Display::default())
        };
        assert_eq!(
            offset_px(&stripes(0), &stripes(1)),
            None,
            "along the stripes anything goes"
        );
    }
}
