//! Formats besides plain OpenEXR, and what is written here.

use super::{difference, fixture, floats, native, read_both, strings, worker, worker_for};
use afterimage::image::files::exr::{Compression, FloatFormat, write_exr, write_rgb_exr};
use afterimage::image::files::png::{encode_png, write_png};
use afterimage::image::files::{Backend, ImageError, Plane, Planes, SampleType};
use afterimage::image::{Extent, Image};
use image::{DynamicImage, ImageBuffer};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

/// What `fixtures/images/README.md` says is in the fixtures.
fn pattern() -> Image<[f32; 3]> {
    Image::from_fn(Extent::new(7, 5), |x, y| {
        [0, 1, 2].map(|c| (128 + (x * 7 + y * 13 + c * 29) % 128) as f32 / 256.0)
    })
}

/// Largest difference from the pattern when that is rounded to steps of `1 / max`.
fn error_of(image: &Image<[f32; 3]>, max: Option<f32>) -> f32 {
    assert_eq!(image.extent(), Extent::new(7, 5));
    let stored = |value: f32| max.map_or(value, |max| (value * max).round() / max);
    let pairs = pattern().pixels().as_flattened().to_vec();
    let pairs = pairs.into_iter().zip(image.pixels().as_flattened());
    pairs
        .map(|(expected, read)| (stored(expected) - read).abs())
        .fold(0.0, f32::max)
}

#[test]
fn other_formats_come_through_the_worker_exactly() {
    let auto = worker_for(Backend::Auto);
    let cases = [
        ("float.tif", SampleType::F32, None),
        ("uint16.tif", SampleType::U16, Some(65_535.0)),
        ("uint16.dpx", SampleType::U16, Some(65_535.0)),
        ("uint10.dpx", SampleType::U16, Some(1023.0)),
        ("radiance.hdr", SampleType::F32, None),
        ("uint8.bmp", SampleType::U8, Some(255.0)),
    ];
    for (name, sample, max) in cases {
        let read = auto.read_rgb(&fixture(name)).expect(name);
        assert_eq!(read.sample, sample, "{name}");
        assert_eq!(error_of(&read.image, max), 0.0, "{name}");
        assert!(
            matches!(native().read_rgb(&fixture(name)), Err(ImageError::Unsupported { .. })),
            "{name}"
        );
    }
    // Lossy; and a control that the measure sees a wrong rounding.
    assert!(error_of(&auto.read_rgb(&fixture("uint8.jpg")).expect("JPEG").image, None) < 0.1);
    assert!(error_of(&auto.read_rgb(&fixture("uint8.bmp")).expect("BMP").image, None) > 0.0);
}

#[test]
fn compression_that_is_refused_here_goes_to_the_worker() {
    let path = fixture("dwaa.exr");
    let error = native().read_rgb(&path).expect_err("DWA is refused").to_string();
    assert!(
        error.contains("dwaa.exr") && error.contains("dwaa compression"),
        "{error}"
    );
    assert!(
        error_of(
            &worker_for(Backend::Auto).read_rgb(&path).expect("by the worker").image,
            None
        ) < 0.01
    );
}

#[test]
fn smaller_levels_are_ignored() {
    let path = fixture("mip.exr");
    read_both(&path, &native(), &worker());
    assert_eq!(error_of(&native().read_rgb(&path).expect("read").image, None), 0.0);
}

