//! OpenEXR with parts, and 16-bit PNG.

use anyhow::Context;
use exr::prelude::*;
use half::f16;
use std::path::Path;

/// One channel's samples, row by row.
pub struct Channel {
    name: String,
    samples: FlatSamples,
}

impl Channel {
    /// Stored as 16-bit floats.
    pub fn half(name: String, values: impl Iterator<Item = f64>) -> Self {
        let samples = FlatSamples::F16(values.map(f16::from_f64).collect());
        Self { name, samples }
    }

    /// Stored as 32-bit floats.
    pub fn float(name: String, values: impl Iterator<Item = f64>) -> Self {
        let samples = FlatSamples::F32(values.map(|value| value as f32).collect());
        Self { name, samples }
    }

    /// Stored as integers.
    pub fn uint(name: String, values: impl Iterator<Item = u32>) -> Self {
        let samples = FlatSamples::U32(values.collect());
        Self { name, samples }
    }
}

/// A part of a file.
pub struct Part {
    pub name: Option<&'static str>,
    pub channels: Vec<Channel>,
}

/// Writes `parts` over one window, ZIP-compressed.
pub fn write_exr(path: &Path, [width, height]: [u32; 2], parts: &[Part]) -> anyhow::Result<()> {
    let size = Vec2(width as usize, height as usize);
    let layers = parts.iter().map(|part| {
        let channels = part
            .channels
            .iter()
            .map(|channel| AnyChannel::new(&*channel.name, channel.samples.clone()))
            .collect();
        let attributes = LayerAttributes {
            layer_name: part.name.map(Text::from),
            ..LayerAttributes::default()
        };
        Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels))
    });
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions(size));
    Image::from_layers(attributes, layers.collect::<Layers<_>>())
        .write()
        .non_parallel()
        .to_file(path)
        .with_context(|| path.display().to_string())
}

/// Writes linear colours in [0, 1] as 16-bit sRGB.
pub fn write_png16(
    path: &Path,
    [width, height]: [u32; 2],
    linear: impl Iterator<Item = [f64; 3]>,
) -> anyhow::Result<()> {
    let encode = |c: f64| match c {
        c if c <= 0.003_130_8 => 12.92 * c,
        c => 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055,
    };
    let samples = linear.flatten().map(|c| (encode(c) * 65535.0).round() as u16).collect();
    let image: image::ImageBuffer<image::Rgb<u16>, Vec<u16>> =
        image::ImageBuffer::from_raw(width, height, samples).context("as many samples as pixels")?;
    image.save(path).with_context(|| path.display().to_string())
}
