//! Oliveros Labrador, "Improved Sampling for Temporal Anti-Aliasing", Lund 2018: tables 4.1 and 5.1 to 5.13.
//!
//! Errors of tables are in steps of 8 bits, as there: MSE is 255² times ours.

mod ghosting;
mod method;
mod published;
mod still;

pub use method::{reference_samples, sharpening};
pub use published::{GHOSTING_TESTS, STATIC_TESTS};

use super::{finding::Entry, lab::Shot, subject::Subject};
use crate::metrics::Metric;

/// A row of a table: what it is called there, the metric, and what that is multiplied by.
struct Row {
    name: &'static str,
    metric: Metric,
    factor: f64,
}

const ROWS: [Row; 5] = [
    Row {
        name: "MSE, 8-bit steps²",
        metric: Metric::MSE,
        factor: 255.0 * 255.0,
    },
    Row {
        name: "RMSD, 8-bit steps",
        metric: Metric::RMSE,
        factor: 255.0,
    },
    Row {
        name: "PSNR, dB",
        metric: Metric::PSNR,
        factor: 1.0,
    },
    Row {
        name: "SNR, dB",
        metric: Metric::SNR,
        factor: 1.0,
    },
    Row {
        name: "SSIM",
        metric: Metric::SSIM,
        factor: 1.0,
    },
];
const METRICS: [Metric; 5] = [Metric::MSE, Metric::RMSE, Metric::PSNR, Metric::SNR, Metric::SSIM];
/// Where in [`ROWS`].
const MSE: usize = 0;
const PSNR: usize = 2;
const SSIM: usize = 4;

/// Decibels and similarities that tell nothing apart.
const TIE_DB: f64 = 0.05;
const TIE_SSIM: f64 = 0.0002;

/// History fills for so many frames before an image is judged (section 4.2.1).
const N_FILLING_FRAMES: usize = 16;

/// A scene that stands still while history fills.
fn still(scene: &'static str) -> Shot {
    Shot {
        n_frames: Some(N_FILLING_FRAMES),
        ..Shot::of(scene).at_rest()
    }
}

/// The columns of every table.
fn systems() -> [Subject; 5] {
    [
        Subject::new("no AA", "none").without_history(),
        Subject::new("FXAA", "fxaa").without_history(),
        Subject::new("SMAA", "smaa").without_history(),
        Subject::new("Uncharted 4", "uncharted4"),
        Subject::new("thesis", "sobel2018"),
    ]
}

/// Entries of system, number here and number there, by the last, best first.
fn ranked<'a>(numbers: impl Iterator<Item = (&'a str, f64, f64)>) -> Vec<Entry> {
    let mut entries: Vec<Entry> = numbers
        .map(|(system, ours, published)| Entry {
            system: system.to_owned(),
            ours,
            published: Some(published),
        })
        .collect();
    entries.sort_by(|a, b| b.published.partial_cmp(&a.published).expect("printed numbers"));
    entries
}
