//! `/trends`: metrics over time, a chart for each, a line for each sequence, recipe, environment and branch.

use super::{
    format,
    layout::{Page, PageError, Section, script_data},
    lines::{Choice, Line, Style, all_series, styles},
    parts,
    query::{Query, href},
};
use crate::{
    metrics::Better,
    server::{Service, Shared},
    store::{GPU_TIME, Series, Timestamp},
    verdict::better,
};
use axum::{
    extract::{RawQuery, State},
    response::Html,
};
use maud::{Markup, html};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Results of a line in the table's sparkline.
const HISTORY: usize = 24;
/// Lines of a chart; more would not be told apart.
const MAX_LINES: usize = 24;
const MAX_PANELS: usize = 6;

/// What the script draws.
#[derive(Serialize)]
struct Data<'a> {
    panels: Vec<PanelData<'a>>,
}

#[derive(Serialize)]
struct PanelData<'a> {
    metric: &'a str,
    unit: &'static str,
    lines: Vec<LineData<'a>>,
}

#[derive(Serialize)]
struct LineData<'a> {
    series: i64,
    branch: Option<&'a str>,
    name: &'a str,
    color: usize,
    dash: usize,
}

struct Panel {
    metric: String,
    lines: Vec<Line>,
    styles: Vec<Style>,
    n_more: usize,
}

/// `GET /trends`
pub async fn page(State(service): Shared, RawQuery(text): RawQuery) -> Result<Html<String>, PageError> {
    let query = Query::parse(text.as_deref());
    let choice = Choice::of(&service, &query).await?;
    let all = all_series(&service).await?;
    let mut panels = Vec::new();
    for metric in choice.metrics.iter().take(MAX_PANELS) {
        let (lines, n_more) = choice.lines(&service, &all, metric, HISTORY, MAX_LINES).await?;
        panels.push(Panel {
            metric: metric.clone(),
            styles: styles(&lines),
            lines,
            n_more,
        });
    }
    let picture = format!("/chart.svg?{}", text.as_deref().unwrap_or_default());
    let content = html! {
        h1 { "Trends" }
        (form(&service, &choice, &query, &all).await?)
        p #range hidden { "Zoomed to " span {} ". " button type="button" { "Show all" } }
        @for (i, panel) in panels.iter().enumerate() { (panel.render(i, &picture)) }
        (embedding(&picture))
        (script_data(&Data { panels: panels.iter().map(Panel::data).collect() })?)
    };
    let page = Page {
        title: "Trends",
        section: Some(Section::Trends),
        script: Some("trends.js"),
        charts: true,
        content,
    };
    Ok(page.render(&service))
}

/// One line on what the numbers are and which way is better.
fn meaning(metric: &str) -> String {
    let direction = match better(metric) {
        Some(Better::Higher) => "higher is better",
        Some(Better::Lower) => "lower is better",
        None => "which way is better is not known here",
    };
    match format::metric_info(metric) {
        Some(info) => format!("{}; {direction}.", info.description.trim_end_matches('.')),
        None if metric == GPU_TIME => {
            format!("GPU time of one frame: the sum of its passes' medians, or as it was posted; {direction}.")
        }
        None => format!("Measured elsewhere; {direction}."),
    }
}

impl Panel {
    fn data(&self) -> PanelData<'_> {
        PanelData {
            metric: &self.metric,
            unit: format::unit(&self.metric),
            lines: self
                .lines
                .iter()
                .zip(&self.styles)
                .map(|(line, style)| LineData {
                    series: line.series.id,
                    branch: line.branch.as_deref(),
                    name: &style.name,
                    color: style.color,
                    dash: style.dash,
                })
                .collect(),
        }
    }

    fn render(&self, i: usize, picture: &str) -> Markup {
        html! {
            section.panel #{ "panel-" (i) } {
                h2 { (format::title(&self.metric)) }
                p.muted { (meaning(&self.metric)) }
                @if self.lines.is_empty() { div.notice { p { "No report has this metric for this choice." } } }
                @if self.n_more > 0 { p.muted { "The first " (self.lines.len()) " lines; " (self.n_more) " more do not fit. Choose fewer." } }
                div.chart hidden[self.lines.is_empty()] {}
                @if i == 0 && !self.lines.is_empty() { noscript { img.picture src=(picture) alt={ (self.metric) " over time" }; } }
                p.muted.thinned {}
                form.controls.difference hidden {
                    label { "Difference" select {} } span.minus-sign { "−" } label { "and" select {} }
                    button { "Subtract" }
                }
                div.chart.minus hidden {}
                details.rows { summary { "The points as a table" } div.scroll {} p { (self.csv()) } }
                (self.table())
            }
        }
    }

    fn csv(&self) -> Markup {
        html! { "CSV: "
            @for (i, (line, style)) in self.lines.iter().zip(&self.styles).enumerate() {
                @if i > 0 { ", " }
                a href=(href(&format!("/api/v1/series/{}/points", line.series.id),
                    [("metric", Some(self.metric.clone())), ("branch", line.branch.clone()), ("format", Some("csv".to_owned()))])) { (style.name) }
            }
        }
    }

    /// The newest value of every line and how it differs from the one before.
    fn table(&self) -> Markup {
        let now = Timestamp::now();
        html! {
            div.scroll { table.latest {
                thead { tr {
                    th { "Sequence" } th { "Recipe" } th.wide { "Environment" } th.number { "Latest, " (format::title(&self.metric)) }
                    th.number { "Change" } th { "Trend" } th { "Commit" } th.number { "Age" }
                } }
                tbody { @for line in &self.lines {
                    @if let Some(latest) = line.points.last() {
                        tr {
                            td { (parts::sequence(&line.series)) }
                            td { (parts::recipe(&line.series)) }
                            td.wide.fill { (parts::environment(&line.series.environment)) }
                            td.number { a href={ "/reports/" (latest.report_id) } { (format::value(&self.metric, Some(latest.value))) } }
                            td.number { (parts::change(&self.metric, &line.points)) }
                            td { (parts::sparkline(&self.metric, &line.points)) }
                            td { (parts::place(latest.branch.as_deref(), latest.commit.as_deref())) }
                            td.number { (format::age(latest.created_at, now)) }
                        }
                    }
                } }
            } }
        }
    }
}

