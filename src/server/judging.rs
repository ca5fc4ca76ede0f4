//! `POST /verdicts`: reports held against rules. Also what follows from it: the rules are kept as their lines' on the branch, alerts are
//! opened and resolved, webhooks are told.

use super::{ApiError, Service, Shared, blocking, extract::ApiJson};
use crate::{
    statistics::median,
    store::{GPU_TIME, Judged, Point, Report, Timestamp, TrendFilter},
    verdict::{Check, Kind, Line, Outcome, Past, Rules, RulesError, better, overall, worst_frames},
};
use axum::{Json, extract::State};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher},
    sync::Arc,
};
use tokio::sync::{Mutex, MutexGuard};

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
    /// Numbers of the alerts that this opened: of the newest results, where these are of a commit before.
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
    reports: Vec<Arc<Report>>,
    metric: String,
    values: Vec<f64>,
    version: u32,
    history: Vec<Past>,
    approved: crate::verdict::Approved,
}

/// One verdict on a branch at a time: what an older one found must not be noted after what a newer one did.
pub struct Turns(Vec<Mutex<()>>);

impl Default for Turns {
    fn default() -> Self {
        Self((0..64).map(|_| Mutex::default()).collect())
    }
}

impl Turns {
    /// The branch's turn, until it is dropped. A few branches share one.
    pub(super) async fn of(&self, project: &str, branch: &str) -> MutexGuard<'_, ()> {
        let hash = BuildHasherDefault::<DefaultHasher>::default().hash_one((project, branch));
        self.0[hash as usize % self.0.len()].lock().await
    }
}

/// Judges reports that are stored, and notes what follows.
pub async fn judge(service: &Arc<Service>, ids: &[i64], rules: Rules) -> Result<Judgement, ApiError> {
    let store = &service.store;
    let reports = load(service, ids.iter().copied().collect()).await?;
    let (project, branch) = place(&reports)?;
    let _turn = service.turns.of(&project, &branch).await;
    let lines = by_series(&reports);
    let mut gathered = Vec::new();
    for reports in lines.values() {
        gather(service, reports, &branch, &rules, &mut gathered).await?;
    }
    let (mut checks, gathered) = judged(gathered, rules.clone()).await?;
    for reports in lines.values() {
        let series = &reports[0].series;
        let (sequence, recipe) = (&series.sequence_name, &series.preset);
        checks.extend(rules.unmeasured(Some(series.id), sequence, recipe, &measured(reports)));
    }
    add_worst_frames(service, &reports, &mut checks).await?;
    let now = Timestamp::now();
    let superseded = gathered.iter().filter(|one| one.is_superseded());
    let superseded: BTreeSet<_> = superseded.map(Gathered::key).collect();
    let current = current(service, &lines, &branch, &superseded, &checks).await?;
    store.put_rules(&branch, &current, &rules, now).await?;
    let is_current = |check: &&Check| {
        let key = check.series_id.map(|id| (id, check.metric.clone()));
        // Nobody says in which order results of no branch belong, but a change is none of what was before it.
        branch.is_empty() && check.kind != Kind::Change || key.is_none_or(|key| !superseded.contains(&key))
    };
    let mut noted: Vec<Check> = checks.iter().filter(is_current).cloned().collect();
    // What was before says nothing of how a branch stands now, but may say where a fault of now began: the newest results are
    // judged again, by their own rules.
    for one in gathered.into_iter().filter(|one| superseded.contains(&one.key())) {
        if !branch.is_empty() {
            noted.extend(again(service, one, &branch).await?);
        }
    }
    let alerts = store.note_checks(&project, &branch, &noted, now).await?;
    let series: Vec<i64> = lines.into_keys().collect();
    store.note_heard(&branch, &series, now).await?;
    let judgement = Judgement {
        outcome: overall(&checks),
        checks,
        alerts,
    };
    announce(service, &project, &branch, &reports, &judgement).await?;
    Ok(judgement)
}

/// The reports of each line.
fn by_series(reports: &[Arc<Report>]) -> BTreeMap<i64, Vec<Arc<Report>>> {
    let mut lines: BTreeMap<i64, Vec<Arc<Report>>> = BTreeMap::new();
    for report in reports {
        lines.entry(report.series.id).or_default().push(Arc::clone(report));
    }
    lines
}

/// The checks, found off the async threads, and what they were made of.
async fn judged(gathered: Vec<Gathered>, rules: Rules) -> Result<(Vec<Check>, Vec<Gathered>), ApiError> {
    blocking(move || (gathered.iter().flat_map(|one| one.judge(&rules)).collect(), gathered)).await
}

