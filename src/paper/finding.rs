//! What an experiment found: tables, curves, pictures, and for each published ordering whether it holds here.

use crate::metrics::Value;
use serde::{Serialize, Serializer};

/// The outcome of one experiment.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// Stable id, such as `thesis.pipe`.
    pub id: &'static str,
    /// What it is about.
    pub title: &'static str,
    /// Publication, table or figure.
    pub source: &'static str,
    /// Scene, frames and settings here, and how they differ from those published.
    pub setup: String,
    /// Numbers beside each other.
    pub tables: Vec<Table>,
    /// Curves.
    pub charts: Vec<Chart>,
    /// Images beside each other.
    pub strips: Vec<Strip>,
    /// What the publication says is better than what, and what was measured.
    pub orderings: Vec<Ordering>,
}

/// Numbers of several systems.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// What stands above it.
    pub caption: String,
    /// Names of the columns after the first.
    pub columns: Vec<String>,
    /// Name of the row, and a cell a column.
    pub rows: Vec<(String, Vec<Cell>)>,
}

/// A number here, and the one published for the like of it.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Cell {
    /// Measured here; none where only the publication has it.
    #[serde(serialize_with = "some_value")]
    pub ours: Option<f64>,
    /// As printed; none where the publication has none.
    #[serde(serialize_with = "some_value")]
    pub published: Option<f64>,
}

/// Curves over frames or the like.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// File name without its ending.
    pub name: String,
    /// What stands above it.
    pub caption: String,
    /// What the x axis counts.
    pub x: String,
    /// What the y axis measures, with its unit.
    pub y: String,
    /// Name and points of each curve; points that are not finite are left out of the drawing, and null in JSON.
    pub curves: Vec<(String, Vec<[f64; 2]>)>,
}

/// The same crop of several images, magnified.
#[derive(Clone, Debug, Serialize)]
pub struct Strip {
    /// File name without its ending.
    pub name: String,
    /// What stands under it.
    pub caption: String,
    /// Whose each image is, from left to right.
    pub labels: Vec<String>,
    /// PNG.
    #[serde(skip)]
    pub png: Vec<u8>,
}

/// A published ordering: `entries` stand in it from best to worst.
#[derive(Clone, Debug)]
pub struct Ordering {
    /// In words.
    pub claim: String,
    /// Which number decides, with its unit.
    pub measure: &'static str,
    /// Whether larger numbers are better.
    pub higher_is_better: bool,
    /// Differences up to this are no differences.
    pub tie: f64,
    /// From best to worst as published. Equal published numbers claim nothing of each other.
    pub entries: Vec<Entry>,
    /// The same under other conditions, to find out what it hangs on. Shown only where it does not hold.
    pub trials: Vec<Trial>,
    /// Why it does not hold here, as far as that was found out. Shown only where it does not.
    pub reason: &'static str,
}

/// A system in an ordering.
#[derive(Clone, Debug, Serialize)]
pub struct Entry {
    /// Name of the system.
    pub system: String,
    /// Number here.
    #[serde(serialize_with = "value")]
    pub ours: f64,
    /// Number there; none where the publication shows pictures or says it in words.
    #[serde(serialize_with = "some_value")]
    pub published: Option<f64>,
}

/// An ordering's entries where one thing is different.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// What is different.
    pub change: String,
    /// The same systems in the same order.
    pub entries: Vec<Entry>,
}

/// Whether an ordering holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every pair stands as published.
    Holds,
    /// No pair stands the other way round, but some are too close to call.
    Close,
    /// Some pair stands the other way round.
    Fails,
}

impl Ordering {
    /// Whether it holds.
    pub fn verdict(&self) -> Verdict {
        self.verdict_of(&self.entries)
    }

    /// Whether it holds of other numbers of its systems.
    pub fn verdict_of(&self, entries: &[Entry]) -> Verdict {
        if !self.reversed(entries).is_empty() {
            return Verdict::Fails;
        }
        match claimed(entries).all(|(a, b)| self.lead(entries, a, b) > self.tie) {
            true => Verdict::Holds,
            false => Verdict::Close,
        }
    }

    /// Indices of entries `(a, b)` of which the publication has `a` ahead and here `b` is.
    pub fn reversed(&self, entries: &[Entry]) -> Vec<(usize, usize)> {
        claimed(entries)
            .filter(|&(a, b)| self.lead(entries, a, b) < -self.tie)
            .collect()
    }

    /// How many pairs the publication has an order of.
    pub fn n_claimed(&self) -> usize {
        claimed(&self.entries).count()
    }

    /// How far `a` is ahead of `b`. A NaN is behind everything.
    fn lead(&self, entries: &[Entry], a: usize, b: usize) -> f64 {
        let rank = |index: usize| {
            let value: f64 = entries[index].ours;
            let value = if self.higher_is_better { value } else { -value };
            if value.is_nan() { f64::NEG_INFINITY } else { value }
        };
        let (a, b) = (rank(a), rank(b));
        if a == b { 0.0 } else { a - b }
    }
}

