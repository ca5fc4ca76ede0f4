//! Image and sequence metrics, defined exactly in `docs/metrics.md`. Knows images and display transforms; names no
//! wgpu except in `metrics::gpu`, no SQL, no HTTP.
//!
//! `R` is the reference, `T` the test image. [`Metric`] is the closed list; [`Metric::info`] says what each number
//! means; a [`Reference`] scores any number of test images in f64; [`Summary`] condenses a sequence.
//!
//! Several metrics share one measured `Quantity` (a squared error gives `mse`, `psnr` and `snr` at once), so a frame
//! is measured once a quantity, whoever measures: `squared_error` and `ssim` on the CPU, `gpu` on the device. A new
//! metric is a `Definition` in its own file, a variant, and its line in `Metric::definition`.

use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    ops::Range,
    str::FromStr,
    sync::Arc,
};
use temporal::{Change, Step};

pub mod display;
mod flip;
pub mod gpu;
pub mod map;
mod ms_ssim;
mod relative_error;
mod shown;
mod squared_error;
pub mod srgb;
mod ssim;
mod summary;
mod temporal;
mod value;

pub use display::{Display, Tonemap};
pub use shown::Shown;
pub use summary::Summary;
pub use temporal::{LateValue, Track};
pub use value::{Value, Values};

/// Which way a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Better {
    /// Larger is better.
    Higher,
    /// Smaller is better.
    Lower,
}

/// What a metric's numbers mean. `version` rises whenever they change; only equal versions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MetricInfo {
    /// Stored id; never changes.
    pub id: &'static str,
    /// `dB`, or empty for a pure number.
    pub unit: &'static str,
    /// Which way it improves.
    pub better: Better,
    /// Raised when the numbers change.
    pub version: u32,
    /// One line for people.
    pub description: &'static str,
}

/// Every metric, by stored id in text and JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "&'static str")]
pub enum Metric {
    /// Mean squared error.
    Mse,
    /// Root of the mean squared error.
    Rmse,
    /// Peak signal-to-noise ratio of display values.
    Psnr,
    /// Peak signal-to-noise ratio of linear values.
    PsnrLinear,
    /// Peak signal-to-noise ratio of 8-bit values.
    PsnrU8,
    /// Peak signal-to-noise ratio of luma.
    PsnrY,
    /// Signal-to-noise ratio.
    Snr,
    /// Structural similarity of display values.
    Ssim,
    /// Structural similarity of luma.
    SsimY,
    /// Structural similarity of 8-bit values.
    SsimU8,
    /// Structural similarity of luma over five scales.
    MsSsimY,
    /// LDR-FLIP, mean.
    Flip,
    /// LDR-FLIP, 95th percentile.
    FlipP95,
    /// HDR-FLIP, mean.
    HdrFlip,
    /// Relative mean squared error of linear values.
    RelMse,
    /// Symmetric mean absolute relative error of linear values.
    Smape,
    /// PSNR of changes from frame to frame.
    Tpsnr,
    /// PSNR of changes along the motion.
    WarpedTpsnr,
    /// Excess of change along the motion.
    WarpExcess,
    /// Change of the mean luma error.
    Flicker,
    /// Deviation over time of the luma error.
    FlickerLocal,
    /// Share of the previous frame left.
    Ghost,
    /// Share of a box blur.
    Blur,
    /// Frames until PSNR settles after a reset.
    ConvergeFrames,
}

/// How a metric is computed: what to measure on a frame, and its value from that.
struct Definition {
    info: MetricInfo,
    quantity: Quantity,
    value: fn(&Sums) -> f64,
    /// Mean squared error over peak squared, from the value; where a metric is a function of it, a sequence is pooled.
    relative_mse: Option<fn(f64) -> f64>,
}

impl Metric {
    /// Every metric, in the order shown to people.
    pub const ALL: [Self; 24] = [
        Self::Mse,
        Self::Rmse,
        Self::Psnr,
        Self::PsnrLinear,
        Self::PsnrU8,
        Self::PsnrY,
        Self::Snr,
        Self::Ssim,
        Self::SsimY,
        Self::SsimU8,
        Self::MsSsimY,
        Self::Flip,
        Self::FlipP95,
        Self::HdrFlip,
        Self::RelMse,
        Self::Smape,
        Self::Tpsnr,
        Self::WarpedTpsnr,
        Self::WarpExcess,
        Self::Flicker,
        Self::FlickerLocal,
        Self::Ghost,
        Self::Blur,
        Self::ConvergeFrames,
    ];

