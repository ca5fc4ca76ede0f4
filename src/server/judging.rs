//! `POST /verdicts`: reports held against rules. Also what follows from it: the rules are kept as the branch's, alerts are
//! opened and resolved, webhooks are told.

use super::{ApiError, Service, Shared, extract::ApiJson, tidying};
use crate::{
    metrics::Value,
    statistics::median,
    store::{GPU_TIME, Report, ReportFilter, Timestamp, TrendFilter},
    verdict::{Check, Line, Outcome, Past, Rules, RulesError, better, overall, worst_frames},
};
use axum::{Json, extract::State};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// More reports than any nightly has.
const MAX_REPORTS: usize = 2000;
/// As many results as any rule may look back at, with their repeats.
pub(super) const HISTORY: usize = 2000;

/// The body of `POST /verdicts`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VerdictRequest {
    /// Reports by number, all of one branch. Those of one line are repeats of one measurement: their median is judged.
    #[schemars(length(min = 1, max = 2000), inner(range(min = 1)))]
    reports: Vec<i64>,
    /// The rules file as JSON.
    rules: Rules,
}

/// What the rules say.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Judgement {
    /// A regression if there is any; else unknown if anything could not be told.
    pub outcome: Outcome,
    /// Every check.
    pub checks: Vec<Check>,
    /// Numbers of the alerts that this opened.
    pub alerts: Vec<i64>,
}

/// A rules file that cannot be used.
pub fn rules_error(error: RulesError) -> ApiError {
    let field = match &error {
        RulesError::Form(_) => "rules".to_owned(),
        RulesError::Rule { index, field, .. } => format!("rules.rule[{index}].{field}"),
        RulesError::Field { field, .. } => format!("rules.{field}"),
    };
    ApiError::invalid("invalid_rules", error.to_string()).field(field)
}

/// `POST /verdicts`
pub async fn post(
    State(service): Shared,
    ApiJson(request): ApiJson<VerdictRequest>,
) -> Result<Json<Judgement>, ApiError> {
    request.rules.validate().map_err(rules_error)?;
    if !(1..=MAX_REPORTS).contains(&request.reports.len()) {
        let detail = format!("give 1 to {MAX_REPORTS} reports");
        return Err(ApiError::invalid("invalid_field", detail).field("reports"));
    }
    judge(&service, &request.reports, request.rules).await.map(Json)
}

/// Everything of one metric of one line, gathered before it is judged off the async threads.
struct Gathered {
    report: Arc<Report>,
    metric: String,
    values: Vec<f64>,
    version: u32,
    history: Vec<Past>,
    approved: crate::verdict::Approved,
}

/// Judges reports that are stored, and notes what follows.
pub async fn judge(service: &Arc<Service>, ids: &[i64], rules: Rules) -> Result<Judgement, ApiError> {
    let reports = load(service, ids).await?;
    let (project, branch) = place(&reports)?;
    let mut by_series: BTreeMap<i64, Vec<&Arc<Report>>> = BTreeMap::new();
    for report in &reports {
        by_series.entry(report.series.id).or_default().push(report);
    }
    let mut gathered = Vec::new();
    for reports in by_series.values() {
        gather(service, reports, &branch, &rules, &mut gathered).await?;
    }
    let on_branch = !branch.is_empty();
    let superseded: BTreeSet<_> = gathered
        .iter()
        .filter(|one| on_branch && one.is_superseded())
        .map(Gathered::key)
        .collect();
    let judged = rules.clone();
    let mut checks =
        tokio::task::spawn_blocking(move || gathered.iter().flat_map(|one| one.judge(&judged)).collect::<Vec<_>>())
            .await
            .map_err(ApiError::internal)?;
    for reports in by_series.values() {
        let series = &reports[0].series;
        let (sequence, recipe) = (&series.sequence_name, &series.preset);
        checks.extend(rules.unmeasured(Some(series.id), sequence, recipe, &measured(reports)));
    }
    add_worst_frames(service, &reports, &mut checks).await?;
    let now = Timestamp::now();
    // What was before says nothing of how a branch stands now.
    if is_current(service, &by_series, &branch).await? {
        service.store.put_rules(&project, &branch, &rules, now).await?;
    }
    let stands = |check: &&Check| {
        let key = check.series_id.map(|id| (id, check.metric.clone()));
        key.is_none_or(|key| !superseded.contains(&key))
    };
    let current: Vec<Check> = checks.iter().filter(stands).cloned().collect();
    let alerts = service.store.note_checks(&project, &branch, &current, now).await?;
    if service.store.is_silent(&project, &branch).await? {
        tidying::note_silence(service, now).await?;
    }
    let judgement = Judgement {
        outcome: overall(&checks),
        checks,
        alerts,
    };
    announce(service, &project, &branch, &reports, &judgement).await?;
    Ok(judgement)
}

