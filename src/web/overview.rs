//! `/`: the last night at a glance, for one environment: what got worse and since when, what stopped reporting, and every
//! sequence by recipe with verdict, value, change and a little history.

use super::{
    format,
    layout::{Page, PageError, Section},
    parts,
    query::{Query, href},
    standing::{Standing, Standings, regressions},
};
use crate::{
    metrics::Value,
    server::{Service, Shared},
    store::{GPU_TIME, JobFilter, Point, Report, ReportFilter, Series, SeriesFilter, Timestamp},
    verdict::Kind,
};
use axum::{
    extract::{RawQuery, State},
    response::Html,
};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};
use maud::{Markup, html};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Metrics of the grid of a sequence's page, and the first choice here.
const COLUMNS: [&str; 2] = ["psnr", "ssim"];
const MAX_ROWS: u32 = 200;
/// Reports in a sparkline.
const HISTORY: usize = 24;
/// Lines whose points are read at once.
const AT_ONCE: usize = 8;

/// A row of a sequence's grid.
pub struct Row {
    report: Arc<Report>,
    history: Vec<Point>,
}

/// The latest report of every series of a sequence, with a little history.
pub async fn latest(service: &Service, sequence_hash: &str) -> Result<Vec<Row>, PageError> {
    let filter = ReportFilter {
        sequence: Some(sequence_hash.to_owned()),
        latest_only: true,
        limit: MAX_ROWS,
        ..ReportFilter::default()
    };
    let mut rows = Vec::new();
    for report in service.store.reports(&filter).await? {
        let history = service.store.points(&report.series, COLUMNS[0], None, HISTORY).await?;
        rows.push(Row { report, history });
    }
    rows.sort_by_key(|row| recipe_order(&row.report.series));
    Ok(rows)
}

/// Presets in the order of their publication, then by series.
fn recipe_order(series: &Series) -> (usize, i64) {
    let place = crate::taa::PRESETS.iter().position(|preset| preset.id == series.preset);
    (place.unwrap_or(usize::MAX), series.id)
}

/// What is chosen, and what there is to choose from.
struct View {
    project: String,
    projects: Vec<String>,
    environment: i64,
    environments: BTreeMap<i64, String>,
    metric: String,
    metrics: Vec<String>,
    branch: Option<String>,
    branches: Vec<String>,
}

/// A line with its newest results.
struct Line {
    series: Series,
    points: Vec<Point>,
}

impl View {
    async fn of(service: &Service, query: &Query, newest: &Report) -> Result<(Self, Vec<Series>), PageError> {
        let store = &service.store;
        let project = query.one("project").unwrap_or(&newest.series.project).to_owned();
        let filter = SeriesFilter {
            project: Some(project.clone()),
            ..SeriesFilter::default()
        };
        let all = store.series(&filter).await?;
        let environments: BTreeMap<i64, String> = all
            .iter()
            .map(|series| (series.environment_id, parts::environment(&series.environment)))
            .collect();
        let asked = query.number("environment").filter(|id| environments.contains_key(id));
        // The nightly's, not that of whoever ran a job by hand last: the one with the most lines.
        let n_lines = |id: i64| all.iter().filter(|series| series.environment_id == id).count();
        let usual = environments.keys().copied().max_by_key(|&id| (n_lines(id), id));
        let environment = asked.or(usual).unwrap_or_default();
        let mut metrics = store.metric_names().await?;
        if !metrics.iter().any(|metric| metric == GPU_TIME) {
            metrics.push(GPU_TIME.to_owned());
        }
        let known = |metric: &&str| metrics.iter().any(|name| name == metric);
        let metric = query.one("metric").filter(known).or(COLUMNS.into_iter().find(known));
        let view = Self {
            metric: metric.unwrap_or(metrics[0].as_str()).to_owned(),
            metrics,
            branches: store
                .branches(&project)
                .await?
                .into_iter()
                .map(|branch| branch.name)
                .collect(),
            branch: query.one("branch").map(str::to_owned),
            projects: store.projects().await?,
            project,
            environment,
            environments,
        };
        Ok((view, all))
    }

    async fn lines(&self, service: &Service, all: Vec<Series>) -> Result<Vec<Line>, PageError> {
        let own = all
            .into_iter()
            .filter(|series| series.environment_id == self.environment);
        let read = stream::iter(own.map(async |series| {
            let points = service
                .store
                .points(&series, &self.metric, self.branch.as_deref(), HISTORY)
                .await?;
            Ok::<_, PageError>(Line { series, points })
        }));
        let lines: Vec<Line> = read.buffered(AT_ONCE).try_collect().await?;
        Ok(lines.into_iter().filter(|line| !line.points.is_empty()).collect())
    }
}

