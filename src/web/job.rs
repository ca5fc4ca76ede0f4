//! `/jobs/{id}`: one job. While it waits or runs, its progress; afterwards its recipes beside each other, by summary and by
//! frame.

use super::{
    format,
    layout::{Page, PageError, Section, script_data},
    parts,
};
use crate::{
    metrics::Value,
    run::report::FrameReport,
    server::{ApiError, ApiPath, ApiQuery, Shared},
    store::{FailureKind, GPU_TIME, Images, Job, Report, ReportFilter, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// More presets than a job may have.
const MAX_REPORTS: u32 = 1000;

/// Narrower than a column of the page, in pixels.
const MAX_SMALL_WIDTH: u32 = 320;

/// What is chosen; without scripts, a form sends it.
#[derive(Deserialize)]
pub struct JobQuery {
    metric: Option<String>,
}

/// What the script needs.
#[derive(Serialize)]
struct Data<'a> {
    job: i64,
    running: bool,
    /// Any at all; without them there is nothing to look at.
    images: bool,
    units: BTreeMap<&'a str, &'static str>,
    reports: Vec<ReportData>,
}

#[derive(Serialize)]
struct ReportData {
    id: i64,
    name: String,
}

/// A finished job's numbers.
struct Results {
    reports: Vec<Arc<Report>>,
    /// Of each report.
    frames: Vec<Vec<FrameReport>>,
    metrics: BTreeSet<String>,
    /// So small that the page enlarges its images; texels then stay sharp.
    is_small: bool,
}

/// `GET /jobs/{id}`
pub async fn page(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<JobQuery>,
) -> Result<Html<String>, PageError> {
    let job = service.store.job(id).await?;
    let job = job.ok_or_else(|| ApiError::not_found(format!("there is no job {id}")))?;
    let filter = ReportFilter {
        job_id: Some(id),
        limit: MAX_REPORTS,
        ..ReportFilter::default()
    };
    let reports = service.store.reports(&filter).await?;
    let mut frames = Vec::with_capacity(reports.len());
    for report in &reports {
        frames.push(service.store.frames(report.id).await?);
    }
    let sequence = service.store.sequence(&job.sequence_hash).await?;
    let results = Results {
        metrics: reports
            .iter()
            .flat_map(|report| report.summary.keys().cloned())
            .collect(),
        is_small: sequence
            .as_ref()
            .is_some_and(|sequence| sequence.output_size.width <= MAX_SMALL_WIDTH),
        reports,
        frames,
    };
    let content = html! {
        (heading(&job))
        (standing(&job))
        @if !results.reports.is_empty() { (results.render(&job, &query)) }
        (script_data(&results.data(&job))?)
    };
    let title = format!("Job {id}");
    let page = Page {
        title: &title,
        section: Some(Section::Jobs),
        script: Some("job.js"),
        charts: !results.reports.is_empty(),
        content,
    };
    Ok(page.render(&service))
}

fn heading(job: &Job) -> Markup {
    let now = Timestamp::now();
    html! {
        h1 { "Job " (job.id) @if let Some(label) = &job.provenance.label { span.muted { " · " (label) } } }
        ul.facts {
            li { (parts::status(job)) }
            li { span.key { "sequence " } (parts::subject(job)) }
            @if let Some(branch) = &job.provenance.branch { li { span.key { "branch " } (branch) } }
            @if let Some(commit) = &job.provenance.commit { li { span.key { "commit " } (format::short_hash(commit)) } }
            li { span.key { "queued " } (format::age(job.created_at, now)) }
            @if let (Some(started), Some(finished)) = (job.started_at, job.finished_at) {
                li { span.key { "took " } (format!("{:.1} s", finished.since(started).as_secs_f64())) }
            }
            @if job.attempts > 1 { li { span.key { "attempt " } (job.attempts) } }
            @if job.status.is_final() { li { a href={ "/jobs/new?from=" (job.id) } { "Run again" } } }
        }
    }
}

/// Progress of a job that is not over, or why it failed.
fn standing(job: &Job) -> Markup {
    html! {
        @if !job.status.is_final() {
            div.running-box {
                progress #progress max=(job.n_total.max(1)) value=(job.n_done) {}
                span #progress-text aria-live="polite" { (job.n_done) " of " (job.n_total) " frames" }
                button.quiet #cancel type="button" disabled[job.cancel_requested] { "Cancel" }
            }
        }
        @if let Some(error) = &job.error {
            div.notice.bad role="alert" {
                p { b { (match error.kind {
                    FailureKind::Input => "The sequence or the job is at fault.",
                    FailureKind::Device => "The GPU or its driver failed.",
                    FailureKind::Internal => "The service failed.",
                }) } " " code { (error.code) } }
                p { (error.message) }
            }
        }
    }
}

impl Results {
    fn data<'a>(&'a self, job: &Job) -> Data<'a> {
        let report = |report: &Arc<Report>| ReportData {
            id: report.id,
            name: parts::recipe(&report.series),
        };
        Data {
            job: job.id,
            running: !job.status.is_final(),
            images: job.spec.images != Images::None,
            units: self
                .metrics
                .iter()
                .map(|metric| (metric.as_str(), format::unit(metric)))
                .collect(),
            reports: self.reports.iter().map(report).collect(),
        }
    }

    fn render(&self, job: &Job, query: &JobQuery) -> Markup {
        let metric = query.metric.as_deref().filter(|metric| self.metrics.contains(*metric));
        let metric = metric.or_else(|| {
            ["psnr", "ssim"]
                .into_iter()
                .find(|metric| self.metrics.contains(*metric))
        });
        let metric = metric.or(self.metrics.first().map(String::as_str));
        html! {
            (self.notes())
            h2 { "Summary" }
            (self.summary())
            @if let Some(metric) = metric {
                h2 { "Frame by frame" }
                (self.by_frame(metric))
            }
            @if job.spec.images != Images::None {
                h2 #images { "Images" }
                (self.images())
            }
            @if self.reports.iter().any(|report| report.validation.is_some()) {
                h2 { "Validation" }
                (self.validation())
            }
            h2 { "Times" }
            (self.times())
        }
    }

    /// What a reader must know to trust the numbers, once for all presets that share it.
    fn notes(&self) -> Markup {
        let mut notes: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for report in &self.reports {
            for note in &report.notes {
                notes.entry(note).or_default().push(parts::recipe(&report.series));
            }
        }
        html! {
            @if !notes.is_empty() {
                div.notice { @for (note, presets) in notes {
                    p { @if presets.len() < self.reports.len() { b { (presets.join("; ")) ": " } } (note) }
                } }
            }
        }
    }

    fn summary(&self) -> Markup {
        let best = |metric: &str| parts::best(metric, self.reports.iter().map(Arc::as_ref));
        html! {
            div.scroll { table {
                thead { tr {
                    th { "Preset" }
                    @for metric in &self.metrics { th.number { (format::title(metric)) } th.number { "worst 5 %" } }
                    th.number { (format::title(GPU_TIME)) }
                    th { "Rows" }
                } }
                tbody { @for report in &self.reports {
                    tr {
                        th scope="row" { a href={ "/reports/" (report.id) } { (parts::recipe(&report.series)) } }
                        @for metric in &self.metrics {
                            @let value = report.values.get(metric).copied();
                            @let best = best(metric);
                            td.number.best[best.is_some() && value.map(|value| value.0) == best] { (format::value(metric, value)) }
                            td.number.muted { (format::value(metric, report.summary.get(metric).map(|summary| summary.p5))) }
                        }
                        td.number { (format::value(GPU_TIME, report.gpu_time_ms.map(Value))) }
                        td { a href={ "/api/v1/reports/" (report.id) "/frames?format=csv" } { "CSV" } " "
                             a href={ "/api/v1/reports/" (report.id) "/frames" } { "JSON" } }
                    }
                } }
            } }
            p.muted { "Frames of the warm-up after a reset are stored but not counted here." }
        }
    }

    /// The chart, and its numbers as a table for whoever cannot see or run it.
    fn by_frame(&self, metric: &str) -> Markup {
        let n_frames = self.frames.iter().map(Vec::len).max().unwrap_or(0);
        html! {
            form.controls {
                label { "Metric" select #metric name="metric" {
                    @for id in &self.metrics { option value=(id) selected[id == metric] { (id) } }
                } }
                noscript { button { "Show" } }
            }
            div.chart #chart {}
            details {
                summary { "The same as a table: " (metric) }
                div.scroll tabindex="0" role="group" aria-label="Frame by frame" { table {
                    thead { tr { th { "Frame" } @for report in &self.reports { th.number { (parts::recipe(&report.series)) } } } }
                    tbody { @for i in 0..n_frames {
                        @let frame = self.frames.iter().find_map(|frames| frames.get(i));
                        tr {
                            td { (i) @if frame.is_some_and(|frame| frame.reset) { " " span.muted { "reset" } }
                                @else if frame.is_some_and(|frame| frame.warmup) { " " span.muted { "warm-up" } } }
                            @for frames in &self.frames {
                                td.number { (format::value(metric, frames.get(i).and_then(|frame| frame.metrics.get(metric)).copied())) }
                            }
                        }
                    } }
                } }
            }
        }
    }

    /// The last frame of each preset, by when every system has settled; a click opens the viewer.
    fn images(&self) -> Markup {
        html! {
            ul.cards.pixelated[self.is_small] { @for (report, frames) in self.reports.iter().zip(&self.frames) {
                @let frame = frames.len().saturating_sub(1);
                li { a href={ "/reports/" (report.id) "/frames/" (frame) } {
                    img loading="lazy" src={ "/api/v1/reports/" (report.id) "/frames/" (frame) "/output.png?width=320" } alt={ "output of frame " (frame) };
                    b { (parts::recipe(&report.series)) }
                } }
            } }
        }
    }

    /// The frames and every pass of each preset against the twin.
    fn validation(&self) -> Markup {
        let bad = self
            .reports
            .iter()
            .filter(|report| report.validation.as_ref().is_some_and(|found| !found.agrees));
        html! {
            @for report in bad {
                @let bisection = report.validation.as_ref().and_then(|found| found.bisection.as_ref());
                div.notice.bad role="alert" { p {
                    b { (parts::recipe(&report.series)) } ": the adapter disagrees with the twin. "
                    @if let Some((pass, frame)) = bisection.and_then(|found| found.pass.as_ref().zip(found.frame)) {
                        "Pass " code { (pass) } " is wrong, first in frame " (frame) "."
                    }
                } }
            }
            div.scroll { table {
                thead { tr {
                    th { "Preset" } th { "Pass" } th { "Verdict" } th.number { "max |Δ|" } th.number { "mean |Δ|" }
                    th.number { "beyond" } th.number { "not finite" } th.number { "frames wrong" } th { "Worst" } th { "Rows" }
                } }
                tbody { @for report in &self.reports { @if let Some(found) = &report.validation {
                    @for (i, overview) in [&found.shown].into_iter().chain(&found.passes).enumerate() { tr {
                        @if i == 0 {
                            th scope="rowgroup" rowspan=(1 + found.passes.len()) { (parts::recipe(&report.series)) }
                        }
                        td { @if i == 0 { "frames" } @else { (overview.name) }
                            @if i == 0 && found.frame_bounds.is_none() { " " span.muted { "measured" } } }
                        td { span.status.(if overview.agrees { "done" } else { "failed" }) { (if overview.agrees { "agrees" } else { "disagrees" }) } }
                        td.number { (format!("{:.1e}", overview.max)) }
                        td.number { (format!("{:.1e}", overview.mean)) }
                        td.number { (overview.n_beyond) }
                        td.number { (overview.non_finite_gpu + overview.non_finite_twin) }
                        td.number { (overview.n_disagreeing_frames) }
                        td { @if let Some((worst, frame)) = overview.worst.as_ref().zip(overview.worst_frame) {
                            "frame " (frame) ", " code { (worst.image) } " (" (worst.pixel[0]) ", " (worst.pixel[1]) ")"
                        } }
                        @if i == 0 {
                            td rowspan=(1 + found.passes.len()) { a href={ "/api/v1/reports/" (report.id) "/validation" } { "JSON" } }
                        }
                    } }
                } } }
            } }
            p.muted { "Against the twin on the CPU in f64, in shares of the display's range. Each pass is given the inputs that the GPU's had; frames are what is shown, with the errors of all frames before. Beyond: pixels that a decision made differently." }
        }
    }

    fn times(&self) -> Markup {
        let passes: BTreeSet<&String> = self.reports.iter().flat_map(|report| report.times_ms.keys()).collect();
        let stages = self.reports.first().map(|report| &report.stages_ms);
        html! {
            div.scroll tabindex="0" role="group" aria-label="Times" { table {
                thead { tr { th { "Preset" } @for pass in &passes { th.number { (pass) " " span.unit { "ms" } } th.number { "min" } th.number { "± MAD" } } } }
                tbody { @for report in &self.reports {
                    tr {
                        th scope="row" { (parts::recipe(&report.series)) }
                        @for pass in &passes {
                            @let time = report.times_ms.get(*pass);
                            td.number { (format::ms(time.map(|time| time.median))) }
                            td.number.muted { (format::ms(time.map(|time| time.min))) }
                            td.number.muted { (format::ms(time.map(|time| time.mad))) }
                        }
                    }
                } }
            } }
            @if let Some(stages) = stages {
                p.muted { "Stages of the whole job, while all overlapped: "
                    @for (i, (stage, time_ms)) in stages.iter().enumerate() {
                        @if i > 0 { ", " } (stage) " " (format!("{time_ms:.0}")) " ms"
                    } "." }
            }
            @if let Some(report) = self.reports.first() {
                p.muted { "On " (report.series.environment.adapter.name) " (" (report.series.environment.adapter.driver) " " (report.series.environment.adapter.driver_version)
                    "), build " (report.revision) "." }
            }
        }
    }
}
