//! Where the errors are: per-pixel maps, and a colour scale to look at them.

use super::{Display, Metric, MetricError, Shown, check_sizes, flip, ssim};
use crate::{image::Image, sequence::frame::Rgb};
use std::f64::consts::TAU;

/// Mean over RGB of |T − R| in display values, 0 to 1; NaN where either pixel is non-finite.
pub fn error_map(reference: &Image<Rgb>, test: &Image<Rgb>, display: Display) -> Result<Image<f32>, MetricError> {
    check_sizes(&[], reference.extent(), test.extent())?;
    Ok(Image::from_fn(reference.extent(), |x, y| {
        let (r, t) = (display.apply(reference.at(x, y)), display.apply(test.at(x, y)));
        let sum: f64 = r.iter().zip(t).map(|(r, t)| (t - r).abs()).sum();
        (sum / 3.0) as f32
    }))
}

/// The structural similarity of each 11×11 window of display RGB, averaged over channels. Ten pixels smaller than the
/// images in either axis: pixel (x, y) is the window centred at (x + 5, y + 5).
pub fn ssim_map(reference: &Image<Rgb>, test: &Image<Rgb>, display: Display) -> Result<Image<f32>, MetricError> {
    check_sizes(&[Metric::Ssim], reference.extent(), test.extent())?;
    let shown = |image| Shown::from_linear(image, display, &[Metric::Ssim]);
    Ok(ssim::map(&shown(reference), &shown(test)))
}

/// LDR-FLIP of each pixel, 0 to 1; NaN where what its filters see is non-finite.
pub fn flip_map(reference: &Image<Rgb>, test: &Image<Rgb>, display: Display) -> Result<Image<f32>, MetricError> {
    check_sizes(&[Metric::Flip], reference.extent(), test.extent())?;
    let shown = |image| Shown::from_linear(image, display, &[Metric::Flip]);
    Ok(flip::map(&shown(reference), &shown(test)))
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

    #[test]
    fn ssim_map_averages_to_the_metric() {
        let extent = Extent::new(150, 90);
        let reference = Image::from_fn(extent, |x, y| [(x * 7 + y * 13) as f32 % 11.0 / 11.0; 3]);
        let test = Image::from_fn(extent, |x, y| [((x * 5 + y * 3) % 17) as f32 / 17.0, 0.5, 0.1]);
        let map = ssim_map(&reference, &test, Display::default()).unwrap();
        let mean = map.pixels().iter().map(|&v| f64::from(v)).sum::<f64>() / map.pixels().len() as f64;
        let scores = crate::metrics::Reference::new(&reference, Display::default(), &[Metric::Ssim]).evaluate(&test);
        assert!((mean - scores.unwrap().values["ssim"].0).abs() < 1e-7);
        assert_eq!(map.extent(), Extent::new(140, 80));
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
