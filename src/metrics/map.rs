//! Where the errors are: the samples that a metric is the mean of, pixel by pixel, and a colour scale to look at them.

use super::{
    Display, Metric, MetricError, Picture, Reference,
    display::luma,
    flip, ms_ssim,
    picture::round,
    quantity::{Domain, Quantity},
    reference::{Pair, check_sizes, with_pair},
    relative_error, ssim,
};
use crate::{
    image::{
        Image,
        files::{
            ImageError,
            exr::{FloatFormat, write_map_exr},
            png::{encode_png, write_png},
        },
    },
    sequence::frame::Rgb,
};
use rayon::prelude::*;
use std::{f64::consts::TAU, path::Path};

/// A spatial metric's samples, averaged over channels. Where it leaves out a border, and where a pixel is not finite, they
/// are NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Whose samples.
    pub metric: Metric,
    /// One a pixel, as measured: squared errors for the PSNRs.
    pub values: Image<f32>,
}

/// The values that a map is drawn black and white at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Of pixels as good as they can be.
    pub black: f32,
    /// Of bad ones, and all that are worse.
    pub white: f32,
}

impl Map {
    /// Compares `test` with `reference`.
    pub fn new(metric: Metric, reference: &Picture, test: &Picture) -> Result<Self, MetricError> {
        metric.check_map()?;
        check_sizes(&[metric], reference.extent(), test.extent())?;
        let quantity = metric.definition().quantity;
        let of_pair =
            |f: fn(&Pair) -> Image<f32>| with_pair(&Reference::new(reference.clone(), &[metric]), test, quantity, f);
        let squared = |r: f64, t: f64| (t - r) * (t - r);
        let values = match quantity {
            Quantity::SquaredError(domain) => pointwise(domain, reference, test, squared),
            Quantity::RelativeSquaredError => pointwise(Domain::Linear, reference, test, relative_error::squared),
            Quantity::SymmetricError => pointwise(Domain::Linear, reference, test, relative_error::symmetric),
            Quantity::Ssim(Domain::Luma) => of_pair(|pair| ssim::map(pair, Domain::Luma))?,
            Quantity::Ssim(Domain::U8) => of_pair(|pair| ssim::map(pair, Domain::U8))?,
            Quantity::Ssim(_) => of_pair(|pair| ssim::map(pair, Domain::Display))?,
            Quantity::MsSsim => of_pair(ms_ssim::map)?,
            Quantity::Flip | Quantity::FlipPercentile => of_pair(flip::map)?,
            Quantity::HdrFlip => of_pair(flip::hdr_map)?,
            Quantity::Change(_) | Quantity::ErrorDeviation | Quantity::Convergence => {
                unreachable!("temporal metrics were refused")
            }
        };
        Ok(Self { metric, values })
    }

    /// Fixed for each metric, so that pictures of two frames can be compared: white at a tenth of the display range, and at
    /// the worst value of indices.
    pub fn scale(&self) -> Scale {
        let [black, white] = match self.metric.definition().quantity {
            Quantity::SquaredError(Domain::U8) => [0.0, 25.5 * 25.5],
            Quantity::SquaredError(_) | Quantity::RelativeSquaredError => [0.0, 0.01],
            Quantity::Ssim(_) | Quantity::MsSsim => [1.0, 0.0],
            _ => [0.0, 1.0],
        };
        Scale { black, white }
    }

    /// A picture of it as a PNG file, which says whose samples it shows and what black and white stand for.
    pub fn encode_png(&self, scale: Scale) -> Vec<u8> {
        encode_png(&self.draw(scale), &self.texts(scale))
    }

    /// Writes `FOLDER/NAME.png`, its picture, and `FOLDER/NAME.exr`, its values.
    pub fn write(&self, folder: &Path, name: &str) -> Result<(), ImageError> {
        let scale = self.scale();
        let file = |extension: &str| folder.join(format!("{name}.{extension}"));
        write_png(&file("png"), &self.draw(scale), &self.texts(scale))?;
        write_map_exr(&file("exr"), &self.values, FloatFormat::Float)
    }