/// Pairs of which the publication says which is ahead.
fn claimed(entries: &[Entry]) -> impl Iterator<Item = (usize, usize)> {
    let n = entries.len();
    let pairs = (0..n).flat_map(move |a| (a + 1..n).map(move |b| (a, b)));
    pairs.filter(|&(a, b)| {
        let published = |index: usize| entries[index].published;
        published(a).is_none() || published(a) != published(b)
    })
}

/// With the verdict, which readers of JSON need not work out themselves.
impl Serialize for Ordering {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Tried<'a> {
            #[serde(flatten)]
            trial: &'a Trial,
            verdict: Verdict,
        }
        #[derive(Serialize)]
        struct Shown<'a> {
            claim: &'a str,
            measure: &'a str,
            higher_is_better: bool,
            tie: f64,
            verdict: Verdict,
            entries: &'a [Entry],
            trials: Vec<Tried<'a>>,
            reason: Option<&'a str>,
        }
        let tried = |trial| Tried {
            trial,
            verdict: self.verdict_of(&trial.entries),
        };
        let verdict = self.verdict();
        Shown {
            claim: &self.claim,
            measure: self.measure,
            higher_is_better: self.higher_is_better,
            tie: self.tie,
            verdict,
            entries: &self.entries,
            trials: self.trials.iter().map(tried).collect(),
            reason: (verdict == Verdict::Fails && !self.reason.is_empty()).then_some(self.reason),
        }
        .serialize(serializer)
    }
}

fn value<S: Serializer>(number: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    Value(*number).serialize(serializer)
}

fn some_value<S: Serializer>(number: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    number.map(Value).serialize(serializer)
}

impl Cell {
    /// Measured here, with what was published.
    pub fn beside(ours: f64, published: f64) -> Self {
        Self {
            ours: Some(ours),
            published: Some(published),
        }
    }

    /// Measured here only.
    pub fn ours(ours: f64) -> Self {
        Self {
            ours: Some(ours),
            published: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ordering(higher_is_better: bool, entries: &[(f64, Option<f64>)]) -> Ordering {
        let entry = |&(ours, published): &(f64, Option<f64>)| Entry {
            system: String::new(),
            ours,
            published,
        };
        Ordering {
            claim: String::new(),
            measure: "",
            higher_is_better,
            tie: 0.1,
            entries: entries.iter().map(entry).collect(),
            trials: Vec::new(),
            reason: "it was so",
        }
    }

    #[test]
    fn what_stands_as_published_holds() {
        let it = ordering(true, &[(30.0, Some(40.0)), (29.0, Some(35.0)), (20.0, Some(34.0))]);
        assert_eq!(it.verdict(), Verdict::Holds);
        let it = ordering(false, &[(1.0, None), (2.0, None)]);
        assert_eq!(it.verdict(), Verdict::Holds);
    }

    #[test]
    fn what_is_turned_round_fails_and_is_named() {
        let it = ordering(true, &[(30.0, Some(40.0)), (20.0, Some(35.0)), (29.0, Some(34.0))]);
        assert_eq!((it.verdict(), it.reversed(&it.entries)), (Verdict::Fails, vec![(1, 2)]));
        let it = ordering(false, &[(2.0, None), (1.0, None)]);
        assert_eq!(it.reversed(&it.entries), [(0, 1)]);
    }

    #[test]
    fn what_is_within_the_tie_is_close() {
        let it = ordering(true, &[(30.0, Some(40.0)), (30.05, Some(35.0))]);
        assert_eq!(it.verdict(), Verdict::Close);
    }

    #[test]
    fn equal_published_numbers_claim_nothing() {
        let it = ordering(true, &[(29.0, Some(1.0)), (30.0, Some(1.0)), (20.0, Some(0.9))]);
        assert_eq!(it.verdict(), Verdict::Holds);
    }

    #[test]
    fn a_nan_never_wins() {
        let it = ordering(false, &[(f64::NAN, None), (1.0, None)]);
        assert_eq!(it.verdict(), Verdict::Fails);
        let it = ordering(true, &[(f64::INFINITY, None), (f64::INFINITY, None)]);
        assert_eq!(it.verdict(), Verdict::Close);
    }

    #[test]
    fn json_has_the_verdict_and_a_reason_only_where_one_is_needed() {
        let json = |entries: &[(f64, Option<f64>)]| serde_json::to_value(ordering(true, entries)).unwrap();
        let fails = json(&[(f64::NAN, None), (f64::INFINITY, None)]);
        assert_eq!(
            (&fails["verdict"], &fails["reason"]),
            (&"fails".into(), &"it was so".into())
        );
        assert_eq!(fails["entries"][0]["ours"], "nan");
        assert_eq!(fails["entries"][1]["ours"], "inf");
        let holds = json(&[(2.0, None), (1.0, None)]);
        assert_eq!(
            (&holds["verdict"], &holds["reason"]),
            (&"holds".into(), &serde_json::Value::Null)
        );
    }
}
