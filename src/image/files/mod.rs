//! Reading and writing image files.
//!
//! [`FileReader`] gives one plane a channel, on the canvas of the file's display window. OpenEXR and PNG are decoded
//! here ([`exr`], [`png`]); everything else, and the OpenEXR that is refused here, goes to the decode worker, a
//! separate process around OpenImageIO: linking that costs every start 200 ms and 131 MB, and a crash in one of its
//! decoders must not take the service down. Both give the same pixels.
//!
//! Files come from strangers. What a header claims is compared with [`Limits`] before anything is allocated for it.

mod decoder;
mod error;
pub mod exr;
mod header;
pub mod png;
mod protocol;
mod save;

pub use error::ImageError;
pub use protocol::{Channel, Format, Header, Part, SampleType, Window};

use crate::image::{Extent, Image};
use decoder::Decoder;
use protocol::PlaneRequest;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Who decodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// OpenEXR and PNG here; the decode worker for other formats and for OpenEXR that is refused here (DWA
    /// compression, subsampled channels).
    #[default]
    Auto,
    /// Only what is decoded here.
    Native,
    /// Always the decode worker.
    OpenImageIo,
}

/// What a file may ask for before it is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Longest side of any window, pixels.
    pub max_side: u32,
    /// Channels of all parts together.
    pub max_channels: usize,
    /// Stored samples of all parts together, uncompressed, bytes; once for the data and once for the display windows.
    pub max_bytes: u64,
    /// Uncompressed bytes a byte of the file. Deflate, the densest compression in use, reaches 1032.
    pub max_expansion: u64,
    /// How long the decode worker may take over one file.
    pub decode_timeout: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_side: 16_384,
            max_channels: 64,
            max_bytes: 256 << 20,
            max_expansion: 1200,
            decode_timeout: Duration::from_secs(30),
        }
    }
}

/// Samples of one channel, row by row.
#[derive(Clone, Debug, PartialEq)]
pub enum Plane {
    /// Floats; integers of up to 16 bits come as 0 to 1, the nearest float to `value / (2^bits - 1)`.
    F32(Vec<f32>),
    /// 32-bit integers as they are: object ids must never pass through a float.
    U32(Vec<u32>),
}

/// The planes that were asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Size of the display window.
    pub extent: Extent,
    /// One a channel, in the order asked.
    pub planes: Vec<Plane>,
    /// How each plane's samples are stored.
    pub samples: Vec<SampleType>,
}

/// Red, green and blue of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbFile {
    /// The pixels, untouched by any transfer function.
    pub image: Image<[f32; 3]>,
    /// How the red samples are stored: 8- and 16-bit integers are recovered exactly from their floats.
    pub sample: SampleType,
}

/// Reads image files. Clones share one decode worker, which is started when first needed; one file is decoded there at
/// a time.
#[derive(Clone, Debug)]
pub struct FileReader {
    backend: Backend,
    limits: Limits,
    decoder: Arc<Decoder>,
}

/// A file that was opened and sniffed.
struct Source<'a> {
    path: &'a Path,
    file: File,
    n_bytes: u64,
    format: Format,
}

impl FileReader {
    /// A reader that finds its decode worker by `AFTERIMAGE_DECODER` or beside the running program.
    pub fn new(backend: Backend, limits: Limits) -> Self {
        Self::with_decoder(backend, limits, decoder::find_program())
    }

    /// A reader with the decode worker `program`; none means that what needs one is an error.
    pub fn with_decoder(backend: Backend, limits: Limits, program: Option<PathBuf>) -> Self {
        Self {
            backend,
            limits,
            decoder: Arc::new(Decoder::new(program, &limits)),
        }
    }

    /// Process id of the decode worker, where one is running.
    pub fn decoder_id(&self) -> Option<u32> {
        self.decoder.process_id()
    }

    /// One plane a requested channel, in the order asked, on the canvas of the display window. A channel is named as in
    /// the file, or `part.channel`.
    pub fn read(&self, path: &Path, channels: &[String]) -> Result<Planes, ImageError> {
        let mut source = Source::open(path)?;
        self.dispatch(&mut source, |source, by| {
            let header = self.header(source, by)?;
            self.planes(source, by, &header, &locate_all(path, &header, channels)?)
        })
    }

    /// Parts, channels, types and windows, without decoding any pixel.
    pub fn describe(&self, path: &Path) -> Result<Header, ImageError> {
        self.dispatch(&mut Source::open(path)?, |source, by| self.header(source, by))
    }

    /// The size that [`Self::read`] would give the same channels, without decoding any pixel.
    pub fn extent(&self, path: &Path, channels: &[String]) -> Result<Extent, ImageError> {
        self.dispatch(&mut Source::open(path)?, |source, by| {
            let header = self.header(source, by)?;
            let wanted = locate_all(path, &header, channels)?;
            Ok(common_display_window(path, &header, &wanted)?.extent())
        })
    }

    /// Red, green and blue of a file whose channels nobody declared: `R`, `G`, `B`, else the only layer's, else
    /// luminance for all three.
    pub fn read_rgb(&self, path: &Path) -> Result<RgbFile, ImageError> {
        let mut source = Source::open(path)?;
        self.dispatch(&mut source, |source, by| {
            let header = self.header(source, by)?;
            let wanted = header.locate_rgb(path)?;
            let planes = self.planes(source, by, &header, &wanted)?;
            let sample = header.parts[wanted[0].part].channels[wanted[0].channel].sample;
            interleave(path, planes, sample)
        })
    }