/// What the newest results of a metric of a line are by the line's own rules.
async fn again(service: &Service, past: Gathered, branch: &str) -> Result<Vec<Check>, ApiError> {
    let (series_id, metric) = past.key();
    let rules = service.store.rules(series_id, branch).await?;
    let Some((rules, newest)) = rules.zip(past.history.last().cloned()) else {
        return Ok(Vec::new());
    };
    let approved = service.store.approved(series_id, &metric, newest.version, branch);
    let newest = Gathered {
        reports: load(service, newest.report_ids.into_iter().collect()).await?,
        values: vec![newest.value],
        version: newest.version,
        approved: approved.await?,
        ..past
    };
    let (mut checks, newest) = judged(vec![newest], rules).await?;
    add_worst_frames(service, &newest[0].reports, &mut checks).await?;
    Ok(checks)
}

async fn load(service: &Service, ids: BTreeSet<i64>) -> Result<Vec<Arc<Report>>, ApiError> {
    let mut reports = Vec::with_capacity(ids.len());
    for id in ids {
        let unknown = |detail: String| ApiError::invalid("unknown_report", detail).field("reports");
        let report = service
            .store
            .report(id)
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
fn measured(reports: &[Arc<Report>]) -> BTreeSet<String> {
    let metrics = reports.iter().flat_map(|report| report.values.keys().cloned());
    let times = reports.iter().filter_map(|report| report.gpu_time_ms);
    metrics.chain(times.map(|_| GPU_TIME.to_owned())).collect()
}

/// Whether a history ends with one of the reports, or with another of their commits.
fn ends_with(history: &[Past], reports: &[Arc<Report>]) -> bool {
    let is_of = |newest: &Past, report: &Report| {
        let commit = &report.provenance.commit;
        newest.report_ids.contains(&report.id) || commit.is_some() && newest.commit == *commit
    };
    let newest = history.last();
    newest.is_none_or(|newest| reports.iter().any(|report| is_of(newest, report)))
}

/// The lines whose reports are of the newest commit on the branch, or of no branch, and what could not be told of them.
async fn current(
    service: &Service,
    lines: &BTreeMap<i64, Vec<Arc<Report>>>,
    branch: &str,
    superseded: &BTreeSet<(i64, String)>,
    checks: &[Check],
) -> Result<Vec<Judged>, ApiError> {
    let mut current = Vec::new();
    for (&series_id, reports) in lines {
        if !branch.is_empty() && superseded.iter().any(|(series, _)| *series == series_id) {
            continue;
        }
        let newest = &reports[reports.len() - 1];
        // Some report is in the history of each of their metrics.
        let history = match measured(reports).first() {
            Some(metric) if !branch.is_empty() => history(service, newest, branch, metric).await?,
            _ => Vec::new(),
        };
        if ends_with(&history, reports) {
            let unknown = checks
                .iter()
                .filter(|check| check.series_id == Some(series_id) && check.outcome == Outcome::Unknown);
            let unknown = unknown
                .map(|check| (check.metric.clone(), check.detail.clone()))
                .collect();
            current.push(Judged { series_id, unknown });
        }
    }
    Ok(current)
}

/// Where a report is among all that its line has of a metric, as verdicts order them; none where it is not.
pub(super) async fn places(
    service: &Service,
    report: &Report,
    branch: &str,
    metric: &str,
    reports: [i64; 2],
) -> Result<[Option<usize>; 2], ApiError> {
    let history = history(service, report, branch, metric).await?;
    Ok(reports.map(|id| history.iter().position(|past| past.report_ids.contains(&id))))
}

/// A line's results on a branch and its past, oldest first.
async fn history(service: &Service, report: &Report, branch: &str, metric: &str) -> Result<Vec<Past>, ApiError> {
    let (store, series) = (&service.store, &report.series);
    let path = match branch {
        "" => None,
        branch => store.branch_path(&series.project, branch).await?,
    };
    let filter = TrendFilter {
        path,
        ..TrendFilter::newest(HISTORY)
    };
    let points = store.trend(series.id, metric, &filter).await?;
    Ok(past(store.describe(&points).await?))
}

async fn gather(
    service: &Service,
    reports: &[Arc<Report>],
    branch: &str,
    rules: &Rules,
    gathered: &mut Vec<Gathered>,
) -> Result<(), ApiError> {
    let (store, newest) = (&service.store, &reports[reports.len() - 1]);
    let series = &newest.series;
    for metric in measured(reports) {
        let asked = rules.checks(&series.sequence_name, &series.preset, &metric);
        if asked == crate::verdict::Checks::default() {
            continue;
        }
        let value = |report: &Arc<Report>| match metric == GPU_TIME {
            true => report.gpu_time_ms,
            false => report.values.get(&metric).map(|value| value.0),
        };
        let version = match metric == GPU_TIME {
            true => 0,
            false => newest.metric_versions.get(&metric).copied().unwrap_or(0),
        };
        gathered.push(Gathered {
            reports: reports.to_vec(),
            values: reports.iter().filter_map(value).collect(),
            approved: store.approved(series.id, &metric, version, branch).await?,
            history: history(service, newest, branch, &metric).await?,
            metric,
            version,
        });
    }
    Ok(())
}

/// The history with the measurements of a commit taken together where it was measured first, and each commit behind its parent,
/// whenever they were posted.
pub(super) fn past(points: Vec<Point>) -> Vec<Past> {
    let mut commits: Vec<Vec<Point>> = Vec::new();
    let mut places: HashMap<(String, u32), usize> = HashMap::new();
    for point in points {
        let key = point.commit.clone().map(|commit| (commit, point.metric_version));
        match key.as_ref().and_then(|key| places.get(key)) {
            Some(&place) => commits[place].push(point),
            None => {
                places.extend(key.map(|key| (key, commits.len())));
                commits.push(vec![point]);
            }
        }
    }
    let parents: Vec<Option<usize>> = commits
        .iter()
        .map(|repeats| {
            let parent = repeats.iter().find_map(|point| point.parent.clone())?;
            places.get(&(parent, repeats[0].metric_version)).copied()
        })
        .collect();
    let mut order = Vec::with_capacity(commits.len());
    let mut is_placed = vec![false; commits.len()];
    for first in 0..commits.len() {
        // Its ancestors that are not placed yet go first. Who is its own ancestor is nobody's.
        let mut waiting = Vec::new();
        let mut next = Some(first);
        while let Some(place) = next.filter(|&place| !is_placed[place]) {
            is_placed[place] = true;
            waiting.push(place);
            next = parents[place];
        }
        order.extend(waiting.into_iter().rev());
    }
    order
        .into_iter()
        .map(|place| {
            let repeats = &commits[place];
            Past {
                report_ids: repeats.iter().map(|point| point.report_id).collect(),
                commit: repeats[0].commit.clone(),
                branch: repeats[0].branch.clone(),
                value: of_measurements(&repeats.iter().map(|point| point.value.0).collect::<Vec<_>>()),
                version: repeats[0].metric_version,
            }
        })
        .collect()
}

/// The median of what a commit was measured as, whenever that was; not a number where it mostly was none.
fn of_measurements(values: &[f64]) -> f64 {
    let numbers: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    match 2 * numbers.len() > values.len() {
        true => median(&numbers),
        false => f64::NAN,
    }
}

impl Gathered {
    fn newest(&self) -> &Report {
        &self.reports[self.reports.len() - 1]
    }

    fn key(&self) -> (i64, String) {
        (self.newest().series.id, self.metric.clone())
    }

    fn is_superseded(&self) -> bool {
        !ends_with(&self.history, &self.reports)
    }

    fn judge(&self, rules: &Rules) -> Vec<Check> {
        rules.judge(&Line {
            series_id: self.newest().series.id,
            sequence: &self.newest().series.sequence_name,
            recipe: &self.newest().series.preset,
            metric: &self.metric,
            values: &self.values,
            version: self.version,
            report_id: Some(self.newest().id),
            branch: self.newest().provenance.branch.as_deref(),
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
    let payload = json!({
        "project": project,
        "branch": branch,
        "commit": reports.last().and_then(|report| report.provenance.commit.clone()),
        "outcome": judgement.outcome,
        "regressions": failed,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Value;

    /// Commits and values of what was posted: commit, its parent, and the value.
    fn order(posted: &[(&str, &str, f64)]) -> Vec<(String, f64)> {
        let text = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
        let points = posted
            .iter()
            .zip(1..)
            .map(|(&(commit, parent, value), report_id)| Point {
                report_id,
                job_id: None,
                branch: None,
                commit: text(commit),
                parent: text(parent),
                created_at: Timestamp(report_id),
                value: Value(value),
                metric_version: 1,
            });
        let name = |past: Past| (past.commit.unwrap_or_default(), past.value);
        past(points.collect()).into_iter().map(name).collect()
    }

    fn commits(posted: &[(&str, &str, f64)]) -> String {
        order(posted).into_iter().map(|(commit, _)| commit).collect()
    }

    #[test]
    fn a_commit_that_is_measured_again_stays_where_it_was() {
        let found = order(&[
            ("a", "", 1.0),
            ("b", "", 2.0),
            ("c", "", 3.0),
            ("b", "", 4.0),
            ("", "", 9.0),
        ]);
        let names = ["a", "b", "c", ""].map(str::to_owned);
        assert_eq!(found, names.into_iter().zip([1.0, 3.0, 3.0, 9.0]).collect::<Vec<_>>());
    }

    #[test]
    fn commits_go_behind_their_parents() {
        assert_eq!(
            commits(&[("c", "b", 0.0), ("d", "c", 0.0), ("b", "a", 0.0), ("a", "x", 0.0)]),
            "abcd"
        );
        assert_eq!(
            commits(&[("a", "", 0.0), ("c", "", 0.0), ("b", "", 0.0)]),
            "acb",
            "as posted"
        );
        assert_eq!(
            commits(&[("a", "c", 0.0), ("b", "a", 0.0), ("c", "b", 0.0)]).len(),
            3,
            "a circle"
        );
    }
}
