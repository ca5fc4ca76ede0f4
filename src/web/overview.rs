//! `/`: the latest report of every series, by sequence; recent jobs; sequences; and how to begin when there is nothing.

use super::{
    format,
    layout::{Page, PageError, Section},
    parts,
};
use crate::{
    metrics::Value,
    server::{Service, Shared},
    store::{GPU_TIME, JobFilter, Point, Report, ReportFilter, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};

/// What the grid shows; the same for all, so that sequences can be compared.
const COLUMNS: [&str; 2] = ["psnr", "ssim"];
const MAX_ROWS: u32 = 200;
/// Reports in a row's sparkline.
const HISTORY: usize = 24;

/// A row of the grid.
pub struct Row {
    report: Report,
    history: Vec<Point>,
}

/// The latest report of every series, of one sequence or of all, with a little history.
pub async fn latest(service: &Service, sequence_hash: Option<&str>) -> Result<Vec<Row>, PageError> {
    let filter = ReportFilter {
        sequence: sequence_hash.map(str::to_owned),
        latest_only: true,
        limit: MAX_ROWS,
        ..ReportFilter::default()
    };
    let mut rows = Vec::new();
    for report in service.store.reports(&filter).await? {
        let history = service.store.points(&report.series, COLUMNS[0], None, HISTORY).await?;
        rows.push(Row { report, history });
    }
    rows.sort_by(|a, b| {
        let key = |row: &Row| {
            (
                row.report.series.sequence_name.clone(),
                row.report.series.sequence_hash.clone(),
            )
        };
        key(a)
            .cmp(&key(b))
            .then_with(|| preset_order(&a.report).cmp(&preset_order(&b.report)))
    });
    Ok(rows)
}

/// Presets in the order of their publication, then by series.
fn preset_order(report: &Report) -> (usize, i64) {
    let place = crate::taa::PRESETS
        .iter()
        .position(|preset| preset.id == report.series.preset);
    (place.unwrap_or(usize::MAX), report.series.id)
}

/// `GET /`
pub async fn page(State(service): Shared) -> Result<Html<String>, PageError> {
    let now = Timestamp::now();
    let rows = latest(&service, None).await?;
    let sequences = service.store.sequences().await?;
    let filter = JobFilter {
        status: None,
        sequence_hash: None,
        project: None,
        before: None,
        limit: 8,
    };
    let jobs = service.store.jobs(&filter).await?;
    let content = html! {
        h1 { "Latest reports" }
        @if rows.is_empty() { (first_steps()) } @else { (grid(&rows, now, true)) }
        @if !jobs.is_empty() {
            h2 { "Recent jobs" }
            (parts::job_table(&jobs, now))
        }
        @if !sequences.is_empty() {
            h2 { "Sequences" }
            (parts::sequence_table(&sequences, now))
        }
    };
    let page = Page {
        title: "Reports",
        section: Some(Section::Reports),
        script: None,
        content,
    };
    Ok(page.render(&service))
}

/// The reports, a block of rows a sequence; the best value of each column in bold.
pub fn grid(rows: &[Row], now: Timestamp, with_titles: bool) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th { "Preset" }
                @for metric in COLUMNS { th.number { (format::title(metric)) } }
                th.number { (format::title(GPU_TIME)) }
                th { "Trend" }
                th.wide { "Adapter" } th { "Commit" } th.number { "Age" }
            } }
            @for block in rows.chunk_by(|a, b| {
                let key = |row: &Row| (row.report.series.sequence_hash.clone(), row.report.series.sequence_name.clone());
                key(a) == key(b)
            }) {
                (grid_block(block, now, with_titles))
            }
        } }
    }
}

fn grid_block(block: &[Row], now: Timestamp, with_title: bool) -> Markup {
    let reports = || block.iter().map(|row| &row.report);
    let best = COLUMNS.map(|metric| parts::best(metric, reports()));
    let series = &block[0].report.series;
    html! {
        tbody.group {
            @if with_title {
                tr { td.title colspan="8" { (parts::sequence(series)) } }
            }
            @for row in block {
                @let report = &row.report;
                tr data-report=(report.id) {
                    td { a href=(parts::report_href(report.id, report.job_id, report.preset_index)) { (parts::recipe(&report.series)) } }
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
            }
        }
    }
}

/// What a service without reports has to say.
fn first_steps() -> Markup {
    html! {
        p { "Nothing has been measured yet. Put a sequence, then post a job over it; its reports appear here." }
        pre {
            "tar -C my-sequence -cf - . | curl -T - http://localhost:8080/api/v1/sequences/my-sequence\n"
            "curl http://localhost:8080/api/v1/jobs -H 'content-type: application/json' \\\n"
            "     -d '{\"sequence\": \"my-sequence\", \"presets\": [\"none\", \"ema\", \"karis2014\"]}'"
        }
    }
}
