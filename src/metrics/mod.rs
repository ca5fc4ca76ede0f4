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
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    str::FromStr,
};

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
mod value;

pub use display::{Display, Tonemap};
pub use shown::Shown;
pub use summary::Summary;
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
    pub const ALL: [Self; 16] = [
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
}

impl Quantity {
    const fn domain(self) -> Domain {
        match self {
            Self::SquaredError(domain) | Self::Ssim(domain) => domain,
            Self::MsSsim => Domain::Luma,
            Self::Flip => Domain::Display,
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

    fn measure(self, reference: &Shown, test: &Shown) -> Sums {
        match self {
            Self::SquaredError(domain) => squared_error::measure(domain, reference, test),
            Self::Ssim(domain) => ssim::measure(domain, reference, test),
            Self::MsSsim => ms_ssim::measure(reference, test),
            Self::Flip => flip::sums(flip::map(reference, test)),
            Self::HdrFlip => flip::sums(flip::hdr_map(reference, test)),
            Self::RelativeSquaredError => relative_error::measure_squared(reference, test),
            Self::SymmetricError => relative_error::measure_symmetric(reference, test),
        }
    }
}

/// A quantity summed over the samples (pixels × channels) of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sums {
    /// Σ of the quantity.
    total: f64,
    /// Σ R², with squared errors of display values only.
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
    shown: Shown,
    display: Display,
    metrics: Vec<Metric>,
}

impl Reference {
    /// Prepares the linear RGB image `linear` for `metrics` after `display`.
    pub fn new(linear: &Image<Rgb>, display: Display, metrics: &[Metric]) -> Self {
        Self {
            shown: Shown::from_linear(linear, display, metrics),
            display,
            metrics: metrics.to_vec(),
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
    let non_finite_pixels = reference.count_non_finite(test);
    let measure = |quantity: Quantity| match non_finite_pixels {
        0 => quantity.measure(reference, test),
        _ => Sums::unknown(),
    };
    let measured = quantities(metrics)
        .into_iter()
        .map(|quantity| (quantity, measure(quantity)))
        .collect();
    let mut values = values(metrics, &measured);
    if non_finite_pixels == 0 && metrics.contains(&Metric::HdrFlip) {
        let exposures = reference.exposures();
        values.insert(flip::START_EXPOSURE, Value(exposures.start));
        values.insert(flip::STOP_EXPOSURE, Value(exposures.stop));
    }
    Ok(FrameScores {
        values,
        non_finite_pixels,
    })
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

/// The value of each of `metrics`, whose quantities were all measured.
fn values(metrics: &[Metric], measured: &BTreeMap<Quantity, Sums>) -> Values {
    let value = |metric: &Metric| {
        let definition = metric.definition();
        (metric.id(), Value((definition.value)(&measured[&definition.quantity])))
    };
    metrics.iter().map(value).collect()
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