    const fn definition(self) -> &'static Definition {
        match self {
            Self::Mse => &squared_error::MSE,
            Self::Rmse => &squared_error::RMSE,
            Self::Psnr => &squared_error::PSNR,
            Self::PsnrLinear => &squared_error::PSNR_LINEAR,
            Self::PsnrU8 => &squared_error::PSNR_U8,
            Self::PsnrY => &squared_error::PSNR_Y,
            Self::Snr => &squared_error::SNR,
            Self::Ssim => &ssim::SSIM,
            Self::SsimY => &ssim::SSIM_Y,
            Self::SsimU8 => &ssim::SSIM_U8,
            Self::MsSsimY => &ms_ssim::MS_SSIM_Y,
            Self::Flip => &flip::FLIP,
            Self::FlipP95 => &flip::FLIP_P95,
            Self::HdrFlip => &flip::HDR_FLIP,
            Self::RelMse => &relative_error::REL_MSE,
            Self::Smape => &relative_error::SMAPE,
            Self::Tpsnr => &temporal::TPSNR,
            Self::WarpedTpsnr => &temporal::WARPED_TPSNR,
            Self::WarpExcess => &temporal::WARP_EXCESS,
            Self::Flicker => &temporal::FLICKER,
            Self::FlickerLocal => &temporal::FLICKER_LOCAL,
            Self::Ghost => &temporal::GHOST,
            Self::Blur => &temporal::BLUR,
            Self::ConvergeFrames => &temporal::CONVERGE_FRAMES,
        }
    }

    /// Id, unit, direction, version and description.
    pub const fn info(self) -> &'static MetricInfo {
        &self.definition().info
    }

    /// The stored id, such as `psnr.linear`.
    pub const fn id(self) -> &'static str {
        self.info().id
    }

    /// Whether it speaks of a sequence, and has no value for two images.
    pub const fn is_temporal(self) -> bool {
        matches!(
            self.definition().quantity,
            Quantity::Change(_) | Quantity::ErrorDeviation | Quantity::Convergence
        )
    }

    /// Whether it follows the reference along its motion.
    pub const fn needs_motion(self) -> bool {
        matches!(self, Self::WarpedTpsnr | Self::WarpExcess)
    }

    /// Whether its values are known only after more frames, [`Track::finish`]; warm-up frames hold some of them.
    pub const fn is_late(self) -> bool {
        matches!(self, Self::FlickerLocal | Self::ConvergeFrames)
    }

    /// Whether images of this size are large enough for the metric's window.
    pub fn check_size(self, extent: Extent) -> Result<(), MetricError> {
        let smallest = self.definition().quantity.smallest();
        if extent.width.min(extent.height) >= smallest {
            return Ok(());
        }
        Err(MetricError::TooSmall {
            metric: self.id(),
            smallest,
            extent,
        })
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.id())
    }
}

impl FromStr for Metric {
    type Err = MetricError;

    fn from_str(id: &str) -> Result<Self, MetricError> {
        let exact = Self::ALL.into_iter().find(|metric| metric.id() == id);
        exact.ok_or_else(|| MetricError::Unknown {
            id: id.to_owned(),
            nearest: nearest_id(id),
        })
    }
}

fn nearest_id(id: &str) -> &'static str {
    let ids = Metric::ALL.map(Metric::id).into_iter();
    ids.max_by(|a, b| strsim::jaro_winkler(a, id).total_cmp(&strsim::jaro_winkler(b, id)))
        .expect("the list of metrics is not empty")
}

impl TryFrom<String> for Metric {
    type Error = MetricError;

    fn try_from(id: String) -> Result<Self, MetricError> {
        id.parse()
    }
}

impl From<Metric> for &'static str {
    fn from(metric: Metric) -> Self {
        metric.id()
    }
}

/// Why a metric has no value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// No metric has this id.
    #[error("unknown metric `{id}`; did you mean `{nearest}`?")]
    Unknown {
        /// What was asked for.
        id: String,
        /// The known id that looks most like it.
        nearest: &'static str,
    },
    /// Metrics compare pixel with pixel.
    #[error("the test image is {test} pixels, its reference {reference}; metrics need equal sizes")]
    SizeMismatch {
        /// Size of the reference.
        reference: Extent,
        /// Size of the test image.
        test: Extent,
    },
    /// Two images alone have no value.
    #[error("`{metric}` needs a sequence of frames; leave the metric out")]
    NeedsSequence {
        /// The metric's id.
        metric: &'static str,
    },
    /// The image is smaller than the metric's window.
    #[error("`{metric}` needs at least {smallest}×{smallest} pixels, the image has {extent}; leave the metric out")]
    TooSmall {
        /// The metric's id.
        metric: &'static str,
        /// Fewest pixels in either axis.
        smallest: u32,
        /// Size of the images.
        extent: Extent,
    },
}

