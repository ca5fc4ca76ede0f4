//! The closed list of metrics: what each is called, what its numbers mean, and over which pixels it is taken.

use super::{
    flip,
    mask::Mask,
    ms_ssim,
    quantity::{Quantity, Sums},
    relative_error, squared_error, ssim, temporal,
};
use crate::image::Extent;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    cmp::Ordering,
    fmt,
    hash::{Hash, Hasher},
    str::FromStr,
    sync::LazyLock,
};

/// Which way a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Better {
    /// Larger is better.
    Higher,
    /// Smaller is better.
    Lower,
}

/// What a metric's numbers mean. `version` rises whenever they change; only equal versions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
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

/// A metric as lists show it.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Listing {
    /// What it is.
    #[serde(flatten)]
    pub info: &'static MetricInfo,
    /// The masks that it can be taken over, by what is put behind its id.
    pub masks: Vec<&'static str>,
}

/// How a metric is computed: what to measure on a frame, and its value from that.
pub(super) struct Definition {
    pub info: MetricInfo,
    pub quantity: Quantity,
    /// `None` where the samples leave it undefined.
    pub value: fn(&Sums) -> Option<f64>,
    /// Mean squared error over peak squared, from the value; where a metric is a function of it, a sequence is pooled.
    pub relative_mse: Option<fn(f64) -> f64>,
}

/// A metric over all pixels, or over those of a mask. In text and JSON its stored id: `psnr`, `psnr.moving`.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(try_from = "String", into = "&'static str")]
pub struct Metric {
    definition: &'static Definition,
    mask: Option<Mask>,
}

impl JsonSchema for Metric {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "MetricId".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "type": "string",
            "description": "A metric's id, such as `psnr`, or over a mask, such as `psnr.moving`. `/api/v1/metrics` lists them.",
            "examples": ["psnr", "flip", "psnr.moving"],
        })
    }
}

impl Metric {
    /// Mean squared error.
    pub const MSE: Self = Self::over_all(&squared_error::MSE);
    /// Root of the mean squared error.
    pub const RMSE: Self = Self::over_all(&squared_error::RMSE);
    /// Peak signal-to-noise ratio of display values.
    pub const PSNR: Self = Self::over_all(&squared_error::PSNR);
    /// Peak signal-to-noise ratio of linear values.
    pub const PSNR_LINEAR: Self = Self::over_all(&squared_error::PSNR_LINEAR);
    /// Peak signal-to-noise ratio of 8-bit values.
    pub const PSNR_U8: Self = Self::over_all(&squared_error::PSNR_U8);
    /// Peak signal-to-noise ratio of luma.
    pub const PSNR_Y: Self = Self::over_all(&squared_error::PSNR_Y);
    /// Signal-to-noise ratio.
    pub const SNR: Self = Self::over_all(&squared_error::SNR);
    /// Structural similarity of display values.
    pub const SSIM: Self = Self::over_all(&ssim::SSIM);
    /// Structural similarity of luma.
    pub const SSIM_Y: Self = Self::over_all(&ssim::SSIM_Y);
    /// Structural similarity of 8-bit values.
    pub const SSIM_U8: Self = Self::over_all(&ssim::SSIM_U8);
    /// Structural similarity of luma over five scales.
    pub const MS_SSIM_Y: Self = Self::over_all(&ms_ssim::MS_SSIM_Y);
    /// LDR-FLIP, mean.
    pub const FLIP: Self = Self::over_all(&flip::FLIP);
    /// LDR-FLIP, 95th percentile.
    pub const FLIP_P95: Self = Self::over_all(&flip::FLIP_P95);
    /// HDR-FLIP, mean.
    pub const HDR_FLIP: Self = Self::over_all(&flip::HDR_FLIP);
    /// Relative mean squared error of linear values.
    pub const REL_MSE: Self = Self::over_all(&relative_error::REL_MSE);
    /// Symmetric mean absolute relative error of linear values.
    pub const SMAPE: Self = Self::over_all(&relative_error::SMAPE);
    /// PSNR of changes from frame to frame.
    pub const TPSNR: Self = Self::over_all(&temporal::TPSNR);
    /// PSNR of changes along the motion.
    pub const WARPED_TPSNR: Self = Self::over_all(&temporal::WARPED_TPSNR);
    /// Excess of change along the motion.
    pub const WARP_EXCESS: Self = Self::over_all(&temporal::WARP_EXCESS);
    /// Change of the mean luma error.
    pub const FLICKER: Self = Self::over_all(&temporal::FLICKER);
    /// Deviation over time of the luma error.
    pub const FLICKER_LOCAL: Self = Self::over_all(&temporal::FLICKER_LOCAL);
    /// Share of the previous frame left.
    pub const GHOST: Self = Self::over_all(&temporal::GHOST);
    /// Share of a box blur.
    pub const BLUR: Self = Self::over_all(&temporal::BLUR);
    /// Frames until PSNR settles after a reset.
    pub const CONVERGE_FRAMES: Self = Self::over_all(&temporal::CONVERGE_FRAMES);

