//! What one preset has to remember from frame to frame.

use super::{
    super::{
        FrameScores, Metric, MetricError, Value,
        mask::{counts, place},
        picture::Picture,
        quantity::{Quantity, quantities},
        reference::Reference,
    },
    Convergence, Past,
};
use rayon::prelude::*;

/// Scores one preset's frames in order.
pub struct Track {
    metrics: Vec<Metric>,
    past: Past,
    n_frames: usize,
    /// Of the pixels of each place of [`super::super::mask::ByMask`] that a metric asks for.
    deviations: Vec<(usize, Deviation)>,
    convergence: Convergence,
}

/// A value of a whole sequence, or of a stretch of it, and the frame that it is stored with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateValue {
    /// Which frame, counted from the first one scored.
    pub frame: usize,
    /// Stored id of the metric.
    pub id: &'static str,
    /// The value.
    pub value: Value,
}

impl Track {
    /// Of a preset that has not seen a frame.
    pub fn new(metrics: &[Metric]) -> Self {
        let places = of(metrics, Quantity::ErrorDeviation).map(|metric| place(metric.mask()));
        Self {
            metrics: metrics.to_vec(),
            past: Past::default(),
            n_frames: 0,
            deviations: places.map(|place| (place, Deviation::default())).collect(),
            convergence: Convergence::default(),
        }
    }

    /// Scores the next frame. A reference that follows no other is a reset. Frames that are not `settled` (warming up) are
    /// left out of what is gathered over the sequence.
    pub fn score(&mut self, reference: &Reference, test: &Picture, settled: bool) -> Result<FrameScores, MetricError> {
        let scores = reference.score(test, &mut self.past)?;
        if settled && !self.deviations.is_empty() {
            self.gather(reference);
        }
        if let (true, Some(errors)) = (
            quantities(&self.metrics).contains(&Quantity::Convergence),
            self.past.squared_errors(),
        ) {
            self.convergence.add(errors, reference.step().is_none());
        }
        self.n_frames += 1;
        Ok(scores)
    }

    fn gather(&mut self, reference: &Reference) {
        let luma = self.past.luma().expect("luma is kept for the deviation of its errors");
        for (place, deviation) in &mut self.deviations {
            let classes = reference.classes();
            if *place > 0 && classes.is_none() {
                continue; // A reset: nobody knows what moves.
            }
            let is_counted = |i: usize| classes.is_none_or(|classes| counts(*place, classes.all()[i].into()));
            deviation.add(reference.luma(), luma, is_counted);
            deviation.last = self.n_frames;
        }
    }

    /// What only the whole sequence tells.
    pub fn finish(self) -> Vec<LateValue> {
        let mut values = self.convergence.values(&self.metrics);
        let deviations = of(&self.metrics, Quantity::ErrorDeviation).zip(&self.deviations);
        values.extend(deviations.filter_map(|(metric, (_, deviation))| {
            Some(LateValue {
                frame: deviation.last,
                id: metric.id(),
                value: Value(deviation.mean()?),
            })
        }));
        values
    }
}

/// The metrics that are made of `quantity`.
fn of(metrics: &[Metric], quantity: Quantity) -> impl Iterator<Item = Metric> {
    metrics
        .iter()
        .copied()
        .filter(move |metric| metric.definition().quantity == quantity)
}

/// The luma error of each pixel over time: how often it counted, mean and sum of squared deviations, after Welford, "Note on
/// a Method for Calculating Corrected Sums of Squares and Products", 1962.
#[derive(Default)]
struct Deviation {
    /// The last frame added.
    last: usize,
    moments: Vec<Moments>,
}

#[derive(Clone, Copy, Default)]
struct Moments {
    n: u32,
    mean: f64,
    squares: f64,
}

impl Deviation {
    fn add(&mut self, reference: &[f64], test: &[f64], is_counted: impl Fn(usize) -> bool + Sync) {
        self.moments.resize(reference.len(), Moments::default());
        let pixels = self.moments.par_iter_mut().with_min_len(4096).enumerate();
        pixels.for_each(|(i, moments)| {
            if is_counted(i) {
                let error = test[i] - reference[i];
                let away = error - moments.mean;
                moments.n += 1;
                moments.mean += away / f64::from(moments.n);
                moments.squares += away * (error - moments.mean);
            }
        });
    }

    /// Mean of the population's standard deviation over the pixels that counted more than once. `None` where none did.
    fn mean(&self) -> Option<f64> {
        let counted = self.moments.iter().filter(|moments| moments.n > 1);
        let deviations = counted.map(|moments| (moments.squares / f64::from(moments.n)).sqrt());
        let (sum, n) = deviations.fold((0.0, 0_usize), |(sum, n), deviation| (sum + deviation, n + 1));
        (n > 0).then(|| sum / n as f64)
    }
}