async fn form(service: &Service, choice: &Choice, query: &Query, all: &[Series]) -> Result<Markup, PageError> {
    let mut metrics: BTreeSet<String> = service.store.metric_names().await?.into_iter().collect();
    metrics.insert(GPU_TIME.to_owned());
    let sequences: BTreeMap<String, String> = all
        .iter()
        .map(|series| {
            let hash = series.sequence_hash.as_ref().and_then(|hash| hash.get(..6));
            let name = &series.sequence_name;
            (
                parts::subject_of(series),
                hash.map_or(name.clone(), |hash| format!("{name} ({hash})")),
            )
        })
        .collect();
    let recipes: BTreeSet<String> = all.iter().map(parts::recipe).collect();
    let environments: BTreeMap<i64, String> = all
        .iter()
        .map(|series| (series.environment_id, parts::environment(&series.environment)))
        .collect();
    let projects: BTreeSet<&String> = all.iter().map(|series| &series.project).collect();
    let mut branches = BTreeSet::new();
    for project in &projects {
        branches.extend(
            service
                .store
                .branches(project)
                .await?
                .into_iter()
                .map(|branch| branch.name),
        );
    }
    let environment_ids: Vec<String> = choice.environments.iter().map(i64::to_string).collect();
    let environments = environments.into_iter().map(|(id, name)| (id.to_string(), name));
    Ok(html! {
        form.filters {
            (pick("Metrics", "metric", parts::same(metrics), &choice.metrics))
            (pick("Sequences", "sequence", sequences, &choice.sequences))
            (pick("Recipes", "recipe", parts::same(recipes), &choice.recipes))
            (pick("Environments", "environment", environments, &environment_ids))
            (pick("Branches", "branch", parts::same(branches), &choice.branches))
            @if projects.len() > 1 { (pick("Projects", "project", parts::same(projects), &choice.projects)) }
            @for name in ["from", "to"] {
                input type="hidden" name=(name) value=(query.one(name).unwrap_or_default()) disabled[query.one(name).is_none()];
            }
            button { "Show" }
        }
    })
}

/// A choice of several: tick boxes that open below their name.
fn pick(title: &str, name: &str, options: impl IntoIterator<Item = (String, String)>, chosen: &[String]) -> Markup {
    let options: Vec<(String, String)> = options.into_iter().collect();
    let ticked: Vec<&str> = options
        .iter()
        .filter(|(value, _)| chosen.contains(value))
        .map(|(_, text)| text.as_str())
        .collect();
    let text = match ticked.as_slice() {
        [] => "all".to_owned(),
        [one] => (*one).to_owned(),
        several => format!("{} of {}", several.len(), options.len()),
    };
    html! {
        details.pick {
            summary { span.key { (title) } span.chosen { (text) } }
            div.sheet role="group" aria-label=(title) { @for (value, text) in &options {
                label { input type="checkbox" name=(name) value=(value) checked[chosen.contains(value)]; " " (text) }
            } }
        }
    }
}

/// How to show this elsewhere.
fn embedding(picture: &str) -> Markup {
    let badge = picture.replace("/chart.svg", "/badge.svg");
    html! {
        details.embed {
            summary { "Embed" }
            p { "A picture of the first chart, and a badge with the newest value of its first line, for a README or a wiki. "
                "They need a token where this page does." }
            p { img src=(badge) alt="badge"; }
            pre tabindex="0" { "![badge](" (badge) ")\n![trend](" (picture) ")" }
        }
    }
}
