//! How far an image lies beside its reference. Half a pixel is the commonest mistake of a resolve, and looks like blur in
//! every metric.

use super::{Picture, mask::sum_rows, rows::luma};
use rayon::prelude::*;

/// Pixels from the edge that have no gradient.
const MARGIN: usize = 2;
/// Below this share of the larger one, the smaller eigenvalue is rounding: everything varies along one direction, or
/// nothing does.
const SINGULAR: f64 = 1e-9;

/// Pixels by which `test` lies to the right of `reference`, and below it: the shift of luma that leaves the least squared
/// difference, from T − R ≈ −offset · ∇(T + R)/2. `None` where the images do not tell.
///
/// The gradient is that of both images' mean, halfway between them, so that the error is of third order: below a hundredth
/// of a pixel for a third of one, and 4 % of a whole one, for details ten pixels across.
pub fn offset_px(reference: &Picture, test: &Picture) -> Option<[f64; 2]> {
    let extent = reference.extent();
    if extent != test.extent() {
        return None;
    }
    let (width, height) = (extent.width as usize, extent.height as usize);
    let [r, t] = [reference, test].map(luma_of);
    let sums = sum_rows(extent, None, |y, products| {
        products.iter_mut().for_each(|row| row.fill(0.0));
        if !(MARGIN..height.saturating_sub(MARGIN)).contains(&y) {
            return;
        }
        let [xx, yy, xy, xe, ye] = products;
        for x in MARGIN..width.saturating_sub(MARGIN) {
            let i = y * width + x;
            let mean = |i: usize| 0.5 * (r[i] + t[i]);
            // Exact for polynomials up to the fourth degree.
            let gradient = |step: usize| {
                (8.0 * (mean(i + step) - mean(i - step)) - (mean(i + 2 * step) - mean(i - 2 * step))) / 12.0
            };
            let (gx, gy, error) = (gradient(1), gradient(width), t[i] - r[i]);
            (xx[x], yy[x], xy[x]) = (gx * gx, gy * gy, gx * gy);
            (xe[x], ye[x]) = (gx * error, gy * error);
        }
    });
    let [xx, yy, xy, xe, ye] = sums.map(|by_class| by_class[0]);
    let determinant = xx * yy - xy * xy;
    let known = determinant > SINGULAR * (xx + yy) * (xx + yy);
    known.then(|| [(xy * ye - yy * xe) / determinant, (xy * xe - xx * ye) / determinant])
}

fn luma_of(picture: &Picture) -> Vec<f64> {
    let width = picture.extent().width as usize;
    let mut plane = vec![0.0; picture.extent().n_pixels()];
    plane.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let mut shown = [(); 3].map(|()| vec![0.0; width]);
        picture.show(y, 0..width, shown.each_mut().map(Vec::as_mut_slice));
        luma(shown.each_ref().map(Vec::as_slice), row);
    });
    plane
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        image::{Extent, Image},
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
            ([-0.07, 0.31], 0.01),
            ([1.0, -1.0], 0.04),
        ] {
            let [x, y] = offset_px(&picture([0.0; 2]), &picture(by)).unwrap();
            let near = (x - by[0]).abs() < within && (y - by[1]).abs() < within;
            assert!(near, "{by:?}: found {x}, {y}");
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
