//! Scenes that hurt, and baking them: a raster pipeline of our own renders every image that a sequence holds, exactly as
//! its manifest says, and a reference of many samples a pixel.
//!
//! ```text
//! BakeSettings ─▶ builtin or gltf (Scene: meshes, materials, objects, camera, light by time)
//!              ─▶ Baker::frame (Renderer draws views; Accumulator sums them; Disocclusion) ─▶ BakedFrame
//!              ─▶ bake (a folder, renamed into place when whole) ─▶ Cache
//! ```
//! The rasteriser has no twin on the CPU; its depth and motion are compared with what the matrices say, in f64.

mod baker;
pub mod builtin;
mod cache;
mod disocclusion;
mod folder;
pub mod gltf;
pub mod mesh;
pub mod model;
mod moment;
mod pattern;
mod pipelines;
mod reference;
mod renderer;
mod settings;
pub mod texture;

pub use baker::{BakeTimes, BakedFrame, Baker};
pub use builtin::{BuiltIn, SCENES};
pub use cache::{Cache, Cached, copy_sequence};
pub use folder::{BakeObserver, BakeSummary, bake};
pub use moment::Clip;
pub use pattern::Pattern;
pub use settings::BakeSettings;

use crate::{gpu::GpuError, image::files::ImageError};
use std::{io, path::PathBuf};

/// Why a sequence was not baked. Nothing is left behind then.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// No such scene.
    #[error("there is no scene `{wanted}`; did you mean `{nearest}`? `afterimage bake --list` shows all")]
    UnknownScene {
        /// What was asked for.
        wanted: String,
        /// The scene whose id is most like it.
        nearest: &'static str,
    },
    /// A setting is out of range.
    #[error("--{field} {problem}")]
    Setting {
        /// As the command line calls it.
        field: &'static str,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// Something is there already.
    #[error("{}: the folder is not empty; name another or empty it", .0.display())]
    NotEmpty(PathBuf),
    /// Observed to be cancelled.
    #[error("cancelled")]
    Cancelled,
    /// The device's fault.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// An image could not be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file or folder could not be written.
    #[error("{}: {error}", path.display())]
    Io {
        /// Which one.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
}

impl BakeError {
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |error| Self::Io { path, error }
    }
}
