//! An image as it comes, and its values as metrics see them: linear and display RGB, computed where they are read.

use super::{
    Display,
    display::{linear_from_srgb, poison},
    shown::Area,
    srgb::Found,
    vector::vectorised,
};
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use rayon::prelude::*;
use std::{
    ops::Range,
    sync::{Arc, OnceLock},
};

/// Pixels converted at a time.
const BLOCK: usize = 64;
/// And where so many are not left.
const FEW: usize = 16;

/// An image to be judged, or to judge by.
#[derive(Clone)]
pub struct Picture(Pixels);

/// What pixels stand for.
#[derive(Clone)]
enum Pixels {
    /// Linear RGB, shown by this display transform.
    Linear(Arc<Image<Rgb>>, Display),
    /// What is shown: sRGB-encoded integers.
    Codes(Arc<Codes>),
}

/// Integers of 0 to `max` in place of 0 to 1.
struct Codes {
    pixels: Image<[u16; 3]>,
    max: u16,
    /// For those that ask.
    light: OnceLock<CodeLight>,
}

/// The linear value of every code.
struct CodeLight {
    exact: Vec<f64>,
    rounded: Vec<f32>,
}

impl Codes {
    fn light(&self) -> &CodeLight {
        self.light.get_or_init(|| {
            let decode = |code| linear_from_srgb(f64::from(code) / f64::from(self.max));
            let exact: Vec<f64> = (0..=self.max).map(decode).collect();
            CodeLight {
                rounded: exact.iter().map(|light| *light as f32).collect(),
                exact,
            }
        })
    }
}

impl Picture {
    /// Linear RGB, shown by `display`.
    pub fn linear(pixels: impl Into<Arc<Image<Rgb>>>, display: Display) -> Self {
        Self(Pixels::Linear(pixels.into(), display))
    }

    /// sRGB-encoded integers of 0 to `max_code` (255 for 8 bits), which are shown as exactly `code / max_code`.
    ///
    /// # Panics
    /// When a code is above `max_code`: a caller's mistake, never a user's.
    pub fn codes(pixels: Image<[u16; 3]>, max_code: u16) -> Self {
        let largest = pixels.pixels().as_flattened().iter().fold(0, |a, b| a.max(*b));
        assert!(
            largest <= max_code,
            "a code of {largest} among those of 0 to {max_code}"
        );
        Self(Pixels::Codes(Arc::new(Codes {
            pixels,
            max: max_code,
            light: OnceLock::new(),
        })))
    }

    /// Width and height.
    pub fn extent(&self) -> Extent {
        match &self.0 {
            Pixels::Linear(pixels, _) => pixels.extent(),
            Pixels::Codes(codes) => codes.pixels.extent(),
        }
    }

    /// Whether what is shown can be had again at no cost, so that nobody needs to keep it.
    pub(super) fn is_codes(&self) -> bool {
        matches!(self.0, Pixels::Codes(_))
    }

    /// Whether every pixel is.
    pub(super) fn is_finite(&self) -> bool {
        match &self.0 {
            Pixels::Linear(pixels, _) => {
                let blocks = pixels.pixels().par_chunks(4096);
                blocks.all(|block| are_finite(block.as_flattened()))
            }
            Pixels::Codes(_) => true,
        }
    }

