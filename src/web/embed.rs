//! `/chart.svg` and `/badge.svg`: the newest results as pictures for pages elsewhere, and for whoever reads without scripts.
//! They take the query of `/trends`. Nothing in them needs a style sheet.

use super::{
    format,
    layout::PageError,
    lines::{Choice, Line, all_series, styles},
    parts,
    query::Query,
};
use crate::{
    axis::Axis,
    server::Shared,
    store::{Series, Timestamp},
};
use axum::{
    extract::{RawQuery, State},
    http::header,
    response::{IntoResponse as _, Response},
};
use maud::{Markup, PreEscaped, html};
use std::fmt::Write as _;

/// Results of a line in the picture.
const HISTORY: usize = 500;
const MAX_LINES: usize = 8;
/// Okabe and Ito's palette, as the style sheet has it on a light ground.
const COLORS: [&str; 8] = [
    "#0072b2", "#d55e00", "#00805f", "#b4568d", "#8a6d00", "#3c8fc4", "#4a4a4a", "#7a3fb0",
];
const DASHES: [&str; 4] = ["none", "6 4", "2 3", "9 3 2 3"];
const FONT: &str = "system-ui, 'DejaVu Sans', sans-serif";
/// A monitor's refresh is not a nightly's: five minutes, in seconds.
const KEPT: &str = "private, max-age=300";

async fn lines(service: &Shared, query: Option<&str>, limit: usize) -> Result<(String, Vec<Line>), PageError> {
    let choice = Choice::of(service, &Query::parse(query)).await?;
    let all: Vec<Series> = all_series(service).await?;
    let metric = choice.metrics[0].clone();
    let (lines, _) = choice.lines(service, &all, &metric, limit, MAX_LINES).await?;
    Ok((metric, lines))
}

fn respond(picture: Markup) -> Response {
    let headers = [(header::CONTENT_TYPE, "image/svg+xml"), (header::CACHE_CONTROL, KEPT)];
    (headers, picture.into_string()).into_response()
}

/// `GET /chart.svg`
pub async fn chart(service: Shared, RawQuery(query): RawQuery) -> Result<Response, PageError> {
    let (metric, lines) = lines(&service, query.as_deref(), HISTORY).await?;
    Ok(respond(draw(&metric, &lines)))
}

/// `GET /badge.svg`
pub async fn badge(service: Shared, RawQuery(query): RawQuery) -> Result<Response, PageError> {
    let State(inner) = &service;
    let (metric, lines) = lines(&service, query.as_deref(), 2).await?;
    let Some((line, latest)) = lines.first().and_then(|line| Some((line, line.points.last()?))) else {
        return Ok(respond(two_parts(&metric, "no data", "#63676e")));
    };
    let label = format!(
        "{} · {} {metric}",
        line.series.sequence_name,
        parts::recipe(&line.series)
    );
    let value = format!(
        "{} {}",
        format::value(&metric, Some(latest.value)),
        format::unit(&metric)
    );
    let standings = super::standing::Standings::load(inner, &line.series.project, line.branch.as_deref()).await?;
    let color = match standings.of(&line.series, &metric, &line.points, latest.created_at) {
        super::standing::Standing::Regressed(_) => ("✗ ", "#b3261e"),
        super::standing::Standing::Unknown(_) => ("? ", "#63676e"),
        super::standing::Standing::Holds => ("✓ ", "#17753b"),
        _ => ("", "#0b62a8"),
    };
    Ok(respond(two_parts(
        &label,
        &format!("{}{}", color.0, value.trim()),
        color.1,
    )))
}

fn two_parts(label: &str, value: &str, color: &str) -> Markup {
    // No font can be measured here; this is wide enough for the usual ones.
    let width = |text: &str| 12.0 + 6.8 * text.chars().count() as f64;
    let (left, right) = (width(label), width(value));
    html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(left + right) height="20" role="img" aria-label={ (label) ": " (value) } {
            title { (label) ": " (value) }
            rect width=(left + right) height="20" rx="3" fill="#33373d" {}
            rect x=(left) width=(right) height="20" rx="3" fill=(color) {}
            g fill="#fff" font-family=(FONT) font-size="11" text-anchor="middle" {
                text x=(left / 2.0) y="14" { (label) }
                text x=(left + right / 2.0) y="14" { (value) }
            }
        }
    }
}

