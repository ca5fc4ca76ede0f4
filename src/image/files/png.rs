//! PNG: reading 8 and 16 bits a channel, and writing 8-bit RGB. Alpha stays unassociated, as the format has it.

use super::protocol::{Channel, Header, Part, PlaneRequest, SampleType, Window};
use super::save::atomically;
use super::{ImageError, Limits, Plane};
use crate::image::Image;
use ::image::codecs::png::PngDecoder;
use ::image::{ColorType, ImageDecoder, ImageError as PngError};
use ::png::EncodingError;
use std::fs::File;
use std::io::{BufReader, Write};
use std::path::Path;

/// Writes 8-bit RGB, compressed for speed: a 1080p heat map takes 14 ms, against 627 ms for a smaller file. `texts` are
/// keywords and what they say of the image.
pub fn write_png(path: &Path, image: &Image<[u8; 3]>, texts: &[(&str, String)]) -> Result<(), ImageError> {
    atomically(path, |file| {
        encode_to(file, image, texts).map_err(|error| match error {
            EncodingError::IoError(error) => ImageError::io(path)(error),
            error => ImageError::unsupported(path, error.to_string()),
        })
    })
}

/// The bytes of a PNG file, for sending; see [`write_png`].
pub fn encode_png(image: &Image<[u8; 3]>, texts: &[(&str, String)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_to(&mut bytes, image, texts).expect("memory can be written, and an image has as many pixels as it says");
    bytes
}

fn encode_to(writer: impl Write, image: &Image<[u8; 3]>, texts: &[(&str, String)]) -> Result<(), EncodingError> {
    let mut encoder = ::png::Encoder::new(writer, image.extent().width, image.extent().height);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_compression(::png::Compression::Fast);
    for (keyword, text) in texts {
        encoder.add_text_chunk((*keyword).to_owned(), text.clone())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.pixels().as_flattened())?;
    writer.finish()
}

/// The one part, with the channel names that OpenImageIO gives.
pub(super) fn describe(path: &Path, file: &File) -> Result<Header, ImageError> {
    header(path, &PngDecoder::new(BufReader::new(file)).map_err(failed(path))?)
}

/// The wanted channels. `described` must have passed the limits.
pub(super) fn read(
    path: &Path,
    file: &File,
    limits: &Limits,
    described: &Header,
    wanted: &[PlaneRequest],
) -> Result<Vec<Plane>, ImageError> {
    let mut decoder_limits = ::image::Limits::no_limits();
    decoder_limits.max_alloc = Some(limits.max_bytes);
    let decoder = PngDecoder::with_limits(BufReader::new(file), decoder_limits).map_err(failed(path))?;
    if header(path, &decoder)? != *described {
        return Err(ImageError::damaged(path, "it changed while it was read"));
    }
    let (names, sample) = layout(path, decoder.color_type())?;
    let n_bytes = usize::try_from(decoder.total_bytes()).map_err(|error| ImageError::damaged(path, error))?;
    let mut bytes = vec![0; n_bytes];
    decoder.read_image(&mut bytes).map_err(failed(path))?;
    let plane = |wanted: &PlaneRequest| match sample {
        SampleType::U8 => {
            let samples = bytes.iter().skip(wanted.channel).step_by(names.len());
            Plane::F32(samples.map(|&value| f32::from(value) / 255.0).collect())
        }
        _ => {
            let samples = bytes.as_chunks().0.iter().skip(wanted.channel).step_by(names.len());
            Plane::F32(
                samples
                    .map(|&value| f32::from(u16::from_ne_bytes(value)) / 65_535.0)
                    .collect(),
            )
        }
    };
    Ok(wanted.iter().map(plane).collect())
}

fn header(path: &Path, decoder: &impl ImageDecoder) -> Result<Header, ImageError> {
    let (width, height) = decoder.dimensions();
    let window = Window {
        x: 0,
        y: 0,
        width,
        height,
    };
    let (names, sample) = layout(path, decoder.color_type())?;
    let channels = names
        .iter()
        .map(|&name| Channel {
            name: name.to_owned(),
            sample,
        })
        .collect();
    Ok(Header {
        parts: vec![Part {
            name: String::new(),
            data: window,
            display: window,
            channels,
        }],
    })
}

fn layout(path: &Path, color: ColorType) -> Result<(&'static [&'static str], SampleType), ImageError> {
    Ok(match color {
        ColorType::L8 => (&["Y"], SampleType::U8),
        ColorType::La8 => (&["Y", "A"], SampleType::U8),
        ColorType::Rgb8 => (&["R", "G", "B"], SampleType::U8),
        ColorType::Rgba8 => (&["R", "G", "B", "A"], SampleType::U8),
        ColorType::L16 => (&["Y"], SampleType::U16),
        ColorType::La16 => (&["Y", "A"], SampleType::U16),
        ColorType::Rgb16 => (&["R", "G", "B"], SampleType::U16),
        ColorType::Rgba16 => (&["R", "G", "B", "A"], SampleType::U16),
        other => {
            return Err(ImageError::unsupported(path, format!("PNG colour type {other:?}")));
        }
    })
}

fn failed(path: &Path) -> impl FnOnce(PngError) -> ImageError + '_ {
    move |error| match error {
        PngError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => ImageError::io(path)(source),
        PngError::Unsupported(what) => ImageError::unsupported(path, what.to_string()),
        error => ImageError::damaged(path, error),
    }
}
