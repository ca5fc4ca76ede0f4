//! Image and sequence metrics, defined exactly in `docs/metrics.md`. Knows images and display transforms; names no
//! wgpu except in `metrics::gpu`, no SQL, no HTTP.
//!
//! `R` is the reference, `T` the test image. [`Metric`] is the closed list; [`Metric::info`] says what each number
//! means; [`evaluate`] computes any set of them for one frame in f64; [`Summary`] condenses a sequence.

use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, fmt, str::FromStr};

pub mod display;
mod summary;

pub use display::{Display, Tonemap};
pub use summary::Summary;

/// Which way a metric improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Better {
    /// Larger is better.
    Higher,
    /// Smaller is better.
    Lower,
}

/// What a metric's numbers mean. `version` rises whenever they change; only equal versions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MetricInfo {
    /// Stored id; never changes.
    pub id: &'static str,
    /// `dB`, or empty for a pure number.
    pub unit: &'static str,
    /// Which way it improves.
    pub better: Better,
    /// Raised when the numbers change.
    pub version: u32,
    /// One line for people.
    pub description: &'static str,
}

/// A metric's value for one frame. JSON has no infinities: they are the strings `"inf"`, `"-inf"` and `"nan"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value(pub f64);

/// The values of one frame, by metric id.
pub type Values = BTreeMap<&'static str, Value>;
