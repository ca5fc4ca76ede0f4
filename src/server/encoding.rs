//! How an image leaves the service: as a PNG to look at, as an EXR to work with, or as bare halves for the page that looks
//! at single pixels, which a browser can hand to its GPU as they are.

use super::{ApiError, Service};
use crate::{
    image::{
        Extent, Image,
        files::{
            exr::{FloatFormat, write_map_exr, write_rgb_exr},
            png::encode_png,
        },
    },
    metrics::{
        Display,
        map::{Map, NAN_COLOR, Scale, false_color},
    },
    sequence::frame::Rgb,
};
use axum::{
    http::{HeaderName, HeaderValue, header},
    response::{IntoResponse as _, Response},
};
use half::{f16, slice::HalfFloatSliceExt as _};
use image::imageops;
use rayon::prelude::*;
use std::{fmt, fs, path::Path};

/// Tells a viewer of a false-colour image what white stands for.
const MAX_ERROR_HEADER: HeaderName = HeaderName::from_static("x-afterimage-error-max");
/// Width, height and channels of bare halves, such as `1920x1080x3`.
const SIZE_HEADER: HeaderName = HeaderName::from_static("x-afterimage-size");
/// The values of a map that are drawn black and white, such as `1,0`.
const SCALE_HEADER: HeaderName = HeaderName::from_static("x-afterimage-scale");

/// Reports and contents never change, so neither do their images.
const FOR_EVER: &str = "private, max-age=31536000, immutable";

/// The media type of bare halves. An image, so that nothing tries to compress it.
pub const HALVES: &str = "image/x-afterimage-f16";

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Png,
    Exr,
    /// Rows from the top, channels side by side, little endian.
    Halves,
}

impl Encoding {
    pub fn of_extension(extension: &str) -> Option<Self> {
        match extension {
            "png" => Some(Self::Png),
            "exr" => Some(Self::Exr),
            "f16" => Some(Self::Halves),
            _ => None,
        }
    }

    fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Exr => "image/x-exr",
            Self::Halves => HALVES,
        }
    }
}

/// Encodes as one request wants it.
pub struct Encoder<'a> {
    pub service: &'a Service,
    pub encoding: Encoding,
    /// The most that a PNG may be wide.
    pub width: Option<u32>,
}