async fn load(service: &Service, ids: &[i64]) -> Result<Vec<Arc<Report>>, ApiError> {
    let mut reports = Vec::with_capacity(ids.len());
    for id in ids.iter().collect::<BTreeSet<_>>() {
        let unknown = |detail: String| ApiError::invalid("unknown_report", detail).field("reports");
        let report = service
            .store
            .report(*id)
            .await?
            .ok_or_else(|| unknown(format!("there is no report {id}")))?;
        if !report.complete {
            return Err(unknown(format!("report {id} is not complete yet; close it first")));
        }
        reports.push(report);
    }
    Ok(reports)
}

/// The one project and branch of all reports.
fn place(reports: &[Arc<Report>]) -> Result<(String, String), ApiError> {
    let place = |report: &Arc<Report>| {
        let branch = report.provenance.branch.clone().unwrap_or_default();
        (report.series.project.clone(), branch)
    };
    let places: BTreeSet<_> = reports.iter().map(place).collect();
    match places.len() {
        1 => Ok(places.into_iter().next().unwrap_or_default()),
        _ => Err(
            ApiError::invalid("several_branches", "the reports are of several projects or branches").field("reports"),
        ),
    }
}

/// What any of these has a value of.
fn measured(reports: &[&Arc<Report>]) -> BTreeSet<String> {
    let metrics = reports.iter().flat_map(|report| report.values.keys().cloned());
    let times = reports.iter().filter_map(|report| report.gpu_time_ms);
    metrics.chain(times.map(|_| GPU_TIME.to_owned())).collect()
}

/// Whether a report was posted after this one, and not of the same commit, as repeats are.
fn is_later(id: i64, commit: Option<&String>, report: &Report) -> bool {
    id > report.id && (commit.is_none() || commit != report.provenance.commit.as_ref())
}

/// Whether any of the reports is of its line's newest commit on the branch, or of no branch.
async fn is_current(
    service: &Service,
    by_series: &BTreeMap<i64, Vec<&Arc<Report>>>,
    branch: &str,
) -> Result<bool, ApiError> {
    if branch.is_empty() {
        return Ok(true);
    }
    for (series_id, reports) in by_series {
        let newest = ReportFilter {
            series_id: Some(*series_id),
            branch: Some(branch.to_owned()),
            limit: 1,
            ..ReportFilter::default()
        };
        let found = service.store.reports(&newest).await?;
        let judged = reports[reports.len() - 1];
        if !found
            .iter()
            .any(|newest| is_later(newest.id, newest.provenance.commit.as_ref(), judged))
        {
            return Ok(true);
        }
    }
    Ok(false)
}

