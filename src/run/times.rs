//! Measuring, and condensing what was measured.

use super::report::TimeSummary;
use crate::statistics::median;
use std::time::Instant;

/// Runs `work` and returns its wall time in milliseconds beside its result.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, milliseconds_since(start))
}

/// Wall time since `start`.
pub fn milliseconds_since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// CPU time that the calling thread has used, milliseconds.
pub fn thread_cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// CPU time that the whole process has used, milliseconds.
pub fn process_cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// None where nothing was measured.
pub fn summary(values: &[f64]) -> Option<TimeSummary> {
    let median_ms = median(values);
    let deviations: Vec<_> = values.iter().map(|value| (value - median_ms).abs()).collect();
    (!values.is_empty()).then(|| TimeSummary {
        median: median_ms,
        min: values.iter().copied().fold(f64::INFINITY, f64::min),
        mad: median(&deviations),
        n: values.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summaries_are_robust_against_one_slow_frame() {
        let found = summary(&[1.0, 2.0, 3.0, 1000.0]).unwrap();
        assert_eq!((found.median, found.min, found.mad, found.n), (2.5, 1.0, 1.0, 4));
        assert!(summary(&[]).is_none());
    }
}
