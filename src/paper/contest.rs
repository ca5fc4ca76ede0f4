//! The common shape of an experiment: a few systems, each on its scene, and a claim about which is ahead in which metric.

use super::{
    PaperError,
    finding::{Cell, Entry, Finding, Ordering, Table},
    lab::{Lab, Shot},
    picture,
    subject::{Outcome, Subject},
};
use crate::metrics::{Better, Metric};

/// Systems that a publication compares in words or pictures.
pub struct Contest {
    pub id: &'static str,
    pub title: &'static str,
    pub source: &'static str,
    /// How the scenes here stand for those published.
    pub setup: &'static str,
    /// From best to worst as published; each on its own shot, most often the same.
    pub entries: Vec<(Shot, Subject)>,
    pub claims: Vec<Claim>,
    /// Metrics that the table shows beside those of the claims.
    pub also: Vec<Metric>,
    /// Show a crop of the last frame of each shot.
    pub pictured: bool,
}

/// What a publication says of the entries.
pub struct Claim {
    text: &'static str,
    metric: Metric,
    /// Differences up to this are none.
    tie: f64,
    /// Indices into the contest's entries, best first.
    order: Vec<usize>,
    /// Why it does not hold, where it does not.
    reason: &'static str,
}

impl Claim {
    /// Entries `order` stand so, best first, by `metric`; differences up to `tie` are none.
    pub fn new(text: &'static str, metric: Metric, tie: f64, order: &[usize]) -> Self {
        Self {
            text,
            metric,
            tie,
            order: order.to_vec(),
            reason: "",
        }
    }

    /// Why it does not hold.
    pub fn because(self, reason: &'static str) -> Self {
        Self { reason, ..self }
    }

    fn ordering(&self, outcomes: &[Outcome]) -> Ordering {
        let entry = |&index: &usize| Entry {
            system: outcomes[index].label.clone(),
            ours: outcomes[index].mean(self.metric),
            published: None,
        };
        Ordering {
            claim: self.text.to_owned(),
            measure: self.metric.id(),
            higher_is_better: self.metric.info().better == Better::Higher,
            tie: self.tie,
            entries: self.order.iter().map(entry).collect(),
            trials: vec![],
            reason: self.reason,
        }
    }
}

impl Contest {
    pub fn run(&self, lab: &Lab<'_>) -> Result<Finding, PaperError> {
        let mut metrics: Vec<Metric> = self.claims.iter().map(|claim| claim.metric).collect();
        metrics.extend(&self.also);
        let mut seen = Vec::new();
        metrics.retain(|metric| {
            !seen.contains(metric) && {
                seen.push(*metric);
                true
            }
        });
        let mut outcomes: Vec<Option<Outcome>> = vec![None; self.entries.len()];
        let mut strips = Vec::new();
        for (index, (shot, _)) in self.entries.iter().enumerate() {
            if outcomes[index].is_some() {
                continue;
            }
            let shared: Vec<usize> = (index..self.entries.len())
                .filter(|&i| self.entries[i].0 == *shot)
                .collect();
            let sequence = lab.bake(shot.clone())?;
            let last = sequence.n_frames() - 1;
            let subjects: Vec<Subject> = shared.iter().map(|&i| self.entries[i].1.clone()).collect();
            let made = lab.run(&sequence, &subjects, &metrics, self.pictured.then_some(last))?;
            if self.pictured {
                let reference = super::lab::reference(&sequence, last)?;
                let shown = made
                    .iter()
                    .filter_map(|it| Some((it.label.as_str(), it.picture.as_ref()?)));
                let images: Vec<_> = [("reference", &reference)].into_iter().chain(shown).collect();
                let caption = "The last frame, where the first differs most from the reference.";
                let name = match strips.len() {
                    0 => self.id.to_owned(),
                    n => format!("{}.{}", self.id, n + 1),
                };
                strips.push(picture::strip(&name, caption, sequence.display(), &images));
            }
            for (i, outcome) in shared.into_iter().zip(made) {
                outcomes[i] = Some(outcome);
            }
        }
        let outcomes: Vec<Outcome> = outcomes.into_iter().flatten().collect();
        let rows = outcomes.iter().map(|outcome| {
            let cells = metrics.iter().map(|&metric| Cell::ours(outcome.mean(metric)));
            (outcome.label.clone(), cells.collect())
        });
        Ok(Finding {
            id: self.id,
            title: self.title,
            source: self.source,
            setup: self.setup.to_owned(),
            tables: vec![Table {
                caption: "Means over the frames after warm-up".to_owned(),
                columns: metrics.iter().map(|metric| title(*metric)).collect(),
                rows: rows.collect(),
            }],
            charts: vec![],
            strips,
            orderings: self.claims.iter().map(|claim| claim.ordering(&outcomes)).collect(),
        })
    }
}

fn title(metric: Metric) -> String {
    match metric.info().unit {
        "" => metric.id().to_owned(),
        unit => format!("{}, {unit}", metric.id()),
    }
}
