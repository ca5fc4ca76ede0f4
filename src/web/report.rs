//! `/reports/{id}`: a report in full: what its alerts say, summaries, every frame's metrics and times on charts with one
//! cursor, and the worst frames first. Another report may lie beside it: `?with=`.

use super::{
    format,
    layout::{Page, PageError, script_data},
    parts,
    query::{Query, href},
    standing::{Standings, regressions},
};
use crate::{
    metrics::{Better, Value},
    run::report::FrameReport,
    server::{ApiError, ApiPath, Service, Shared},
    store::{GPU_TIME, Images, Report, Timestamp},
    verdict::{Kind, better},
};
use axum::{
    extract::{RawQuery, State},
    response::Html,
};
use maud::{Markup, html};
use serde::Serialize;
use std::{collections::BTreeSet, sync::Arc};

/// Charts that are shown unless others are asked for.
const MAX_CHARTS: usize = 6;
/// In the order in which they are wanted.
const USUAL: [&str; 8] = ["psnr", "ssim", "flip", "ghost", "flicker", "tpsnr", "blur", "hdr_flip"];
const N_WORST: usize = 8;
/// Rows of the table without scripts.
const MAX_ROWS: usize = 600;

#[derive(Serialize)]
struct Data<'a> {
    report: i64,
    name: String,
    other: Option<Other>,
    /// Where frames are looked at, if there are any.
    viewer: Option<String>,
    metrics: Vec<MetricData<'a>>,
}

#[derive(Serialize)]
struct Other {
    id: i64,
    name: String,
}

#[derive(Serialize)]
struct MetricData<'a> {
    metric: &'a str,
    unit: &'static str,
}

/// The report that a path or a query names.
pub async fn find(service: &Service, id: i64) -> Result<Arc<Report>, PageError> {
    let found = service.store.report(id).await?;
    Ok(found.ok_or_else(|| ApiError::not_found(format!("there is no report {id}")))?)
}

/// Whether its frames can be looked at.
pub async fn has_images(service: &Service, report: &Report) -> Result<bool, PageError> {
    let Some(job) = report.job_id else { return Ok(false) };
    let job = service.store.job(job).await?;
    Ok(report.series.sequence_hash.is_some() && job.is_some_and(|job| job.spec.images != Images::None))
}

/// Which metric frames are sorted by: the one that is asked for, else the first that is known.
pub fn sorted_by(report: &Report, asked: Option<&str>) -> Option<String> {
    let known = |metric: &&str| report.values.contains_key(*metric);
    let found = asked.filter(known).or(USUAL.into_iter().find(known));
    found
        .map(str::to_owned)
        .or_else(|| report.values.keys().next().cloned())
}

/// How a report is called beside another.
pub fn name(report: &Report) -> String {
    let commit = report
        .provenance
        .commit
        .as_deref()
        .map(|commit| commit.chars().take(10).collect::<String>());
    let place = commit.unwrap_or_else(|| format!("report {}", report.id));
    format!("{}, {place}", parts::recipe(&report.series))
}

/// `GET /reports/{report}`
pub async fn page(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    RawQuery(query): RawQuery,
) -> Result<Html<String>, PageError> {
    let query = Query::parse(query.as_deref());
    let report = find(&service, id).await?;
    let other = match query.number("with") {
        Some(other) => Some(find(&service, other).await?),
        None => None,
    };
    let frames = service.store.frames(id).await?;
    let metric = sorted_by(&report, query.one("metric"));
    let viewer = match has_images(&service, &report).await? {
        true => Some(format!("/reports/{id}/frames")),
        false => None,
    };
    let mut shown: Vec<String> = query.all("show");
    shown.retain(|metric| report.values.contains_key(metric));
    if shown.is_empty() {
        let usual = USUAL
            .into_iter()
            .filter(|metric| report.values.contains_key(*metric))
            .map(str::to_owned);
        let rest = report
            .values
            .keys()
            .filter(|metric| !USUAL.contains(&metric.as_str()))
            .cloned();
        shown = metric.clone().into_iter().chain(usual.chain(rest)).collect();
        let mut seen = BTreeSet::new();
        shown.retain(|metric| seen.insert(metric.clone()));
        shown.truncate(MAX_CHARTS);
    }
    let data = Data {
        report: id,
        name: name(&report),
        other: other.as_ref().map(|other| Other {
            id: other.id,
            name: name(other),
        }),
        viewer: viewer.clone(),
        metrics: shown
            .iter()
            .map(|metric| MetricData {
                metric,
                unit: format::unit(metric),
            })
            .collect(),
    };
    let standings = Standings::load(&service, &report.series.project, None).await?;
    let view = View {
        report: &report,
        other: other.as_deref(),
        frames: &frames,
        metric: metric.as_deref(),
        viewer: viewer.as_deref(),
    };
    let content = html! {
        (view.heading())
        (view.verdict(&standings))
        (view.summary())
        @if !frames.is_empty() {
            (view.worst())
            (view.charts(&shown))
        }
        (view.origin())
        (script_data(&data)?)
    };
    let title = format!("Report {id}");
    let page = Page {
        title: &title,
        section: None,
        script: (!frames.is_empty()).then_some("report.js"),
        charts: !frames.is_empty(),
        content,
    };
    Ok(page.render(&service))
}

