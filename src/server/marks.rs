//! `GET /series/{id}/marks`: what a chart draws beside a line's points. Limits and tolerances are those of the branch's rules;
//! changes of level are found as verdicts find them.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared, blocking,
    judging::{HISTORY, past},
    reports::{check_metric, find_series},
};
use crate::{
    metrics::{Better, Value},
    statistics::median,
    store::{Series, Timestamp, TrendFilter},
    verdict::{
        Approved, ChangeState, Checks, Past, Tolerance, better,
        change::{changes as changes_of, place},
    },
};
use axum::{Json, extract::State};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::HashMap, ops::Range};

/// Query of `GET /series/{series}/marks`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkQuery {
    /// A metric's id, or `gpu_time_ms`.
    #[schemars(length(min = 1, max = 100))]
    metric: String,
    /// Of this branch and its past, by its rules; without it, of all reports, by the rules of the newest one's branch.
    branch: Option<String>,
}

/// What lies behind a line.
#[derive(Serialize, JsonSchema)]
pub struct Marks {
    /// The branch whose rules these are; none where no branch has any for this line.
    branch: Option<String>,
    /// The least that is good enough.
    min: Option<Value>,
    /// The most that is good enough.
    max: Option<Value>,
    /// What was approved.
    baseline: Option<Baseline>,
    /// Where the line changed its level in the rule's window, oldest first, with the change that an alert is open of.
    changes: Vec<Change>,
}

/// The approved results of a line.
#[derive(Serialize, JsonSchema)]
pub struct Baseline {
    /// How many there are.
    n_approved: usize,
    /// The worst of them; of a metric of unknown direction, their mean.
    worst: Value,
    /// The worst that rules allow beside them.
    allowed: Option<Value>,
}

/// A change of level.
#[derive(Serialize, JsonSchema)]
pub struct Change {
    /// The first report of the new level.
    report_id: i64,
    /// Its commit.
    commit: Option<String>,
    /// When it was stored.
    created_at: Timestamp,
    /// Median before, back to the change before, within the rule's window.
    before: Value,
    /// Median after, up to the next change, within the rule's window.
    after: Value,
    /// The probability that chance made it.
    p: f64,
    /// Whether it is a change for the worse; none of a metric of unknown direction.
    worse: Option<bool>,
}

/// `GET /series/{series}/marks`
pub async fn get(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<MarkQuery>,
) -> Result<Json<Marks>, ApiError> {
    let series = find_series(&service, id).await?;
    check_metric(&service, &query.metric).await?;
    of(&service, &series, &query.metric, query.branch.as_deref())
        .await
        .map(Json)
}

