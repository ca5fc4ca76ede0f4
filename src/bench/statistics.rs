//! Robust figures of few and skewed samples: times have a floor and a long tail.

use crate::statistics::median;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Repeated measurements of one thing, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Timing {
    /// Middle value.
    pub median: f64,
    /// Median absolute deviation from the median.
    pub mad: f64,
    /// Lower end of the 95 % interval of the median.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Timing {
    /// Condenses samples, of which there must be some.
    pub fn new(samples: &[f64]) -> Self {
        let median_ms = median(samples);
        let deviations: Vec<_> = samples.iter().map(|sample| (sample - median_ms).abs()).collect();
        let [low, high] = median_interval(samples);
        Self {
            median: median_ms,
            mad: median(&deviations),
            low,
            high,
        }
    }

    /// Whether two medians are further apart than `noise`, a share of the larger.
    pub fn differs(&self, other: &Self, noise: f64) -> bool {
        (self.median - other.median).abs() > noise * self.median.max(other.median)
    }
}

/// The 95 % interval of the median, whatever the distribution: the order statistics whose ranks a fair coin's count of
/// heads leaves with probability 0.025 at either end. Of five samples or fewer, the whole range.
pub fn median_interval(samples: &[f64]) -> [f64; 2] {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    // The largest k for which at most k - 1 heads have probability 0.025 at most.
    let mut probability = libm::pow(0.5, n as f64);
    let mut below = probability;
    let mut k = 0;
    while below <= 0.025 && 2 * (k + 1) < n {
        k += 1;
        probability *= (n - k + 1) as f64 / k as f64;
        below += probability;
    }
    let first = k.saturating_sub(1);
    [sorted[first], sorted[n - 1 - first]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_the_median_has_the_tabulated_ranks() {
        let ranks = |n: usize| {
            let samples: Vec<_> = (1..=n).map(|i| i as f64).collect();
            median_interval(&samples)
        };
        // Conover, Practical Nonparametric Statistics, table of confidence intervals for a median, 95 %.
        assert_eq!(ranks(6), [1.0, 6.0]);
        assert_eq!(ranks(10), [2.0, 9.0]);
        assert_eq!(ranks(20), [6.0, 15.0]);
        assert_eq!(ranks(30), [10.0, 21.0]);
        assert_eq!(ranks(3), [1.0, 3.0]);
    }

    #[test]
    fn one_slow_frame_moves_nothing() {
        let mut samples: Vec<_> = (0..25).map(|i| 10.0 + 0.01 * f64::from(i)).collect();
        let calm = Timing::new(&samples);
        samples[24] = 1000.0;
        let disturbed = Timing::new(&samples);
        assert_eq!(calm, disturbed);
        assert!(
            (calm.median - 10.12).abs() < 1e-9 && (calm.mad - 0.06).abs() < 1e-9,
            "{calm:?}"
        );
    }

    #[test]
    fn what_lies_within_the_noise_is_not_called_different() {
        let timing = |median| Timing::new(&[median]);
        assert!(!timing(100.0).differs(&timing(104.0), 0.05));
        assert!(timing(100.0).differs(&timing(106.0), 0.05));
        assert!(!timing(104.0).differs(&timing(100.0), 0.05));
    }
}
