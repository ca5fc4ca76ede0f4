//! When a run has seen enough.

use crate::metrics::Metric;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Ends a run as soon as the mean of a metric is known well enough for every preset. Written `psnr±0.05` or `psnr+-0.05`.
///
/// Known is the 95 % interval of the mean over frames after warm-up, as if frames were independent. They are not quite:
/// where the scene changes, so may the mean later on. It is meant for sequences that stand still and for long ones that do
/// not change their nature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Until {
    /// Which metric; one of the run's.
    pub metric: Metric,
    /// Half the width of the interval, in the metric's unit.
    pub within: f64,
}

/// The fewest frames an interval is taken of.
const LEAST_FRAMES: usize = 6;

impl Until {
    /// Whether these values, one a frame, say enough. Values that are not finite never do.
    pub fn is_met(&self, values: &[f64]) -> bool {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (n - 1.0);
        // Student's factor for 5 degrees of freedom, the fewest there are, is 2.57; beyond, it only falls.
        values.len() >= LEAST_FRAMES && 2.57 * (variance / n).sqrt() <= self.within
    }
}

impl JsonSchema for Until {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Until".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "type": "string",
            "description": "A metric and half the width of its mean's 95 % interval, at which a run has seen enough.",
            "examples": ["psnr±0.05", "psnr+-0.05"],
        })
    }
}

impl fmt::Display for Until {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}±{}", self.metric, self.within)
    }
}

impl FromStr for Until {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not of the form psnr±0.05");
        let (metric, within) = text
            .split_once('±')
            .or_else(|| text.split_once("+-"))
            .ok_or_else(wrong)?;
        let within: f64 = within.trim().parse().map_err(|_| wrong())?;
        if !(within > 0.0 && within.is_finite()) {
            return Err(format!("`{text}`: the width must be above 0"));
        }
        let metric = metric.trim().parse::<Metric>().map_err(|error| error.to_string())?;
        Ok(Self { metric, within })
    }
}

impl TryFrom<String> for Until {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Until> for String {
    fn from(until: Until) -> Self {
        until.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let until: Until = "psnr±0.05".parse().unwrap();
        assert_eq!(until, "psnr+-0.05".parse().unwrap());
        assert_eq!((until.metric.id(), until.within), ("psnr", 0.05));
        assert_eq!(until.to_string(), "psnr±0.05");
        for wrong in ["psnr", "psnr±", "psnr±-1", "psnr±0", "no_such±1", "psnr±nan"] {
            assert!(wrong.parse::<Until>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn enough_is_an_interval_and_a_few_frames() {
        let until: Until = "psnr±0.1".parse().unwrap();
        assert!(!until.is_met(&[30.0; 5]), "too few");
        assert!(until.is_met(&[30.0; 6]));
        let wobbling = |n: usize| {
            (0..n)
                .map(|i| 30.0 + if i % 2 == 0 { 0.5 } else { -0.5 })
                .collect::<Vec<_>>()
        };
        assert!(!until.is_met(&wobbling(100)));
        // 2.57 · 0.5 / √n = 0.1 at n = 165.
        assert!(until.is_met(&wobbling(170)));
        assert!(!until.is_met(&[f64::INFINITY; 20]));
    }
}
