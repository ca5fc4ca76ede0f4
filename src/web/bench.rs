//! `/bench`: run time against error, of the newest benchmark or of another, with the fronts of those before it.

use super::{
    format,
    layout::{Page, PageError, Section},
};
use crate::{
    bench::Point,
    metrics::Metric,
    server::{ApiQuery, Shared, bench},
    store::{BenchFilter, BenchRun, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde::Deserialize;

const MAX_RUNS: u32 = 100;
/// Older fronts than these would only be clutter.
const MAX_FRONTS: usize = 5;

/// Query of the page.
#[derive(Deserialize)]
pub struct BenchQuery {
    /// The newest by default.
    job: Option<i64>,
    /// The benchmark's own by default.
    metric: Option<Metric>,
}

/// `GET /bench`
pub async fn page(State(service): Shared, ApiQuery(query): ApiQuery<BenchQuery>) -> Result<Html<String>, PageError> {
    let newest = BenchFilter {
        limit: MAX_RUNS,
        ..BenchFilter::default()
    };
    let runs = service.store.bench_runs(&newest).await?;
    let content = match query.job.or_else(|| runs.first().map(|run| run.job_id)) {
        None => html! {
            h1 { "Run time against error" }
            p { "Nothing has been measured yet. " (new_job()) " or post a sweep of settings over a sequence, and follow its job:" }
            pre tabindex="0" { "curl -X POST -H 'content-type: application/json' -d '{\"sequence\": \"pan\", \"bench\": {\"presets\": [{\"preset\": \"inside\"}, {\"preset\": \"karis2014\"}], \"knobs\": {\"history\": [\"f16\", \"f32\"]}, \"metrics\": [\"psnr\"], \"metric\": \"psnr\"}}' HOST/api/v1/bench" }
        },
        Some(job_id) => {
            let mut run = bench::find(&service, job_id).await?;
            if let Some(metric) = query.metric {
                run.report = run.report.on(metric);
            }
            html! {
                h1 { "Run time against error" }
                p { (new_job()) }
                (heading(&run))
                (metrics(&run))
                (chart(&run, &runs))
                (points(&run))
                @if runs.len() > 1 { (others(&runs)) }
            }
        }
    };
    let page = Page {
        title: "Run time against error",
        section: Some(Section::Bench),
        script: None,
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

fn new_job() -> Markup {
    html! { a.button href="/jobs/new?kind=bench" { "New benchmark" } }
}

fn heading(run: &BenchRun) -> Markup {
    let report = &run.report;
    html! {
        p {
            a href={ "/jobs/" (run.job_id) } { "#" (run.job_id) } " · "
            a href={ "/sequences/" (run.sequence_hash) } { (report.sequence.name) } " · "
            (report.adapter.name) " (" (report.adapter.driver) " " (report.adapter.driver_version) ") · "
            (format::short_hash(&report.revision)) " · " (format::age(run.created_at, Timestamp::now()))
        }
        p.muted {
            "Times are " (report.clock.description()) ". The setting " (report.noise.setting) ", measured twice, differed by up to "
            (format!("{:.1}", 100.0 * report.noise.relative)) " %: no two times nearer than that are told apart."
        }
        @for reason in &report.left_out { p.muted { "Left out: " (reason) } }
    }
}

fn metrics(run: &BenchRun) -> Markup {
    let ids = run.report.points.first().map(|point| point.metrics.keys());
    html! {
        p { "On "
            @for (i, id) in ids.into_iter().flatten().enumerate() {
                @if i > 0 { ", " }
                @if id == run.report.metric.id() { strong { (id) } }
                @else { a href={ "/bench?job=" (run.job_id) "&metric=" (id) } { (id) } }
            }
            " · " a href={ "/api/v1/bench/" (run.job_id) "/front.svg?metric=" (run.report.metric) } { "picture" }
            " · " a href={ "/api/v1/bench/" (run.job_id) "/points.csv?metric=" (run.report.metric) } { "CSV" }
            " · " a href={ "/api/v1/bench/" (run.job_id) } { "JSON" }
        }
    }
}

/// Fronts are comparable where sequence, adapter and driver are the same.
fn chart(run: &BenchRun, runs: &[BenchRun]) -> Markup {
    let before: Vec<_> = runs
        .iter()
        .filter(|other| {
            other.job_id < run.job_id
                && other.report.sequence.name == run.report.sequence.name
                && other.report.adapter == run.report.adapter
        })
        .map(|other| &other.report)
        .take(MAX_FRONTS)
        .collect();
    html! {
        figure tabindex="0" aria-label="Time against error" {
            (maud::PreEscaped(run.report.svg(&before)))
            @if !before.is_empty() {
                figcaption.muted { "Dashed: the fronts of the " (before.len()) " benchmarks before it, the older the paler." }
            }
        }
    }
}

const COPIES: &str = "A frame's time over that of moving its bytes once at the speed of a plain copy";

fn points(run: &BenchRun) -> Markup {
    let metric = run.report.metric;
    let mut points: Vec<&Point> = run.report.points.iter().collect();
    points.sort_by(|a, b| a.time_ms.median.total_cmp(&b.time_ms.median));
    html! {
        div.scroll tabindex="0" role="group" aria-label="Settings" { table {
            thead { tr {
                th { "Setting" } th { "Dominated by" }
                th.number { (metric) }
                th.number { "ms" } th.number { "MAD" } th.number { "95 %" }
                th.number { "B/pixel" } th.number title=(COPIES) { "Copies" } th.number { "Skipped" } th.number { "MiB" }
            } }
            tbody { @for point in points {
                @let time = &point.time_ms;
                tr {
                    td { (point.name()) }
                    td { (point.dominated_by.as_deref().unwrap_or("on the front")) }
                    td.number { @match point.metrics.get(metric.id()) { Some(value) => (format!("{value:.4}")), None => (format::ABSENT) } }
                    td.number { (format!("{:.3}", time.median)) }
                    td.number { (format!("{:.3}", time.mad)) }
                    td.number { (format!("{:.3}–{:.3}", time.low, time.high)) }
                    td.number { (format!("{:.0}", point.bytes_per_pixel)) }
                    td.number { @match point.over_copy {
                        Some(ratio) => (format!("{ratio:.2}")),
                        None => (format::ABSENT),
                    } }
                    td.number { (format!("{:.0} %", 100.0 * point.skipped)) }
                    td.number { @match point.peak_gpu_bytes {
                        Some(bytes) => (format!("{:.1}", bytes as f64 / 1_048_576.0)),
                        None => (format::ABSENT),
                    } }
                }
            } }
        } }
    }
}

fn others(runs: &[BenchRun]) -> Markup {
    html! {
        h2 { "Benchmarks" }
        ul { @for run in runs {
            li {
                a href={ "/bench?job=" (run.job_id) } { "#" (run.job_id) } " " (run.report.sequence.name) ", "
                (run.report.points.len()) " settings, " (run.report.adapter.name) ", " (format::age(run.created_at, Timestamp::now()))
            }
        } }
    }
}