/// Where values and times lie in the picture.
struct Frame {
    times: [f64; 2],
    values: Axis,
}

// The chart's edges in the picture.
const LEFT: f64 = 62.0;
const RIGHT: f64 = 744.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 226.0;

impl Frame {
    /// Nothing where no value is finite.
    fn of(lines: &[Line]) -> Option<Self> {
        let points = || {
            lines
                .iter()
                .flat_map(|line| &line.points)
                .filter(|point| point.value.0.is_finite())
        };
        let of = |key: &dyn Fn(&crate::store::Point) -> f64| {
            let low = points().map(key).reduce(f64::min)?;
            Some([low, points().map(key).reduce(f64::max)?])
        };
        let times = of(&|point| point.created_at.0 as f64)?;
        let values = of(&|point| point.value.0)?;
        Some(Self {
            times: [times[0], times[1].max(times[0] + 1.0)],
            values: Axis::linear(values.into_iter()),
        })
    }

    fn x(&self, at: Timestamp) -> f64 {
        let [first, last] = self.times;
        LEFT + (RIGHT - LEFT) * (at.0 as f64 - first) / (last - first)
    }

    fn y(&self, value: f64) -> f64 {
        BOTTOM - (BOTTOM - TOP) * self.values.place(value)
    }
}

fn draw(metric: &str, lines: &[Line]) -> Markup {
    let styles = styles(lines);
    let height = BOTTOM + 30.0 + 16.0 * lines.len() as f64;
    let title = format!("{metric} {}", format::unit(metric));
    html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 760 {height}")) width="760" height=(height) role="img" aria-label=(title) {
            title { (title) }
            rect width="760" height=(height) fill="#fbfbfa" {}
            g font-family=(FONT) font-size="12" fill="#1c1e21" {
                text x=(LEFT) y="18" font-weight="600" { (title) }
                @match Frame::of(lines) {
                    None => text x=(LEFT) y="60" { "no data" },
                    Some(frame) => (inside(metric, lines, &styles, &frame)),
                }
            }
        }
    }
}

fn inside(metric: &str, lines: &[Line], styles: &[super::lines::Style], frame: &Frame) -> Markup {
    let date = |ms: f64| Timestamp(ms as i64).to_string().chars().take(10).collect::<String>();
    html! {
        @for &value in frame.values.ticks() {
            @let y = format!("{:.1}", frame.y(value));
            line x1=(LEFT) x2=(RIGHT) y1=(y) y2=(y) stroke="#e3e3df" {}
            text x=(LEFT - 6.0) y=(y) text-anchor="end" dominant-baseline="middle" fill="#63676e" { (format::value(metric, Some(crate::metrics::Value(value)))) }
        }
        text x=(LEFT) y=(BOTTOM + 16.0) fill="#63676e" { (date(frame.times[0])) }
        text x=(RIGHT) y=(BOTTOM + 16.0) text-anchor="end" fill="#63676e" { (date(frame.times[1])) }
        @for (i, (line, style)) in lines.iter().zip(styles).enumerate() {
            @let color = COLORS[style.color % COLORS.len()];
            @let dash = DASHES[style.dash % DASHES.len()];
            path d=(PreEscaped(path(line, frame))) fill="none" stroke=(color) stroke-width="1.75" stroke-dasharray=(dash) {}
            @let y = BOTTOM + 36.0 + 16.0 * i as f64;
            line x1=(LEFT) x2=(LEFT + 22.0) y1=(y - 4.0) y2=(y - 4.0) stroke=(color) stroke-width="2" stroke-dasharray=(dash) {}
            text x=(LEFT + 30.0) y=(y) { (style.name)
                @if let Some(latest) = line.points.last() { ": " (format::value(metric, Some(latest.value))) } }
        }
    }
}

fn path(line: &Line, frame: &Frame) -> String {
    let mut path = String::new();
    for point in line.points.iter().filter(|point| point.value.0.is_finite()) {
        let letter = if path.is_empty() { 'M' } else { 'L' };
        let _ = write!(
            path,
            "{letter}{:.1} {:.1}",
            frame.x(point.created_at),
            frame.y(point.value.0)
        );
    }
    path
}
