//! Whether a line changed its level for the worse.

use super::{ChangeState, Check, Finding, Judge, Kind, KnownChange, Outcome, Past, named};
use crate::{
    metrics::{Better, Value},
    statistics::median,
    verdict::{
        ChangeRule,
        change::{self, ChangePoint},
    },
};
use std::ops::Range;

/// Results that are looked at together.
struct View<'a> {
    results: &'a [Past],
    /// Their values, and with those that are not finite beside the others.
    true_values: Vec<f64>,
    values: Vec<f64>,
    rule: &'a ChangeRule,
    better: Better,
}

/// A change of level in a view.
struct Level {
    /// The level before.
    before: Range<usize>,
    /// The first result of the change.
    index: usize,
    /// The level now.
    now: Range<usize>,
    /// The probability that chance made it; none where it is not seen any more, but was.
    p: Option<f64>,
}

impl<'a> View<'a> {
    fn new(results: &'a [Past], better: Better, rule: &'a ChangeRule) -> Self {
        let true_values: Vec<f64> = results.iter().map(|past| past.value).collect();
        Self {
            results,
            values: change::place(&true_values, Some(better), rule),
            true_values,
            rule,
            better,
        }
    }

    /// Changes of level in a part.
    fn changes(&self, part: Range<usize>) -> Vec<ChangePoint> {
        let mut found = change::changes(&self.values[part.clone()], self.rule);
        for point in &mut found {
            point.index += part.start;
        }
        found
    }

    fn is_loss(&self, before: f64, after: f64) -> bool {
        let loss = match self.better {
            Better::Lower => after - before,
            Better::Higher => before - after,
        };
        loss > 0.0 && loss >= self.rule.min_effect.of(before)
    }

    /// A change that is known, if every level since is worse than the one before it.
    fn still(&self, index: usize) -> Option<Level> {
        let (n, window) = (self.values.len(), self.rule.window);
        let level = |part: Range<usize>| median(&self.values[part]);
        let start = self.changes(0..index).last().map_or(0, |point| point.index);
        let since = n.saturating_sub(2 * window).max(index);
        let mut ends: Vec<usize> = self.changes(since..n).iter().map(|point| point.index).collect();
        ends.push(n);
        let starts = [since].into_iter().chain(ends.iter().copied());
        let mut levels = starts.zip(&ends).map(|(start, &end)| level(start..end));
        let is_there = index > 0 && levels.all(|now| self.is_loss(level(start..index), now));
        is_there.then(|| {
            // Where it began is known better with each result.
            let around = index.saturating_sub(window)..n.min(index + window);
            let seen = self.changes(around);
            let seen = seen.iter().min_by_key(|point| point.index.abs_diff(index));
            let seen = seen.filter(|point| point.index.abs_diff(index) < self.rule.min_segment);
            let index = seen.map_or(index, |point| point.index);
            Level {
                before: start.min(index - 1)..index,
                index,
                now: ends.iter().rev().nth(1).copied().unwrap_or(since).max(index)..n,
                p: seen.map(|point| point.p),
            }
        })
    }
}