/// The values that a metric compares. [`Shown`] holds an image in those it needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Domain {
    /// Linear RGB before exposure and tone mapping.
    Linear,
    /// Display RGB, sRGB-encoded, in `[0, 1]`.
    Display,
    /// Rec. 709 luma of the display values.
    Luma,
    /// Display RGB rounded to whole numbers in `[0, 255]`.
    U8,
}

impl Domain {
    const fn peak(self) -> f64 {
        match self {
            Self::U8 => 255.0,
            Self::Linear | Self::Display | Self::Luma => 1.0,
        }
    }

    const fn n_channels(self) -> usize {
        match self {
            Self::Luma => 1,
            Self::Linear | Self::Display | Self::U8 => 3,
        }
    }
}

/// What is measured on a frame. Metrics that share a quantity share its cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Quantity {
    SquaredError(Domain),
    Ssim(Domain),
    MsSsim,
    Flip,
    HdrFlip,
    RelativeSquaredError,
    SymmetricError,
    Change(Change),
    /// Over all frames.
    ErrorDeviation,
    /// Over the frames after a reset.
    Convergence,
}

impl Quantity {
    const fn domain(self) -> Domain {
        match self {
            Self::SquaredError(domain) | Self::Ssim(domain) => domain,
            Self::MsSsim => Domain::Luma,
            Self::Flip | Self::Change(_) | Self::ErrorDeviation | Self::Convergence => Domain::Display,
            Self::HdrFlip | Self::RelativeSquaredError | Self::SymmetricError => Domain::Linear,
        }
    }

    /// Fewest pixels in either axis.
    const fn smallest(self) -> u32 {
        match self {
            Self::Ssim(_) => ssim::WINDOW as u32,
            Self::MsSsim => ms_ssim::SMALLEST,
            _ => 1,
        }
    }

    /// `None` where the frames leave it undefined, or it is not a frame's.
    fn measure(self, reference: &Shown, test: &Shown, step: Option<(&Step, &Shown)>) -> Option<Sums> {
        Some(match self {
            Self::Change(change) => {
                let (step, previous_test) = step?;
                return change.measure(step, reference, [test, previous_test]);
            }
            Self::ErrorDeviation | Self::Convergence => return None,
            Self::SquaredError(domain) => squared_error::measure(domain, reference, test),
            Self::Ssim(domain) => ssim::measure(domain, reference, test),
            Self::MsSsim => ms_ssim::measure(reference, test),
            Self::Flip => flip::sums(flip::map(reference, test)),
            Self::HdrFlip => flip::sums(flip::hdr_map(reference, test)),
            Self::RelativeSquaredError => relative_error::measure_squared(reference, test),
            Self::SymmetricError => relative_error::measure_symmetric(reference, test),
        })
    }
}

/// A quantity summed over the samples (pixels × channels) of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sums {
    /// Σ of the quantity.
    total: f64,
    /// Σ R² with squared errors of display values; the second factor of a fit.
    reference: f64,
    /// How many samples.
    n: usize,
    /// Every sample, where a percentile may be asked of them.
    samples: Vec<f32>,
}

impl Sums {
    /// Of images that cannot be measured: every metric becomes NaN.
    fn unknown() -> Self {
        Self {
            total: f64::NAN,
            ..Self::default()
        }
    }

    fn mean(&self) -> f64 {
        self.total / self.n as f64
    }
}

/// The scores of one test image.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScores {
    /// By metric id.
    pub values: Values,
    /// Pixels of test or reference with a NaN or an infinity. Any at all makes every metric that saw it NaN.
    pub non_finite_pixels: u64,
}

/// A reference frame, prepared once and shared by every preset that is compared with it.
pub struct Reference {
    shown: Arc<Shown>,
    display: Display,
    metrics: Vec<Metric>,
    step: Option<Step>,
}

impl Reference {
    /// Prepares the linear RGB image `linear` for `metrics` after `display`.
    pub fn new(linear: &Image<Rgb>, display: Display, metrics: &[Metric]) -> Self {
        Self {
            shown: Arc::new(Shown::from_linear(linear, display, metrics)),
            display,
            metrics: metrics.to_vec(),
            step: None,
        }
    }

    /// The same as the frame after `previous`, with its motion where that is known: what [`Track`] needs.
    pub fn follow(self, previous: &Self, motion_px: Option<&Image<[f32; 2]>>) -> Self {
        let wanted = self.metrics.iter().any(|metric| metric.needs_motion());
        let motion_px = motion_px.filter(|_| wanted);
        Self {
            step: Some(Step::new(Arc::clone(&previous.shown), &self.shown, motion_px)),
            ..self
        }
    }

