//! Curves as SVG.

use super::finding::Chart;
use crate::axis::Axis;
use std::fmt::Write as _;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 170.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 44.0;

/// Told apart by those who see few colours, too: Okabe and Ito, "Color Universal Design", 2008.
const COLORS: [&str; 8] = [
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#d55e00", "#0072b2", "#cc79a7", "#999999",
];

/// Draws `chart` with labelled axes and a legend.
pub fn svg(chart: &Chart) -> String {
    let points = || {
        chart
            .curves
            .iter()
            .flat_map(|(_, points)| points)
            .filter(|p| is_finite(p))
    };
    let [x_axis, y_axis] = [0, 1].map(|axis| Axis::linear(points().map(|point| point[axis])));
    let to_x = |x: f64| LEFT + x_axis.place(x) * (WIDTH - LEFT - RIGHT);
    let to_y = |y: f64| HEIGHT - BOTTOM - y_axis.place(y) * (HEIGHT - TOP - BOTTOM);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    for &tick in y_axis.ticks() {
        let y = to_y(tick);
        let end = WIDTH - RIGHT;
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {y:.1}H{end}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
            LEFT - 6.0,
            y + 4.0
        );
    }
    for &tick in x_axis.ticks() {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{tick}</text>",
            to_x(tick),
            HEIGHT - BOTTOM + 16.0
        );
    }
    for (index, (name, points)) in chart.curves.iter().enumerate() {
        let color = COLORS[index % COLORS.len()];
        let corners: Vec<String> = points
            .iter()
            .filter(|point| is_finite(point))
            .map(|&[x, y]| format!("{:.1},{:.1}", to_x(x), to_y(y)))
            .collect();
        let y = TOP + 10.0 + 18.0 * index as f64;
        let x = WIDTH - RIGHT + 12.0;
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"/>\
             <path d=\"M{x} {y}h18\" stroke=\"{color}\" stroke-width=\"3\"/><text x=\"{}\" y=\"{}\">{}</text>",
            corners.join(" "),
            x + 24.0,
            y + 4.0,
            escape(name)
        );
    }
    let middle = TOP + (HEIGHT - TOP - BOTTOM) / 2.0;
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
         <text transform=\"translate(14 {middle}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n</svg>",
        LEFT + (WIDTH - LEFT - RIGHT) / 2.0,
        HEIGHT - 8.0,
        escape(&chart.x),
        escape(&chart.y)
    );
    svg
}

fn is_finite(point: &[f64; 2]) -> bool {
    point.iter().all(|value| value.is_finite())
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: &[[f64; 2]]) -> Chart {
        Chart {
            name: "name".to_owned(),
            caption: String::new(),
            x: "frame".to_owned(),
            y: "PSNR, dB".to_owned(),
            curves: vec![("a < b".to_owned(), points.to_vec())],
        }
    }

    #[test]
    fn infinite_points_are_left_out() {
        let drawn = svg(&chart(&[[0.0, 1.0], [1.0, f64::INFINITY], [2.0, 3.0]]));
        let line = drawn.lines().find(|line| line.contains("<polyline")).unwrap();
        assert_eq!(
            line.split("points=\"")
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
                .split(' ')
                .count(),
            2
        );
        assert!(
            drawn.contains("a &lt; b") && !drawn.contains("inf") && !drawn.contains("NaN"),
            "{drawn}"
        );
    }

    #[test]
    fn nothing_to_draw_is_drawn_empty() {
        let drawn = svg(&chart(&[]));
        assert!(drawn.ends_with("</svg>\n") && !drawn.contains("NaN"), "{drawn}");
    }
}
