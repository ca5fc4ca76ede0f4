//! The GPU as the rest of the crate sees it: an adapter ([`Gpu`]), compute passes and raster pipelines that bind by WGSL name ([`Pass`],
//! [`Raster`]), textures, read-back and timestamps. Knows nothing of frames, recipes or metrics.

mod adapter;
mod pass;
mod raster;
mod readback;
mod reflection;
mod texture;
mod timer;
mod workgroup;

pub use adapter::{Gpu, NO_DRIVER, adapters};
pub use pass::{Bound, Dispatch, Invocation, Kept, Pass, Variant};
pub use raster::{DepthTest, Raster, RasterBound, RasterSpec};
pub use readback::{Floats, Readback, ReadbackPool};
pub use reflection::{Access, UniformValue};
pub use texture::{Layer, Texture};
pub use timer::{Timer, Times};
pub use workgroup::Workgroup;

/// What can go wrong on the GPU.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No driver, or none that was asked for.
    #[error("{0}")]
    NoAdapter(String),
    /// The adapter cannot do what is needed.
    #[error("adapter `{adapter}`: {message}")]
    Unsupported {
        /// Adapter's name.
        adapter: String,
        /// What it lacks.
        message: String,
    },
    /// A shader does not compile, or a binding does not match it: a mistake in this crate.
    #[error("pass `{pass}`: {message}")]
    Pass {
        /// Label of the pass.
        pass: String,
        /// What is wrong with it.
        message: String,
    },
    /// The device failed while working.
    #[error("while {activity}: {message}")]
    Device {
        /// What was being done.
        activity: String,
        /// What wgpu said.
        message: String,
    },
}