async fn gather(
    service: &Service,
    reports: &[&Arc<Report>],
    branch: &str,
    rules: &Rules,
    gathered: &mut Vec<Gathered>,
) -> Result<(), ApiError> {
    let (store, newest) = (&service.store, reports[reports.len() - 1]);
    let series = &newest.series;
    let path = match branch {
        "" => None,
        branch => store.branch_path(&series.project, branch).await?,
    };
    for metric in measured(reports) {
        let asked = rules.checks(&series.sequence_name, &series.preset, &metric);
        if asked == crate::verdict::Checks::default() {
            continue;
        }
        let value = |report: &&Arc<Report>| match metric == GPU_TIME {
            true => report.gpu_time_ms,
            false => report.values.get(&metric).map(|value| value.0),
        };
        let version = match metric == GPU_TIME {
            true => 0,
            false => newest.metric_versions.get(&metric).copied().unwrap_or(0),
        };
        let filter = TrendFilter {
            path: path.clone(),
            ..TrendFilter::newest(HISTORY)
        };
        let points = store.trend(series.id, &metric, &filter).await?;
        let history = past(store.describe(&points).await?);
        gathered.push(Gathered {
            report: Arc::clone(newest),
            values: reports.iter().filter_map(value).collect(),
            approved: store.approved(series.id, &metric, version).await?,
            metric,
            version,
            history,
        });
    }
    Ok(())
}

/// The history with the repeats of a commit taken together.
pub(super) fn past(points: Vec<crate::store::Point>) -> Vec<Past> {
    let alike = |a: &crate::store::Point, b: &crate::store::Point| {
        a.commit.is_some() && a.commit == b.commit && a.metric_version == b.metric_version
    };
    points
        .chunk_by(alike)
        .map(|repeats| Past {
            // The last of them: what is approved or dismissed by number then holds for all.
            report_id: repeats[repeats.len() - 1].report_id,
            commit: repeats[0].commit.clone(),
            value: median(&repeats.iter().map(|point| point.value.0).collect::<Vec<_>>()),
            version: repeats[0].metric_version,
        })
        .collect()
}

impl Gathered {
    fn key(&self) -> (i64, String) {
        (self.report.series.id, self.metric.clone())
    }

    fn is_superseded(&self) -> bool {
        let newest = self.history.last();
        newest.is_some_and(|newest| is_later(newest.report_id, newest.commit.as_ref(), &self.report))
    }

    fn judge(&self, rules: &Rules) -> Vec<Check> {
        rules.judge(&Line {
            series_id: self.report.series.id,
            sequence: &self.report.series.sequence_name,
            recipe: &self.report.series.preset,
            metric: &self.metric,
            values: &self.values,
            version: self.version,
            history: &self.history,
            approved: &self.approved,
        })
    }
}

/// Says of each regression which frames to look at.
async fn add_worst_frames(service: &Service, reports: &[Arc<Report>], checks: &mut [Check]) -> Result<(), ApiError> {
    for check in checks
        .iter_mut()
        .filter(|check| check.outcome == Outcome::Regression && check.metric != GPU_TIME)
    {
        let newest = reports.iter().rfind(|report| Some(report.series.id) == check.series_id);
        let Some(report) = newest else { continue };
        let frames = service.store.frames(report.id).await?;
        check.finding.worst_frames = worst_frames(&frames, &check.metric, better(&check.metric));
    }
    Ok(())
}

async fn announce(
    service: &Service,
    project: &str,
    branch: &str,
    reports: &[Arc<Report>],
    judgement: &Judgement,
) -> Result<(), ApiError> {
    let failed: Vec<&Check> = judgement
        .checks
        .iter()
        .filter(|check| check.outcome == Outcome::Regression)
        .collect();
    let values: BTreeMap<String, Value> = failed
        .iter()
        .filter_map(|check| Some((check.metric.clone(), check.finding.value?)))
        .collect();
    let payload = json!({
        "project": project,
        "branch": branch,
        "commit": reports.last().and_then(|report| report.provenance.commit.clone()),
        "outcome": judgement.outcome,
        "regressions": failed,
        "values": values,
        "alerts": judgement.alerts,
        "reports": reports.iter().map(|report| report.id).collect::<Vec<_>>(),
    });
    if service
        .store
        .announce(project, "verdict", &payload, Timestamp::now())
        .await?
        > 0
    {
        service.deliver.notify_one();
    }
    Ok(())
}
