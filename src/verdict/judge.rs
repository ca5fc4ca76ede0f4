//! One metric of one line held against its rules.
//!
//! What cannot be told is not a failure: a line without an approved result, or whose approved results were made in other
//! environments, is `unknown` and says so.

mod level;

use super::{Checks, Rules};
use crate::{
    metrics::{Better, Value},
    run::report::FrameReport,
    statistics::median,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// What became of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It holds.
    Ok,
    /// It could not be told: no baseline, too short a history, another environment.
    Unknown,
    /// It does not hold.
    Regression,
}

/// What kind of check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Against an absolute limit.
    Limit,
    /// Against the approved results.
    Baseline,
    /// Against the line's own history.
    Change,
    /// Whether results come at all.
    NoData,
}

impl Kind {
    /// As the API writes it.
    pub fn id(self) -> &'static str {
        match self {
            Self::Limit => "limit",
            Self::Baseline => "baseline",
            Self::Change => "change",
            Self::NoData => "no_data",
        }
    }
}

/// A result that was before.
#[derive(Clone, Debug, PartialEq)]
pub struct Past {
    /// Its reports, oldest first: several where a commit was measured again.
    pub report_ids: Vec<i64>,
    /// Their commit.
    pub commit: Option<String>,
    /// Their branch.
    pub branch: Option<String>,
    /// The value, by [`of_repeats`].
    pub value: f64,
    /// Version of the metric.
    pub version: u32,
}

impl Past {
    /// The report that is named: the first, which stays the same whatever is measured again.
    pub fn report_id(&self) -> i64 {
        self.report_ids.first().copied().unwrap_or_default()
    }
}

/// The value of repeats of one measurement: their median, or not a number where one of them is none.
pub fn of_repeats(values: &[f64]) -> f64 {
    match values.iter().any(|value| value.is_nan()) {
        true => f64::NAN,
        false => median(values),
    }
}

/// What people said of a line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Approved {
    /// Approved values of the same metric version.
    pub values: Vec<f64>,
    /// The approved reports; changes up to the last of them in a history are accepted there.
    pub report_ids: Vec<i64>,
    /// Their commits, which count wherever else they were measured.
    pub commits: BTreeSet<String>,
    /// Changes that there are or were alerts of on the branch.
    pub changes: Vec<KnownChange>,
    /// There are approved results of the same system and sequence, but of other environments only.
    pub elsewhere: bool,
}

/// A change that there is or was an alert of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownChange {
    /// The first report that was bad, as far as was known.
    pub report_id: i64,
    /// What became of it.
    pub state: ChangeState,
    /// How large it was.
    pub effect: Option<f64>,
}

/// What became of a change's alert.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangeState {
    /// It is open.
    Open,
    /// It was dismissed: other changes go first.
    Dismissed,
    /// An approval closed it.
    Approved,
    /// It closed because the line was good again.
    Closed,
}

/// A metric of a line: what is judged and what it is judged by.
#[derive(Clone, Debug)]
pub struct Line<'a> {
    /// The line.
    pub series_id: i64,
    /// Name of its sequence.
    pub sequence: &'a str,
    /// Its preset or system.
    pub recipe: &'a str,
    /// The metric's id.
    pub metric: &'a str,
    /// Values of this run, one a repeat; what is judged is [`of_repeats`] them.
    pub values: &'a [f64],
    /// Version of the metric in this run.
    pub version: u32,
    /// A report of this run, where it is stored.
    pub report_id: Option<i64>,
    /// The branch that is judged.
    pub branch: Option<&'a str>,
    /// Results of the branch and its past, oldest first, this run's included where they are stored.
    pub history: &'a [Past],
    /// What was approved.
    pub approved: &'a Approved,
}

/// What was found, as far as it applies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Finding {
    /// The value judged: the median of the repeats, or NaN where one of them is.
    pub value: Option<Value>,
    /// What it was held against.
    pub limit: Option<Value>,
    /// How far the value lies from what was before or approved; its sign is the value's change.
    pub effect: Option<Value>,
    /// Lower end of the effect's 95 % interval.
    pub effect_low: Option<Value>,
    /// Upper end of the effect's 95 % interval.
    pub effect_high: Option<Value>,
    /// The first report that is bad.
    pub first_bad_report: Option<i64>,
    /// Its commit.
    pub first_bad_commit: Option<String>,
    /// The last report that was good.
    pub last_good_report: Option<i64>,
    /// Its commit.
    pub last_good_commit: Option<String>,
    /// Frames of the judged report that are worst, worst first.
    pub worst_frames: Vec<usize>,
}

