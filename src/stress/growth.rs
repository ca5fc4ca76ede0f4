//! How error changes from frame to frame: a rate fitted to what was measured.

use super::report::ErrorAt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How an error behaves over frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "GrowthTrend")]
pub enum Trend {
    /// It does not grow.
    Bounded,
    /// It grows by so much a frame.
    Linear,
    /// It grows by such a share a frame.
    Exponential,
}

/// A trend and its rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Growth {
    /// Which kind of curve fits best.
    pub trend: Trend,
    /// Display units a frame where linear, natural logarithm of the factor a frame where exponential, else 0.
    pub rate: f64,
}

/// Fits errors of frames. The first quarter of the frames is how an error begins, and does not count; nor does what is smaller
/// than `negligible`, where only rounding is seen.
pub fn fit(errors: &[ErrorAt], negligible: f64) -> Option<Growth> {
    let bounded = Growth {
        trend: Trend::Bounded,
        rate: 0.0,
    };
    let last = errors.last()?.frame;
    let counted: Vec<(f64, f64)> = errors
        .iter()
        .filter(|at| at.frame * 4 >= last)
        .map(|at| (at.frame as f64, at.error.0))
        .collect();
    if counted.len() < 4 || counted.iter().any(|(_, error)| !error.is_finite()) {
        return None;
    }
    let largest = |part: &[(f64, f64)]| part.iter().fold(0.0, |largest: f64, (_, error)| largest.max(*error));
    let (early, late) = counted.split_at(counted.len() / 2);
    // What grows is larger in its second half than ever before.
    if largest(late) <= negligible || largest(late) <= 1.25 * largest(early) {
        return Some(bounded);
    }
    let linear = Line::through(counted.iter().copied());
    let logarithms = counted
        .iter()
        .map(|&(frame, error)| (frame, libm::log(error.max(negligible * 1e-3))));
    let exponential = Line::through(logarithms);
    let span = counted[counted.len() - 1].0 - counted[0].0;
    // A straight line explains the half of a spread at least, or it is only that: a spread.
    if linear.explained < 0.5 && exponential.explained < 0.5 {
        return Some(bounded);
    }
    let doubles_twice = exponential.slope * span > 2.0 * std::f64::consts::LN_2;
    Some(if doubles_twice && exponential.explained > linear.explained + 0.02 {
        Growth {
            trend: Trend::Exponential,
            rate: exponential.slope,
        }
    } else if linear.slope > 0.0 {
        Growth {
            trend: Trend::Linear,
            rate: linear.slope,
        }
    } else {
        bounded
    })
}

/// Least squares.
struct Line {
    slope: f64,
    /// The share of the variance that the line explains.
    explained: f64,
}

impl Line {
    fn through(points: impl Iterator<Item = (f64, f64)> + Clone) -> Self {
        let n = points.clone().count() as f64;
        let mean = |f: fn(&(f64, f64)) -> f64| points.clone().map(|point| f(&point)).sum::<f64>() / n;
        let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (x, y) in points {
            xx += (x - mx) * (x - mx);
            xy += (x - mx) * (y - my);
            yy += (y - my) * (y - my);
        }
        Self {
            slope: if xx > 0.0 { xy / xx } else { 0.0 },
            explained: if xx * yy > 0.0 { xy * xy / (xx * yy) } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Value;

    fn errors(n: usize, error: impl Fn(f64) -> f64) -> Vec<ErrorAt> {
        let at = |frame| ErrorAt {
            frame,
            error: Value(error(frame as f64)),
            error_ulps: Value(0.0),
        };
        (0..n).map(at).collect()
    }

    fn trend(error: impl Fn(f64) -> f64) -> Growth {
        let errors = errors(400, error);
        fit(&errors, 1e-9).unwrap()
    }

    #[test]
    fn curves_are_told_apart() {
        let wobble = |t: f64| 1.0 + 0.2 * libm::sin(t * 1.7);
        assert_eq!(trend(|t| 1e-4 * wobble(t)).trend, Trend::Bounded);
        assert_eq!(
            trend(|t| 1e-3 * (1.0 - libm::exp(-t / 40.0)) * wobble(t)).trend,
            Trend::Bounded
        );
        assert_eq!(trend(|_| 0.0).trend, Trend::Bounded);
        let linear = trend(|t| 1e-5 * t * wobble(t));
        assert_eq!(linear.trend, Trend::Linear);
        assert!((linear.rate / 1e-5 - 1.0).abs() < 0.1, "{linear:?}");
        let exponential = trend(|t| 1e-8 * libm::exp(0.02 * t) * wobble(t));
        assert_eq!(exponential.trend, Trend::Exponential);
        assert!((exponential.rate / 0.02 - 1.0).abs() < 0.1, "{exponential:?}");
    }

    #[test]
    fn what_is_smaller_than_rounding_does_not_grow() {
        let errors = errors(100, |frame| 1e-12 * frame);
        assert_eq!(fit(&errors, 1e-9).unwrap().trend, Trend::Bounded);
    }
}
