//! An image as metrics see it: planes of f64 in the domains asked for, and which pixels cannot be judged.

use super::{
    Display, Domain, Metric, display,
    flip::{Exposures, SeenImage},
    ms_ssim::Pyramid,
    quantities,
};
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use rayon::prelude::*;
use std::{ops::Range, sync::OnceLock};

/// Three channels, each a row-major plane.
type Planes = [Vec<f64>; 3];

/// An image prepared for a set of metrics: display values, and linear ones where a metric reads them. A pixel with a
/// non-finite component is NaN in all of them.
pub struct Shown {
    extent: Extent,
    display: Planes,
    linear: Option<Planes>,
    reused: Reused,
    n_non_finite: u64,
}

/// What metrics derive from one image alone: made at the first use. Of a reference every image compared with it shares
/// them; of an image under test the next frame does.
#[derive(Default)]
struct Reused {
    seen: OnceLock<SeenImage>,
    exposures: OnceLock<Exposures>,
    pyramid: OnceLock<Pyramid>,
    luma: OnceLock<Vec<f64>>,
}

impl Shown {
    /// A linear RGB image after `display`.
    pub fn from_linear(linear: &Image<Rgb>, display: Display, metrics: &[Metric]) -> Self {
        Self::from_pixels(linear, metrics, |pixel| display.apply(pixel), poison)
    }

    /// An image of sRGB-encoded integers of 0 to `max_code` (255 for 8 bits), each given as the float nearest to
    /// `code / max_code`. The quotients are restored in f64, so that the scores are those of the integers themselves.
    pub fn from_encoded(encoded: &Image<Rgb>, max_code: u16, metrics: &[Metric]) -> Self {
        let display = |pixel: Rgb| pixel.map(|value| restore(value, f64::from(max_code)));
        Self::from_pixels(encoded, metrics, display, |pixel| {
            display(pixel).map(display::linear_from_srgb)
        })
    }

    fn from_pixels(
        image: &Image<Rgb>,
        metrics: &[Metric],
        display: impl Fn(Rgb) -> [f64; 3] + Sync,
        linear: impl Fn(Rgb) -> [f64; 3] + Sync,
    ) -> Self {
        let reads_linear = quantities(metrics)
            .iter()
            .any(|quantity| quantity.domain() == Domain::Linear);
        let display = planes(image, display);
        Self {
            extent: image.extent(),
            linear: reads_linear.then(|| planes(image, linear)),
            n_non_finite: display[0].par_iter().filter(|value| value.is_nan()).count() as u64,
            reused: Reused::default(),
            display,
        }
    }

    /// Width and height.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    pub(super) fn seen(&self) -> &SeenImage {
        self.reused.seen.get_or_init(|| SeenImage::new(self))
    }

    pub(super) fn exposures(&self) -> Exposures {
        *self.reused.exposures.get_or_init(|| Exposures::of(self))
    }

    /// The whole plane of [`Domain::Luma`].
    pub(super) fn luma(&self) -> &[f64] {
        self.reused.luma.get_or_init(|| {
            let [r, g, b] = &self.display;
            let luma = (0..r.len()).into_par_iter().map(|i| display::luma([r[i], g[i], b[i]]));
            luma.collect()
        })
    }

    pub(super) fn pyramid(&self) -> &Pyramid {
        self.reused.pyramid.get_or_init(|| Pyramid::new(self))
    }

    /// A channel of a domain that is stored.
    pub(super) fn plane(&self, domain: Domain, channel: usize) -> &[f64] {
        match domain {
            Domain::Display => &self.display[channel],
            Domain::Linear => {
                let linear = self.linear.as_ref().expect("the image was prepared for these metrics");
                &linear[channel]
            }
            Domain::Luma | Domain::U8 => unreachable!("computed a row at a time"),
        }
    }

    /// How many pixels are non-finite here or in `other`.
    pub(super) fn count_non_finite(&self, other: &Self) -> u64 {
        if self.n_non_finite == 0 || other.n_non_finite == 0 {
            return self.n_non_finite + other.n_non_finite;
        }
        let pairs = self.display[0].iter().zip(&other.display[0]);
        pairs.filter(|(a, b)| a.is_nan() || b.is_nan()).count() as u64
    }

    /// The `columns` of row `y` of a channel. Domains that are not stored are computed into `scratch`.
    pub(super) fn row<'a>(
        &'a self,
        domain: Domain,
        channel: usize,
        y: usize,
        columns: Range<usize>,
        scratch: &'a mut Vec<f64>,
    ) -> &'a [f64] {
        let start = y * self.extent.width as usize;
        let span = start + columns.start..start + columns.end;
        let [r, g, b] = self.display.each_ref().map(|plane| &plane[span.clone()]);
        scratch.clear();
        match domain {
            Domain::Display => [r, g, b][channel],
            Domain::Linear => &self.plane(domain, channel)[span],
            Domain::Luma => {
                scratch.extend((0..r.len()).map(|x| display::luma([r[x], g[x], b[x]])));
                scratch
            }
            Domain::U8 => {
                scratch.extend([r, g, b][channel].iter().map(|&value| round(255.0 * value)));
                scratch
            }
        }
    }
}