    /// How many pixels of some columns of row `y` are not finite here or in `other`.
    pub(super) fn n_non_finite(&self, other: &Self, y: usize, columns: Range<usize>) -> u64 {
        let row = |pixels: &'_ Arc<Image<Rgb>>| -> Range<usize> {
            let start = y * pixels.extent().width as usize;
            start + columns.start..start + columns.end
        };
        match (&self.0, &other.0) {
            (Pixels::Linear(a, _), Pixels::Linear(b, _)) => count_non_finite(&a.pixels()[row(a)], &b.pixels()[row(b)]),
            (Pixels::Linear(a, _), _) | (_, Pixels::Linear(a, _)) => {
                count_non_finite(&a.pixels()[row(a)], &a.pixels()[row(a)])
            }
            _ => 0,
        }
    }

    /// Whether the same pixels stand for the same colours in both.
    pub(super) fn reads_like(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (Pixels::Linear(_, a), Pixels::Linear(_, b)) => a == b,
            (Pixels::Codes(a), Pixels::Codes(b)) => a.max == b.max,
            _ => false,
        }
    }

    /// Whether both hold the same bits in a part of row `y`.
    pub(super) fn has_pixels_of(&self, other: &Self, y: usize, columns: Range<usize>) -> bool {
        fn row<T: Copy + Send + Sync + bytemuck::Pod>(image: &Image<T>, y: usize, columns: Range<usize>) -> &[u16] {
            bytemuck::cast_slice(&image.row(y as u32)[columns])
        }
        match (&self.0, &other.0) {
            (Pixels::Linear(a, _), Pixels::Linear(b, _)) => row(a, y, columns.clone()) == row(b, y, columns),
            (Pixels::Codes(a), Pixels::Codes(b)) => row(&a.pixels, y, columns.clone()) == row(&b.pixels, y, columns),
            _ => false,
        }
    }

    /// Σ (a − b)² of the codes in some columns of row `y`, where both have 8 bits.
    pub(super) fn squares_of_codes(&self, other: &Self, y: usize, columns: Range<usize>) -> Option<u64> {
        match (&self.0, &other.0) {
            (Pixels::Codes(a), Pixels::Codes(b)) if (a.max, b.max) == (255, 255) => {
                let [a, b] = [a, b].map(|codes| codes.pixels.row(y as u32)[columns.clone()].as_flattened());
                Some(sum_squares(a, b))
            }
            _ => None,
        }
    }

    /// Display values of an area, row by row; NaN where the pixel has a non-finite component.
    pub(super) fn show(&self, area: Area, shown: [&mut [f64]; 3]) {
        match &self.0 {
            Pixels::Linear(image, display) => show_linear(Piece { image, area }, shown, *display),
            Pixels::Codes(codes) => {
                let image = &codes.pixels;
                show_codes(Piece { image, area }, shown, codes.max.into());
            }
        }
    }

    /// Linear values of the same; NaN where the pixel has a non-finite component.
    pub(super) fn light(&self, y: usize, columns: Range<usize>, light: [&mut [f64]; 3]) {
        match &self.0 {
            Pixels::Linear(pixels, _) => light_linear(&pixels.row(y as u32)[columns], light),
            Pixels::Codes(codes) => look_up(&codes.pixels.row(y as u32)[columns], &codes.light().exact, light),
        }
    }

    /// The same in f32, whatever is not finite.
    pub(super) fn light_f32(&self, y: usize, columns: Range<usize>, light: [&mut [f32]; 3]) {
        match &self.0 {
            Pixels::Linear(pixels, _) => split(&pixels.row(y as u32)[columns], light),
            Pixels::Codes(codes) => look_up(&codes.pixels.row(y as u32)[columns], &codes.light().rounded, light),
        }
    }

    /// The light that a display gives off, 0 to 1: what is shown, decoded, in f32.
    pub(super) fn shown_light(&self, y: usize, columns: Range<usize>, light: [&mut [f32]; 3]) {
        match &self.0 {
            Pixels::Linear(pixels, display) => shine(&pixels.row(y as u32)[columns], light, *display),
            Pixels::Codes(codes) => look_up(&codes.pixels.row(y as u32)[columns], &codes.light().rounded, light),
        }
    }
}

