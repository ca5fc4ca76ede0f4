//! FXAA 3.11, quality preset 39: the twin of `shaders/taa/spatial/fxaa.wgsl`, after Lottes 2011.

use super::{
    color::Color,
    real::Real,
    sampling::Lerp,
    spatial::{Light, edge_lumas},
};
use crate::image::Image;

/// How much of the sub-pixel blur is applied: `fxaaQualitySubpix`.
const SUBPIXEL: f64 = 0.75;
/// An edge's contrast as a share of the brightest texel: `fxaaQualityEdgeThreshold`.
const CONTRAST: f64 = 0.166;
/// The least contrast of an edge: `fxaaQualityEdgeThresholdMin`.
const CONTRAST_MIN: f64 = 0.0833;
/// What preset 39 adds to the distance along an edge with each look.
const STEPS: [f64; 12] = [1.0, 1.0, 1.0, 1.0, 1.0, 1.5, 2.0, 2.0, 2.0, 2.0, 4.0, 8.0];

/// The whole image.
pub(super) fn antialiased<R: Real>(color: &Image<Color<R>>, light: Light) -> Image<Color<R>> {
    let luma = edge_lumas(color);
    Image::from_fn(color.extent(), |x, y| {
        let p = [i64::from(x), i64::from(y)];
        let centre = color.at(x, y);
        match edge(&luma, p) {
            None => centre,
            Some(edge) => {
                let [i, j] = edge.across;
                let offset = edge.offset(&luma, p).max(edge.subpixel);
                let [centre, other] = [centre, color.clamped(p[0] + i, p[1] + j)].map(|c| light.decoded(c));
                light.encoded(centre.lerp(other, offset))
            }
        }
    })
}

/// The edge that passes a texel.
struct Edge<R> {
    along: [i64; 2],
    /// To the texel on the other side.
    across: [i64; 2],
    /// Luma of the texel.
    luma: R,
    /// Luma on the edge beside the texel: the mean of both sides.
    middle: R,
    /// A change of that by so much ends the edge.
    threshold: R,
    /// How far to read across it at least, because the texel stands out.
    subpixel: R,
}

/// The edge at `p`; none where the contrast is too small.
fn edge<R: Real>(luma: &Image<R>, [x, y]: [i64; 2]) -> Option<Edge<R>> {
    let (zero, two) = (R::new(0.0), R::new(2.0));
    let at = |i: i64, j: i64| luma.clamped(x + i, y + j);
    let cross = [(0, 0), (0, -1), (-1, 0), (1, 0), (0, 1)].map(|(i, j)| at(i, j));
    let [m, n, w, e, s] = cross;
    let brightest = cross.into_iter().fold(m, R::max);
    let range = brightest - cross.into_iter().fold(m, R::min);
    if range < R::new(CONTRAST_MIN).max(brightest * R::new(CONTRAST)) {
        return None;
    }
    // How much luma bends along each column, and along each row; those through the centre count twice.
    let bend = |a: R, b: R, c: R| (a - two * b + c).abs();
    let column = |i: i64| bend(at(i, -1), at(i, 0), at(i, 1));
    let row = |j: i64| bend(at(-1, j), at(0, j), at(1, j));
    let is_horizontal = column(-1) + two * column(0) + column(1) >= row(-1) + two * row(0) + row(1);

    let (along, across, [before, after]) = if is_horizontal {
        ([1, 0], [0, 1], [n, s])
    } else {
        ([0, 1], [1, 0], [w, e])
    };
    let (step_before, step_after) = ((before - m).abs(), (after - m).abs());
    let (across, other) = if step_before >= step_after {
        (across.map(|d: i64| -d), before)
    } else {
        (across, after)
    };

    let corners = at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1);
    let mean = (two * (n + w + e + s) + corners) / R::new(12.0);
    let share = ((mean - m).abs() / range).clamp(zero, R::new(1.0));
    let smooth = share * share * (R::new(3.0) - two * share);
    Some(Edge {
        along,
        across,
        luma: m,
        middle: (m + other) / two,
        threshold: step_before.max(step_after) / R::new(4.0),
        subpixel: smooth * smooth * R::new(SUBPIXEL),
    })
}

impl<R: Real> Edge<R> {
    /// How far across to read, for what the nearer end of the edge says.
    fn offset(&self, luma: &Image<R>, p: [i64; 2]) -> R {
        let [back, forth] = [-1, 1].map(|direction| self.end(luma, p, direction));
        let (nearer, change) = if back.0 < forth.0 { back } else { forth };
        if (change < R::new(0.0)) == (self.luma < self.middle) {
            return R::new(0.0);
        }
        R::new(0.5) - R::new(nearer) / R::new(back.0 + forth.0)
    }

    /// How far the edge reaches, and how its luma changes there.
    fn end(&self, luma: &Image<R>, [x, y]: [i64; 2], direction: i64) -> (f64, R) {
        let [(ax, ay), (bx, by)] = [self.along, self.across].map(|[i, j]| (i, j));
        let on_edge = |steps: i64| {
            let (x, y) = (x + direction * steps * ax, y + direction * steps * ay);
            (luma.clamped(x, y) + luma.clamped(x + bx, y + by)) / R::new(2.0)
        };
        let (mut distance, mut change) = (STEPS[0], R::new(0.0));
        for next in &STEPS[1..] {
            let (below, above) = (distance.floor() as i64, distance.ceil() as i64);
            change = (on_edge(below) + on_edge(above)) / R::new(2.0) - self.middle;
            if change.abs() >= self.threshold {
                break;
            }
            distance += next;
        }
        (distance, change)
    }
}
