//! The front as a picture: time along x, in powers of ten, the metric along y as it is; the front as a line through its points,
//! dominated ones as open circles, with what dominates them in the tooltip.

use super::{BenchReport, Point};
use crate::metrics::Metric;
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
        @for &tick in &xs.ticks {
            path d={ "M" (x(tick)) " " (TOP) "V" (bottom) } stroke="#8886" fill="none" {}
            text x=(x(tick)) y=(bottom + 14.0) text-anchor="middle" { (tick) }
        }
        @for &tick in &ys.ticks {
            path d={ "M" (LEFT) " " (y(tick)) "H" (right) } stroke="#8886" fill="none" {}
            text x=(LEFT - 6.0) y=(y(tick) + 4.0) text-anchor="end" { (tick) }
        }
        text x=(0.5 * (LEFT + right)) y=(HEIGHT - 10.0) text-anchor="middle" { "ms a frame" }
        text x="14" y=(0.5 * HEIGHT) text-anchor="middle" transform={ "rotate(-90 14 " (0.5 * HEIGHT) ")" } { (unit) }
        @for (age, front) in before.iter().enumerate() {
            polyline points=(line(front)) fill="none" stroke=(BLUE) stroke-dasharray="4 3" opacity=(round(0.5 / (1.0 + age as f64))) {}
        }
        polyline points=(line(&front(now))) fill="none" stroke=(BLUE) stroke-width="1.5" {}
        @for at in now { (point(at, x(at.ms), y(at.value), [x(at.point.time_ms.low), x(at.point.time_ms.high)])) }
    }
}

/// One point with the interval of its time. Names stand left of points in the right half, so that none is cut off.
fn point(at: &Placed<'_>, x: f64, y: f64, [low, high]: [f64; 2]) -> Markup {
    let name = at.point.name();
    let is_dominated = at.point.dominated_by.is_some();
    let is_right = x > 0.5 * WIDTH;
    html! {
        g {
            title {
                (name) ": " (format!("{:.3}", at.ms)) " ms, " (at.value)
                @if let Some(by) = &at.point.dominated_by { ", dominated by " (by) }
            }
            path d={ "M" (low) " " (y) "H" (high) } stroke=(BLUE) {}
            @if is_dominated {
                circle cx=(x) cy=(y) r="3.5" fill="none" stroke="#888" {}
            } @else {
                circle cx=(x) cy=(y) r="4" fill=(BLUE) {}
                text x=(if is_right { x - 7.0 } else { x + 7.0 }) y=(round(y - 6.0))
                    text-anchor=(if is_right { "end" } else { "start" }) { (name) }
            }
        }
    }
}

/// Of coordinates: tenths are enough.
fn round(pixels: f64) -> f64 {
    (10.0 * pixels).round() / 10.0
}

/// From values to 0..1.
struct Axis {
    from: f64,
    to: f64,
    is_log: bool,
    ticks: Vec<f64>,
}

impl Axis {
    /// 1, 2 and 5 times the powers of ten.
    fn powers(values: impl Iterator<Item = f64> + Clone) -> Self {
        let (least, most) = range(values);
        let (least, most) = (least.max(1e-6) / 1.2, most.max(1e-6) * 1.2);
        let first = libm::floor(libm::log10(least)) as i32;
        let ticks = (first..first + 8)
            .flat_map(|power| [1.0, 2.0, 5.0].map(|digit| rounded(digit * libm::pow(10.0, f64::from(power)))))
            .filter(|tick| (least..=most).contains(tick))
            .collect();
        Self {
            from: libm::log10(least),
            to: libm::log10(most),
            is_log: true,
            ticks,
        }
    }

    fn linear(values: impl Iterator<Item = f64> + Clone) -> Self {
        let (least, most) = range(values);
        let margin = (0.08 * (most - least)).max(1e-6 * most.abs()).max(1e-9);
        let (from, to) = (least - margin, most + margin);
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|digit| digit * libm::pow(10.0, libm::floor(libm::log10((to - from) / 5.0))))
            .into_iter()
            .find(|step| (to - from) / step <= 6.0)
            .expect("ten of a power of ten are enough");
        let first = libm::ceil(from / step) as i64;
        let ticks = (first..)
            .map(|i| rounded(i as f64 * step))
            .take_while(|tick| *tick <= to)
            .collect();
        Self {
            from,
            to,
            is_log: false,
            ticks,
        }
    }

    fn place(&self, value: f64) -> f64 {
        let value = if self.is_log {
            libm::log10(value.max(1e-6))
        } else {
            value
        };
        (value - self.from) / (self.to - self.from)
    }
}

/// Without the digits that a product of powers of ten leaves behind.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().expect("a printed number")
}

fn range(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let least = values.clone().fold(f64::INFINITY, f64::min);
    (least, values.fold(f64::NEG_INFINITY, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_round_ticks_and_hold_their_values() {
        let axis = Axis::powers([0.9, 30.0].into_iter());
        assert_eq!(axis.ticks, [1.0, 2.0, 5.0, 10.0, 20.0]);
        assert!(axis.place(0.9) > 0.0 && axis.place(30.0) < 1.0);
        let axis = Axis::linear([28.1, 33.2].into_iter());
        assert_eq!(axis.ticks, [28.0, 29.0, 30.0, 31.0, 32.0, 33.0]);
        let flat = Axis::linear([5.0, 5.0].into_iter());
        assert!(
            (flat.place(5.0) - 0.5).abs() < 1e-6 && flat.ticks.len() < 8,
            "{:?}",
            flat.ticks
        );
    }
}