impl Judge<'_> {
    /// Where a report is in the results that compare.
    pub(super) fn place_of(&self, report_id: i64) -> Option<usize> {
        let history = self.comparable();
        history.iter().rposition(|past| past.report_ids.contains(&report_id))
    }

    /// Looks for the oldest change for the worse that was neither approved, dismissed nor made good since; others may have followed.
    pub(super) fn change(&self, rule: &ChangeRule) -> Check {
        let all = self.comparable();
        let unknown = |detail: String| self.check(Kind::Change, Outcome::Unknown, detail, Finding::default());
        let needed = change::fewest(rule);
        if self.line.history.is_empty() {
            return unknown("a change is seen in a history, which a service keeps; there is none".to_owned());
        }
        if all.len() < needed {
            return unknown(format!(
                "{} results are too few to see a change; {needed} are needed",
                all.len()
            ));
        }
        let Some(better) = self.better else {
            return unknown("which way the metric improves is not known; say `better` in its rule".to_owned());
        };
        let approved = self.line.approved;
        let accepted = all.iter().rposition(|past| {
            past.report_ids.iter().any(|id| approved.report_ids.contains(id))
                || past
                    .commit
                    .as_ref()
                    .is_some_and(|commit| approved.commits.contains(commit))
        });
        // What the branch came with is another's to answer for.
        let is_own = |past: &Past| past.branch.as_deref() == self.line.branch;
        let first_own = all.iter().position(is_own).filter(|_| self.line.branch.is_some());
        let accepted = accepted.max(first_own.and_then(|index| index.checked_sub(1)));
        let open = approved.changes.iter().find(|known| known.state == ChangeState::Open);
        if open.is_some_and(|open| self.is_out_of_sight(open, rule)) {
            return unknown(format!(
                "the change that an alert is open of is older than the {} results that are looked at, or of another version of the metric; approve or dismiss it",
                all.len()
            ));
        }
        // A change that was found once is no matter of chance any more: with what was before it still in sight, the levels are
        // compared. One whose alert was closed too early is found again so.
        let newest = all.len().saturating_sub(rule.window);
        let is_new = |index: &usize| accepted.is_none_or(|accepted| *index > accepted);
        let closed = approved
            .changes
            .iter()
            .rev()
            .filter(|known| known.state == ChangeState::Closed);
        let closed = closed.filter_map(|known| self.place_of(known.report_id));
        let closed = closed.filter(|index| index + 2 * rule.window >= all.len());
        let dismissed = |index: &usize| {
            let known = approved
                .changes
                .iter()
                .filter(|known| known.state == ChangeState::Dismissed);
            let mut places = known.filter_map(|known| self.place_of(known.report_id));
            places.any(|place| place.abs_diff(*index) < rule.min_segment)
        };
        let closed = closed.filter(|index| !dismissed(index)).take(1);
        let open = open.and_then(|open| self.place_of(open.report_id));
        for index in open.into_iter().chain(closed).filter(is_new) {
            let start = newest.min(index.saturating_sub(rule.window));
            let view = View::new(&all[start..], better, rule);
            if let Some(level) = view.still(index - start) {
                return self.regressed(&view, &level);
            }
        }
        // While an alert was open, another change may have left the window behind it.
        let farthest = all.len().saturating_sub(2 * rule.window);
        let start = open.map_or(newest, |index| newest.min(index.max(farthest)));
        let view = View::new(&all[start..], better, rule);
        let accepted = accepted.and_then(|index| index.checked_sub(start));
        self.newest_change(&view, accepted)
    }

    /// Whether what is there before a change is no level any more.
    fn is_out_of_sight(&self, open: &KnownChange, rule: &ChangeRule) -> bool {
        self.place_of(open.report_id)
            .is_none_or(|index| index < rule.min_segment)
    }

    fn newest_change(&self, view: &View, accepted: Option<usize>) -> Check {
        let n = view.values.len();
        let start = self.comparable().len() - n;
        let changes = view.changes(0..n);
        // Where a change begins is known better with each result, but a small one nearby is not a large one.
        let known_at = |point: &ChangePoint, state: ChangeState| {
            let known = self
                .line
                .approved
                .changes
                .iter()
                .filter(move |known| known.state == state);
            let size = (point.after - point.before).abs();
            let alike = known.filter(move |known| known.effect.is_none_or(|effect| size <= 2.0 * effect.abs()));
            let places = alike.filter_map(|known| self.place_of(known.report_id)?.checked_sub(start));
            places
                .into_iter()
                .find(|place| place.abs_diff(point.index) < view.rule.min_segment)
        };
        let is_new = |point: &&ChangePoint| {
            accepted.is_none_or(|accepted| point.index > accepted) && known_at(point, ChangeState::Approved).is_none()
        };
        let lasts = |(position, point): &(usize, &ChangePoint)| {
            let mut later = changes[*position..].iter();
            later.all(|later| view.is_loss(point.before, later.after))
        };
        let lasting = changes.iter().enumerate().filter(lasts).map(|(_, point)| point);
        let lasting: Vec<&ChangePoint> = lasting.filter(is_new).collect();
        let oldest = lasting
            .iter()
            .find(|point| known_at(point, ChangeState::Dismissed).is_none())
            .or(lasting.first())
            .copied();
        let Some(found) = oldest.or_else(|| changes.last().filter(is_new)) else {
            let detail = format!("no new change in {n} results");
            return self.check(Kind::Change, Outcome::Ok, detail, Finding::default());
        };
        let before = changes.iter().rfind(|point| point.index < found.index);
        let level = Level {
            before: before.map_or(0, |point| point.index)..found.index,
            index: known_at(found, ChangeState::Dismissed).unwrap_or(found.index).max(1),
            now: changes.last().map_or(found.index, |point| point.index)..n,
            p: Some(found.p),
        };
        match oldest {
            Some(_) => self.regressed(view, &level),
            None => self.changed(view, &level, Outcome::Ok),
        }
    }

    /// A change for the worse, unless this result is of a commit before it.
    fn regressed(&self, view: &View, level: &Level) -> Check {
        let first_bad = &view.results[level.index];
        let place = |id| self.place_of(id);
        let this = self.line.report_id.and_then(place);
        if this
            .zip(place(first_bad.report_id()))
            .is_some_and(|(this, first_bad)| this < first_bad)
        {
            let at = match &first_bad.commit {
                Some(commit) => format!("commit {commit}"),
                None => format!("report {}", first_bad.report_id()),
            };
            let detail = format!("no change up to here; a later one for the worse is at {at}");
            return self.check(Kind::Change, Outcome::Ok, detail, Finding::default());
        }
        self.changed(view, level, Outcome::Regression)
    }

    /// A change in words and numbers. What is not finite is so in both.
    fn changed(&self, view: &View, level: &Level, outcome: Outcome) -> Check {
        let [before, now] = [&level.before, &level.now].map(|part| &view.true_values[part.clone()]);
        let words = match outcome {
            Outcome::Regression => "worse",
            _ => "better",
        };
        let (from, to) = (median(before), median(now));
        let finding = Finding {
            limit: Some(Value(from)),
            ..match outcome {
                Outcome::Regression => named(view.results.get(level.index), view.results.get(level.index - 1)),
                _ => Finding::default(),
            }
        };
        let chance = match level.p {
            Some(p) => format!("p = {p:.3}"),
            None => "found before".to_owned(),
        };
        if !(from.is_finite() && to.is_finite()) {
            let detail = format!(
                "changed for the {words} from {:.4} to {:.4}, {chance}",
                Value(from),
                Value(to)
            );
            let effect = Some(Value(to - from)).filter(|effect| !effect.0.is_nan());
            return self.check(Kind::Change, outcome, detail, Finding { effect, ..finding });
        }
        let finite =
            |values: &[f64]| -> Vec<f64> { values.iter().copied().filter(|value| value.is_finite()).collect() };
        let (effect, low, high) = change::effect(&finite(before), &finite(now));
        let detail = format!(
            "changed for the {words} by {effect:+.4} ({low:+.4} to {high:+.4}), from {from:.4} to {to:.4}, {chance}"
        );
        let finding = Finding {
            effect: Some(Value(effect)),
            effect_low: Some(Value(low)),
            effect_high: Some(Value(high)),
            ..finding
        };
        self.check(Kind::Change, outcome, detail, finding)
    }
}
