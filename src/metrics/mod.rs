//! Image and sequence metrics, defined exactly in `docs/metrics.md`. Knows images and display transforms; names no
//! wgpu except in `metrics::gpu`, no SQL, no HTTP.
//!
//! `R` is the reference, `T` the test image. [`Metric`] is the closed list; [`Metric::info`] says what each number
//! means; a [`Reference`] scores any number of [`Picture`]s in f64; a [`Track`] those of a sequence; [`Summary`]
//! condenses it.
//!
//! Several metrics share one measured `Quantity` (a squared error gives `mse`, `psnr` and `snr` at once), so a frame
//! is measured once a quantity, whoever measures: `rows` pixel by pixel while an image is converted, other files what
//! needs neighbours, `gpu` on the device. All give sums by class of pixel (`mask`), from which `Metric::definition` makes
//! values. A new metric is a `Definition` in its own file and its line in [`Metric::ALL`].

pub mod display;
mod flip;
pub mod gpu;
pub mod map;
mod mask;
mod metric;
mod ms_ssim;
mod offset;
mod picture;
mod plane;
mod quantity;
mod reference;
mod relative_error;
mod rows;
mod same;
mod shown;
mod squared_error;
pub mod srgb;
mod ssim;
mod summary;
mod temporal;
mod value;
mod vector;

pub use display::{Display, Tonemap};
pub use mask::Mask;
pub use metric::{Better, Listing, Metric, MetricError, MetricInfo};
pub use offset::offset_px;
pub use picture::Picture;
pub use reference::{FrameScores, Reference};
pub use summary::Summary;
pub use temporal::{LateValue, Track};
pub use value::{Value, Values};
