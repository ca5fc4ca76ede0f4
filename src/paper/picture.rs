//! The same crop of several images beside each other, magnified, as PNG.

use super::finding::Strip;
use crate::{
    image::{Extent, Image, files::png},
    metrics::Display,
    sequence::frame::Rgb,
};

/// Side of the crop, pixels, and how often each of its pixels is repeated.
const CROP: Extent = Extent::new(56, 42);
const MAGNIFICATION: u32 = 4;
/// Between crops, pixels of the strip.
const GAP: u32 = 4;

/// Shows where `images[1]` is furthest from `images[0]`, the reference.
pub fn strip(name: &str, caption: &str, display: Display, images: &[(&str, &Image<Rgb>)]) -> Strip {
    let shown: Vec<Image<[f64; 3]>> = images
        .iter()
        .map(|(_, image)| image.map(|pixel| display.apply(pixel)))
        .collect();
    let crop = Extent::new(
        CROP.width.min(shown[0].extent().width),
        CROP.height.min(shown[0].extent().height),
    );
    let [left, top] = furthest(&shown[0], &shown[1], crop);
    let cell = Extent::new(crop.width * MAGNIFICATION, crop.height * MAGNIFICATION);
    let n = shown.len() as u32;
    let extent = Extent::new(n * cell.width + (n - 1) * GAP, cell.height);
    let pixels = Image::from_fn(extent, |x, y| {
        let (index, x) = (x / (cell.width + GAP), x % (cell.width + GAP));
        if x >= cell.width {
            return [255; 3];
        }
        let pixel = shown[index as usize].at(left + x / MAGNIFICATION, top + y / MAGNIFICATION);
        pixel.map(|value| (value * 255.0).round() as u8)
    });
    Strip {
        name: name.to_owned(),
        caption: caption.to_owned(),
        labels: images.iter().map(|(label, _)| (*label).to_owned()).collect(),
        png: png::encode_png(&pixels, &[]),
    }
}

/// The top left corner of the crop whose squared error is largest, on a grid of half crops.
fn furthest(reference: &Image<[f64; 3]>, test: &Image<[f64; 3]>, crop: Extent) -> [u32; 2] {
    let error = |left: u32, top: u32| -> f64 {
        let rows = (top..top + crop.height).flat_map(|y| {
            let range = left as usize..(left + crop.width) as usize;
            reference.row(y)[range.clone()].iter().zip(&test.row(y)[range])
        });
        rows.map(|(r, t)| (0..3).map(|i| (r[i] - t[i]).powi(2)).sum::<f64>())
            .sum()
    };
    let along = |size: u32, crop: u32| (0..=size - crop).step_by((crop as usize / 2).max(1));
    let extent = reference.extent();
    let corners =
        along(extent.height, crop.height).flat_map(|top| along(extent.width, crop.width).map(move |left| [left, top]));
    corners
        .max_by(|a, b| error(a[0], a[1]).total_cmp(&error(b[0], b[1])))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crop_goes_where_the_error_is() {
        let extent = Extent::new(200, 100);
        let reference = Image::filled(extent, [0.5; 3]);
        let mut test = reference.clone();
        test.pixels_mut()[80 * 200 + 170] = [1.0; 3];
        let [left, top] = furthest(&reference, &test, CROP);
        assert!((left..left + CROP.width).contains(&170) && (top..top + CROP.height).contains(&80));
    }

    #[test]
    fn a_strip_has_every_image() {
        let images = [0.0, 0.5, 1.0].map(|value| Image::filled(Extent::new(20, 10), [value; 3]));
        let named: Vec<_> = ["a", "b", "c"].into_iter().zip(&images).collect();
        let strip = strip("name", "", Display::default(), &named);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("strip.png");
        std::fs::write(&path, &strip.png).unwrap();
        let reader = crate::image::files::FileReader::new(Default::default(), Default::default());
        let image = reader.read_rgb(&path).unwrap().image;
        let width = 20 * MAGNIFICATION;
        assert_eq!(image.extent(), Extent::new(3 * width + 2 * GAP, 10 * MAGNIFICATION));
        let at = |index: u32| image.at(index * (width + GAP) + 1, 1)[0];
        assert_eq!([at(0), at(2)], [0.0, 1.0]);
        assert!((at(1) - 188.0 / 255.0).abs() < 1e-6, "{}", at(1));
    }
}