/// The marks of one metric of a line.
pub async fn of(service: &Service, series: &Series, metric: &str, branch: Option<&str>) -> Result<Marks, ApiError> {
    let store = &service.store;
    let path = match branch {
        None => None,
        Some(branch) => Some(store.branch_path(&series.project, branch).await?.unwrap_or_default()),
    };
    let filter = TrendFilter {
        path,
        ..TrendFilter::newest(HISTORY)
    };
    let points = store.describe(&store.trend(series.id, metric, &filter).await?).await?;
    let newest = points.last();
    let branch = branch
        .map(str::to_owned)
        .or_else(|| newest.and_then(|point| point.branch.clone()));
    let version = newest.map_or(0, |point| point.metric_version);
    let times: HashMap<i64, Timestamp> = points.iter().map(|point| (point.report_id, point.created_at)).collect();
    let checks = checks(service, series, metric, branch.as_deref()).await?;
    let approved = store
        .approved(series.id, metric, version, branch.as_deref().unwrap_or_default())
        .await?;
    let history: Vec<Past> = past(points)
        .into_iter()
        .filter(|past| past.version == version)
        .collect();
    let better = checks
        .as_ref()
        .and_then(|checks| checks.better)
        .or_else(|| better(metric));
    let rule = checks.as_ref().and_then(|checks| checks.change).unwrap_or_default();
    let open = approved.changes.iter().find(|known| known.state == ChangeState::Open);
    let open = open.and_then(|open| {
        history
            .iter()
            .position(|past| past.report_ids.contains(&open.report_id))
    });
    let mut changes = blocking(move || {
        let values: Vec<f64> = history.iter().map(|past| past.value).collect();
        let n = values.len();
        let in_part = |part: Range<usize>| {
            let found = changes_of(&place(&values[part.clone()], better, &rule), &rule);
            found.into_iter().map(move |point| (part.start + point.index, point.p))
        };
        let newest = n.saturating_sub(rule.window);
        // What an alert is open of is drawn, however long ago it was.
        let older = open
            .filter(|&index| index < newest)
            .map(|index| index.saturating_sub(rule.window)..n.min(index + rule.window));
        let older = older.into_iter().flat_map(in_part).filter(|&(index, _)| index < newest);
        let found: Vec<(usize, f64)> = older.chain(in_part(newest..n)).collect();
        let change = |(position, &(index, p)): (usize, &(usize, f64))| {
            let from = position.checked_sub(1).map_or(0, |position| found[position].0);
            let to = found.get(position + 1).map_or(n, |next| next.0);
            let before = median(&values[from.max(index.saturating_sub(rule.window))..index]);
            let after = median(&values[index..to.min(index + rule.window)]);
            Change {
                report_id: history[index].report_id(),
                commit: history[index].commit.clone(),
                created_at: Timestamp(0),
                before: Value(before),
                after: Value(after),
                p,
                worse: better.map(|better| (better == Better::Higher) == (after < before)),
            }
        };
        found.iter().enumerate().map(change).collect::<Vec<_>>()
    })
    .await?;
    for change in &mut changes {
        change.created_at = times.get(&change.report_id).copied().unwrap_or(change.created_at);
    }
    let tolerance = checks.as_ref().and_then(|checks| checks.baseline);
    Ok(Marks {
        branch: branch.filter(|_| checks.is_some()),
        min: checks.as_ref().and_then(|checks| checks.min).map(Value),
        max: checks.as_ref().and_then(|checks| checks.max).map(Value),
        baseline: baseline(&approved, tolerance, better),
        changes,
    })
}

/// What the branch's rules ask of the metric; none where they ask nothing.
async fn checks(
    service: &Service,
    series: &Series,
    metric: &str,
    branch: Option<&str>,
) -> Result<Option<Checks>, ApiError> {
    let found = service.store.rules(series.id, branch.unwrap_or_default()).await?;
    Ok(found
        .map(|rules| rules.checks(&series.sequence_name, &series.preset, metric))
        .filter(|checks| *checks != Checks::default()))
}

fn baseline(approved: &Approved, tolerance: Option<Tolerance>, better: Option<Better>) -> Option<Baseline> {
    let values: Vec<f64> = approved
        .values
        .iter()
        .copied()
        .filter(|value| !value.is_nan())
        .collect();
    if values.is_empty() {
        return None;
    }
    let worst = match better {
        Some(Better::Higher) => values.iter().copied().fold(f64::INFINITY, f64::min),
        Some(Better::Lower) => values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        None => values.iter().sum::<f64>() / values.len() as f64,
    };
    let allowed = tolerance.zip(better).map(|(tolerance, better)| match better {
        // A share of infinity is no number.
        _ if worst.is_infinite() => worst,
        Better::Higher => worst - tolerance.of(worst),
        Better::Lower => worst + tolerance.of(worst),
    });
    Some(Baseline {
        n_approved: values.len(),
        worst: Value(worst),
        allowed: allowed.map(Value),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_baseline_is_its_worst_result_and_what_may_be_worse() {
        let approved = Approved {
            values: vec![30.0, 29.0, 31.0],
            ..Approved::default()
        };
        let of = |better| {
            let found = baseline(&approved, Some(Tolerance::Absolute(0.5)), better).unwrap();
            (found.worst.0, found.allowed.map(|value| value.0))
        };
        assert_eq!(of(Some(Better::Higher)), (29.0, Some(28.5)));
        assert_eq!(of(Some(Better::Lower)), (31.0, Some(31.5)));
        assert_eq!(of(None), (30.0, None));
        assert!(baseline(&Approved::default(), None, None).is_none());
    }
}
