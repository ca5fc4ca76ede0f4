//! The front as a picture: time along x, in powers of ten, the metric along y as it is; the front as a line through its points,
//! dominated ones as open circles, with what dominates them in the tooltip.

use super::{BenchReport, Point};
use crate::{axis::Axis, metrics::Metric};
use maud::{Markup, html};

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 420.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 30.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 46.0;
const BLUE: &str = "#2a78c2";

/// An SVG of a report's points; points without a finite value are left out. Under them the fronts of earlier reports, the
/// newest first.
pub fn draw(report: &BenchReport, earlier: &[&BenchReport]) -> String {
    let now = placed(report, report.metric);
    let earlier: Vec<_> = earlier
        .iter()
        .map(|&earlier| earlier.clone().on(report.metric))
        .collect();
    let before: Vec<_> = earlier
        .iter()
        .map(|earlier| front(&placed(earlier, report.metric)))
        .collect();
    let title = format!(
        "{} on {}, {}",
        report.sequence.name,
        report.adapter.name,
        report.clock.description()
    );
    let svg = html! {
        svg.front xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img" aria-label=(title)
            font-family="sans-serif" font-size="11" fill="currentColor" {
            text x=(LEFT) y="16" font-size="13" { (title) }
            @if now.is_empty() {
                text x=(LEFT) y="40" { "no point has a value of " (report.metric) }
            } @else {
                (chart(report.metric, &now, &before))
            }
        }
    };
    svg.into_string()
}

/// A point where it is drawn.
#[derive(Clone, Copy)]
struct Placed<'a> {
    point: &'a Point,
    ms: f64,
    value: f64,
}

fn placed(report: &BenchReport, metric: Metric) -> Vec<Placed<'_>> {
    let place = |point: &'_ Point| point.metrics.get(metric.id()).map(|value| value.0);
    let points = report.points.iter();
    points
        .filter_map(|point| {
            let value = place(point).filter(|value| value.is_finite())?;
            Some(Placed {
                point,
                ms: point.time_ms.median,
                value,
            })
        })
        .collect()
}

/// The points that nothing dominates, fastest first.
fn front<'a>(placed: &[Placed<'a>]) -> Vec<Placed<'a>> {
    let mut front: Vec<_> = placed
        .iter()
        .copied()
        .filter(|placed| placed.point.dominated_by.is_none())
        .collect();
    front.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    front
}

fn chart(metric: Metric, now: &[Placed<'_>], before: &[Vec<Placed<'_>>]) -> Markup {
    let all = || now.iter().chain(before.iter().flatten());
    let (xs, ys) = (
        Axis::powers(all().flat_map(|at| [at.point.time_ms.low, at.point.time_ms.high])),
        Axis::linear(all().map(|at| at.value)),
    );
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    let x = |ms: f64| round(LEFT + xs.place(ms) * (right - LEFT));
    let y = |value: f64| round(bottom - ys.place(value) * (bottom - TOP));
    let line = |front: &[Placed<'_>]| {
        let points: Vec<_> = front.iter().map(|at| format!("{},{}", x(at.ms), y(at.value))).collect();
        points.join(" ")
    };
    let unit = match metric.info().unit {
        "" => metric.id().to_owned(),
        unit => format!("{metric}, {unit}"),
    };
    html! {
        @for &tick in xs.ticks() {
            path d={ "M" (x(tick)) " " (TOP) "V" (bottom) } stroke="#8886" fill="none" {}
            text x=(x(tick)) y=(bottom + 14.0) text-anchor="middle" { (tick) }
        }
        @for &tick in ys.ticks() {
            path d={ "M" (LEFT) " " (y(tick)) "H" (right) } stroke="#8886" fill="none" {}
            text x=(LEFT - 6.0) y=(y(tick) + 4.0) text-anchor="end" { (tick) }
        }
        text x=(0.5 * (LEFT + right)) y=(HEIGHT - 10.0) text-anchor="middle" { "ms a frame" }
        text x="14" y=(0.5 * HEIGHT) text-anchor="middle" transform={ "rotate(-90 14 " (0.5 * HEIGHT) ")" } { (unit) }
        @for (age, front) in before.iter().enumerate() {
            polyline points=(line(front)) fill="none" stroke=(BLUE) stroke-dasharray="4 3" opacity=(round(0.5 / (1.0 + age as f64))) {}
        }
        polyline points=(line(&front(now))) fill="none" stroke=(BLUE) stroke-width="1.5" {}
        @for (at, name_y) in now.iter().zip(name_places(now, x, y)) {
            (point(at, [x(at.ms), y(at.value)], name_y, [x(at.point.time_ms.low), x(at.point.time_ms.high)]))
        }
    }
}