/// `GET /`
pub async fn page(State(service): Shared, RawQuery(query): RawQuery) -> Result<Html<String>, PageError> {
    let query = Query::parse(query.as_deref());
    let newest = ReportFilter {
        project: query.one("project").map(str::to_owned),
        limit: 1,
        ..ReportFilter::default()
    };
    let content = match service.store.reports(&newest).await?.pop() {
        Some(newest) => measured(&service, &query, &newest).await?,
        None => html! { h1 { "Overview" } (first_steps()) },
    };
    let page = Page {
        title: "Overview",
        section: Some(Section::Overview),
        script: Some("jobs.js"),
        charts: false,
        content: html! { (content) (recent_jobs(&service).await?) },
    };
    Ok(page.render(&service))
}

async fn measured(service: &Service, query: &Query, newest: &Report) -> Result<Markup, PageError> {
    let (view, all) = View::of(service, query, newest).await?;
    let lines = view.lines(service, all).await?;
    let standings = Standings::load(service, &view.project, view.branch.as_deref()).await?;
    let last = lines
        .iter()
        .filter_map(|line| line.points.last())
        .map(|point| point.created_at)
        .max();
    let last = last.unwrap_or(newest.created_at);
    let standing = |line: &Line| standings.of(&line.series, &view.metric, &line.points, last);
    let here = |id: i64| lines.iter().any(|line| line.series.id == id);
    let worse: Vec<_> = standings
        .alerts
        .iter()
        .filter(|alert| alert.kind != Kind::NoData && here(alert.series.id))
        .collect();
    let n_elsewhere = standings.alerts.iter().filter(|alert| !here(alert.series.id)).count();
    let silent: Vec<_> = lines
        .iter()
        .filter_map(|line| match standing(line) {
            Standing::Silent(since) => Some((line, since)),
            _ => None,
        })
        .collect();
    Ok(html! {
        h1 { "Overview" }
        p.muted { (lines.len()) @if lines.len() == 1 { " line" } @else { " lines" } " on " (view.environments.get(&view.environment).map_or("", String::as_str))
            "; the newest report came " (format::age(last, Timestamp::now())) "." }
        (form(&view))
        h2 { "Worse than before" }
        @if worse.is_empty() { p.calm { "✓ No open alert here." } } @else { (regressions(&worse)) }
        @if n_elsewhere > 0 {
            p { a href=(href("/alerts", [("project", Some(view.project.clone())), ("branch", view.branch.clone())])) {
                (n_elsewhere) " open " @if n_elsewhere == 1 { "alert" } @else { "alerts" } " of other lines and environments" } }
        }
        @if !silent.is_empty() {
            h2 { "Stopped reporting" }
            (silence(&silent, &view))
        }
        h2 { "Latest: " (format::title(&view.metric)) }
        @if lines.is_empty() { p.muted { "No report has this metric for this choice." } }
        @else { (matrix(&lines, &view, standing)) }
    })
}

fn form(view: &View) -> Markup {
    let environments = view
        .environments
        .iter()
        .map(|(id, name)| (id.to_string(), name.clone()));
    html! {
        form.filters {
            @if view.projects.len() > 1 { (parts::select("Project", "project", parts::same(&view.projects), &view.project, None)) }
            (parts::select("Environment", "environment", environments, &view.environment.to_string(), None))
            (parts::select("Metric", "metric", parts::same(&view.metrics), &view.metric, None))
            (parts::select("Branch", "branch", parts::same(&view.branches), view.branch.as_deref().unwrap_or_default(), Some("all")))
            button { "Show" }
        }
    }
}

fn silence(silent: &[(&Line, Timestamp)], view: &View) -> Markup {
    let now = Timestamp::now();
    html! {
        div.scroll { table #silent {
            thead { tr { th { "Sequence" } th { "Recipe" } th.number { "Last report" } th { "Commit" } th { "Look" } } }
            tbody { @for (line, since) in silent {
                tr {
                    td { (parts::sequence(&line.series)) }
                    td { (parts::recipe(&line.series)) }
                    td.number { (format::age(*since, now)) }
                    td { @if let Some(point) = line.points.last() { (parts::place(point.branch.as_deref(), point.commit.as_deref())) } }
                    td { a href=(super::standing::trend_href(&line.series, &view.metric, view.branch.as_deref())) { "trend" } }
                }
            } }
        } }
    }
}

