//! What one preset has to remember from frame to frame.

use crate::{
    image::Image,
    metrics::{
        Domain, FrameScores, Metric, MetricError, Quantity, Reference, Shown, Value, check_sizes, measure,
        squared_error::{self, psnr_db},
    },
    sequence::frame::Rgb,
};

/// How long after a reset an image counts as converged.
const CONVERGED_AFTER: usize = 32;
/// How far from the PSNR that it has then, in dB.
const CONVERGED_WITHIN_DB: f64 = 0.5;

/// Scores one preset's frames in order.
pub struct Track {
    metrics: Vec<Metric>,
    previous: Option<Shown>,
    n_frames: usize,
    deviation: Deviation,
    /// PSNR of every frame, and whether it was a reset.
    psnr_db: Vec<(f64, bool)>,
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
        Self {
            metrics: metrics.to_vec(),
            previous: None,
            n_frames: 0,
            deviation: Deviation::default(),
            psnr_db: Vec::new(),
        }
    }

    /// Scores the next frame, linear RGB. A reference that follows no other is a reset. Frames that are not `settled`
    /// (warming up) are left out of what is gathered over the sequence.
    pub fn score(
        &mut self,
        reference: &Reference,
        test: &Image<Rgb>,
        settled: bool,
    ) -> Result<FrameScores, MetricError> {
        check_sizes(&self.metrics, reference.shown.extent(), test.extent())?;
        let test = Shown::from_linear(test, reference.display, &self.metrics);
        let step = reference.step.as_ref().zip(self.previous.as_ref());
        let scores = measure(&self.metrics, &reference.shown, &test, step);
        if settled && self.wants(Quantity::ErrorDeviation) {
            self.deviation.add(reference.shown.luma(), test.luma());
            self.deviation.last = self.n_frames;
        }
        if self.wants(Quantity::Convergence) {
            let errors = squared_error::measure(Domain::Display, &reference.shown, &test);
            self.psnr_db
                .push((psnr_db(errors.mean(), 1.0), reference.step.is_none()));
        }
        self.n_frames += 1;
        self.previous = self.metrics.iter().any(|metric| metric.is_temporal()).then_some(test);
        Ok(scores)
    }

    /// What only the whole sequence tells.
    pub fn finish(self) -> Vec<LateValue> {
        let mut values = self.converged();
        if self.deviation.n > 0 {
            values.push(LateValue {
                frame: self.deviation.last,
                id: Metric::FlickerLocal.id(),
                value: Value(self.deviation.mean()),
            });
        }
        values
    }

    fn wants(&self, quantity: Quantity) -> bool {
        let mut wanted = self.metrics.iter().map(|metric| metric.definition().quantity);
        wanted.any(|wanted| wanted == quantity)
    }

    /// One value a reset that is followed by enough frames, stored with the reset.
    fn converged(&self) -> Vec<LateValue> {
        let resets = self.psnr_db.iter().enumerate().filter(|(_, (_, reset))| *reset);
        let value = |(frame, _): (usize, &(f64, bool))| {
            let stretch = self.psnr_db.get(frame..=frame + CONVERGED_AFTER)?;
            if stretch[1..].iter().any(|(_, reset)| *reset) {
                return None;
            }
            let (last, _) = stretch[CONVERGED_AFTER];
            // Two infinities are near each other as well.
            let near = |&(db, _): &(f64, bool)| db == last || (db - last).abs() <= CONVERGED_WITHIN_DB;
            let n_frames = stretch
                .iter()
                .rposition(|frame| !near(frame))
                .map_or(0, |away| away + 1);
            Some(LateValue {
                frame,
                id: Metric::ConvergeFrames.id(),
                value: Value(n_frames as f64),
            })
        };
        resets.filter_map(value).collect()
    }
}

/// The luma error of each pixel over time: mean and sum of squared deviations, after Welford, "Note on a Method for
/// Calculating Corrected Sums of Squares and Products", 1962.
#[derive(Default)]
struct Deviation {
    n: usize,
    /// The last frame added.
    last: usize,
    moments: Vec<[f64; 2]>,
}

impl Deviation {
    fn add(&mut self, reference: &[f64], test: &[f64]) {
        self.moments.resize(reference.len(), [0.0; 2]);
        self.n += 1;
        for ((moments, r), t) in self.moments.iter_mut().zip(reference).zip(test) {
            let [mean, squares] = moments;
            let away = (t - r) - *mean;
            *mean += away / self.n as f64;
            *squares += away * ((t - r) - *mean);
        }
    }

    /// Mean over pixels of the population's standard deviation.
    fn mean(&self) -> f64 {
        let deviations = self.moments.iter().map(|[_, squares]| (squares / self.n as f64).sqrt());
        deviations.sum::<f64>() / self.moments.len() as f64
    }
}
