//! `/trends`: a metric over time, a line for each sequence, recipe and adapter.

use super::{
    format,
    layout::{Page, PageError, Section, script_data},
    parts,
};
use crate::{
    metrics::{Better, Metric, Value},
    server::{ApiQuery, Shared},
    store::{GPU_TIME, Point, Series, SeriesFilter, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Points of one line; more would not be told apart on a screen.
const MAX_POINTS: usize = 500;

/// The form's fields; empty means all.
#[derive(Deserialize)]
#[serde(default)]
pub struct TrendQuery {
    metric: String,
    sequence: String,
    preset: String,
    adapter: String,
    branch: String,
}

impl Default for TrendQuery {
    fn default() -> Self {
        Self {
            metric: Metric::PSNR.id().to_owned(),
            sequence: String::new(),
            preset: String::new(),
            adapter: String::new(),
            branch: String::new(),
        }
    }
}

/// What the script draws.
#[derive(Serialize)]
struct Chart<'a> {
    metric: &'a str,
    unit: &'static str,
    lines: Vec<ChartLine<'a>>,
}

#[derive(Serialize)]
struct ChartLine<'a> {
    name: String,
    /// A number a recipe, so that it looks alike on every sequence.
    color: usize,
    /// A number a sequence.
    dash: usize,
    points: &'a [Point],
    /// Seconds since 1970.
    times: Vec<f64>,
}

struct Line {
    series: Series,
    points: Vec<Point>,
}

/// `GET /trends`
pub async fn page(
    State(service): Shared,
    ApiQuery(mut query): ApiQuery<TrendQuery>,
) -> Result<Html<String>, PageError> {
    // A name, as people write it into an address, means its latest content; the form speaks of hashes.
    if let Some(sequence) = service.store.sequence(&query.sequence).await? {
        query.sequence = sequence.hash;
    }
    let given = |text: &str| (!text.is_empty()).then(|| text.to_owned());
    let all = service.store.series(&SeriesFilter::default()).await?;
    let filter = SeriesFilter {
        sequence: given(&query.sequence),
        preset: given(&query.preset),
        adapter: given(&query.adapter),
        ..SeriesFilter::default()
    };
    let branch = given(&query.branch);
    let mut lines = Vec::new();
    for series in service.store.series(&filter).await? {
        let points = service
            .store
            .points(&series, &query.metric, branch.as_deref(), MAX_POINTS)
            .await?;
        if !points.is_empty() {
            lines.push(Line { series, points });
        }
    }
    let content = html! {
        h1 { "Trends" }
        p.muted { (meaning(&query.metric)) }
        (form(&query, &all))
        @if lines.is_empty() {
            div.notice { p { "No report has this metric for this choice." } }
        } @else {
            div.chart #chart {}
            (table(&query.metric, &lines))
            (script_data(&chart(&query.metric, &lines))?)
        }
    };
    let page = Page {
        title: "Trends",
        section: Some(Section::Trends),
        script: Some("trends.js"),
        content,
    };
    Ok(page.render(&service))
}

/// One line on what the numbers are and which way is better.
fn meaning(metric: &str) -> String {
    match format::metric_info(metric) {
        Some(info) => {
            let better = match info.better {
                Better::Higher => "higher is better",
                Better::Lower => "lower is better",
            };
            format!("{}; {better}.", info.description.trim_end_matches('.'))
        }
        None => "GPU time of one frame: the sum of its passes' medians; lower is better.".to_owned(),
    }
}

fn form(query: &TrendQuery, all: &[Series]) -> Markup {
    let unique = |key: &dyn Fn(&Series) -> (String, String)| all.iter().map(key).collect::<BTreeSet<_>>();
    let same = |text: &str| (text.to_owned(), text.to_owned());
    let mut metrics: Vec<_> = Metric::ALL.iter().map(|metric| same(metric.id())).collect();
    metrics.push((GPU_TIME.to_owned(), "GPU time".to_owned()));
    let sequences = unique(&|series| match &series.sequence_hash {
        Some(hash) => (
            hash.clone(),
            format!("{} ({})", series.sequence_name, hash.get(..6).unwrap_or(hash)),
        ),
        None => same(&series.sequence_name),
    });
    let presets = unique(&|series| (series.preset.clone(), series.preset.clone()));
    let adapters = unique(&|series| {
        (
            series.environment.adapter.name.clone(),
            series.environment.adapter.name.clone(),
        )
    });
    html! {
        form.filters {
            (select("Metric", "metric", metrics, &query.metric, None))
            (select("Sequence", "sequence", sequences, &query.sequence, Some("all")))
            (select("Preset", "preset", presets, &query.preset, Some("all")))
            (select("Adapter", "adapter", adapters, &query.adapter, Some("all")))
            label { "Branch" input type="text" name="branch" value=(query.branch) placeholder="all" size="12"; }
            button { "Show" }
        }
    }
}

