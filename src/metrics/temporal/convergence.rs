//! `converge_frames`: how soon after a reset PSNR stays where it is going to be.

use super::super::{
    Metric, Value,
    mask::{ByMask, place},
    quantity::{Domain, Quantity, Sums},
    squared_error::psnr_db,
};
use super::LateValue;

/// How long after a reset an image counts as converged.
const CONVERGED_AFTER: usize = 32;
/// How far from the PSNR that it has then, in dB.
const CONVERGED_WITHIN_DB: f64 = 0.5;

/// PSNR of every frame, and whether it was a reset.
#[derive(Debug, Default)]
pub struct Convergence(Vec<(ByMask<f64>, bool)>);

impl Convergence {
    /// Adds the next frame; NaN where no pixel counts.
    pub fn add(&mut self, squared_errors: &ByMask<Sums>, is_reset: bool) {
        let psnr_db = squared_errors.map(|sums| psnr_db(sums.mean(), Domain::Display.peak()));
        self.0.push((psnr_db, is_reset));
    }

    /// One value a metric and reset that is followed by enough frames, stored with the reset.
    pub fn values(&self, metrics: &[Metric]) -> Vec<LateValue> {
        let metrics = metrics
            .iter()
            .filter(|metric| metric.definition().quantity == Quantity::Convergence);
        metrics.flat_map(|metric| self.of(*metric)).collect()
    }

    fn of(&self, metric: Metric) -> Vec<LateValue> {
        let place = place(metric.mask());
        let resets = self.0.iter().enumerate().filter(|(_, (_, reset))| *reset);
        let value = |(frame, _): (usize, &(ByMask<f64>, bool))| {
            let stretch = self.0.get(frame..=frame + CONVERGED_AFTER)?;
            if stretch[1..].iter().any(|(_, reset)| *reset) {
                return None;
            }
            let (last, _) = stretch[CONVERGED_AFTER];
            let last = last[place];
            // Two infinities are near each other as well.
            let near =
                |(db, _): &(ByMask<f64>, bool)| db[place] == last || (db[place] - last).abs() <= CONVERGED_WITHIN_DB;
            let n_frames = stretch
                .iter()
                .rposition(|frame| !near(frame))
                .map_or(0, |away| away + 1);
            Some(LateValue {
                frame,
                id: metric.id(),
                value: Value(n_frames as f64),
            })
        };
        resets.filter_map(value).collect()
    }
}
