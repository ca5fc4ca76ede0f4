//! `/stress`: the matrix of hazards and recipes, of the newest stress run or of another; and a cell with its frames.

use super::{
    format,
    layout::{Page, PageError, Section},
};
use crate::{
    server::{ApiError, ApiPath, ApiQuery, Shared, stress},
    store::{StressRun, Timestamp},
    stress::{
        Trend,
        report::{Cell, Verdict},
    },
    taa::recipe::Guards,
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde::Deserialize;

const MAX_RUNS: u32 = 100;

/// Query of the page.
#[derive(Deserialize)]
pub struct StressQuery {
    /// The newest by default.
    job: Option<i64>,
}

/// `GET /stress`
pub async fn page(State(service): Shared, ApiQuery(query): ApiQuery<StressQuery>) -> Result<Html<String>, PageError> {
    let runs = service.store.stress_runs(None, MAX_RUNS).await?;
    let job_id = query.job.or_else(|| runs.first().map(|run| run.job_id));
    let content = match job_id {
        None => html! {
            h1 { "Stability" }
            p { "No recipe has been put under stress yet. " (new_job()) " or post a matrix, and follow its job:" }
            pre tabindex="0" { "curl -X POST -H 'content-type: application/json' -d '{\"stress\": {\"quick\": true}}' HOST/api/v1/stress" }
        },
        Some(job_id) => {
            let (run, cells) = stress::find(&service, job_id).await?;
            html! {
                h1 { "Stability" }
                p { (new_job()) }
                (heading(&run))
                (matrix(&run, &cells))
                @if runs.len() > 1 { (others(&runs)) }
            }
        }
    };
    let page = Page {
        title: "Stability",
        section: Some(Section::Stress),
        script: None,
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

fn new_job() -> Markup {
    html! { a.button href="/jobs/new?kind=stress" { "New matrix" } }
}

fn heading(run: &StressRun) -> Markup {
    html! {
        p {
            a href={ "/jobs/" (run.job_id) } { "#" (run.job_id) } " · " (run.adapter.name) " (" (run.adapter.driver) " "
            (run.adapter.driver_version) ") · seed " (run.seed) " · " (run.n_cells) " cells, " (run.n_failed) " failed · "
            (format::short_hash(&run.revision)) " · " (format::age(run.created_at, Timestamp::now()))
        }
        p.muted {
            "Errors are of the adapter against the f64 twin, in display units. In a field history as f16 \
             stands first, then as f32. A mark opens its frames."
        }
    }
}

fn others(runs: &[StressRun]) -> Markup {
    html! {
        h2 { "Runs" }
        ul { @for run in runs {
            li {
                a href={ "/stress?job=" (run.job_id) } { "#" (run.job_id) } " " (run.adapter.name) ", " (run.n_cells) " cells, "
                (run.n_failed) " failed, " (format::age(run.created_at, Timestamp::now()))
            }
        } }
    }
}

/// The recipe, and whether it is without guards.
fn column(cell: &Cell) -> String {
    match cell.guards {
        Guards::On => cell.recipe.clone(),
        Guards::Off => format!("{}, no guards", cell.recipe),
    }
}

fn matrix(run: &StressRun, cells: &[Cell]) -> Markup {
    let (mut hazards, mut columns): (Vec<&str>, Vec<String>) = (Vec::new(), Vec::new());
    for cell in cells {
        if !hazards.contains(&cell.hazard.as_str()) {
            hazards.push(&cell.hazard);
        }
        if !columns.contains(&column(cell)) {
            columns.push(column(cell));
        }
    }
    html! {
        div.scroll { table.matrix {
            thead { tr { th { "Hazard" } @for name in &columns { th { (name) } } } }
            tbody { @for hazard in hazards {
                tr {
                    td { (hazard) }
                    @for name in &columns {
                        td {
                            @for (index, cell) in cells.iter().enumerate().filter(|(_, cell)| cell.hazard == hazard && column(cell) == *name) {
                                a class={ "verdict " (cell.verdict.id()) } href={ "/stress/" (run.job_id) "/cells/" (index) }
                                    title={ (cell.precision.id()) ": " (cell.verdict.id()) ". " (cell.reason) } { (mark(cell.verdict)) }
                            }
                        }
                    }
                }
            } }
        } }
    }
}

fn mark(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "✓",
        Verdict::Degrades => "~",
        Verdict::Fails => "✗",
        Verdict::NotRun => "·",
    }
}

/// `GET /stress/{job}/cells/{index}`
pub async fn cell(
    State(service): Shared,
    ApiPath((job_id, index)): ApiPath<(i64, usize)>,
) -> Result<Html<String>, PageError> {
    let (run, cells) = stress::find(&service, job_id).await?;
    let missing = || ApiError::not_found(format!("the matrix of job {job_id} has no cell {index}"));
    let cell = cells.get(index).ok_or_else(missing)?;
    let frame = cell.frame.map_or_else(|| "none".to_owned(), |frame| frame.to_string());
    let recovered = cell
        .recovered_after
        .map_or_else(|| "–".to_owned(), |n| format!("{n} frames"));
    let facts = [
        (
            "verdict",
            format!("{} {}", cell.verdict.id().replace('_', " "), cell.reason),
        ),
        ("history", cell.precision.id().to_owned()),
        (
            "adapter",
            format!(
                "{} ({} {})",
                cell.adapter, run.adapter.driver, run.adapter.driver_version
            ),
        ),
        ("input", format!("{}, {} frames", cell.size, cell.n_frames)),
        (
            "largest error",
            format!(
                "{:.3e} of the display's range, {:.1} steps",
                cell.max_error.0, cell.max_error_ulps.0
            ),
        ),
        ("frame", frame),
        ("recovered after", recovered),
        ("growth", growth(cell)),
        ("theory", bound(cell)),
    ];
    let content = html! {
        h1 { (cell.hazard) " · " (column(cell)) }
        p { a href={ "/stress?job=" (job_id) } { "To the matrix" } }
        ul.facts { @for (name, value) in facts { li { span.key { (name) " " } (value) } } }
        @if cell.course.len() > 1 {
            h2 { "Frame by frame" }
            (course(cell))
        }
        @if cell.verdict != Verdict::NotRun {
            h2 { "The frames" }
            p.muted {
                "The first, the worst and one that was disturbed with those before and after them, and the last: adapter, twin, and \
                 their difference, enlarged until the largest is white. Magenta is not finite."
            }
            div.film {
                ol { @for frame in &cell.pictured {
                    li { @if Some(*frame) == cell.frame { strong { (frame) } } @else { (frame) } }
                } }
                img.pixels alt="each frame: adapter, twin and difference" src={ "/api/v1/stress/" (job_id) "/cells/" (index) ".png" };
            }
        }
    };
    let title = format!("{} · {}", cell.hazard, cell.recipe);
    let page = Page {
        title: &title,
        section: Some(Section::Stress),
        script: None,
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

/// The error over frames, logarithmic, with what theory allows as a dashed line; and in numbers.
fn course(cell: &Cell) -> Markup {
    const DECADES: [f64; 2] = [-9.0, 0.0];
    let last = cell.course.last().map_or(1, |at| at.frame.max(1)) as f64;
    let y = |error: f64| {
        let decade = libm::log10(error.max(1e-300)).clamp(DECADES[0], DECADES[1]);
        10.0 + 160.0 * (DECADES[1] - decade) / (DECADES[1] - DECADES[0])
    };
    let points: Vec<String> = cell
        .course
        .iter()
        .map(|at| format!("{:.1},{:.1}", 40.0 + 550.0 * at.frame as f64 / last, y(at.error.0)))
        .collect();
    let words = format!("largest error of each frame, 0 to {last}, display units");
    html! {
        svg.course viewBox="0 0 600 190" role="img" aria-label=(words) {
            title { (words) }
            @for decade in [-9, -6, -3, 0] {
                @let at = format!("{:.1}", y(libm::exp10(f64::from(decade))));
                line.grid x1="40" x2="590" y1=(at) y2=(at) {}
                text x="36" y=(at) text-anchor="end" dominant-baseline="middle" { "1e" (decade) }
            }
            text x="590" y="186" text-anchor="end" { "frame " (last) }
            @if let Some(bound) = cell.bound.as_ref().filter(|bound| bound.value < 1.0) {
                @let at = format!("{:.1}", y(bound.value));
                line.bound x1="40" x2="590" y1=(at) y2=(at) { title { (bound.formula) } }
            }
            polyline points=(points.join(" ")) {}
        }
        details {
            summary { "In numbers" }
            div.scroll tabindex="0" role="group" aria-label="Errors" { table {
                thead { tr { th.number { "Frame" } th.number { "Error, display units" } th.number { "Steps" } } }
                tbody { @for at in &cell.course {
                    tr {
                        td.number { (at.frame) }
                        td.number { (format!("{:.2e}", at.error.0)) }
                        td.number { (format!("{:.1}", at.error_ulps.0)) }
                    }
                } }
            } }
        }
    }
}

fn growth(cell: &Cell) -> String {
    match cell.growth.map(|growth| (growth.trend, growth.rate)) {
        None => "too few frames to say".to_owned(),
        Some((Trend::Bounded, _)) => "bounded".to_owned(),
        Some((Trend::Linear, rate)) => format!("linear, {rate:.2e} a frame"),
        Some((Trend::Exponential, rate)) => format!("exponential, e^{rate:.2e} a frame"),
    }
}

fn bound(cell: &Cell) -> String {
    cell.bound.as_ref().map_or_else(
        || "says nothing here".to_owned(),
        |bound| {
            format!(
                "{} = {:.3e}; measured {:.3e}",
                bound.formula, bound.value, bound.measured
            )
        },
    )
}
