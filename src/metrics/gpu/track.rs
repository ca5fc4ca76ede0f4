//! What one preset's frames come to, as the device's sums arrive: the twin of [`super::super::Track`].

use super::{
    super::{
        FrameScores, LateValue, Metric, Value,
        mask::place,
        quantity::{Domain, Quantity, Sums, quantities},
        reference::values,
        temporal::Convergence,
    },
    Recorded,
};
use crate::gpu::{GpuError, Readback};

/// Scores one preset's frames in the order they were recorded.
#[derive(Debug)]
pub struct DeviceTrack {
    metrics: Vec<Metric>,
    n_frames: usize,
    was_finite: bool,
    convergence: Convergence,
    /// The last value of each place that has one, and its frame.
    deviations: Vec<(usize, usize, f64)>,
}

impl DeviceTrack {
    /// Of a preset that has not seen a frame.
    pub fn new(metrics: &[Metric]) -> Self {
        Self {
            metrics: metrics.to_vec(),
            n_frames: 0,
            was_finite: true,
            convergence: Convergence::default(),
            deviations: Vec::new(),
        }
    }

    /// The scores of the next frame, from a read-back whose submission is done.
    pub fn score(&mut self, recorded: &Recorded, readback: &Readback) -> Result<FrameScores, GpuError> {
        let mut measured = recorded.read(readback)?;
        let is_finite = measured.n_non_finite == 0;
        let follows_finite = is_finite && self.was_finite;
        for (quantity, sums) in &mut measured.quantities {
            let is_known = match quantity {
                Quantity::Change(_) => follows_finite,
                _ => is_finite,
            };
            if !is_known {
                // Drivers may compute anything but NaN from a NaN, so it is told from the count.
                *sums = Sums::unknown();
            }
        }
        if quantities(&self.metrics).contains(&Quantity::Convergence) {
            let errors = &measured.quantities[&Quantity::SquaredError(Domain::Display)];
            self.convergence.add(errors, !recorded.follows);
        }
        for (place, deviation) in measured.deviations {
            self.deviations.retain(|(known, ..)| *known != place);
            self.deviations
                .extend(deviation.map(|value| (place, self.n_frames, value)));
        }
        self.was_finite = is_finite;
        self.n_frames += 1;
        let mut values = values(&self.metrics, &measured.quantities, recorded.knows_classes);
        if is_finite {
            values.extend(recorded.exposures());
        }
        Ok(FrameScores {
            values,
            non_finite_pixels: measured.n_non_finite,
        })
    }

    /// What only the whole sequence tells.
    pub fn finish(self) -> Vec<LateValue> {
        let mut values = self.convergence.values(&self.metrics);
        let deviations = self.metrics.iter().filter_map(|metric| {
            let is_deviation = metric.definition().quantity == Quantity::ErrorDeviation;
            let of_place = |(known, ..): &&(usize, usize, f64)| is_deviation && *known == place(metric.mask());
            let (_, frame, value) = self.deviations.iter().find(of_place)?;
            Some(LateValue {
                frame: *frame,
                id: metric.id(),
                value: Value(*value),
            })
        });
        values.extend(deviations);
        values
    }
}
