//! A sequence's values condensed. Frames that cannot be averaged are counted, never dropped in silence.

use super::{Better, Metric, Value, quantity::Quantity, temporal::Change};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One metric over the frames of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// Mean of the finite frames; of `flicker` their root mean square. Where there are none, the infinity that all frames share, or NaN.
    pub mean: Value,
    /// Smallest value of all frames but NaN ones.
    pub min: Value,
    /// 5th percentile of all frames but NaN ones: linear between order statistics, rank 0.05·(n − 1) counted from 0.
    pub p5: Value,
    /// For PSNRs: the PSNR of the mean of the frames' mean squared errors. Equal frames count as error 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pooled: Option<Value>,
    /// How many frames are infinite.
    pub infinite: usize,
    /// How many frames are NaN. Any at all means that the other fields speak of fewer frames than ran.
    pub nan: usize,
}

impl Summary {
    /// Condenses the values of `metric`, one a frame, in any order.
    pub fn new(metric: Metric, values: impl IntoIterator<Item = Value>) -> Self {
        Self::condense(values, |values| center(metric, values), |values| pool(metric, values))
    }

    /// Condenses the values of the metric with this id; of one that is measured elsewhere and unknown here, the plain mean.
    pub fn of(id: &str, values: impl IntoIterator<Item = Value>) -> Self {
        match id.parse() {
            Ok(metric) => Self::new(metric, values),
            Err(_) => Self::condense(values, mean, |_| None),
        }
    }

    /// The number that stands for the sequence where results are judged: the mean, unless a frame is as bad as can be. Not a
    /// number where any frame is none; the infinity on the worse side where any frame is there, and where that is not known, any
    /// infinity.
    pub fn headline(&self, better: Option<Better>) -> Value {
        let is_below = self.min.0 == f64::NEG_INFINITY;
        match better {
            _ if self.nan > 0 => Value(f64::NAN),
            Some(Better::Higher) | None if is_below => self.min,
            Some(Better::Lower) | None if self.infinite > 0 && !is_below => Value(f64::INFINITY),
            _ => self.mean,
        }
    }

    fn condense(
        values: impl IntoIterator<Item = Value>,
        center: impl Fn(&[f64]) -> f64,
        pool: impl Fn(&[f64]) -> Option<Value>,
    ) -> Self {
        let (nan, mut known): (Vec<f64>, Vec<f64>) = values.into_iter().map(|value| value.0).partition(|v| v.is_nan());
        known.sort_by(f64::total_cmp);
        let finite: Vec<f64> = known.iter().copied().filter(|value| value.is_finite()).collect();
        Self {
            mean: Value(center(if finite.is_empty() { &known } else { &finite })),
            min: Value(known.first().copied().unwrap_or(f64::NAN)),
            p5: Value(percentile(&known, 0.05)),
            pooled: pool(&known),
            infinite: known.len() - finite.len(),
            nan: nan.len(),
        }
    }
}

/// What stands for all values.
fn center(metric: Metric, values: &[f64]) -> f64 {
    if metric.definition().quantity == Quantity::Change(Change::MeanError) {
        return (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt();
    }
    mean(values)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Linear between order statistics.
pub(super) fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    if sorted.is_empty() {
        return f64::NAN;
    }
    let rank = fraction * (sorted.len() - 1) as f64;
    let below = sorted[rank.floor() as usize];
    let above = sorted[rank.ceil() as usize];
    if below == above {
        return below; // Two infinities too, whose difference is NaN.
    }
    below + (above - below) * rank.fract()
}

/// A PSNR is a function of its frame's mean squared error and can be turned back into it, so pooling needs no other
/// column than the PSNR's own.
fn pool(metric: Metric, values: &[f64]) -> Option<Value> {
    let relative_mse = metric.definition().relative_mse?;
    let errors: Vec<f64> = values.iter().map(|&value| relative_mse(value)).collect();
    Some(Value(super::squared_error::psnr_db(mean(&errors), 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(metric: Metric, values: &[f64]) -> Summary {
        Summary::new(metric, values.iter().copied().map(Value))
    }

    #[test]
    fn finite_frames() {
        let summary = summary(Metric::SSIM, &[0.5, 0.2, 0.9, 0.4]);
        assert!((summary.mean.0 - 0.5).abs() < 1e-15);
        assert_eq!((summary.min, summary.pooled), (Value(0.2), None));
        assert!((summary.p5.0 - 0.23).abs() < 1e-15, "{:?}", summary.p5);
    }

    #[test]
    fn one_frame_as_bad_as_can_be_is_the_headline() {
        let headline = |metric, values: &[f64], better| summary(metric, values).headline(Some(better)).0;
        assert!(headline(Metric::PSNR, &[34.0, f64::NAN, 34.0], Better::Higher).is_nan());
        assert_eq!(
            headline(Metric::SNR, &[34.0, f64::NEG_INFINITY], Better::Higher),
            f64::NEG_INFINITY
        );
        assert_eq!(
            headline(Metric::MSE, &[0.5, f64::INFINITY], Better::Lower),
            f64::INFINITY
        );
        assert_eq!(headline(Metric::PSNR, &[34.0, f64::INFINITY], Better::Higher), 34.0);
        assert_eq!(headline(Metric::MSE, &[0.5, 0.0], Better::Lower), 0.25);
        let unknown = |values: [f64; 2]| Summary::of("mine", values.map(Value)).headline(None).0;
        assert_eq!(unknown([1.0, f64::INFINITY]), f64::INFINITY);
        assert_eq!(unknown([1.0, f64::NEG_INFINITY]), f64::NEG_INFINITY);
    }

    #[test]
    fn infinite_and_nan_frames_are_counted() {
        let summary = summary(Metric::PSNR, &[f64::INFINITY, 20.0, f64::NAN, 40.0, f64::NAN]);
        assert_eq!((summary.mean, summary.min), (Value(30.0), Value(20.0)));
        assert_eq!((summary.infinite, summary.nan), (1, 2));
        // Errors 0, 1e-2 and 1e-4.
        let expected = -10.0 * libm::log10(0.0101 / 3.0);
        assert!((summary.pooled.unwrap().0 - expected).abs() < 1e-12);
    }

    #[test]
    fn perfect_sequences_stay_perfect() {
        let summary = summary(Metric::PSNR, &[f64::INFINITY; 3]);
        let all = [summary.mean, summary.min, summary.p5, summary.pooled.unwrap()];
        assert_eq!(all, [Value(f64::INFINITY); 4]);
        assert_eq!(summary.infinite, 3);
    }

    #[test]
    fn nothing_known_is_nan_not_zero() {
        let summary = summary(Metric::PSNR, &[f64::NAN]);
        for value in [summary.mean, summary.min, summary.p5, summary.pooled.unwrap()] {
            assert!(value.0.is_nan());
        }
    }
}
