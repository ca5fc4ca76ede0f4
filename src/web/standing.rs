//! Where a line stands: what its alerts, its branch's rules and its silence say.

use super::{format, parts, query::href};
use crate::{
    metrics::Value,
    server::Service,
    store::{Alert, AlertFilter, AlertStatus, LineRules, Point, Series, StoreError, Timestamp},
    verdict::{Checks, Kind},
};
use maud::{Markup, html};
use std::collections::HashMap;

const MAX_ALERTS: u32 = 500;
/// Lines with fewer results have no rhythm that could be missed.
const RHYTHM: usize = 5;
/// Silence of less than this is a weekend job or a late nightly, in milliseconds.
const MIN_SILENCE: i64 = 36 * 3_600_000;

/// The verdict on a metric of a line.
pub enum Standing<'a> {
    /// An alert is open for it.
    Regressed(&'a Alert),
    /// An alert is open for another metric of the line.
    Elsewhere(&'a Alert),
    /// No result came for longer than usual.
    Silent(Timestamp),
    /// Its last verdict could not be told, and why.
    Unknown(&'a str),
    /// Rules ask something of it and no alert is open.
    Holds,
    /// No rule asks anything of it.
    NotJudged,
}

/// Everything that verdicts are made of, read once a page.
pub struct Standings {
    /// Open alerts, newest first.
    pub alerts: Vec<Alert>,
    rules: HashMap<(i64, String), LineRules>,
    branch: Option<String>,
}

impl Standings {
    /// Of a project and a branch, or of all.
    pub async fn load(service: &Service, project: &str, branch: Option<&str>) -> Result<Self, StoreError> {
        let filter = AlertFilter {
            project: Some(project.to_owned()),
            status: Some(AlertStatus::Open),
            branch: branch.map(str::to_owned),
            limit: MAX_ALERTS,
            ..AlertFilter::default()
        };
        let rules = service.store.line_rules(branch).await?;
        Ok(Self {
            alerts: service.store.alerts(&filter).await?,
            rules: rules
                .into_iter()
                .map(|line| ((line.series_id, line.branch.clone()), line))
                .collect(),
            branch: branch.map(str::to_owned),
        })
    }

    /// The verdict on a metric of a line whose newest results are `points`; `newest` is that of any line.
    pub fn of(&self, series: &Series, metric: &str, points: &[Point], newest: Timestamp) -> Standing<'_> {
        let mut own = self
            .alerts
            .iter()
            .filter(|alert| alert.series.id == series.id && alert.kind != Kind::NoData);
        if let Some(alert) = own.clone().find(|alert| alert.metric == metric) {
            return Standing::Regressed(alert);
        }
        if let Some(since) = self.silence(series, points, newest) {
            return Standing::Silent(since);
        }
        if let Some(alert) = own.next() {
            return Standing::Elsewhere(alert);
        }
        let branch = self
            .branch
            .as_deref()
            .or(points.last().and_then(|point| point.branch.as_deref()))
            .unwrap_or_default();
        let Some(line) = self.rules.get(&(series.id, branch.to_owned())) else {
            return Standing::NotJudged;
        };
        let asked = line.rules.checks(&series.sequence_name, &series.preset, metric);
        match line.unknown.get(metric) {
            _ if asked == Checks::default() => Standing::NotJudged,
            Some(why) => Standing::Unknown(why),
            None => Standing::Holds,
        }
    }

    /// Since when a line is silent: an alert says so, or its rhythm was broken.
    fn silence(&self, series: &Series, points: &[Point], newest: Timestamp) -> Option<Timestamp> {
        let last = points.last()?.created_at;
        let is_noted = self
            .alerts
            .iter()
            .any(|alert| alert.series.id == series.id && alert.kind == Kind::NoData);
        (is_noted || broken_rhythm(points, newest)).then_some(last)
    }
}

/// Whether a line that came regularly has missed more than three of its own turns.
fn broken_rhythm(points: &[Point], newest: Timestamp) -> bool {
    let mut gaps: Vec<i64> = points
        .windows(2)
        .map(|pair| pair[1].created_at.0 - pair[0].created_at.0)
        .collect();
    gaps.sort_unstable();
    let usual = gaps.get(gaps.len() / 2).copied().unwrap_or_default();
    let since = points.last().map_or(0, |last| newest.0 - last.created_at.0);
    points.len() >= RHYTHM && since > (3 * usual).max(MIN_SILENCE)
}

impl Standing<'_> {
    /// A word and a mark: colour alone says nothing to many.
    pub fn render(&self) -> Markup {
        let now = Timestamp::now();
        html! {
            @match self {
                Self::Regressed(alert) => a.mark.bad href=(alert_href(alert)) title=(alert.detail) { "✗ " (kind(alert)) },
                Self::Elsewhere(alert) => a.mark.bad href=(alert_href(alert)) title=(alert.detail) { "✗ " (alert.metric) },
                Self::Silent(since) => span.mark.silent title={ "the last report came " (since) } { "… silent, " (format::age(*since, now)) },
                Self::Unknown(why) => span.mark.muted title=(why) { "? not told" },
                Self::Holds => span.mark.good title="its rules hold" { "✓ holds" },
                Self::NotJudged => span.mark.muted title="no rule asks anything of it" { "no rule" },
            }
        }
    }
}

