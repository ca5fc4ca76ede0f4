//! `/reports/{id}`: a report that was posted. One that came from a job is shown there, with its images.

use super::{
    format,
    layout::{Page, PageError, Section},
    parts,
};
use crate::{
    metrics::Value,
    server::{ApiError, ApiPath, Shared},
    store::{GPU_TIME, Report, Timestamp},
};
use axum::{
    extract::State,
    response::{IntoResponse as _, Redirect, Response},
};
use maud::{Markup, html};

/// `GET /reports/{report}`
pub async fn page(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Response, PageError> {
    let report = service.store.report(id).await?;
    let report = report.ok_or_else(|| ApiError::not_found(format!("there is no report {id}")))?;
    if report.job_id.is_some() {
        let href = parts::report_href(id, report.job_id, report.preset_index);
        return Ok(Redirect::to(&href).into_response());
    }
    let title = format!("Report {id}");
    let page = Page {
        title: &title,
        section: Some(Section::Reports),
        script: None,
        content: html! { (heading(&report)) (summary(&report)) (origin(&report)) },
    };
    Ok(page.render(&service).into_response())
}

fn heading(report: &Report) -> Markup {
    html! {
        h1 { "Report " (report.id) @if let Some(label) = &report.provenance.label { span.muted { " · " (label) } } }
        ul.facts {
            li { span.key { "sequence " } (parts::sequence(&report.series)) }
            li { span.key { "system " } (parts::recipe(&report.series)) }
            li { (parts::revision(&report.provenance)) }
            li { span.key { "posted " } (format::age(report.created_at, Timestamp::now())) }
            @if !report.complete { li { "frames are still being added" } }
        }
        @for note in &report.notes { p.muted { (note) } }
    }
}

fn summary(report: &Report) -> Markup {
    html! {
        h2 { "Summary" }
        div.scroll { table {
            thead { tr { th { "Metric" } th.number { "Mean" } th.number { "Least" } th.number { "5 %" } } }
            tbody {
                @for (metric, summary) in &report.summary {
                    tr {
                        td { a href={ "/trends?metric=" (metric) } { (metric) } }
                        @for value in [summary.mean, summary.min, summary.p5] {
                            td.number { (format::value(metric, Some(value))) }
                        }
                    }
                }
                @if report.gpu_time_ms.is_some() {
                    tr { td { (format::title(GPU_TIME)) } td.number { (format::value(GPU_TIME, report.gpu_time_ms.map(Value))) } td {} td {} }
                }
            }
        } }
        p { a href={ "/api/v1/reports/" (report.id) "/frames?format=csv" } { "Every frame as CSV" } }
    }
}

fn origin(report: &Report) -> Markup {
    let (origin, environment) = (&report.provenance, &report.series.environment);
    let adapter = &environment.adapter;
    let facts = [
        ("Adapter", Some(adapter.name.clone())),
        ("Driver", Some(format!("{} {}", adapter.driver, adapter.driver_version))),
        ("System", Some(environment.os.clone())),
        ("Clocks", Some(environment.clocks.clone())),
        ("Parent", origin.parent.clone()),
        ("Pull request", origin.pull_request.clone()),
        ("Engine", origin.engine_version.clone()),
    ];
    html! {
        h2 { "Where it came from" }
        ul.facts {
            @for (name, text) in facts {
                @if let Some(text) = text.filter(|text| !text.trim().is_empty()) {
                    li { span.key { (name) " " } (text) }
                }
            }
            @for (name, text) in &origin.labels { li { span.key { (name) " " } (text) } }
        }
    }
}
