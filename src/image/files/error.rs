//! Why an image file could not be read or written. Every message names the file.

use super::protocol::Window;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::Duration;

/// Why an image file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The first bytes are those of no format that is read.
    #[error("{}: not an image that is read here (OpenEXR, PNG, TIFF, DPX, Radiance HDR, JPEG, BMP)", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The contents are damaged, or the file was cut short.
    #[error("{}: damaged or incomplete: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// The contents are legal but this reader does not know them.
    #[error("{}: {what} cannot be read", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature.
        what: String,
    },
    /// A header claims more than [`Limits`](super::Limits) allow.
    #[error("{}: {what}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The claim and the limit.
        what: String,
    },
    /// A channel was asked for that the file has not.
    #[error("{}: no channel `{wanted}`; there is {available}", path.display())]
    NoChannel {
        /// The file.
        path: PathBuf,
        /// The name asked for.
        wanted: String,
        /// The names there are, nearest first.
        available: String,
    },
    /// No channels that are evidently red, green and blue.
    #[error("{}: cannot tell which channels are red, green and blue; there is {available}", path.display())]
    NoRgb {
        /// The file.
        path: PathBuf,
        /// The names there are.
        available: String,
    },
    /// Channels that were asked for together lie in differently framed parts.
    #[error(
        "{}: `{channel}` has the display window {}×{} at ({}, {}), but `{first}` has {}×{} at ({}, {})",
        path.display(), window.width, window.height, window.x, window.y,
        first_window.width, first_window.height, first_window.x, first_window.y
    )]
    Windows {
        /// The file.
        path: PathBuf,
        /// The channel that disagrees.
        channel: String,
        /// Its display window.
        window: Window,
        /// The first channel asked for.
        first: String,
        /// That one's display window.
        first_window: Window,
    },
    /// The format needs the decode worker and there is none.
    #[error(
        "{}: needs the decode worker, which is not installed: install the package libopenimageio-dev, run \
         `cargo build -p oiio-decoder`, and keep afterimage-oiio-decoder beside this program or name it in \
         AFTERIMAGE_DECODER",
        path.display()
    )]
    DecoderMissing {
        /// The file.
        path: PathBuf,
    },
    /// The decode worker ended while it had this file; the next read starts another.
    #[error("{}: the decode worker crashed ({status}): the file is damaged, or needs more memory than it may use", path.display())]
    DecoderCrashed {
        /// The file.
        path: PathBuf,
        /// Its exit status or the signal.
        status: ExitStatus,
    },
    /// The decode worker took too long and was ended; the next read starts another.
    #[error("{}: not decoded within {} s", path.display(), timeout.as_secs_f32())]
    DecoderTimeout {
        /// The file.
        path: PathBuf,
        /// The time it had.
        timeout: Duration,
    },
    /// The decode worker answered what nobody asked: it is of another version.
    #[error("{}: the decode worker {} is of another version: {reason}", path.display(), program.display())]
    DecoderVersion {
        /// The file.
        path: PathBuf,
        /// The worker's executable.
        program: PathBuf,
        /// What was wrong with its answer.
        reason: String,
    },
}

impl ImageError {
    /// For `map_err` on input and output with `path`.
    pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    /// The decoder says that the contents are wrong.
    pub(super) fn damaged(path: &Path, reason: impl ToString) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// The contents are legal but not read.
    pub(super) fn unsupported(path: &Path, what: impl Into<String>) -> Self {
        Self::Unsupported {
            path: path.to_owned(),
            what: what.into(),
        }
    }
}