vectorised! {
    fn sum_squares<'a>(a: &'a [u16], b: &'a [u16]) -> u64 {
        let mut sum = 0;
        // A part's sum fits 32 bits: its squares are below 2¹⁶.
        for (a, b) in a.chunks(1 << 15).zip(b.chunks(1 << 15)) {
            let mut part = 0_u32;
            for (a, b) in a.iter().zip(b) {
                let difference = u32::from(a.abs_diff(*b));
                part += difference * difference;
            }
            sum += u64::from(part);
        }
        sum
    }

    fn are_finite<'a>(values: &'a [f32]) -> bool {
        let mut all = 0.0;
        for value in values {
            all += 0.0 * value;
        }
        all == 0.0
    }

    fn count_non_finite<'a>(a: &'a [Rgb], b: &'a [Rgb]) -> u64 {
        let mut n = 0;
        for ([r, g, b], [x, y, z]) in a.iter().zip(b) {
            n += u64::from((0.0 * r + 0.0 * g + 0.0 * b + 0.0 * x + 0.0 * y + 0.0 * z).is_nan());
        }
        n
    }

    fn show_linear<'a>(pixels: Piece<'a, Rgb>, shown: [&'a mut [f64]; 3], display: Display) {
        let mut shown = shown;
        let (mut block, mut few) = (Room::<BLOCK>::default(), Room::<FEW>::default());
        let mut few_shown = [[0.0; FEW]; 3];
        for row in pixels.rows() {
            let (blocks, rest) = row.as_chunks::<BLOCK>();
            for pixels in blocks {
                let shown = shown.each_mut().map(|run| {
                    let block = run.split_off_mut(..BLOCK).and_then(<[f64]>::first_chunk_mut);
                    block.expect("room for all pixels")
                });
                block.show(pixels, shown, display);
            }
            for pixels in rest.chunks(FEW) {
                few.show(pixels, few_shown.each_mut(), display);
                store(&few_shown, pixels.len(), &mut shown);
            }
        }
    }

    fn light_linear<'a>(pixels: &'a [Rgb], light: [&'a mut [f64]; 3]) {
        let mut light = light;
        let (mut narrow, mut planes) = ([[0.0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        for pixels in pixels.chunks(BLOCK) {
            load(pixels, &mut narrow);
            poison(&mut narrow);
            widen(&narrow, &mut planes);
            store(&planes, pixels.len(), &mut light);
        }
    }

    fn shine<'a>(pixels: &'a [Rgb], light: [&'a mut [f32]; 3], display: Display) {
        let mut light = light;
        let mut planes = [[0.0; BLOCK]; 3];
        for pixels in pixels.chunks(BLOCK) {
            load(pixels, &mut planes);
            display.shine(&mut planes);
            store(&planes, pixels.len(), &mut light);
        }
    }

    /// Pixels as planes.
    fn split<'a>(pixels: &'a [Rgb], planes: [&'a mut [f32]; 3]) {
        let mut planes = planes;
        let mut loaded = [[0.0; BLOCK]; 3];
        for pixels in pixels.chunks(BLOCK) {
            load(pixels, &mut loaded);
            store(&loaded, pixels.len(), &mut planes);
        }
    }

    fn show_codes<'a>(pixels: Piece<'a, [u16; 3]>, shown: [&'a mut [f64]; 3], max: f64) {
        let mut shown = shown;
        let inverse = 1.0 / max;
        let (mut codes, mut planes) = ([[0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        for row in pixels.rows() {
            for pixels in row.chunks(BLOCK) {
                load(pixels, &mut codes);
                for channel in 0..3 {
                    for i in 0..BLOCK {
                        planes[channel][i] = quotient(f64::from(codes[channel][i]), max, inverse);
                    }
                }
                store(&planes, pixels.len(), &mut shown);
            }
        }
    }
}

/// A area of an image.
struct Piece<'a, T> {
    image: &'a Image<T>,
    area: Area,
}

impl<'a, T: Copy + Send + Sync> Piece<'a, T> {
    #[inline(always)]
    fn rows(&self) -> impl Iterator<Item = &'a [T]> {
        let Self {
            image,
            area: [columns, rows],
        } = self;
        let image = *image;
        rows.clone().map(move |y| &image.row(y as u32)[columns.clone()])
    }
}

/// Room for `N` pixels on their way to what they show.
struct Room<const N: usize> {
    narrow: [[f32; N]; 3],
    planes: [[f64; N]; 3],
    found: Found<N>,
}

impl<const N: usize> Default for Room<N> {
    #[inline(always)]
    fn default() -> Self {
        Self {
            narrow: [[0.0; N]; 3],
            planes: [[0.0; N]; 3],
            found: Found::default(),
        }
    }
}

impl<const N: usize> Room<N> {
    /// Shows up to `N` pixels.
    #[inline(always)]
    fn show(&mut self, pixels: &[Rgb], shown: [&mut [f64; N]; 3], display: Display) {
        load(pixels, &mut self.narrow);
        poison(&mut self.narrow);
        widen(&self.narrow, &mut self.planes);
        display.show(&mut self.planes, shown, &mut self.found);
    }
}

/// What a table has for each code.
fn look_up<T: Copy>(pixels: &[[u16; 3]], table: &[T], found: [&mut [T]; 3]) {
    for (channel, found) in found.into_iter().enumerate() {
        for (value, pixel) in found.iter_mut().zip(pixels) {
            *value = table[usize::from(pixel[channel])];
        }
    }
}

/// `code / max` rounded once, as a division would, which costs more: Markstein, "IA-64 and Elementary Functions", 2000.
#[inline(always)]
fn quotient(code: f64, max: f64, inverse: f64) -> f64 {
    let near = code * inverse;
    inverse.mul_add(max.mul_add(-near, code), near)
}

/// Up to a block of pixels as planes; what follows the last pixel stays.
#[inline(always)]
fn load<T: Copy, const N: usize>(pixels: &[[T; 3]], planes: &mut [[T; N]; 3]) {
    let [r, g, b] = planes;
    // Whole blocks have a loop of their own, of a number of steps that is known.
    match pixels.first_chunk::<N>() {
        Some(pixels) => {
            for i in 0..N {
                [r[i], g[i], b[i]] = pixels[i];
            }
        }
        None => {
            for (i, pixel) in pixels.iter().enumerate() {
                [r[i], g[i], b[i]] = *pixel;
            }
        }
    }
}

#[inline(always)]
fn widen<const N: usize>(planes: &[[f32; N]; 3], wide: &mut [[f64; N]; 3]) {
    for channel in 0..3 {
        for i in 0..N {
            wide[channel][i] = f64::from(planes[channel][i]);
        }
    }
}

/// Writes the first `n` pixels of a block to where a run begins, which then is behind them.
#[inline(always)]
fn store<T: Copy, const N: usize>(block: &[[T; N]; 3], n: usize, run: &mut [&mut [T]; 3]) {
    for (run, plane) in run.iter_mut().zip(block) {
        let run = run.split_off_mut(..n).expect("room for all pixels");
        match run.first_chunk_mut::<N>() {
            Some(run) => *run = *plane,
            None => run.copy_from_slice(&plane[..n]),
        }
    }
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
    fn codes_are_exact_quotients() {
        for max in [255, 1023, u16::MAX] {
            let codes = Image::from_fn(Extent::new(u32::from(max) + 1, 1), |x, _| [x as u16; 3]);
            let n = codes.pixels().len();
            let mut planes = [(); 6].map(|()| vec![0.0; n]);
            let [r, g, b, lr, lg, lb] = planes.each_mut().map(Vec::as_mut_slice);
            let picture = Picture::codes(codes, max);
            picture.show([0..n, 0..1], [r, g, b]);
            picture.light(0, 0..n, [lr, lg, lb]);
            let exact = |code: usize| code as f64 / f64::from(max);
            for (plane, light) in planes[..3].iter().zip(&planes[3..]) {
                assert!(plane.iter().enumerate().all(|(code, value)| *value == exact(code)));
                let decoded = |code: usize| linear_from_srgb(exact(code));
                assert!(light.iter().enumerate().all(|(code, value)| *value == decoded(code)));
            }
        }
    }

    #[test]
    fn a_bad_component_poisons_its_pixel_in_every_domain() {
        let mut image = Image::filled(Extent::new(70, 2), [0.5; 3]);
        image.pixels_mut()[70 + 66] = [0.5, f32::INFINITY, 0.5];
        let picture = Picture::linear(image, Display::default());
        let mut planes = [(); 6].map(|()| vec![0.0; 10]);
        let [r, g, b, lr, lg, lb] = planes.each_mut().map(Vec::as_mut_slice);
        picture.show([60..70, 1..2], [r, g, b]);
        picture.light(1, 60..70, [lr, lg, lb]);
        for plane in planes {
            assert!(plane.iter().enumerate().all(|(x, value)| value.is_nan() == (x == 6)));
        }
    }
}
