//! `/jobs`: all jobs, newest first, a page at a time.

use super::{
    layout::{Page, PageError, Section},
    parts,
};
use crate::{
    server::{ApiQuery, Shared},
    store::{JobFilter, Status, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::html;
use serde::Deserialize;

const PAGE_SIZE: u32 = 50;

/// Query of the page.
#[derive(Deserialize)]
pub struct JobsQuery {
    /// One of the statuses; anything else, such as the empty choice of the form, means all.
    #[serde(default)]
    status: String,
    before: Option<i64>,
}

/// `GET /jobs`
pub async fn page(State(service): Shared, ApiQuery(query): ApiQuery<JobsQuery>) -> Result<Html<String>, PageError> {
    let statuses = [
        ("queued", Status::Queued),
        ("running", Status::Running),
        ("done", Status::Done),
        ("failed", Status::Failed),
        ("cancelled", Status::Cancelled),
    ];
    let status = statuses
        .iter()
        .find(|(name, _)| *name == query.status)
        .map(|(_, status)| *status);
    let filter = JobFilter {
        status,
        sequence_hash: None,
        project: None,
        before: query.before,
        limit: PAGE_SIZE,
    };
    let jobs = service.store.jobs(&filter).await?;
    let older = jobs
        .last()
        .filter(|_| jobs.len() == PAGE_SIZE as usize)
        .map(|job| job.id);
    let content = html! {
        h1 { "Jobs" }
        p.buttons {
            a.button href="/jobs/new" { "New job" } a.button href="/jobs/new?kind=bench" { "New benchmark" } a.button href="/jobs/new?kind=stress" { "New matrix" }
        }
        form.filters {
            label { "Status" select name="status" {
                option value="" { "all" }
                @for (name, value) in statuses { option value=(name) selected[status == Some(value)] { (name) } }
            } }
            button { "Show" }
        }
        @if jobs.is_empty() { p.muted { "No jobs." } } @else { (parts::job_table(&jobs, Timestamp::now())) }
        div.pages {
            @if query.before.is_some() { a href={ "/jobs?status=" (query.status) } { "Newest" } }
            @if let Some(id) = older { a href={ "/jobs?status=" (query.status) "&before=" (id) } { "Older" } }
        }
    };
    let page = Page {
        title: "Jobs",
        section: Some(Section::Jobs),
        script: Some("jobs.js"),
        charts: false,
        content,
    };
    Ok(page.render(&service))
}