/// Linear values in f64; a pixel with a non-finite component is NaN altogether, so that Inf − Inf, Inf − 1 and NaN all
/// end as NaN.
fn poison(pixel: Rgb) -> [f64; 3] {
    if pixel.iter().all(|c| c.is_finite()) {
        pixel.map(f64::from)
    } else {
        [f64::NAN; 3]
    }
}

/// The exact `code / max_code` that `value` was rounded from, or `value` where it was rounded from no such quotient.
fn restore(value: f32, max_code: f64) -> f64 {
    let exact = round(f64::from(value) * max_code) / max_code;
    if exact as f32 == value { exact } else { f64::from(value) }
}

/// To the nearest whole number, ties to even, for 0 ≤ `value` < 2⁵¹. Adding 2⁵² leaves no bits for a fraction; unlike
/// `round` it needs no call, so that rows vectorise, and unlike a cast to an integer it keeps NaN.
fn round(value: f64) -> f64 {
    const TWO_52: f64 = (1_u64 << 52) as f64;
    (value + TWO_52) - TWO_52
}

fn planes(image: &Image<Rgb>, f: impl Fn(Rgb) -> [f64; 3] + Sync) -> Planes {
    let width = (image.extent().width as usize).max(1);
    let mut planes = [(); 3].map(|()| vec![0.0; image.extent().n_pixels()]);
    let [r, g, b] = &mut planes;
    let rows = (
        r.par_chunks_mut(width),
        g.par_chunks_mut(width),
        b.par_chunks_mut(width),
    );
    rows.into_par_iter()
        .zip(image.pixels().par_chunks(width))
        .for_each(|((r, g, b), pixels)| {
            for (x, &pixel) in pixels.iter().enumerate() {
                [r[x], g[x], b[x]] = f(pixel);
            }
        });
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bit_codes_are_exact() {
        let codes = Image::from_fn(Extent::new(256, 1), |x, _| [x as f32 / 255.0; 3]);
        let shown = Shown::from_encoded(&codes, 255, &[Metric::PsnrU8]);
        let mut scratch = Vec::new();
        for (domain, scale) in [(Domain::U8, 1.0), (Domain::Display, 255.0)] {
            let row = shown.row(domain, 2, 0, 0..256, &mut scratch);
            assert!(
                row.iter()
                    .enumerate()
                    .all(|(code, &value)| value == code as f64 / scale)
            );
        }
    }

    #[test]
    fn a_bad_component_poisons_its_pixel_in_every_domain() {
        let mut image = Image::filled(Extent::new(4, 2), [0.5; 3]);
        image.pixels_mut()[6] = [0.5, f32::INFINITY, 0.5];
        let shown = Shown::from_linear(&image, Display::default(), &[Metric::PsnrLinear]);
        let mut scratch = Vec::new();
        for domain in [Domain::Linear, Domain::Display, Domain::Luma, Domain::U8] {
            for channel in 0..domain.n_channels() {
                let row = shown.row(domain, channel, 1, 0..4, &mut scratch);
                let bad: Vec<bool> = row.iter().map(|value| value.is_nan()).collect();
                assert_eq!(bad, [false, false, true, false], "{domain:?}");
            }
        }
    }
}