    /// Scores the linear RGB image `test`, shown by the same display transform.
    pub fn evaluate(&self, test: &Image<Rgb>) -> Result<FrameScores, MetricError> {
        check_sizes(&self.metrics, self.shown.extent(), test.extent())?;
        evaluate(
            &self.metrics,
            &self.shown,
            &Shown::from_linear(test, self.display, &self.metrics),
        )
    }
}

/// Scores `test` against `reference`, both prepared for (at least) `metrics`.
///
/// # Panics
/// When either was prepared for other metrics, which read values it does not hold: a caller's mistake, never a user's.
pub fn evaluate(metrics: &[Metric], reference: &Shown, test: &Shown) -> Result<FrameScores, MetricError> {
    check_sizes(metrics, reference.extent(), test.extent())?;
    match metrics.iter().find(|metric| metric.is_temporal()) {
        Some(metric) => Err(MetricError::NeedsSequence { metric: metric.id() }),
        None => Ok(measure(metrics, reference, test, None)),
    }
}

/// The values of `metrics`, with temporal ones where `step` leads here from a previous image under test.
fn measure(metrics: &[Metric], reference: &Shown, test: &Shown, step: Option<(&Step, &Shown)>) -> FrameScores {
    let non_finite_pixels = reference.count_non_finite(test);
    let is_finite = |quantity: Quantity| match (quantity, step) {
        (Quantity::Change(_), Some((step, previous))) => non_finite_pixels == 0 && step.is_finite(previous),
        _ => non_finite_pixels == 0,
    };
    let measured = quantities(metrics)
        .into_iter()
        .filter_map(|quantity| {
            let sums = match is_finite(quantity) {
                true => quantity.measure(reference, test, step)?,
                false => Sums::unknown(),
            };
            Some((quantity, sums))
        })
        .collect();
    let mut values = values(metrics, &measured);
    if non_finite_pixels == 0 && metrics.contains(&Metric::HdrFlip) {
        let exposures = reference.exposures();
        values.insert(flip::START_EXPOSURE, Value(exposures.start));
        values.insert(flip::STOP_EXPOSURE, Value(exposures.stop));
    }
    FrameScores {
        values,
        non_finite_pixels,
    }
}

/// Sums over the pixels of each row, added from top to bottom, so that they do not depend on the number of threads.
fn sum_in_rows<const N: usize>(extent: Extent, row_sums: impl Fn(Range<usize>) -> [f64; N] + Sync) -> [f64; N] {
    let width = extent.width as usize;
    let rows = (0..extent.height as usize).into_par_iter();
    let rows: Vec<[f64; N]> = rows.map(|y| row_sums(y * width..(y + 1) * width)).collect();
    std::array::from_fn(|i| rows.iter().map(|sums| sums[i]).sum())
}

fn check_sizes(metrics: &[Metric], reference: Extent, test: Extent) -> Result<(), MetricError> {
    if reference != test {
        return Err(MetricError::SizeMismatch { reference, test });
    }
    metrics.iter().try_for_each(|metric| metric.check_size(test))
}

fn quantities(metrics: &[Metric]) -> BTreeSet<Quantity> {
    metrics.iter().map(|metric| metric.definition().quantity).collect()
}

/// The value of each of `metrics` whose quantity was measured.
fn values(metrics: &[Metric], measured: &BTreeMap<Quantity, Sums>) -> Values {
    let value = |metric: &Metric| {
        let definition = metric.definition();
        let sums = measured.get(&definition.quantity)?;
        Some((metric.id(), Value((definition.value)(sums))))
    };
    metrics.iter().filter_map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_distinct_and_parse_back() {
        let ids: BTreeSet<&str> = Metric::ALL.map(Metric::id).into();
        assert_eq!(ids.len(), Metric::ALL.len());
        for metric in Metric::ALL {
            assert_eq!(metric.id().parse(), Ok(metric));
            let json = serde_json::to_string(&metric).unwrap();
            assert_eq!(json, format!("\"{metric}\""));
            assert_eq!(serde_json::from_str::<Metric>(&json).unwrap(), metric);
        }
    }

    #[test]
    fn an_unknown_id_names_the_nearest() {
        for (wrong, right) in [("pnsr", "psnr"), ("psnr_linear", "psnr.linear"), ("SSIM.y", "ssim.y")] {
            let error = wrong.parse::<Metric>().unwrap_err().to_string();
            assert_eq!(error, format!("unknown metric `{wrong}`; did you mean `{right}`?"));
        }
    }

    #[test]
    fn unequal_sizes_are_refused() {
        let reference = Image::filled(Extent::new(20, 20), [0.5; 3]);
        let test = Image::filled(Extent::new(20, 21), [0.5; 3]);
        let error = Reference::new(&reference, Display::default(), &[Metric::Psnr]).evaluate(&test);
        assert!(error.unwrap_err().to_string().contains("20×21"));
    }
}
