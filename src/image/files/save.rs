//! Writing files so that nobody ever sees half of one: under a temporary name in the same folder, then renamed. Holds
//! the OpenEXR writer too.

use super::{ImageError, Plane};
use crate::image::{Extent, Image};
use ::exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, Layer};
use ::exr::meta::attribute::{LineOrder, Text};
use ::exr::meta::header::LayerAttributes;
use ::exr::prelude::{Blocks, Compression, WritableImage as _};
use half::slice::HalfFloatSliceExt as _;
use std::fs::{File, Permissions};
use std::io::{BufWriter, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

/// How floats are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FloatFormat {
    /// 16 bits; values are rounded to the nearest.
    Half,
    /// 32 bits.
    Float,
}

/// Writes planes as the channels of an OpenEXR file of one part. Integer planes stay integers.
///
/// # Panics
/// When a plane has not `extent.n_pixels()` samples: a caller's mistake.
pub fn write_exr(
    path: &Path,
    extent: Extent,
    channels: &[(&str, Plane)],
    format: FloatFormat,
    compression: Compression,
) -> Result<(), ImageError> {
    let list = channels.iter().map(|(name, plane)| {
        let samples = match (plane, format) {
            (Plane::U32(samples), _) => FlatSamples::U32(samples.clone()),
            (Plane::F32(samples), FloatFormat::Float) => FlatSamples::F32(samples.clone()),
            (Plane::F32(samples), FloatFormat::Half) => {
                let mut halves = vec![half::f16::ZERO; samples.len()];
                halves.convert_from_f32_slice(samples);
                FlatSamples::F16(halves)
            }
        };
        Text::new_or_none(name)
            .map(|name| AnyChannel::new(name, samples))
            .ok_or_else(|| ImageError::unsupported(path, format!("a channel named `{name}`")))
    });
    let encoding = Encoding {
        compression,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = (extent.width as usize, extent.height as usize);
    let channels = AnyChannels::sort(list.collect::<Result<_, _>>()?);
    let image = ExrImage::from_layer(Layer::new(size, LayerAttributes::default(), encoding, channels));
    let writer = match compression {
        // A line a block, which takes a thread less time than being told of it.
        Compression::RLE => image.write().non_parallel(),
        _ => image.write(),
    };
    atomically(path, |file| {
        writer.to_buffered(file).map_err(|error| match error {
            ::exr::error::Error::Io(source) => ImageError::io(path)(source),
            error => ImageError::unsupported(path, error.to_string()),
        })
    })
}

/// Writes red, green and blue.
pub fn write_rgb_exr(path: &Path, image: &Image<[f32; 3]>, format: FloatFormat) -> Result<(), ImageError> {
    let plane = |channel: usize| Plane::F32(image.pixels().iter().map(|pixel| pixel[channel]).collect());
    let channels = [("R", plane(0)), ("G", plane(1)), ("B", plane(2))];
    write_exr(path, image.extent(), &channels, format, compression(format))
}

/// Writes one value a pixel, as channel `Y`.
pub fn write_map_exr(path: &Path, map: &Image<f32>, format: FloatFormat) -> Result<(), ImageError> {
    let channels = [("Y", Plane::F32(map.pixels().to_vec()))];
    write_exr(path, map.extent(), &channels, format, compression(format))
}

/// Of what is computed while somebody waits. Run lengths of halves take a quarter of ZIP's time, and a third to four fifths more
/// space than it; of floats, whose last bits are all different, they save none.
fn compression(format: FloatFormat) -> Compression {
    match format {
        FloatFormat::Half => Compression::RLE,
        FloatFormat::Float => Compression::ZIP16,
    }
}

/// Gives `write` a file beside `path` and renames it to `path` when that succeeds.
pub(super) fn atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), ImageError>,
) -> Result<(), ImageError> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    // Temporary files are private by default, but this one becomes an ordinary file.
    let ordinary = Permissions::from_mode(0o666);
    let temporary = tempfile::Builder::new()
        .permissions(ordinary)
        .tempfile_in(folder)
        .map_err(ImageError::io(path))?;
    let mut buffered = BufWriter::new(temporary.as_file());
    write(&mut buffered)?;
    buffered.flush().map_err(ImageError::io(path))?;
    drop(buffered);
    temporary
        .persist(path)
        .map_err(|error| ImageError::io(path)(error.error))?;
    Ok(())
}