    /// Runs `read` with this reader's backend, and once more with the worker where that should know what was refused.
    fn dispatch<T>(
        &self,
        source: &mut Source<'_>,
        read: impl Fn(&mut Source<'_>, Backend) -> Result<T, ImageError>,
    ) -> Result<T, ImageError> {
        match (self.backend, source.format) {
            (Backend::Auto, Format::Exr | Format::Png) => match read(source, Backend::Native) {
                Err(ImageError::Unsupported { .. }) => read(source, Backend::OpenImageIo),
                done => done,
            },
            (Backend::Auto, _) => read(source, Backend::OpenImageIo),
            (backend, _) => read(source, backend),
        }
    }

    fn header(&self, source: &mut Source<'_>, by: Backend) -> Result<Header, ImageError> {
        source.file.rewind().map_err(ImageError::io(source.path))?;
        let header = match (by, source.format) {
            (Backend::OpenImageIo, format) => self.decoder.describe(source.path, format)?,
            (_, Format::Exr) => exr::describe(source.path, &source.file)?,
            (_, Format::Png) => png::describe(source.path, &source.file)?,
            (_, format) => {
                return Err(ImageError::unsupported(
                    source.path,
                    format!("{format:?} without the worker"),
                ));
            }
        };
        header.check(source.path, source.n_bytes, &self.limits)?;
        Ok(header)
    }

    /// Decodes `wanted` from a file whose `header` has passed the limits.
    fn planes(
        &self,
        source: &mut Source<'_>,
        by: Backend,
        header: &Header,
        wanted: &[PlaneRequest],
    ) -> Result<Planes, ImageError> {
        let display = common_display_window(source.path, header, wanted)?;
        source.file.rewind().map_err(ImageError::io(source.path))?;
        let planes = match (by, source.format) {
            (Backend::OpenImageIo, format) => self.decoder.read(source.path, format, wanted)?,
            (_, Format::Exr) => exr::read(source.path, &source.file, &self.limits, header, wanted)?,
            (_, _) => png::read(source.path, &source.file, &self.limits, header, wanted)?,
        };
        let placed = planes.into_iter().zip(wanted);
        Ok(Planes {
            extent: display.extent(),
            planes: placed
                .map(|(plane, at)| header::place(plane, header.parts[at.part].data, display))
                .collect(),
            samples: wanted
                .iter()
                .map(|at| header.parts[at.part].channels[at.channel].sample)
                .collect(),
        })
    }
}

impl<'a> Source<'a> {
    fn open(path: &'a Path) -> Result<Self, ImageError> {
        let mut file = File::open(path).map_err(ImageError::io(path))?;
        let n_bytes = file.metadata().map_err(ImageError::io(path))?.len();
        let mut start = Vec::new();
        file.by_ref()
            .take(16)
            .read_to_end(&mut start)
            .map_err(ImageError::io(path))?;
        let format = Format::sniff(&start).ok_or_else(|| ImageError::UnknownFormat { path: path.to_owned() })?;
        Ok(Self {
            path,
            file,
            n_bytes,
            format,
        })
    }
}

fn locate_all(path: &Path, header: &Header, channels: &[String]) -> Result<Vec<PlaneRequest>, ImageError> {
    channels.iter().map(|name| header.locate(path, name)).collect()
}

fn common_display_window(path: &Path, header: &Header, wanted: &[PlaneRequest]) -> Result<Window, ImageError> {
    let name = |plane: &PlaneRequest| header.parts[plane.part].channels[plane.channel].name.clone();
    let window = |plane: &PlaneRequest| header.parts[plane.part].display;
    let Some(first) = wanted.first() else {
        return Ok(header.parts[0].display);
    };
    match wanted.iter().find(|plane| window(plane) != window(first)) {
        None => Ok(window(first)),
        Some(other) => Err(ImageError::Windows {
            path: path.to_owned(),
            channel: name(other),
            window: window(other),
            first: name(first),
            first_window: window(first),
        }),
    }
}

fn interleave(path: &Path, planes: Planes, sample: SampleType) -> Result<RgbFile, ImageError> {
    let [Plane::F32(r), Plane::F32(g), Plane::F32(b)] = &planes.planes[..] else {
        return Err(ImageError::unsupported(path, "colour in 32-bit integers"));
    };
    let pixels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect();
    Ok(RgbFile {
        image: Image::from_pixels(planes.extent, pixels),
        sample,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_are_framed_differently_cannot_be_read_together() {
        let part = |name: &str, width| Part {
            name: name.to_owned(),
            data: Window {
                x: 0,
                y: 0,
                width: 2,
                height: 2,
            },
            display: Window {
                x: 0,
                y: 0,
                width,
                height: 2,
            },
            channels: vec![Channel {
                name: name.to_owned(),
                sample: SampleType::F16,
            }],
        };
        let header = Header {
            parts: vec![part("color", 2), part("depth", 3), part("motion", 2)],
        };
        let path = Path::new("a.exr");
        let wanted = ["color", "motion", "depth"].map(|name| header.locate(path, name).expect("is there"));
        let window = common_display_window(path, &header, &wanted[..2]).expect("the same");
        assert_eq!(window.extent(), Extent::new(2, 2));
        let error = common_display_window(path, &header, &wanted)
            .expect_err("they differ")
            .to_string();
        assert!(error.contains("a.exr: `depth` has the display window 3×2"), "{error}");
    }
}