/// A check and its outcome.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Check {
    /// The line; none where nothing is stored.
    pub series_id: Option<i64>,
    /// Name of its sequence.
    pub sequence: String,
    /// Its preset or system.
    pub recipe: String,
    /// The metric's id.
    pub metric: String,
    /// What kind of check.
    pub kind: Kind,
    /// What became of it.
    pub outcome: Outcome,
    /// In words.
    pub detail: String,
    /// In numbers.
    pub finding: Finding,
}

/// The outcome of a whole run: a regression if there is any, else unknown if anything is.
pub fn overall(checks: &[Check]) -> Outcome {
    checks
        .iter()
        .map(|check| check.outcome)
        .max()
        .unwrap_or(Outcome::Unknown)
}

/// The frames with the worst values of a metric, worst first, at most three; none of a metric of unknown direction.
pub fn worst_frames(frames: &[FrameReport], metric: &str, better: Option<Better>) -> Vec<usize> {
    let Some(better) = better else { return Vec::new() };
    let mut known: Vec<(usize, f64)> = frames
        .iter()
        .filter(|frame| !frame.warmup)
        .filter_map(|frame| Some((frame.index, frame.metrics.get(metric)?.0)))
        .collect();
    let badness = |value: f64| match better {
        _ if value.is_nan() => f64::INFINITY,
        Better::Higher => -value,
        Better::Lower => value,
    };
    known.sort_by(|a, b| badness(b.1).total_cmp(&badness(a.1)));
    known.into_iter().take(3).map(|(index, _)| index).collect()
}

impl Rules {
    /// Every check that the rules ask of a metric of a line.
    pub fn judge(&self, line: &Line) -> Vec<Check> {
        let checks = self.checks(line.sequence, line.recipe, line.metric);
        let better = checks.better.or_else(|| super::better(line.metric));
        let judge = Judge {
            line,
            better,
            value: of_repeats(line.values),
        };
        let mut found = Vec::new();
        if checks.min.is_some() || checks.max.is_some() {
            found.push(judge.limits(&checks));
        }
        if let Some(tolerance) = checks.baseline {
            found.push(judge.baseline(tolerance));
        }
        if let Some(rule) = &checks.change {
            found.push(judge.change(rule));
        }
        found
    }

    /// A check that could not be told for each metric that is asked of a line by its full name and was not measured: whoever stops
    /// measuring must not pass.
    pub fn unmeasured(
        &self,
        series_id: Option<i64>,
        sequence: &str,
        recipe: &str,
        measured: &BTreeSet<String>,
    ) -> Vec<Check> {
        let named = self.rules.iter().map(|rule| rule.metric.as_str());
        let named: BTreeSet<&str> = named.filter(|metric| !metric.contains(['*', '?'])).collect();
        let missing = named.into_iter().filter(|metric| !measured.contains(*metric));
        let check = |metric: &str| {
            let asked = self.checks(sequence, recipe, metric);
            let kind = match asked {
                Checks {
                    min: None,
                    max: None,
                    baseline: None,
                    change: None,
                    ..
                } => return None,
                Checks {
                    min: None,
                    max: None,
                    baseline: None,
                    ..
                } => Kind::Change,
                Checks {
                    min: None, max: None, ..
                } => Kind::Baseline,
                _ => Kind::Limit,
            };
            Some(Check {
                series_id,
                sequence: sequence.to_owned(),
                recipe: recipe.to_owned(),
                metric: metric.to_owned(),
                kind,
                outcome: Outcome::Unknown,
                detail: "was not measured, or in warm-up only; measure it, or ask for it where it is".to_owned(),
                finding: Finding::default(),
            })
        };
        missing.filter_map(check).collect()
    }
}

struct Judge<'a> {
    line: &'a Line<'a>,
    better: Option<Better>,
    value: f64,
}