struct View<'a> {
    report: &'a Report,
    other: Option<&'a Report>,
    frames: &'a [FrameReport],
    metric: Option<&'a str>,
    viewer: Option<&'a str>,
}

impl View<'_> {
    fn with(&self) -> Option<String> {
        self.other.map(|other| other.id.to_string())
    }

    fn heading(&self) -> Markup {
        let report = self.report;
        html! {
            h1 { "Report " (report.id) @if let Some(label) = &report.provenance.label { span.muted { " · " (label) } } }
            ul.facts {
                li { span.key { "sequence " } (parts::sequence(&report.series)) }
                li { span.key { "recipe " } (parts::recipe(&report.series)) }
                li { (parts::revision(&report.provenance)) }
                li { span.key { "stored " } (format::age(report.created_at, Timestamp::now())) }
                @if let Some(job) = report.job_id { li { span.key { "job " } a href={ "/jobs/" (job) } { "#" (job) } } }
                @if !report.complete { li { "frames are still being added" } }
            }
            @if let Some(other) = self.other {
                p { "Beside it, dashed: " a href={ "/reports/" (other.id) } { "report " (other.id) } ", " (name(other)) ". "
                    a href={ "/reports/" (report.id) } { "Without it" } }
            }
            @for note in &report.notes { p.muted { (note) } }
        }
    }

    /// What its line's open alerts say of it.
    fn verdict(&self, standings: &Standings) -> Markup {
        let own: Vec<_> = standings
            .alerts
            .iter()
            .filter(|alert| alert.series.id == self.report.series.id && alert.kind != Kind::NoData)
            .filter(|alert| alert.report_id.is_some_and(|first| first <= self.report.id))
            .collect();
        html! { @if !own.is_empty() { h2 { "Worse than before" } (regressions(&own)) } }
    }

    fn summary(&self) -> Markup {
        let report = self.report;
        let passes: Vec<_> = report.times_ms.iter().collect();
        html! {
            h2 { "Summary" }
            div.scroll { table {
                thead { tr { th { "Metric" } th.number { "Mean" }
                    @if self.other.is_some() { th.number { "Beside it" } th.number { "Difference" } }
                    th.number { "Least" } th.number { "5 %" } th { "Look" } } }
                tbody {
                    @for (metric, summary) in report.summary.iter().filter(|(metric, _)| *metric != GPU_TIME) {
                        tr {
                            td { (format::title(metric)) }
                            td.number { (format::value(metric, Some(summary.mean))) }
                            @if let Some(other) = self.other { (difference(metric, Some(summary.mean), other.values.get(metric).copied())) }
                            td.number { (format::value(metric, Some(summary.min))) }
                            td.number { (format::value(metric, Some(summary.p5))) }
                            td { a href=(super::standing::trend_href(&report.series, metric, report.provenance.branch.as_deref())) { "trend" } }
                        }
                    }
                    @if report.gpu_time_ms.is_some() {
                        tr { td { (format::title(GPU_TIME)) } td.number { (format::value(GPU_TIME, report.gpu_time_ms.map(Value))) }
                            @if let Some(other) = self.other { (difference(GPU_TIME, report.gpu_time_ms.map(Value), other.gpu_time_ms.map(Value))) }
                            td {} td {}
                            td { a href=(super::standing::trend_href(&report.series, GPU_TIME, report.provenance.branch.as_deref())) { "trend" } } }
                    }
                }
            } }
            @if !passes.is_empty() {
                p.muted { "Passes: " @for (i, (pass, time)) in passes.iter().enumerate() {
                    @if i > 0 { ", " } (pass) " " (format::ms(Some(time.median))) " ms" } "." }
            }
        }
    }

    /// The worst frames, worst first, with their pictures where there are any.
    fn worst(&self) -> Markup {
        let Some(metric) = self.metric else { return html! {} };
        let mut counted: Vec<(&FrameReport, Value)> = self
            .frames
            .iter()
            .filter(|frame| !frame.warmup)
            .filter_map(|frame| Some((frame, *frame.metrics.get(metric)?)))
            .collect();
        let badness = |value: Value| match better(metric) {
            _ if value.0.is_nan() => f64::INFINITY,
            Some(Better::Higher) => -value.0,
            _ => value.0,
        };
        counted.sort_by(|a, b| badness(b.1).total_cmp(&badness(a.1)));
        let names = parts::same(self.report.values.keys());
        html! {
            h2 { "Worst frames" }
            form.controls {
                (parts::select("By", "metric", names, metric, None))
                @if let Some(with) = self.with() { input type="hidden" name="with" value=(with); }
                button { "Sort" }
            }
            ol.worst { @for (frame, value) in counted.iter().take(N_WORST) {
                li { (self.frame(frame.index, metric, *value)) }
            } }
        }
    }

    fn frame(&self, index: usize, metric: &str, value: Value) -> Markup {
        let text = html! { span { "frame " (index) } " " b { (format::value(metric, Some(value))) } " " span.unit { (format::unit(metric)) } };
        let Some(viewer) = self.viewer else { return text };
        let target = href(
            &format!("{viewer}/{index}"),
            [("with", self.with()), ("metric", Some(metric.to_owned()))],
        );
        html! {
            a href=(target) {
                img loading="lazy" width="160" src={ "/api/v1/reports/" (self.report.id) "/frames/" (index) "/output.png?width=160" } alt={ "output of frame " (index) };
                (text)
            }
        }
    }

    fn charts(&self, shown: &[String]) -> Markup {
        let report = self.report;
        html! {
            h2 { "Frame by frame" }
            p.muted { "One cursor for all charts; drag to zoom, double-click to see all. Tinted: warm-up and resets, not counted."
                @if self.viewer.is_some() { " A click opens the frame." } }
            form.controls {
                details.pick {
                    summary { span.key { "Charts" } span.chosen { (shown.len()) " of " (report.values.len()) } }
                    div.sheet role="group" aria-label="Charts" { @for metric in report.values.keys() {
                        label { input type="checkbox" name="show" value=(metric) checked[shown.contains(metric)]; " " (metric) }
                    } }
                }
                @if let Some(with) = self.with() { input type="hidden" name="with" value=(with); }
                button { "Show" }
            }
            div.charts { @for metric in shown {
                section { h3 { (format::title(metric)) } div.chart.small #{ "chart-" (metric) } {} }
            } }
            @if !report.times_ms.is_empty() {
                h3 { "GPU time by pass " span.unit { "ms" } }
                div.chart #chart-times {}
            }
            details {
                summary { "The same as a table" }
                (self.table(shown))
                p { a href={ "/api/v1/reports/" (report.id) "/frames?format=csv" } { "Every frame as CSV" } }
            }
        }
    }

    fn table(&self, shown: &[String]) -> Markup {
        let passes: BTreeSet<&String> = self.report.times_ms.keys().collect();
        html! {
            div.scroll tabindex="0" role="group" aria-label="Frame by frame" { table {
                thead { tr { th { "Frame" }
                    @for metric in shown { th.number { (format::title(metric)) } }
                    @for pass in &passes { th.number { (pass) " " span.unit { "ms" } } } } }
                tbody { @for frame in self.frames.iter().take(MAX_ROWS) {
                    tr {
                        td { (frame.index) @if frame.reset { " " span.muted { "reset" } } @else if frame.warmup { " " span.muted { "warm-up" } } }
                        @for metric in shown { td.number { (format::value(metric, frame.metrics.get(metric).copied())) } }
                        @for pass in &passes { td.number { (format::ms(frame.times_ms.get(*pass).copied())) } }
                    }
                } }
            } }
            @if self.frames.len() > MAX_ROWS { p.muted { "The first " (MAX_ROWS) " of " (self.frames.len()) " frames." } }
        }
    }

    fn origin(&self) -> Markup {
        let (origin, environment) = (&self.report.provenance, &self.report.series.environment);
        let adapter = &environment.adapter;
        let facts = [
            ("Adapter", Some(adapter.name.clone())),
            ("Driver", Some(format!("{} {}", adapter.driver, adapter.driver_version))),
            ("System", Some(environment.os.clone())),
            ("Clocks", Some(environment.clocks.clone())),
            ("Parent", origin.parent.clone()),
            ("Pull request", origin.pull_request.clone()),
            ("Engine", origin.engine_version.clone()),
            ("Build", Some(self.report.revision.clone())),
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
}

fn difference(metric: &str, own: Option<Value>, other: Option<Value>) -> Markup {
    let both = own
        .zip(other)
        .filter(|(own, other)| own.0.is_finite() && other.0.is_finite());
    html! {
        td.number { (format::value(metric, other)) }
        td.number { @if let Some((own, other)) = both {
            @let by = own.0 - other.0;
            @if by > 0.0 { "+" } (format::value(metric, Some(Value(by)))) " "
            span.changed { (if by == 0.0 { "same" } else if format::is_better(metric, own, other) { "better" } else { "worse" }) }
        } @else { (format::ABSENT) } }
    }
}
