//! `/alerts`: what was found wanting, which commit is to blame, and where to look.

use super::{
    format,
    layout::{Page, PageError, Section},
    parts,
    query::href,
};
use crate::{
    server::{ApiQuery, Shared},
    store::{Alert, AlertFilter, AlertStatus, Timestamp},
    verdict::Kind,
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde::Deserialize;

const PAGE_SIZE: u32 = 100;

/// The form's fields; empty means all.
#[derive(Deserialize)]
#[serde(default)]
pub struct AlertsQuery {
    status: String,
    project: String,
    branch: String,
    before: Option<i64>,
}

impl Default for AlertsQuery {
    fn default() -> Self {
        Self {
            status: "open".to_owned(),
            project: String::new(),
            branch: String::new(),
            before: None,
        }
    }
}

/// `GET /alerts`
pub async fn page(State(service): Shared, ApiQuery(query): ApiQuery<AlertsQuery>) -> Result<Html<String>, PageError> {
    let statuses = [
        ("open", AlertStatus::Open),
        ("resolved", AlertStatus::Resolved),
        ("dismissed", AlertStatus::Dismissed),
    ];
    let given = |text: &str| (!text.is_empty()).then(|| text.to_owned());
    let filter = AlertFilter {
        project: given(&query.project),
        branch: given(&query.branch),
        status: statuses
            .iter()
            .find(|(name, _)| *name == query.status)
            .map(|(_, status)| *status),
        before: query.before,
        limit: PAGE_SIZE,
        ..AlertFilter::default()
    };
    let alerts = service.store.alerts(&filter).await?;
    let older = alerts
        .last()
        .filter(|_| alerts.len() == PAGE_SIZE as usize)
        .map(|alert| alert.id);
    let content = html! {
        h1 { "Alerts" }
        form.filters {
            label { "Status" select name="status" {
                option value="" { "all" }
                @for (name, _) in statuses { option value=(name) selected[query.status == name] { (name) } }
            } }
            label { "Project" input type="text" name="project" value=(query.project) placeholder="all" size="12"; }
            label { "Branch" input type="text" name="branch" value=(query.branch) placeholder="all" size="12"; }
            button { "Show" }
        }
        @if alerts.is_empty() { p.muted { "No alerts." } } @else { (table(&alerts)) }
        @if let Some(older) = older {
            div.pages { a href={ "?status=" (query.status) "&before=" (older) } { "Older" } }
        }
    };
    let page = Page {
        title: "Alerts",
        section: Some(Section::Alerts),
        script: None,
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

fn table(alerts: &[Alert]) -> Markup {
    let now = Timestamp::now();
    html! {
        div.scroll { table {
            thead { tr {
                th { "Alert" } th { "Sequence" } th { "Recipe" } th { "Metric" } th { "Branch" } th { "First bad" }
                th { "Last good" } th { "What" } th.number { "Found" }
            } }
            tbody { @for alert in alerts { (row(alert, now)) } }
        } }
    }
}

fn row(alert: &Alert, now: Timestamp) -> Markup {
    let status = match alert.status {
        AlertStatus::Open => ("failed", "open"),
        AlertStatus::Resolved => ("done", "resolved"),
        AlertStatus::Dismissed => ("cancelled", "dismissed"),
    };
    let finding = &alert.finding;
    let absent = || html! { span.muted { (format::ABSENT) } };
    html! {
        tr data-alert=(alert.id) {
            td { "#" (alert.id) " " span class={ "status " (status.0) } { (status.1) } }
            td { (parts::sequence(&alert.series)) }
            td { (parts::recipe(&alert.series)) }
            td { @if alert.kind == Kind::NoData { "no data" } @else { (alert.metric) } }
            td { (alert.branch) }
            td { @match (&finding.first_bad_commit, place(alert)) {
                (Some(commit), Some(href)) => a href=(href) { (format::short_hash(commit)) },
                (None, Some(href)) => a href=(href) { "report " (alert.report_id.unwrap_or_default()) },
                (Some(commit), None) => (format::short_hash(commit)),
                (None, None) => (absent()),
            } }
            td { @match &finding.last_good_commit { Some(commit) => (format::short_hash(commit)), None => (absent()) } }
            td.fill {
                (alert.detail)
                @if !finding.worst_frames.is_empty() {
                    " · worst frames "
                    @for (position, frame) in finding.worst_frames.iter().enumerate() {
                        @if position > 0 { ", " }
                        @match frame_href(alert, *frame) { Some(href) => a href=(href) { (frame) }, None => (frame) }
                    }
                }
                @if let Some(why) = &alert.closed_why {
                    " · " span.muted { (why) @if let Some(who) = &alert.closed_by { " (" (who) ")" } }
                }
            }
            td.number { (format::age(alert.opened_at, now)) }
        }
    }
}

/// Where the first bad report is.
fn place(alert: &Alert) -> Option<String> {
    Some(format!("/reports/{}", alert.report_id?))
}

/// Where one of its frames is looked at, beside the last good report's.
fn frame_href(alert: &Alert, frame: usize) -> Option<String> {
    let report = alert.report_id.filter(|_| alert.job_id.is_some())?;
    let good = alert.finding.last_good_report.map(|id| id.to_string());
    let metric = Some(alert.metric.clone());
    Some(href(
        &format!("/reports/{report}/frames/{frame}"),
        [("with", good), ("metric", metric)],
    ))
}
