//! What the library and its decode worker say to each other: one JSON [`Request`] a line on the worker's standard
//! input, one JSON [`Reply`] a line on its standard output. Pixels travel through a shared file instead, because a
//! 1080p frame is 25 MB a request. Both sides compile this file, so it names nothing but serde.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The worker's only argument, as JSON.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Settings {
    /// The shared file; the worker opens it before its first reply, and the library then unlinks it.
    pub pixels: PathBuf,
    /// Address space the worker may use, bytes.
    pub memory_bytes: u64,
    /// Largest image that OpenImageIO may open, MiB.
    pub image_mib: u32,
}

/// What the worker is asked to do. Paths are absolute.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Request {
    /// Answered by [`Reply::Header`].
    Describe {
        /// The file.
        path: PathBuf,
        /// What its first bytes say it is.
        format: Format,
    },
    /// Writes the planes one after the other into the shared file. Answered by [`Reply::Pixels`].
    Read {
        /// The file.
        path: PathBuf,
        /// What its first bytes say it is.
        format: Format,
        /// The planes, in the order in which they are wanted.
        planes: Vec<PlaneRequest>,
    },
}

/// One channel of one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlaneRequest {
    /// Index into [`Header::parts`].
    pub part: usize,
    /// Index into [`Part::channels`].
    pub channel: usize,
    /// Pixels of the part's data window, as described before: a file that changed since is refused.
    pub n_pixels: usize,
    /// The channel holds 32-bit integers and is wanted as such; otherwise 32-bit floats are.
    pub integer: bool,
}

/// What the worker answers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Reply {
    /// Sent once, when the worker has started.
    Ready,
    /// The file's contents.
    Header(Header),
    /// The planes lie in the shared file: four bytes a sample, native byte order.
    Pixels,
    /// The file cannot be read, and why.
    Error(String),
}

/// File formats that are read: the well-known ones. OpenImageIO has many more readers, several of them with memory
/// errors on record, and none of those is ever tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Format {
    /// OpenEXR.
    Exr,
    /// PNG.
    Png,
    /// TIFF.
    Tiff,
    /// DPX.
    Dpx,
    /// Radiance HDR (RGBE).
    Hdr,
    /// JPEG.
    Jpeg,
    /// Windows bitmap.
    Bmp,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// The parts (OpenEXR) or pages (TIFF), in the file's order; at least one.
    pub parts: Vec<Part>,
}

/// A part of a file: channels over one data window.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Part {
    /// Name; empty where the file gives none.
    pub name: String,
    /// Where there are pixels.
    pub data: Window,
    /// The picture's frame.
    pub display: Window,
    /// The channels, in the reader's order.
    pub channels: Vec<Channel>,
}

/// A channel of a part.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// Name as the file has it.
    pub name: String,
    /// Type of the stored samples.
    pub sample: SampleType,
}

/// Type of stored samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SampleType {
    /// Unsigned integers of up to 8 bits, read as 0 to 1.
    U8,
    /// Unsigned integers of up to 16 bits, read as 0 to 1.
    U16,
    /// 32-bit unsigned integers, read as they are.
    U32,
    /// 16-bit floats.
    F16,
    /// 32-bit floats, or wider ones read as such.
    F32,
}

/// A rectangle of pixels on the plane that a file's windows share; y down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Window {
    /// Leftmost column.
    pub x: i32,
    /// Topmost row.
    pub y: i32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}