    fn draw(&self, Scale { black, white }: Scale) -> Image<[u8; 3]> {
        false_color(&self.values.map(|value| (value - black) / (white - black)), 1.0)
    }

    fn texts(&self, scale: Scale) -> [(&'static str, String); 3] {
        [
            ("Metric", self.metric.to_string()),
            ("Black", scale.black.to_string()),
            ("White", scale.white.to_string()),
        ]
    }
}

/// `f` of reference and test, averaged over the channels of a domain.
fn pointwise(domain: Domain, reference: &Picture, test: &Picture, f: impl Fn(f64, f64) -> f64 + Sync) -> Image<f32> {
    let extent = reference.extent();
    let width = extent.width as usize;
    let mut map = Image::filled(extent, 0.0);
    map.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let [r, t] = [reference, test].map(|picture| {
            let mut planes = [(); 3].map(|()| vec![0.0; width]);
            let rows = planes.each_mut().map(Vec::as_mut_slice);
            match domain {
                Domain::Linear => picture.light(y, 0..width, rows),
                Domain::Display | Domain::Luma | Domain::U8 => picture.show([0..width, y..y + 1], rows),
            }
            planes
        });
        for (x, value) in row.iter_mut().enumerate() {
            let [r, t] = [&r, &t].map(|planes| planes.each_ref().map(|plane| plane[x]));
            let mean = match domain {
                Domain::Luma => f(luma(r), luma(t)),
                Domain::U8 => mean(|c| f(round(255.0 * r[c]), round(255.0 * t[c]))),
                Domain::Linear | Domain::Display => mean(|c| f(r[c], t[c])),
            };
            *value = mean as f32;
        }
    });
    map
}

fn mean(of_channel: impl Fn(usize) -> f64) -> f64 {
    (0..3).map(of_channel).sum::<f64>() / 3.0
}

/// Mean over RGB of |T − R| in display values, 0 to 1; NaN where either pixel is non-finite.
pub fn error_map(reference: &Image<Rgb>, test: &Image<Rgb>, display: Display) -> Result<Image<f32>, MetricError> {
    check_sizes(&[], reference.extent(), test.extent())?;
    let [reference, test] = [reference, test].map(|image| Picture::linear(image.clone(), display));
    Ok(pointwise(Domain::Display, &reference, &test, |r, t| (t - r).abs()))
}

/// What [`false_color`] draws where there is no value; the scale itself never comes near it.
pub const NAN_COLOR: [u8; 3] = [255, 0, 255];

/// Draws 0 as black and `max` and above as white, through colours whose brightness rises evenly between them: 8-bit
/// sRGB. The scale is fixed, so that pictures of two frames can be compared.
pub fn false_color(map: &Image<f32>, max: f32) -> Image<[u8; 3]> {
    let scale: Vec<[u8; 3]> = (0..256).map(|i| cubehelix(f64::from(i) / 255.0)).collect();
    map.map(|value| {
        if value.is_nan() {
            NAN_COLOR
        } else {
            scale[(value / max * 255.0).clamp(0.0, 255.0).round() as usize]
        }
    })
}