/// How far down the picture the names of the front's points stand.
fn name_places(points: &[Placed<'_>], x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) -> Vec<Option<f64>> {
    let mut taken = Vec::new();
    let place = |at: &Placed<'_>| {
        if at.point.dominated_by.is_some() {
            return None;
        }
        let found = free_box(&taken, [x(at.ms), y(at.value)], at.point.name().chars().count());
        taken.push(found);
        Some(round(found[3]))
    };
    points.iter().map(place).collect()
}

/// Left, top, right and bottom.
type Rect = [f64; 4];

fn overlap(a: &Rect, b: &Rect) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Where a name of so many characters stands: over or under its point, as far away as it takes to cover none that is there.
fn free_box(taken: &[Rect], [x, y]: [f64; 2], n_characters: usize) -> Rect {
    const CHARACTER: f64 = 6.0;
    const LINE: f64 = 12.0;
    let width = CHARACTER * n_characters as f64;
    let left = if is_right(x) { x - GAP - width } else { x + GAP };
    let at = |dy: f64| [left, y + dy - LINE, left + width, y + dy];
    let is_free =
        |place: &Rect| place[1] > 0.0 && place[3] < HEIGHT && !taken.iter().any(|other| overlap(place, other));
    (0..=taken.len())
        .flat_map(|n| [-6.0 - LINE * n as f64, 14.0 + LINE * n as f64])
        .map(at)
        .find(is_free)
        .unwrap_or_else(|| at(-6.0))
}

/// From a point to its name.
const GAP: f64 = 7.0;

/// Names stand left of points in the right half, so that none is cut off.
fn is_right(x: f64) -> bool {
    x > 0.5 * WIDTH
}

/// One point with the interval of its time; with a name on the front.
fn point(at: &Placed<'_>, [x, y]: [f64; 2], name_y: Option<f64>, [low, high]: [f64; 2]) -> Markup {
    let name = at.point.name();
    html! {
        g {
            title {
                (name) ": " (format!("{:.3}", at.ms)) " ms, " (at.value)
                @if let Some(by) = &at.point.dominated_by { ", dominated by " (by) }
            }
            path d={ "M" (low) " " (y) "H" (high) } stroke=(BLUE) {}
            @if let Some(name_y) = name_y {
                circle cx=(x) cy=(y) r="4" fill=(BLUE) {}
                text x=(if is_right(x) { x - GAP } else { x + GAP }) y=(name_y)
                    text-anchor=(if is_right(x) { "end" } else { "start" }) { (name) }
            } @else {
                circle cx=(x) cy=(y) r="3.5" fill="none" stroke="#888" {}
            }
        }
    }
}

/// Of coordinates: tenths are enough.
fn round(pixels: f64) -> f64 {
    (10.0 * pixels).round() / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cover_no_other_and_stay_in_the_picture() {
        // Nine points almost at one place near the top, and one that is alone.
        let crowd = (0..9).map(|i| ([600.0 + f64::from(i), TOP + 2.0], 14));
        let mut taken: Vec<Rect> = Vec::new();
        for (at, n_characters) in crowd.chain([([80.0, 300.0], 20)]) {
            let place = free_box(&taken, at, n_characters);
            assert!(
                taken.iter().all(|other| !overlap(other, &place)),
                "{place:?} in {taken:?}"
            );
            assert!(
                place[0] > 0.0 && place[1] > 0.0 && place[2] < WIDTH && place[3] < HEIGHT,
                "{place:?}"
            );
            taken.push(place);
        }
        assert_eq!(
            taken[9][3],
            300.0 - 6.0,
            "the one that is alone stands right over its point"
        );
        assert!(
            overlap(&free_box(&[], [600.0, 32.0], 14), &taken[0]),
            "who knows of none covers some"
        );
    }
}
