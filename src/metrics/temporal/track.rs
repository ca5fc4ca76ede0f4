//! What one preset has to remember from frame to frame.

use super::{
    super::{
        FrameScores, Metric, MetricError, Value,
        mask::{counts, place},
        picture::Picture,
        plane::Plane,
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
            let classes = classes.filter(|_| *place > 0);
            let is_counted = classes.map(|classes| |i: usize| counts(*place, classes.all()[i].into()));
            deviation.add(reference, luma, is_counted);
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

/// The luma error of each pixel over time: mean and sum of squared deviations, after Welford, "Note on a Method for
/// Calculating Corrected Sums of Squares and Products", 1962; and how often it counted.
#[derive(Default)]
struct Deviation {
    /// The last frame added.
    last: usize,
    /// Mean, and sum of squared deviations; none before the first frame.
    moments: Option<[Plane; 2]>,
    /// Of the frames added, how many each pixel was left out of; empty while there are none.
    missed: Vec<u32>,
    n_frames: u32,
}

impl Deviation {
    /// Adds a frame: all pixels of it, or those that `is_counted`.
    fn add(&mut self, reference: &Reference, test: &[f64], is_counted: Option<impl Fn(usize) -> bool + Sync>) {
        let [means, squares] = self.moments.get_or_insert_with(|| {
            let mut planes = [(); 2].map(|()| reference.new_plane());
            planes.iter_mut().for_each(|plane| plane.fill(0.0));
            planes
        });
        self.n_frames += 1;
        let (n_frames, reference) = (self.n_frames, &reference.luma()[..]);
        let moments = (means.par_iter_mut(), squares.par_iter_mut()).into_par_iter();
        let moments = moments.with_min_len(4096).enumerate();
        let Some(is_counted) = is_counted else {
            moments.for_each(|(i, moments)| update(moments, test[i] - reference[i], n_frames));
            return;
        };
        self.missed.resize(test.len(), 0);
        moments
            .zip(&mut self.missed)
            .for_each(|((i, moments), missed)| match is_counted(i) {
                true => update(moments, test[i] - reference[i], n_frames - *missed),
                false => *missed += 1,
            });
    }

    /// Mean of the population's standard deviation over the pixels that counted more than once. `None` where none did.
    fn mean(&self) -> Option<f64> {
        let missed = self.missed.iter().copied().chain(std::iter::repeat(0));
        let counts = missed.map(|missed| self.n_frames - missed);
        let [_, squares] = self.moments.as_ref()?;
        let counted = squares.iter().zip(counts).filter(|(_, n)| *n > 1);
        let deviations = counted.map(|(squares, n)| (squares / f64::from(n)).sqrt());
        let (sum, n) = deviations.fold((0.0, 0_usize), |(sum, n), deviation| (sum + deviation, n + 1));
        (n > 0).then(|| sum / n as f64)
    }
}

/// Adds the error of a pixel's `n`th frame to its mean and its sum of squared deviations.
fn update((mean, squares): (&mut f64, &mut f64), error: f64, n: u32) {
    let away = error - *mean;
    *mean += away / f64::from(n);
    *squares += away * (error - *mean);
}