    /// Every metric over all pixels, in the order shown to people.
    pub const ALL: [Self; 24] = [
        Self::MSE,
        Self::RMSE,
        Self::PSNR,
        Self::PSNR_LINEAR,
        Self::PSNR_U8,
        Self::PSNR_Y,
        Self::SNR,
        Self::SSIM,
        Self::SSIM_Y,
        Self::SSIM_U8,
        Self::MS_SSIM_Y,
        Self::FLIP,
        Self::FLIP_P95,
        Self::HDR_FLIP,
        Self::REL_MSE,
        Self::SMAPE,
        Self::TPSNR,
        Self::WARPED_TPSNR,
        Self::WARP_EXCESS,
        Self::FLICKER,
        Self::FLICKER_LOCAL,
        Self::GHOST,
        Self::BLUR,
        Self::CONVERGE_FRAMES,
    ];

    const fn over_all(definition: &'static Definition) -> Self {
        Self { definition, mask: None }
    }

    /// The same over the pixels of `mask`. `None` where no pixel can count: what is measured along the motion is
    /// measured where the motion leads back.
    pub fn over(self, mask: Mask) -> Option<Self> {
        let follows = matches!(self.definition.quantity, Quantity::Change(change) if change.follows_motion());
        (!(follows && mask == Mask::Disoccluded)).then_some(Self {
            mask: Some(mask),
            ..self
        })
    }

    /// Every metric over all pixels, and the masks that it has.
    pub fn list() -> Vec<Listing> {
        let listing = |metric: Self| Listing {
            info: metric.info(),
            masks: Mask::ALL
                .into_iter()
                .filter(|mask| metric.over(*mask).is_some())
                .map(Mask::id)
                .collect(),
        };
        Self::ALL.map(listing).into()
    }

    /// Which pixels count; all without one.
    pub const fn mask(self) -> Option<Mask> {
        self.mask
    }