impl Encoder<'_> {
    pub fn rgb(&self, image: &Image<Rgb>, display: Display) -> Result<Response, ApiError> {
        let bytes = match self.encoding {
            Encoding::Png => self.png(&image.map(|pixel| shown(display, pixel)), &[]),
            Encoding::Exr => self.exr_bytes(|path| write_rgb_exr(path, image, FloatFormat::Float))?,
            Encoding::Halves => {
                let bytes = halves(image.pixels().as_flattened());
                return Ok(respond_halves(bytes, image.extent(), 3, None));
            }
        };
        Ok(respond(bytes, self.encoding))
    }

    /// The absolute error in display values.
    pub fn error(&self, error: &Image<f32>, scale: Scale) -> Result<Response, ApiError> {
        let mut response = match self.encoding {
            Encoding::Png => respond(self.png(&false_color(error, scale.white), &[]), self.encoding),
            Encoding::Exr => respond(
                self.exr_bytes(|path| write_map_exr(path, error, FloatFormat::Float))?,
                self.encoding,
            ),
            Encoding::Halves => map_halves(error, scale),
        };
        if let Ok(value) = HeaderValue::from_str(&scale.white.to_string()) {
            response.headers_mut().insert(MAX_ERROR_HEADER, value);
        }
        Ok(response)
    }

    /// A metric's samples.
    pub fn map(&self, map: &Map, max: Option<f32>) -> Result<Response, ApiError> {
        let default = map.scale();
        let scale = Scale {
            white: max.unwrap_or(default.white),
            ..default
        };
        Ok(match self.encoding {
            Encoding::Exr => respond(
                self.exr_bytes(|path| write_map_exr(path, &map.values, FloatFormat::Float))?,
                self.encoding,
            ),
            Encoding::Png if self.width.is_none() => respond(map.encode_png(scale), self.encoding),
            Encoding::Png => {
                let Scale { black, white } = scale;
                let picture = false_color(&map.values.map(|value| (value - black) / (white - black)), 1.0);
                respond(self.png(&picture, &[]), self.encoding)
            }
            Encoding::Halves => map_halves(&map.values, scale),
        })
    }

    fn png(&self, image: &Image<[u8; 3]>, texts: &[(&'static str, String)]) -> Vec<u8> {
        match self.width.filter(|width| *width < image.extent().width) {
            Some(width) => encode_png(&shrunk(image, width), texts),
            None => encode_png(image, texts),
        }
    }

    /// The writer seeks in its file, so the bytes go by way of one.
    fn exr_bytes<E: fmt::Display>(&self, write: impl FnOnce(&Path) -> Result<(), E>) -> Result<Vec<u8>, ApiError> {
        let folder = tempfile::tempdir_in(self.service.folder.spool()).map_err(ApiError::internal)?;
        let path = folder.path().join("image.exr");
        write(&path).map_err(ApiError::internal)?;
        fs::read(&path).map_err(ApiError::internal)
    }
}

/// The pixel on a screen; one that is not finite is drawn in a colour that no scene has by chance.
fn shown(display: Display, pixel: Rgb) -> [u8; 3] {
    let values = display.apply(pixel);
    if values.iter().any(|value| value.is_nan()) {
        return NAN_COLOR;
    }
    values.map(|value| (value * 255.0).round() as u8)
}

/// The same picture, `width` pixels wide: small pictures are for recognising, so encoded values are averaged.
fn shrunk(image: &Image<[u8; 3]>, width: u32) -> Image<[u8; 3]> {
    let Extent { width: w, height: h } = image.extent();
    let height = (u64::from(h) * u64::from(width) / u64::from(w)).max(1) as u32;
    let bytes: Vec<u8> = image.pixels().iter().flatten().copied().collect();
    let whole = image::RgbImage::from_raw(w, h, bytes).expect("three bytes a pixel");
    let small = imageops::thumbnail(&whole, width, height);
    let pixels = small.pixels().map(|pixel| pixel.0).collect();
    Image::from_pixels(Extent::new(width, height), pixels)
}

/// The nearest halves, as bytes. A value that is finite stays so: beyond the largest half it is the largest.
fn halves(values: &[f32]) -> Vec<u8> {
    const SHARE: usize = 1 << 14;
    let max = f16::MAX.to_f32();
    let mut bytes = vec![0; 2 * values.len()];
    let shares = bytes.par_chunks_mut(2 * SHARE).zip(values.par_chunks(SHARE));
    shares.for_each(|(bytes, values)| {
        let clamped = |&value: &f32| match value.is_finite() {
            true => value.clamp(-max, max),
            false => value,
        };
        let clamped: Vec<f32> = values.iter().map(clamped).collect();
        let mut rounded = vec![f16::ZERO; clamped.len()];
        rounded.convert_from_f32_slice(&clamped);
        for (bytes, half) in bytes.as_chunks_mut().0.iter_mut().zip(rounded) {
            *bytes = half.to_le_bytes();
        }
    });
    bytes
}

fn map_halves(values: &Image<f32>, scale: Scale) -> Response {
    respond_halves(halves(values.pixels()), values.extent(), 1, Some(scale))
}

fn respond_halves(bytes: Vec<u8>, extent: Extent, n_channels: u32, scale: Option<Scale>) -> Response {
    let mut response = respond(bytes, Encoding::Halves);
    let headers = [
        (
            SIZE_HEADER,
            Some(format!("{}x{}x{n_channels}", extent.width, extent.height)),
        ),
        (
            SCALE_HEADER,
            scale.map(|scale| format!("{},{}", scale.black, scale.white)),
        ),
    ];
    for (name, text) in headers {
        if let Some(Ok(value)) = text.map(|text| HeaderValue::from_str(&text)) {
            response.headers_mut().insert(name, value);
        }
    }
    response
}

/// Bytes as an image that may be kept for ever.
pub fn respond(bytes: Vec<u8>, encoding: Encoding) -> Response {
    let headers = [
        (header::CONTENT_TYPE, encoding.media_type()),
        (header::CACHE_CONTROL, FOR_EVER),
    ];
    (headers, bytes).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_keep_what_is_finite_finite() {
        let back = |value: f32| {
            let bytes = halves(&[value]);
            f16::from_le_bytes([bytes[0], bytes[1]]).to_f32()
        };
        assert_eq!([0.5, -2.0, 1e6, -1e6].map(back), [0.5, -2.0, 65504.0, -65504.0]);
        assert!(back(f32::NAN).is_nan() && back(f32::INFINITY) == f32::INFINITY);
    }

    #[test]
    fn halves_stay_in_order_where_threads_share_them() {
        let values: Vec<f32> = (0..50_000).map(|i| i as f32 * 0.37 - 9000.0).collect();
        let one_by_one: Vec<u8> = values
            .iter()
            .flat_map(|&value| f16::from_f32(value).to_le_bytes())
            .collect();
        assert!(halves(&values) == one_by_one);
    }

    #[test]
    fn small_pictures_keep_their_shape_and_mean() {
        let image = Image::from_fn(Extent::new(64, 48), |x, _| [if x % 2 == 0 { 200 } else { 100 }; 3]);
        let small = shrunk(&image, 16);
        assert_eq!(small.extent(), Extent::new(16, 12));
        assert!(small.pixels().iter().all(|pixel| pixel[0].abs_diff(150) <= 1));
    }
}