/// D. A. Green, "A colour scheme for the display of astronomical intensity images", 2011: a helix about the grey
/// diagonal (start 0.5, −1.5 rotations, hue 1, gamma 1) whose perceived brightness is `level`, so that it also reads
/// when printed in grey.
fn cubehelix(level: f64) -> [u8; 3] {
    let angle = TAU * (0.5 / 3.0 + 1.0 - 1.5 * level);
    let amplitude = level * (1.0 - level) / 2.0;
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    [
        -0.14861 * cos + 1.78277 * sin,
        -0.29227 * cos - 0.90649 * sin,
        1.97294 * cos,
    ]
    .map(|component| (255.0 * (level + amplitude * component)).clamp(0.0, 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;

    #[test]
    fn errors_show_where_they_are() {
        let reference = Image::filled(Extent::new(40, 20), [0.0; 3]);
        let mut test = reference.clone();
        test.pixels_mut()[3 * 40 + 7] = [1.0, 0.0, 1.0];
        test.pixels_mut()[5] = [0.0, f32::INFINITY, 0.0];
        let map = error_map(&reference, &test, Display::default()).unwrap();
        assert_eq!((map.at(7, 3), map.at(8, 3)), (2.0 / 3.0, 0.0));
        assert!(map.at(5, 0).is_nan());
        let picture = false_color(&map, 2.0 / 3.0);
        assert_eq!(
            [picture.at(7, 3), picture.at(8, 3), picture.at(5, 0)],
            [[255; 3], [0; 3], NAN_COLOR]
        );
    }

    /// `pooled` turns the mean of a map into its metric.
    #[test]
    fn a_map_averages_to_its_metric() {
        let extent = Extent::new(190, 170);
        let reference = Image::from_fn(extent, |x, y| [(x * 7 + y * 13) as f32 % 11.0 / 11.0; 3]);
        let test = Image::from_fn(extent, |x, y| [((x * 5 + y * 3) % 17) as f32 / 17.0, 0.5, 0.1]);
        let [reference, test] = [reference, test].map(|image| Picture::linear(image, Display::default()));
        let spatial = Metric::ALL.into_iter().filter(|metric| !metric.is_temporal());
        let metrics: Vec<Metric> = spatial.collect();
        let scores = Reference::new(reference.clone(), &metrics).evaluate(&test).unwrap();
        for metric in metrics {
            let map = Map::new(metric, &reference, &test).unwrap();
            assert_eq!(map.values.extent(), extent);
            let known: Vec<f64> = map
                .values
                .pixels()
                .iter()
                .map(|&v| v.into())
                .filter(|v: &f64| !v.is_nan())
                .collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            let value = scores.values[metric.id()].0;
            let expected = match (metric.definition().quantity, metric.definition().relative_mse) {
                // Products of means, percentiles and ratios are not means.
                (Quantity::MsSsim | Quantity::FlipPercentile, _) => continue,
                (Quantity::SquaredError(domain), Some(mse)) => domain.peak() * domain.peak() * mse(value),
                (Quantity::SquaredError(_), None) if metric == Metric::MSE => value,
                (Quantity::SquaredError(_), None) if metric == Metric::RMSE => value * value,
                (Quantity::SquaredError(_), None) => continue,
                _ => value,
            };
            assert!(
                (mean - expected).abs() < 2e-7 * expected.max(1.0),
                "{metric}: {mean}, not {expected}"
            );
        }
    }

    #[test]
    fn what_has_no_map_is_refused() {
        let picture = Picture::linear(Image::filled(Extent::new(20, 20), [0.5; 3]), Display::default());
        for id in ["flicker", "psnr.moving"] {
            let error = Map::new(id.parse().unwrap(), &picture, &picture)
                .unwrap_err()
                .to_string();
            assert!(error.contains(id) && error.contains("map"), "{error}");
        }
    }

    #[test]
    fn brightness_of_the_scale_rises_and_never_meets_the_nan_colour() {
        let ramp = Image::from_fn(Extent::new(256, 1), |x, _| x as f32);
        let scale = false_color(&ramp, 255.0);
        let brightness = |[r, g, b]: [u8; 3]| 0.30 * f64::from(r) + 0.59 * f64::from(g) + 0.11 * f64::from(b);
        for pair in scale.pixels().windows(2) {
            assert!(brightness(pair[1]) > brightness(pair[0]) - 1.0, "{pair:?}");
        }
        assert!(!scale.pixels().contains(&NAN_COLOR));
    }
}