/// A row a recipe, a column a sequence.
fn matrix<'a>(lines: &'a [Line], view: &View, standing: impl Fn(&'a Line) -> Standing<'a>) -> Markup {
    let mut recipes: Vec<(&Series, String)> = Vec::new();
    for line in lines {
        let name = parts::recipe(&line.series);
        if !recipes.iter().any(|(_, known)| *known == name) {
            recipes.push((&line.series, name));
        }
    }
    recipes.sort_by_key(|(series, _)| recipe_order(series));
    let sequences: BTreeSet<(String, String)> = lines
        .iter()
        .map(|line| (line.series.sequence_name.clone(), parts::subject_of(&line.series)))
        .collect();
    let title = |subject: &str| lines.iter().find(|line| parts::subject_of(&line.series) == subject);
    html! {
        div.scroll { table.grid #grid {
            thead { tr {
                th { "Recipe" }
                @for (_, subject) in &sequences { th { @if let Some(line) = title(subject) { (parts::sequence(&line.series)) } } }
            } }
            tbody { @for (_, recipe) in &recipes {
                tr {
                    th scope="row" { a href=(href("/trends", [("metric", Some(view.metric.clone())), ("recipe", Some(recipe.clone())),
                        ("environment", Some(view.environment.to_string()))])) { (recipe) } }
                    @for (_, subject) in &sequences {
                        td { @if let Some(line) = lines.iter().find(|line| parts::recipe(&line.series) == *recipe && parts::subject_of(&line.series) == *subject) {
                            (cell(line, view, &standing(line)))
                        } @else { span.muted { (format::ABSENT) } } }
                    }
                }
            } }
        } }
    }
}

fn cell(line: &Line, view: &View, standing: &Standing) -> Markup {
    let Some(latest) = line.points.last() else {
        return html! {};
    };
    html! {
        div.cell data-series=(line.series.id) {
            a.value href={ "/reports/" (latest.report_id) } { (format::value(&view.metric, Some(latest.value))) }
            a.trend href=(super::standing::trend_href(&line.series, &view.metric, view.branch.as_deref())) {
                span.unseen { "trend of " (parts::recipe(&line.series)) " on " (line.series.sequence_name) ": " }
                (parts::sparkline(&view.metric, &line.points))
            }
            div.change { (parts::change(&view.metric, &line.points)) }
            (standing.render())
        }
    }
}

async fn recent_jobs(service: &Service) -> Result<Markup, PageError> {
    let filter = JobFilter {
        status: None,
        sequence_hash: None,
        project: None,
        before: None,
        limit: 5,
    };
    let jobs = service.store.jobs(&filter).await?;
    Ok(html! {
        @if !jobs.is_empty() {
            h2 { "Recent jobs" }
            (parts::job_table(&jobs, Timestamp::now()))
        }
    })
}

/// A sequence's reports, a row a recipe; the best value of each column in bold.
pub fn grid(rows: &[Row], now: Timestamp) -> Markup {
    let reports = || rows.iter().map(|row| &*row.report);
    let best = COLUMNS.map(|metric| parts::best(metric, reports()));
    html! {
        div.scroll { table {
            thead { tr {
                th { "Recipe" }
                @for metric in COLUMNS { th.number { (format::title(metric)) } }
                th.number { (format::title(GPU_TIME)) }
                th { "Trend" }
                th.wide { "Adapter" } th { "Commit" } th.number { "Age" }
            } }
            tbody { @for row in rows {
                @let report = &row.report;
                tr data-report=(report.id) {
                    td { a href={ "/reports/" (report.id) } { (parts::recipe(&report.series)) } }
                    @for (metric, best) in COLUMNS.iter().zip(best) {
                        @let value = report.values.get(*metric).copied();
                        td.number.best[best.is_some() && value.map(|value| value.0) == best] { (format::value(metric, value)) }
                    }
                    td.number { (format::value(GPU_TIME, report.gpu_time_ms.map(Value))) }
                    td { (parts::sparkline(COLUMNS[0], &row.history)) }
                    td.wide { (report.series.environment.adapter.name) }
                    td { (parts::revision(&report.provenance)) }
                    td.number { (format::age(report.created_at, now)) }
                }
            } }
        } }
    }
}

/// What a service without reports has to say.
fn first_steps() -> Markup {
    html! {
        p { "Nothing has been measured yet. Put a sequence, then " a href="/jobs/new" { "start a job" } " over it; its reports appear here." }
        pre tabindex="0" {
            "tar -C my-sequence -cf - . | curl -T - http://localhost:8080/api/v1/sequences/my-sequence\n"
            "curl http://localhost:8080/api/v1/jobs -H 'content-type: application/json' \\\n"
            "     -d '{\"sequence\": \"my-sequence\", \"presets\": [\"none\", \"ema\", \"karis2014\"]}'"
        }
    }
}
