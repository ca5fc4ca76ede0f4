//! An image as it comes, and its values as metrics see them: linear and display RGB, computed where they are read.

use super::{
    Display,
    display::{linear_from_srgb, poison},
    vector::vectorised,
};
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use std::{ops::Range, sync::Arc};

/// Pixels converted at a time.
const BLOCK: usize = 64;

/// An image to be judged, or to judge by.
#[derive(Clone)]
pub struct Picture {
    pixels: Arc<Image<Rgb>>,
    encoding: Encoding,
}

/// What pixels stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    /// Linear RGB, shown by this display transform.
    Linear(Display),
    /// What is shown: sRGB-encoded integers of 0 to this, each as the float nearest to its share of it.
    Codes(f64),
}

impl Picture {
    /// Linear RGB, shown by `display`.
    pub fn linear(pixels: impl Into<Arc<Image<Rgb>>>, display: Display) -> Self {
        Self {
            pixels: pixels.into(),
            encoding: Encoding::Linear(display),
        }
    }

    /// sRGB-encoded integers of 0 to `max_code` (255 for 8 bits), each given as the float nearest to `code / max_code`.
    /// The quotients are restored in f64, so that scores are those of the integers themselves.
    pub fn codes(pixels: impl Into<Arc<Image<Rgb>>>, max_code: u16) -> Self {
        Self {
            pixels: pixels.into(),
            encoding: Encoding::Codes(f64::from(max_code)),
        }
    }

    /// Width and height.
    pub fn extent(&self) -> Extent {
        self.pixels.extent()
    }

    /// The pixels as they came.
    pub(super) fn pixels(&self, y: usize, columns: Range<usize>) -> &[Rgb] {
        &self.pixels.row(y as u32)[columns]
    }

    /// Whether the same pixels stand for the same colours in both.
    pub(super) fn reads_like(&self, other: &Self) -> bool {
        self.encoding == other.encoding
    }

    /// Display values of some columns of row `y`; NaN where the pixel has a non-finite component.
    pub(super) fn show(&self, y: usize, columns: Range<usize>, shown: [&mut [f64]; 3]) {
        let pixels = self.pixels(y, columns);
        match self.encoding {
            Encoding::Linear(display) => show_linear(pixels, shown, display),
            Encoding::Codes(max) => show_codes(pixels, shown, max),
        }
    }

    /// Linear values of the same; NaN where the pixel has a non-finite component.
    pub(super) fn light(&self, y: usize, columns: Range<usize>, mut light: [&mut [f64]; 3]) {
        let pixels = self.pixels(y, columns);
        match self.encoding {
            Encoding::Linear(_) => light_linear(pixels, light),
            Encoding::Codes(max) => {
                show_codes(pixels, light.each_mut().map(|plane| &mut **plane), max);
                light
                    .into_iter()
                    .flatten()
                    .for_each(|value| *value = linear_from_srgb(*value));
            }
        }
    }
}

vectorised! {
    fn show_linear<'a>(pixels: &'a [Rgb], shown: [&'a mut [f64]; 3], display: Display) {
        let mut shown = shown;
        for (block, pixels) in pixels.chunks(BLOCK).enumerate() {
            let mut planes = load(pixels);
            poison(&mut planes);
            display.show(&mut planes);
            store(&planes, block, pixels.len(), &mut shown);
        }
    }

    fn light_linear<'a>(pixels: &'a [Rgb], light: [&'a mut [f64]; 3]) {
        let mut light = light;
        for (block, pixels) in pixels.chunks(BLOCK).enumerate() {
            let mut planes = load(pixels);
            poison(&mut planes);
            store(&planes, block, pixels.len(), &mut light);
        }
    }

    fn show_codes<'a>(pixels: &'a [Rgb], shown: [&'a mut [f64]; 3], max: f64) {
        let mut shown = shown;
        for (block, pixels) in pixels.chunks(BLOCK).enumerate() {
            let mut planes = load(pixels);
            for plane in &mut planes {
                for value in plane {
                    *value = restore(*value, max);
                }
            }
            store(&planes, block, pixels.len(), &mut shown);
        }
    }
}

/// Up to a block of pixels as planes; zeros fill it.
#[inline(always)]
fn load(pixels: &[Rgb]) -> [[f64; BLOCK]; 3] {
    let mut planes = [[0.0; BLOCK]; 3];
    for (channel, plane) in planes.iter_mut().enumerate() {
        for (value, pixel) in plane.iter_mut().zip(pixels) {
            *value = f64::from(pixel[channel]);
        }
    }
    planes
}

/// Writes the first `n` pixels of a block to where it lies in a run.
#[inline(always)]
fn store(block_planes: &[[f64; BLOCK]; 3], block: usize, n: usize, run: &mut [&mut [f64]; 3]) {
    for (run, plane) in run.iter_mut().zip(block_planes) {
        run[block * BLOCK..][..n].copy_from_slice(&plane[..n]);
    }
}

/// The exact `code / max` that `value` was rounded from, or `value` where it was rounded from no such quotient.
#[inline(always)]
fn restore(value: f64, max: f64) -> f64 {
    let exact = round(value * max) / max;
    if f64::from(exact as f32) == value { exact } else { value }
}

/// To the nearest whole number, ties to even, for 0 ≤ `value` < 2⁵¹. Adding 2⁵² leaves no bits for a fraction; unlike
/// `round` it needs no call, so that rows vectorise, and unlike a cast to an integer it keeps NaN.
#[inline(always)]
pub(super) fn round(value: f64) -> f64 {
    const TWO_52: f64 = (1_u64 << 52) as f64;
    (value + TWO_52) - TWO_52
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bit_codes_are_exact() {
        let codes = Image::from_fn(Extent::new(256, 1), |x, _| [x as f32 / 255.0; 3]);
        let mut planes = [(); 3].map(|()| vec![0.0; 256]);
        Picture::codes(codes, 255).show(0, 0..256, planes.each_mut().map(Vec::as_mut_slice));
        for plane in planes {
            assert!(
                plane
                    .iter()
                    .enumerate()
                    .all(|(code, value)| *value == code as f64 / 255.0)
            );
        }
    }

    #[test]
    fn a_bad_component_poisons_its_pixel_in_every_domain() {
        let mut image = Image::filled(Extent::new(70, 2), [0.5; 3]);
        image.pixels_mut()[70 + 66] = [0.5, f32::INFINITY, 0.5];
        let picture = Picture::linear(image, Display::default());
        let mut planes = [(); 6].map(|()| vec![0.0; 10]);
        let [r, g, b, lr, lg, lb] = planes.each_mut().map(Vec::as_mut_slice);
        picture.show(1, 60..70, [r, g, b]);
        picture.light(1, 60..70, [lr, lg, lb]);
        for plane in planes {
            assert!(plane.iter().enumerate().all(|(x, value)| value.is_nan() == (x == 6)));
        }
    }
}
