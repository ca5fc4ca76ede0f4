//! Whether a result is good enough: rules from the user's repository, held against a line's history. Pure: knows neither
//! SQL nor HTTP, so that `ci run` judges alike with a service and without.

pub mod change;
mod judge;
mod rules;

pub use judge::{
    Approved, ChangeState, Check, Finding, Kind, KnownChange, Line, Outcome, Past, of_repeats, overall, worst_frames,
};
pub use rules::{ChangeRule, Checks, Rule, Rules, RulesError, Tolerance, matches};

use crate::metrics::{Better, Metric};

/// Which way a metric improves, as far as it is known here: times of all kinds are better when lower.
pub fn better(metric: &str) -> Option<Better> {
    match metric.parse::<Metric>() {
        Ok(metric) => Some(metric.info().better),
        Err(_) if metric.ends_with("_ms") || metric.ends_with("_s") || metric == "latency" => Some(Better::Lower),
        Err(_) if metric == "throughput" => Some(Better::Higher),
        Err(_) => None,
    }
}
