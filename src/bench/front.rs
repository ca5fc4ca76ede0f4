//! The Pareto front of time and error: the points that no other beats in both.

use super::Point;
use crate::metrics::{Better, Metric};

/// Sets for each point which other beats it: not slower beyond the noise, not worse, and truly better in one of the two.
/// Times within the noise count as equal, so that chance never dominates. Of several that beat a point, the one with
/// the least error is named; it lies on the front, because to beat is transitive in the error, and between equal errors in
/// the time.
pub fn dominate(points: &mut [Point], metric: Metric, noise: f64) {
    let errors: Vec<_> = points.iter().map(|point| point.error(metric)).collect();
    let beats = |a: usize, b: usize| {
        let (Some(error_a), Some(error_b)) = (errors[a], errors[b]) else {
            return false;
        };
        let (time_a, time_b) = (&points[a].time_ms, &points[b].time_ms);
        let differs = time_a.differs(time_b, noise);
        let is_faster = differs && time_a.median < time_b.median;
        let is_slower = differs && !is_faster;
        error_a <= error_b && !is_slower && (is_faster || error_a < error_b)
    };
    let best = |b: usize| {
        let beating = (0..points.len()).filter(|&a| points[a].sequence == points[b].sequence && beats(a, b));
        beating.min_by(|&x, &y| {
            let by_error = errors[x].partial_cmp(&errors[y]).expect("compared above");
            by_error.then(points[x].time_ms.median.total_cmp(&points[y].time_ms.median))
        })
    };
    let dominators: Vec<_> = (0..points.len())
        .map(|index| best(index).map(|by| points[by].name()))
        .collect();
    for (point, dominated_by) in points.iter_mut().zip(dominators) {
        point.dominated_by = dominated_by;
    }
}

impl Point {
    /// The metric turned so that less is better; none where it was not computed or is not a number.
    pub fn error(&self, metric: Metric) -> Option<f64> {
        let value = self.metrics.get(metric.id())?.0;
        let error = match metric.info().better {
            Better::Higher => -value,
            Better::Lower => value,
        };
        (!error.is_nan()).then_some(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{bench::statistics::Timing, metrics::Value};

    fn point(preset: &str, ms: f64, psnr: f64) -> Point {
        Point {
            sequence: "made up".to_owned(),
            preset: preset.to_owned(),
            parameters: serde_json::Map::new(),
            time_ms: Timing::new(&[ms]),
            upload_ms: 0.0,
            passes_ms: Default::default(),
            metrics: [("psnr".to_owned(), Value(psnr))].into(),
            bytes_per_pixel: 0.0,
            skipped: 0.0,
            over_copy: None,
            peak_gpu_bytes: None,
            dominated_by: None,
        }
    }

    fn dominated(points: &mut [Point], noise: f64) -> Vec<Option<&str>> {
        dominate(points, Metric::PSNR, noise);
        points.iter().map(|point| point.dominated_by.as_deref()).collect()
    }

    #[test]
    fn a_point_is_dominated_by_what_is_faster_and_better() {
        let mut points = [
            point("fast", 1.0, 30.0),
            point("good", 10.0, 40.0),
            point("slow and bad", 12.0, 29.0),
            point("middle", 5.0, 35.0),
        ];
        assert_eq!(dominated(&mut points, 0.05), [None, None, Some("good"), None]);
    }

    #[test]
    fn noise_dominates_nothing() {
        let mut points = [point("a", 10.0, 30.0), point("b", 10.3, 30.0)];
        assert_eq!(dominated(&mut points, 0.05), [None, None]);
        assert_eq!(dominated(&mut points, 0.01), [None, Some("a")]);
        // Better at the same time, as far as can be told.
        let mut points = [point("a", 10.0, 30.0), point("b", 10.3, 31.0)];
        assert_eq!(dominated(&mut points, 0.05), [Some("b"), None]);
    }

    #[test]
    fn what_has_no_error_is_left_alone() {
        let mut points = [point("a", 10.0, f64::NAN), point("b", 1.0, f64::INFINITY)];
        assert_eq!(dominated(&mut points, 0.05), [None, None]);
        let mut other = [point("a", 10.0, 1.0), point("b", 1.0, 2.0)];
        other[1].sequence = "another".to_owned();
        assert_eq!(dominated(&mut other, 0.05), [None, None]);
    }
}
