//! `flip.p95`: how often each value occurs in a map, by class, and the percentile from that.

use super::{
    super::mask::{ByClass, ByMask, N_CLASSES, counts},
    Recording, Setup,
    reference::References,
    sums::storage,
};
use crate::gpu::{GpuError, Pass, Readback};
use std::array;
use wgpu::BufferUsages;

const HISTOGRAM: &str = include_str!("../../../shaders/metrics/flip/histogram.wgsl");

/// Equal bins of 0 to 1: no percentile is wrong by more than the width of one.
const N_BINS: usize = 4096;

#[derive(Debug)]
pub struct Histogram {
    pass: Pass,
    counts: wgpu::Buffer,
}

/// A histogram on its way back.
#[derive(Clone, Copy, Debug)]
pub struct CopiedHistogram(usize);

impl Histogram {
    pub fn new(setup: &Setup) -> Result<Self, GpuError> {
        let overrides = [
            ("width", f64::from(setup.extent.width)),
            ("height", f64::from(setup.extent.height)),
            ("n_bins", N_BINS as f64),
        ];
        let size = setup.n_classes() * N_BINS * size_of::<u32>();
        let usage = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        Ok(Self {
            pass: Pass::new(
                setup.gpu,
                "metrics: percentile of flip",
                &[HISTOGRAM, setup.classes_wgsl()],
                &overrides,
            )?,
            counts: storage(setup.gpu, "a histogram", size, usage)?,
        })
    }

    pub fn record(
        &self,
        recording: &mut Recording,
        references: &References,
        map: &wgpu::Buffer,
    ) -> Result<CopiedHistogram, GpuError> {
        recording.encoder.clear_buffer(&self.counts, 0, None);
        let mut invocation = self.pass.bind("map", map).bind("counts", &self.counts);
        if let Some(classes) = &references.classes {
            invocation = invocation.bind("classes", classes);
        }
        recording.dispatch(invocation, references.linear.extent())?;
        Ok(CopiedHistogram(recording.copy(&self.counts)))
    }
}

impl CopiedHistogram {
    /// Over all pixels and over each mask, given how many pixels there are of each class; NaN where there are none.
    pub fn percentiles_95(
        self,
        readback: &Readback,
        n_pixels: &ByClass<f64>,
        knows_classes: bool,
    ) -> Result<ByMask<f64>, GpuError> {
        let bytes = readback.bytes(self.0)?;
        let (bins, _) = bytes.as_chunks::<4>();
        let by_class: Vec<Vec<u32>> = bins
            .chunks_exact(N_BINS)
            .map(|bins| bins.iter().map(|count| u32::from_le_bytes(*count)).collect())
            .collect();
        Ok(array::from_fn(|place| {
            let is_counted = |class: &usize| counts(place, if knows_classes { *class } else { 0 });
            let mut all = vec![0.0; N_BINS];
            for class in (0..by_class.len()).filter(is_counted) {
                all.iter_mut()
                    .zip(&by_class[class])
                    .for_each(|(sum, count)| *sum += f64::from(*count));
            }
            let n: f64 = (0..N_CLASSES)
                .filter(|class| counts(place, *class))
                .map(|class| n_pixels[class])
                .sum();
            percentile_95(&all, n)
        }))
    }
}

/// Of `n` values, of which those that are not 0 are in bins; linear between the two order statistics around it.
fn percentile_95(bins: &[f64], n: f64) -> f64 {
    if n == 0.0 {
        return f64::NAN;
    }
    let rank = 0.95 * (n - 1.0);
    let [below, above] = [rank.floor(), rank.ceil()].map(|rank| order_statistic(bins, n, rank));
    below + (above - below) * rank.fract()
}

/// The value of this rank, as if those of a bin were spread over it evenly.
fn order_statistic(bins: &[f64], n: f64, rank: f64) -> f64 {
    let mut before = n - bins.iter().sum::<f64>();
    if rank < before {
        return 0.0;
    }
    for (bin, count) in bins.iter().enumerate() {
        if rank < before + count {
            return (bin as f64 + (rank - before + 0.5) / count) / N_BINS as f64;
        }
        before += count;
    }
    1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_lie_within_a_bin_of_the_exact_ones() {
        let values: Vec<f64> = (0..777_u32)
            .map(|i| f64::from(i % 500) / 777.0)
            .map(|x| x * x)
            .collect();
        let mut bins = vec![0.0; N_BINS];
        for value in values.iter().filter(|value| **value > 0.0) {
            bins[(value * N_BINS as f64) as usize] += 1.0;
        }
        let mut sorted = values;
        sorted.sort_by(f64::total_cmp);
        let exact = super::super::super::summary::percentile(&sorted, 0.95);
        let found = percentile_95(&bins, sorted.len() as f64);
        assert!((found - exact).abs() < 1.0 / N_BINS as f64, "{found}, not {exact}");
    }

    #[test]
    fn equal_images_have_a_percentile_of_zero_and_none_have_none() {
        assert_eq!(percentile_95(&[0.0; N_BINS], 100.0), 0.0);
        assert!(percentile_95(&[0.0; N_BINS], 0.0).is_nan());
    }
}