    pub(super) const fn definition(self) -> &'static Definition {
        self.definition
    }

    /// Id, unit, direction, version and description.
    pub fn info(self) -> &'static MetricInfo {
        // By metric of `ALL`, by mask.
        static MASKED: LazyLock<Vec<[MetricInfo; Mask::ALL.len()]>> = LazyLock::new(|| {
            Metric::ALL
                .map(|metric| Mask::ALL.map(|mask| masked(metric, mask)))
                .into()
        });
        let Some(mask) = self.mask else {
            return &self.definition.info;
        };
        let base = Self::over_all(self.definition);
        let position = Self::ALL.iter().position(|metric| *metric == base);
        &MASKED[position.expect("every metric is in `ALL`")][mask as usize]
    }

    /// The stored id, such as `psnr.linear`.
    pub fn id(self) -> &'static str {
        self.info().id
    }

    /// Whether it speaks of a sequence, and has no value for two images.
    pub fn is_temporal(self) -> bool {
        self.mask.is_some()
            || matches!(
                self.definition.quantity,
                Quantity::Change(_) | Quantity::ErrorDeviation | Quantity::Convergence
            )
    }

    /// Whether it must know where each pixel was one frame ago.
    pub fn needs_motion(self) -> bool {
        self.mask.is_some() || matches!(self.definition.quantity, Quantity::Change(change) if change.follows_motion())
    }

    /// Whether its values are known only after more frames, [`super::Track::finish`]; warm-up frames hold some of them.
    pub fn is_late(self) -> bool {
        matches!(
            self.definition.quantity,
            Quantity::ErrorDeviation | Quantity::Convergence
        )
    }

    /// Whether it has a map.
    pub fn check_map(self) -> Result<(), MetricError> {
        match self.is_temporal() {
            true => Err(MetricError::NoMap { metric: self.id() }),
            false => Ok(()),
        }
    }

    /// Whether images of this size are large enough for the metric's window.
    pub fn check_size(self, extent: Extent) -> Result<(), MetricError> {
        let smallest = self.definition.quantity.smallest();
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

/// Nothing frees it, and nothing asks for it twice.
fn masked(metric: Metric, mask: Mask) -> MetricInfo {
    let info = metric.definition.info;
    MetricInfo {
        id: format!("{}.{}", info.id, mask.id()).leak(),
        description: format!("{}; {}", info.description, mask.description()).leak(),
        ..info
    }
}

impl PartialEq for Metric {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Metric {}

impl PartialOrd for Metric {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Metric {
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |metric: &Self| (metric.definition.info.id, metric.mask);
        key(self).cmp(&key(other))
    }
}

impl Hash for Metric {
    fn hash<H: Hasher>(&self, state: &mut H) {
        (self.definition.info.id, self.mask).hash(state);
    }
}

impl fmt::Debug for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id())
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
        let find = |id: &str| Self::ALL.into_iter().find(|metric| metric.id() == id);
        let masked = id.rsplit_once('.').and_then(|(base, mask)| {
            let mask = Mask::ALL.into_iter().find(|known| known.id() == mask)?;
            Some((find(base)?, mask))
        });
        match (find(id), masked) {
            (Some(metric), _) => Ok(metric),
            (_, Some((metric, mask))) => metric
                .over(mask)
                .ok_or_else(|| MetricError::NoPixels { id: id.to_owned() }),
            _ => Err(MetricError::Unknown {
                id: id.to_owned(),
                nearest: nearest_id(id),
            }),
        }
    }
}

fn nearest_id(id: &str) -> &'static str {
    let masked = |metric: Metric| Mask::ALL.into_iter().filter_map(move |mask| metric.over(mask));
    let all = Metric::ALL
        .into_iter()
        .flat_map(|metric| [metric].into_iter().chain(masked(metric)));
    let ids = all.map(Metric::id);
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
    /// The metric never has a pixel of the mask.
    #[error("`{id}` has no pixels: along the motion only pixels count that it leads back from; leave the metric out")]
    NoPixels {
        /// What was asked for.
        id: String,
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
    /// Its samples are not those of two images.
    #[error("`{metric}` has no map: only metrics of two images, over all their pixels, have one")]
    NoMap {
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn ids_are_distinct_and_parse_back() {
        let masked = Metric::ALL
            .into_iter()
            .flat_map(|metric| Mask::ALL.map(|mask| metric.over(mask)));
        let all: Vec<Metric> = Metric::ALL.into_iter().chain(masked.flatten()).collect();
        let ids: BTreeSet<&str> = all.iter().map(|metric| metric.id()).collect();
        assert_eq!(ids.len(), 24 + 3 * 24 - 2);
        for metric in all {
            assert_eq!(metric.id().parse(), Ok(metric));
            let json = serde_json::to_string(&metric).unwrap();
            assert_eq!(json, format!("\"{metric}\""));
            assert_eq!(serde_json::from_str::<Metric>(&json).unwrap(), metric);
        }
    }

    #[test]
    fn an_unknown_id_names_the_nearest() {
        for (wrong, right) in [
            ("pnsr", "psnr"),
            ("psnr_linear", "psnr.linear"),
            ("SSIM.y", "ssim.y"),
            ("flip.mooving", "flip.moving"),
        ] {
            let error = wrong.parse::<Metric>().unwrap_err().to_string();
            assert_eq!(error, format!("unknown metric `{wrong}`; did you mean `{right}`?"));
        }
        let error = "warp_excess.disoccluded".parse::<Metric>().unwrap_err().to_string();
        assert!(error.contains("no pixels"), "{error}");
    }
}