#[test]
fn png_reads_the_same_both_ways_and_alpha_is_not_multiplied_in() {
    let (native, worker) = (native(), worker());
    let folder = tempfile::tempdir().expect("a folder");
    let byte = |x: u32, y: u32, c: u32| (x * 31 + y * 57 + c * 101) as u8;
    let word = |x: u32, y: u32, c: u32| (x * 3001 + y * 5077 + c * 20_011) as u16;
    macro_rules! image {
        ($pixel:ident, $variant:ident, $value:ident, $($c:literal),+) => {
            DynamicImage::$variant(ImageBuffer::from_fn(61, 37, |x, y| image::$pixel([$($value(x, y, $c)),+])))
        };
    }
    let images = [
        image!(Luma, ImageLuma8, byte, 0),
        image!(LumaA, ImageLumaA8, byte, 0, 3),
        image!(Rgb, ImageRgb8, byte, 0, 1, 2),
        image!(Rgba, ImageRgba8, byte, 0, 1, 2, 3),
        image!(Luma, ImageLuma16, word, 0),
        image!(LumaA, ImageLumaA16, word, 0, 3),
        image!(Rgb, ImageRgb16, word, 0, 1, 2),
        image!(Rgba, ImageRgba16, word, 0, 1, 2, 3),
    ];
    for (index, image) in images.iter().enumerate() {
        let path = folder.path().join(format!("{index}.png"));
        image.save(&path).expect("written");
        let read = read_both(&path, &native, &worker);
        let (first, sample) = match index < 4 {
            true => (f32::from(byte(5, 3, 0)) / 255.0, SampleType::U8),
            false => (f32::from(word(5, 3, 0)) / 65_535.0, SampleType::U16),
        };
        assert_eq!(floats(&read.planes[0])[3 * 61 + 5], first, "{index}");
        assert_eq!(native.read_rgb(&path).expect("rgb").sample, sample);
    }
}

#[test]
fn written_exr_reads_back_and_replaces_whole_files_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("out.exr");
    let extent = Extent::new(61, 37);
    let floats: Vec<f32> = (0..extent.n_pixels()).map(|i| i as f32 * 0.37 - 100.0).collect();
    let ids: Vec<u32> = (0..extent.n_pixels() as u32).map(|i| u32::MAX - i).collect();
    let channels = [("id", Plane::U32(ids.clone())), ("v", Plane::F32(floats.clone()))];
    std::fs::write(&path, "an older file").expect("written");
    write_exr(&path, extent, &channels, FloatFormat::Float, Compression::PIZ).expect("written");
    let expected = Planes {
        extent,
        planes: vec![Plane::F32(floats), Plane::U32(ids)],
        samples: vec![SampleType::F32, SampleType::U32],
    };
    for reader in [native(), worker()] {
        assert_eq!(
            difference(&reader.read(&path, &strings(&["v", "id"])).expect("read"), &expected),
            None
        );
    }
    let readable_by_all = std::fs::metadata(&path).expect("there").permissions().mode() & 0o044;
    assert_eq!(readable_by_all, 0o044, "not private as temporary files are");

    let error = write_exr(&path, extent, &channels, FloatFormat::Half, Compression::HTJ2K32).expect_err("unwritten");
    assert!(error.to_string().contains("out.exr"), "{error}");
    assert!(
        native().read(&path, &strings(&["id"])).is_ok(),
        "a failed write leaves the old file"
    );
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("listed").count(),
        1,
        "no temporary file stays"
    );
}

#[test]
fn written_rgb_reads_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("out.exr");
    for (format, sample) in [
        (FloatFormat::Half, SampleType::F16),
        (FloatFormat::Float, SampleType::F32),
    ] {
        write_rgb_exr(&path, &pattern(), format).expect("written");
        let read = worker().read_rgb(&path).expect("read");
        assert_eq!((read.image, read.sample), (pattern(), sample));
    }
    let png = folder.path().join("out.png");
    let bytes = pattern().map(|pixel| pixel.map(|value| (value * 255.0).round() as u8));
    write_png(&png, &bytes, &[]).expect("written");
    assert_eq!(std::fs::read(&png).expect("read"), encode_png(&bytes, &[]));
    assert_eq!(
        native().read_rgb(&png).expect("read").image,
        bytes.map(|pixel| pixel.map(|v| f32::from(v) / 255.0))
    );
    let nowhere = Path::new("/nowhere/out.png");
    assert!(
        write_png(nowhere, &bytes, &[])
            .expect_err("no such folder")
            .to_string()
            .contains("/nowhere/out.png")
    );
}