impl Judge<'_> {
    fn check(&self, kind: Kind, outcome: Outcome, detail: String, finding: Finding) -> Check {
        Check {
            series_id: (self.line.series_id > 0).then_some(self.line.series_id),
            sequence: self.line.sequence.to_owned(),
            recipe: self.line.recipe.to_owned(),
            metric: self.line.metric.to_owned(),
            kind,
            outcome,
            detail,
            finding: Finding {
                value: Some(Value(self.value)),
                ..finding
            },
        }
    }

    /// Not a number is never good enough.
    fn limits(&self, checks: &Checks) -> Check {
        let breaks = |value: f64| {
            let below = checks
                .min
                .filter(|min| value.is_nan() || value < *min)
                .map(|min| (min, "below the least allowed,"));
            below.or_else(|| {
                checks
                    .max
                    .filter(|max| value.is_nan() || value > *max)
                    .map(|max| (max, "above the most allowed,"))
            })
        };
        let Some((limit, words)) = breaks(self.value) else {
            let detail = format!("{} is within its limits", Value(self.value));
            return self.check(Kind::Limit, Outcome::Ok, detail, Finding::default());
        };
        let finding = Finding {
            limit: Some(Value(limit)),
            effect: Some(Value(self.value - limit)).filter(|effect| !effect.0.is_nan()),
            ..self.since(|value| breaks(value).is_some())
        };
        let detail = match self.value.is_nan() {
            true => format!("not a number, in some frame at least, where the limit is {limit}"),
            false => format!("{} is {words} {limit}", Value(self.value)),
        };
        self.check(Kind::Limit, Outcome::Regression, detail, finding)
    }

    fn baseline(&self, tolerance: super::Tolerance) -> Check {
        let unknown =
            |detail: &str| self.check(Kind::Baseline, Outcome::Unknown, detail.to_owned(), Finding::default());
        let approved = self.line.approved.values.iter().copied();
        let approved: Vec<f64> = approved.filter(|value| !value.is_nan()).collect();
        if approved.is_empty() {
            return unknown(match self.line.approved {
                Approved { elsewhere: true, .. } => {
                    "environment differs: results are approved in other environments only"
                }
                Approved { values, .. } if values.is_empty() => {
                    "no result of this line, which is one of the same sequence, recipe, settings and metric version, is approved yet"
                }
                _ => "what is approved is not a number",
            });
        }
        let Some(better) = self.better else {
            return unknown("which way the metric improves is not known; say `better` in its rule");
        };
        let (worst, bound) = match better {
            Better::Higher => {
                let worst = approved.iter().copied().fold(f64::INFINITY, f64::min);
                (worst, worst - tolerance.of(worst))
            }
            Better::Lower => {
                let worst = approved.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                (worst, worst + tolerance.of(worst))
            }
        };
        // An infinite share of infinity is no number; equal infinities are equal.
        let bound = if worst.is_infinite() { worst } else { bound };
        let breaks = |value: f64| match better {
            _ if value.is_nan() => true,
            Better::Higher => value < bound,
            Better::Lower => value > bound,
        };
        let finding = Finding {
            limit: Some(Value(bound)),
            effect: Some(Value(self.value - worst)).filter(|effect| !effect.0.is_nan()),
            ..Finding::default()
        };
        if !breaks(self.value) {
            let detail = format!("{} is no worse than approved ({})", Value(self.value), Value(worst));
            return self.check(Kind::Baseline, Outcome::Ok, detail, finding);
        }
        let detail = match self.value.is_nan() {
            true => format!(
                "not a number, in some frame at least, where {} is approved",
                Value(worst)
            ),
            false => format!("{} is worse than the approved {}", Value(self.value), Value(worst)),
        };
        let finding = Finding {
            limit: finding.limit,
            effect: finding.effect,
            ..self.since(breaks)
        };
        self.check(Kind::Baseline, Outcome::Regression, detail, finding)
    }

    /// First bad and last good: the run of bad results up to this one, which is bad whatever other repeats of its commit were.
    fn since(&self, is_bad: impl Fn(f64) -> bool) -> Finding {
        let history = self.comparable();
        let this = self.line.report_id.and_then(|id| self.place_of(id));
        let history = &history[..this.map_or(history.len(), |place| place + 1)];
        let n_bad = history
            .iter()
            .rev()
            .take_while(|past| is_bad(past.value))
            .count()
            .max(1);
        let first_bad = history.len().checked_sub(n_bad).and_then(|at| history.get(at));
        let last_good = history.len().checked_sub(n_bad + 1).and_then(|at| history.get(at));
        named(first_bad, last_good)
    }

    /// Results of the metric's version of this run, back to the last other one.
    fn comparable(&self) -> &[Past] {
        let history = self.line.history;
        let n_equal = history
            .iter()
            .rev()
            .take_while(|past| past.version == self.line.version)
            .count();
        &history[history.len() - n_equal..]
    }
}

/// The reports and commits on either side.
fn named(first_bad: Option<&Past>, last_good: Option<&Past>) -> Finding {
    Finding {
        first_bad_report: first_bad.map(Past::report_id),
        first_bad_commit: first_bad.and_then(|past| past.commit.clone()),
        last_good_report: last_good.map(Past::report_id),
        last_good_commit: last_good.and_then(|past| past.commit.clone()),
        ..Finding::default()
    }
}

#[cfg(test)]
mod tests;