fn select(
    label: &str,
    name: &str,
    options: impl IntoIterator<Item = (String, String)>,
    chosen: &str,
    all: Option<&str>,
) -> Markup {
    html! {
        label { (label) select name=(name) {
            @if let Some(all) = all { option value="" { (all) } }
            @for (value, text) in options { option value=(value) selected[value == chosen] { (text) } }
        } }
    }
}

/// What was measured, as filters name it.
fn subject(series: &Series) -> String {
    series.sequence_hash.as_ref().unwrap_or(&series.sequence_name).clone()
}

fn chart<'a>(metric: &'a str, lines: &'a [Line]) -> Chart<'a> {
    let distinct = |key: fn(&Line) -> String| {
        lines
            .iter()
            .map(key)
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect::<Vec<_>>()
    };
    let recipes = distinct(|line| parts::recipe(&line.series));
    let sequences = distinct(|line| subject(&line.series));
    let adapters = distinct(|line| line.series.environment.adapter.name.clone());
    let place = |all: &[String], one: &str| all.iter().position(|name| name == one).unwrap_or_default();
    let line = |line: &'a Line| {
        let series = &line.series;
        let recipe = parts::recipe(series);
        let (color, dash) = (place(&recipes, &recipe), place(&sequences, &subject(series)));
        let sequence = (sequences.len() > 1).then_some(series.sequence_name.as_str());
        let adapter = (adapters.len() > 1).then_some(series.environment.adapter.name.as_str());
        let name = [sequence, Some(&recipe), adapter]
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(" · ");
        let times = line
            .points
            .iter()
            .map(|point| point.created_at.0 as f64 / 1000.0)
            .collect();
        ChartLine {
            name,
            color,
            dash,
            points: &line.points,
            times,
        }
    };
    Chart {
        metric,
        unit: format::unit(metric),
        lines: lines.iter().map(line).collect(),
    }
}

/// The newest value of every line and how it differs from the one before.
fn table(metric: &str, lines: &[Line]) -> Markup {
    let now = Timestamp::now();
    html! {
        div.scroll { table {
            thead { tr {
                th { "Sequence" } th { "Preset" } th.wide { "Adapter" } th.number { "Latest, " (format::title(metric)) }
                th.number { "Change" } th.number { "Reports" } th { "Commit" } th.number { "Age" }
            } }
            tbody { @for line in lines {
                @if let Some(latest) = line.points.last() {
                    tr {
                        td { (parts::sequence(&line.series)) }
                        td { (parts::recipe(&line.series)) }
                        td.wide { (line.series.environment.adapter.name) }
                        td.number { a href=(parts::report_href(latest.report_id, latest.job_id, 0)) { (format::value(metric, Some(latest.value))) } }
                        td.number { (change(metric, &line.points)) }
                        td.number { (line.points.len()) }
                        td { (parts::place(latest.branch.as_deref(), latest.commit.as_deref())) }
                        td.number { (format::age(latest.created_at, now)) }
                    }
                }
            } }
        } }
    }
}

/// The step from the second last value to the last: better or worse in words, because colour alone says nothing to
/// many. Values of different metric versions do not compare.
fn change(metric: &str, points: &[Point]) -> Markup {
    let [.., before, after] = points else {
        return html! { span.muted { (format::ABSENT) } };
    };
    if before.metric_version != after.metric_version {
        return html! { span.changed { "metric changed" } };
    }
    let difference = after.value.0 - before.value.0;
    if difference == 0.0 || before.value.0 == after.value.0 {
        return html! { span.changed { "same" } };
    }
    let word = if format::is_better(metric, after.value, before.value) {
        "better"
    } else {
        "worse"
    };
    let sign = if difference > 0.0 { "+" } else { "" };
    html! { (sign) (format::value(metric, Some(Value(difference)))) " " span.changed { (word) } }
}