fn kind(alert: &Alert) -> &'static str {
    match alert.kind {
        Kind::Limit => "limit",
        Kind::Baseline => "baseline",
        Kind::Change => "changed",
        Kind::NoData => "no data",
    }
}

/// Where to look at what an alert found: its worst frame in the first bad report, beside the last good one.
pub fn alert_href(alert: &Alert) -> String {
    let good = alert.finding.last_good_report.map(|id| id.to_string());
    let metric = (!alert.metric.is_empty()).then(|| alert.metric.clone());
    let Some(report) = alert.report_id else {
        return "/alerts".to_owned();
    };
    match alert.finding.worst_frames.first().filter(|_| alert.job_id.is_some()) {
        Some(frame) => href(
            &format!("/reports/{report}/frames/{frame}"),
            [("with", good), ("metric", metric)],
        ),
        None => href(&format!("/reports/{report}"), [("with", good), ("metric", metric)]),
    }
}

/// Its line over time.
pub fn trend_href(series: &Series, metric: &str, branch: Option<&str>) -> String {
    href(
        "/trends",
        [
            ("metric", Some(metric.to_owned())),
            ("sequence", Some(parts::subject_of(series))),
            ("recipe", Some(parts::recipe(series))),
            ("environment", Some(series.environment_id.to_string())),
            ("branch", branch.map(str::to_owned)),
        ],
    )
}

/// What got worse, since when, and where to look: newest first.
pub fn regressions(alerts: &[&Alert]) -> Markup {
    let now = Timestamp::now();
    html! {
        div.scroll { table #regressed {
            thead { tr { th { "Metric" } th { "Branch" } th { "Sequence" } th { "Recipe" } th.number { "Change" } th { "Since" } th { "Before" } th { "Look" } th.number { "Found" } } }
            tbody { @for alert in alerts {
                tr data-alert=(alert.id) {
                    td { b { (alert.metric) } " " span.mark.bad { "✗ " (kind(alert)) } }
                    td { (if alert.branch.is_empty() { format::ABSENT } else { &alert.branch }) }
                    td { (parts::sequence(&alert.series)) }
                    td { (parts::recipe(&alert.series)) }
                    td.number { (effect(alert)) }
                    td { @match (&alert.finding.first_bad_commit, alert.report_id) {
                        (Some(commit), Some(id)) => a href={ "/reports/" (id) } { (format::short_hash(commit)) },
                        (None, Some(id)) => a href={ "/reports/" (id) } { "report " (id) },
                        _ => span.muted { (format::ABSENT) },
                    } }
                    td { @match &alert.finding.last_good_commit { Some(commit) => (format::short_hash(commit)), None => span.muted { (format::ABSENT) } } }
                    td { a href=(alert_href(alert)) { @if alert.job_id.is_some() { "before and after" } @else { "frames" } }
                        " · " a href=(trend_href(&alert.series, &alert.metric, (!alert.branch.is_empty()).then_some(alert.branch.as_str()))) { "trend" } }
                    td.number { (format::age(alert.opened_at, now)) }
                }
            } }
        } }
    }
}

/// How much, in the metric's unit.
fn effect(alert: &Alert) -> String {
    let Some(Value(effect)) = alert.finding.effect else {
        return format::value(&alert.metric, alert.finding.value);
    };
    let sign = if effect > 0.0 { "+" } else { "" };
    format!(
        "{sign}{} {}",
        format::value(&alert.metric, Some(Value(effect))),
        format::unit(&alert.metric)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nights(days: impl IntoIterator<Item = i64>) -> Vec<Point> {
        let point = |day: i64| Point {
            report_id: day,
            job_id: None,
            branch: None,
            commit: None,
            parent: None,
            created_at: Timestamp(day * 86_400_000),
            value: Value(1.0),
            metric_version: 1,
        };
        days.into_iter().map(point).collect()
    }

    #[test]
    fn silence_is_a_rhythm_that_was_broken() {
        let today = Timestamp(20 * 86_400_000);
        for (points, silent) in [
            (nights(0..=20), false),
            (nights(0..=17), false),
            (nights(0..=15), true),
            // Weekly lines are not late after five days.
            (nights([-27, -20, -13, -6, 1, 8, 15]), false),
            (nights([0, 1, 2]), false),
            (nights([]), false),
        ] {
            assert_eq!(broken_rhythm(&points, today), silent, "{points:?}");
        }
    }
}
