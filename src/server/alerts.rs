//! Rules as they were last sent, alerts, and what people say: approve, reject, dismiss.

use super::{
    ApiError, ApiPath, ApiQuery, Caller, Service, Shared,
    extract::ApiJson,
    judging::places,
    origin::invalid,
    page::{self, Cursor},
};
use crate::{
    store::{Alert, AlertFilter, AlertStatus, Decision, Report, Timestamp, Verdict},
    verdict::{Kind, Rules},
};
use axum::{Json, extract::State, http::StatusCode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Rules of lines of a branch.
#[derive(Serialize, JsonSchema)]
pub struct Thresholds {
    /// Project.
    project: String,
    /// Branch; empty for none.
    branch: String,
    /// The lines.
    series: Vec<i64>,
    /// The rules that their last run was sent with.
    rules: Arc<Rules>,
}

/// Rules of every branch.
#[derive(Serialize, JsonSchema)]
pub struct ThresholdList {
    /// By project and branch, one a rules file.
    thresholds: Vec<Thresholds>,
}

/// `GET /thresholds`
pub async fn thresholds(State(service): Shared) -> Result<Json<ThresholdList>, ApiError> {
    let mut thresholds: Vec<Thresholds> = Vec::new();
    for line in service.store.line_rules(None).await? {
        let same = thresholds.iter_mut().find(|known| {
            known.project == line.project && known.branch == line.branch && Arc::ptr_eq(&known.rules, &line.rules)
        });
        match same {
            Some(known) => known.series.push(line.series_id),
            None => thresholds.push(Thresholds {
                project: line.project,
                branch: line.branch,
                series: vec![line.series_id],
                rules: line.rules,
            }),
        }
    }
    Ok(Json(ThresholdList { thresholds }))
}

/// Query of `GET /alerts`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AlertQuery {
    /// Only of this project.
    project: Option<String>,
    /// Only of this branch.
    branch: Option<String>,
    /// Only of this status.
    status: Option<AlertStatus>,
    /// Only those whose first bad report is of this commit, or came after it.
    #[schemars(length(min = 1, max = 200))]
    since: Option<String>,
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of alerts.
#[derive(Serialize, JsonSchema)]
pub struct AlertPage {
    /// Newest first.
    alerts: Vec<Alert>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// `GET /alerts`
pub async fn list(State(service): Shared, ApiQuery(query): ApiQuery<AlertQuery>) -> Result<Json<AlertPage>, ApiError> {
    let limit = page::limit(query.limit)?;
    let since_report = match &query.since {
        None => None,
        Some(commit) => Some(first_report(&service, commit, query.project.as_deref()).await?),
    };
    if let Some(project) = &query.project
        && !service.store.projects().await?.contains(project)
    {
        return Err(ApiError::invalid("unknown_project", format!("there is no project `{project}`")).field("project"));
    }
    if let Some(branch) = &query.branch
        && !service.store.is_branch(query.project.as_deref(), branch).await?
    {
        let detail = format!("no report is of a branch `{branch}`");
        return Err(ApiError::invalid("unknown_branch", detail).field("branch"));
    }
    let filter = AlertFilter {
        project: query.project,
        status: query.status,
        branch: query.branch,
        since_report,
        before: query.cursor.map(|cursor| cursor.0),
        limit,
        ..AlertFilter::default()
    };
    let alerts = service.store.alerts(&filter).await?;
    let next_cursor = page::next(&alerts, limit, |alert| alert.id);
    Ok(Json(AlertPage { alerts, next_cursor }))
}

async fn first_report(service: &Service, commit: &str, project: Option<&str>) -> Result<i64, ApiError> {
    let oldest = service.store.first_report(commit, project).await?;
    oldest
        .ok_or_else(|| ApiError::invalid("unknown_commit", format!("no report is of commit `{commit}`")).field("since"))
}

async fn find(service: &Service, id: i64) -> Result<Alert, ApiError> {
    let filter = AlertFilter {
        id: Some(id),
        limit: 1,
        ..AlertFilter::default()
    };
    let found = service.store.alerts(&filter).await?.pop();
    found.ok_or_else(|| ApiError::not_found(format!("there is no alert {id}")))
}

/// `GET /alerts/{alert}`
pub async fn get(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Json<Alert>, ApiError> {
    find(&service, id).await.map(Json)
}

/// Why, and by whom.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reason {
    /// Why.
    #[schemars(length(min = 1, max = 2000))]
    why: String,
    /// Who says so, where no token says it.
    #[serde(default)]
    #[schemars(length(min = 1, max = 200))]
    who: Option<String>,
}

impl Reason {
    fn check(self, caller: Caller) -> Result<(String, String), ApiError> {
        if self.why.trim().is_empty() || self.why.len() > 2000 {
            return Err(invalid("why", "say why, in at most 2000 bytes".to_owned()));
        }
        // A token's name is proof, a field of the request is not.
        let who = caller
            .name
            .or(self.who)
            .filter(|who| (1..=200).contains(&who.trim().len()));
        let who = who.ok_or_else(|| {
            invalid(
                "who",
                "say who decides, in at most 200 bytes, or use a token".to_owned(),
            )
        })?;
        Ok((who, self.why))
    }
}

/// `POST /alerts/{alert}/dismiss`
pub async fn dismiss(
    State(service): Shared,
    caller: Caller,
    ApiPath(id): ApiPath<i64>,
    ApiJson(reason): ApiJson<Reason>,
) -> Result<Json<Alert>, ApiError> {
    let (who, why) = reason.check(caller)?;
    find(&service, id).await?;
    let now = Timestamp::now();
    if !service
        .store
        .close_alert(id, AlertStatus::Dismissed, &why, Some(&who), now)
        .await?
    {
        let detail = format!("alert {id} is closed already");
        return Err(ApiError::new(StatusCode::CONFLICT, "alert_closed", detail));
    }
    find(&service, id).await.map(Json)
}

/// The body of `POST /reports/{report}/decisions`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DecisionRequest {
    /// Whether the result belongs to its line's baseline.
    decision: Verdict,
    /// Why.
    #[schemars(length(min = 1, max = 2000))]
    why: String,
    /// Who says so, where no token says it.
    #[serde(default)]
    #[schemars(length(min = 1, max = 200))]
    who: Option<String>,
}

/// `POST /reports/{report}/decisions`
pub async fn decide(
    State(service): Shared,
    caller: Caller,
    ApiPath(id): ApiPath<i64>,
    ApiJson(request): ApiJson<DecisionRequest>,
) -> Result<(StatusCode, Json<Decision>), ApiError> {
    let reason = Reason {
        why: request.why,
        who: request.who,
    };
    let (who, why) = reason.check(caller)?;
    let unknown = || ApiError::not_found(format!("there is no complete report {id}"));
    let report = service.store.report(id).await?.ok_or_else(unknown)?;
    let branch = report.provenance.branch.clone().unwrap_or_default();
    let _turn = service.turns.of(&report.series.project, &branch).await;
    let answered = match request.decision {
        Verdict::Approved => answered(&service, &report, &branch).await?,
        Verdict::Rejected => Vec::new(),
    };
    let decided = service
        .store
        .decide(id, request.decision, (&who, &why), &answered, Timestamp::now())
        .await?;
    match decided {
        Some(decision) => Ok((StatusCode::CREATED, Json(decision))),
        None => Err(unknown()),
    }
}

/// The open alerts of faults that began with a report or before it.
async fn answered(service: &Service, report: &Report, branch: &str) -> Result<Vec<i64>, ApiError> {
    let filter = AlertFilter {
        project: Some(report.series.project.clone()),
        branch: Some(branch.to_owned()),
        status: Some(AlertStatus::Open),
        limit: 10_000,
        ..AlertFilter::default()
    };
    let mut answered = Vec::new();
    for alert in service.store.alerts(&filter).await? {
        let is_meant = alert.series.id == report.series.id && matches!(alert.kind, Kind::Baseline | Kind::Change);
        let Some(first_bad) = alert.report_id.filter(|_| is_meant) else {
            continue;
        };
        let places = places(service, report, branch, &alert.metric, [first_bad, report.id]).await?;
        let began_before = match places {
            [Some(first_bad), Some(approved)] => first_bad <= approved,
            // The one is older than what is looked at, or has nothing of the metric.
            _ => first_bad <= report.id,
        };
        answered.extend(began_before.then_some(alert.id));
    }
    Ok(answered)
}

/// Query of `GET /baselines`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaselineQuery {
    /// Only of this series.
    series: Option<i64>,
    /// Only of this report.
    report: Option<i64>,
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of decisions.
#[derive(Serialize, JsonSchema)]
pub struct DecisionPage {
    /// Newest first; the newest about a report counts.
    decisions: Vec<Decision>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// `GET /baselines`
pub async fn baselines(
    State(service): Shared,
    ApiQuery(query): ApiQuery<BaselineQuery>,
) -> Result<Json<DecisionPage>, ApiError> {
    let limit = page::limit(query.limit)?;
    let before = query.cursor.map(|cursor| cursor.0);
    let decisions = service
        .store
        .decisions(query.series, query.report, before, limit)
        .await?;
    let next_cursor = page::next(&decisions, limit, |decision| decision.id);
    Ok(Json(DecisionPage { decisions, next_cursor }))
}
