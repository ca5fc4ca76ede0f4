//! SMAA 1x, preset ultra: the twin of `shaders/taa/spatial/smaa_*.wgsl`, after Jimenez et al. 2012.

use super::{
    color::Color,
    real::Real,
    sampling::Lerp,
    spatial::{Light, edge_lumas},
};
use crate::{
    image::Image,
    taa::smaa_area::{AREAS, Area, MAX_DIAGONAL, MAX_TO_END, MAX_TO_START, end},
};

/// The least luma difference of an edge.
const THRESHOLD: f64 = 0.05;
/// An edge with a neighbour that contrasts so many times more is none.
const LOCAL_CONTRAST: f64 = 2.0;
/// How much less corners are rounded, 0 to 1.
const CORNER_ROUNDING: f64 = 0.25;

/// The first pass: where there are edges.
pub fn edges<R: Real>(color: &Image<Color<R>>) -> Image<Sides> {
    let luma = edge_lumas(color);
    Image::from_fn(color.extent(), |x, y| edges_at(&luma, [x.into(), y.into()]))
}

/// The second: what each pixel takes of its neighbours.
pub fn weights<R: Real>(edges: &Image<Sides>) -> Image<Weights<R>> {
    Image::from_fn(edges.extent(), |x, y| Edges(edges).weights([x.into(), y.into()]))
}

/// The third.
pub fn blend<R: Real>(color: &Image<Color<R>>, weights: &Image<Weights<R>>, light: Light) -> Image<Color<R>> {
    Image::from_fn(color.extent(), |x, y| {
        blended(color, weights, [x.into(), y.into()], light)
    })
}

type Position = [i64; 2];

fn plus([x, y]: Position, [i, j]: Position) -> Position {
    [x + i, y + j]
}

/// The edges at a pixel's left and at its top.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sides {
    left: bool,
    top: bool,
}

impl Sides {
    /// As the GPU keeps them.
    pub fn bits(self) -> u64 {
        u64::from(self.left) | u64::from(self.top) << 1
    }

    /// From [`Sides::bits`].
    pub fn from_bits(bits: u64) -> Self {
        Self {
            left: bits & 1 != 0,
            top: bits & 2 != 0,
        }
    }
}

fn edges_at<R: Real>(luma: &Image<R>, [x, y]: Position) -> Sides {
    let at = |i: i64, j: i64| luma.clamped(x + i, y + j);
    let difference = |a: [i64; 2], b: [i64; 2]| (at(a[0], a[1]) - at(b[0], b[1])).abs();
    let left = difference([0, 0], [-1, 0]);
    let top = difference([0, 0], [0, -1]);
    let others = [
        difference([0, 0], [1, 0]),
        difference([0, 0], [0, 1]),
        difference([-1, 0], [-2, 0]),
        difference([0, -1], [0, -2]),
    ];
    let strongest = others.into_iter().fold(left.max(top), R::max);
    let is_edge = |d: R| d >= R::new(THRESHOLD) && d * R::new(LOCAL_CONTRAST) >= strongest;
    Sides {
        left: is_edge(left),
        top: is_edge(top),
    }
}

/// The direction of a line of edges.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Axis {
    /// Top edges of a row of pixels, crossed by left ones.
    Row,
    /// Left edges of a column, crossed by top ones.
    Column,
}

/// The shares of a pixel and of its neighbour across its top edge that each takes of the other; then across its left edge.
pub type Weights<R> = [[R; 2]; 2];

struct Edges<'a>(&'a Image<Sides>);

impl Edges<'_> {
    fn left(&self, [x, y]: Position) -> bool {
        self.0.clamped(x, y).left
    }

    fn top(&self, [x, y]: Position) -> bool {
        self.0.clamped(x, y).top
    }

    /// Diagonals go first: a pixel on one has no other lines.
    fn weights<R: Real>(&self, p: Position) -> Weights<R> {
        let mut weights = Weights::default();
        let mut left = self.left(p);
        if self.top(p) {
            weights[0] = self.diagonals(p);
            if weights[0] == [R::new(0.0); 2] {
                weights[0] = self.line(p, Axis::Row);
            } else {
                left = false;
            }
        }
        if left {
            weights[1] = self.line(p, Axis::Column);
        }
        weights
    }

    /// From the line along a row or column that passes `p`.
    fn line<R: Real>(&self, p: Position, axis: Axis) -> [R; 2] {
        let [along, across] = match axis {
            Axis::Row => [[1, 0], [0, 1]],
            Axis::Column => [[0, 1], [1, 0]],
        };
        let at = |from: Position, i: i64, j: i64| {
            [
                from[0] + i * along[0] + j * across[0],
                from[1] + i * along[1] + j * across[1],
            ]
        };
        let is_edge = |q| match axis {
            Axis::Row => self.top(q),
            Axis::Column => self.left(q),
        };
        let crosses = |q| match axis {
            Axis::Row => self.left(q),
            Axis::Column => self.top(q),
        };
        // Whether a line passes from the pixel before `q` on to `q`.
        let crossed = |q| crosses(q) || crosses(at(q, 0, -1));
        let mut to_start = 0;
        while (to_start as usize) < MAX_TO_START && !crossed(at(p, -to_start, 0)) && is_edge(at(p, -to_start - 1, 0)) {
            to_start += 1;
        }
        let mut to_end = 0;
        while (to_end as usize) < MAX_TO_END && !crossed(at(p, to_end + 1, 0)) && is_edge(at(p, to_end + 1, 0)) {
            to_end += 1;
        }
        let (first, last) = (at(p, -to_start, 0), at(p, to_end, 0));
        let end_at = |q| ends(crosses(q), crosses(at(q, 0, -1)));
        let area = AREAS.orthogonal(
            [end_at(first), end_at(at(last, 1, 0))],
            [to_start as usize, to_end as usize],
        );
        // A corner is an edge that crosses the nearer end and goes on: pixels there are blended less. In the middle both are near.
        let near = [to_start <= to_end, to_start >= to_end];
        let share = R::new((1.0 - CORNER_ROUNDING) / if near == [true; 2] { 2.0 } else { 1.0 });
        let kept = |j: i64| {
            let corners = [near[0] && crosses(at(first, 0, j)), near[1] && crosses(at(last, 1, j))];
            let n_corners = corners.into_iter().filter(|is_corner| *is_corner).count();
            (R::new(1.0) - share * R::new(n_corners as f64)).saturate()
        };
        let [own, other] = area.map(|a| R::new(f64::from(a)));
        [own * kept(1), other * kept(-2)]
    }

    /// From the diagonals that pass `p`, one falling to the left and one to the right.
    fn diagonals<R: Real>(&self, p: Position) -> [R; 2] {
        let [own, other] = self.rising(p);
        let [other_falling, own_falling] = self.falling(p);
        [own + own_falling, other + other_falling].map(|a| R::new(f64::from(a)))
    }

    /// From the lower left to the upper right.
    fn rising(&self, p: Position) -> Area {
        let both = |q| [self.left(q), self.top(q)];
        let mut start = Search::default();
        if self.left(p) {
            start = search(both, p, [-1, 1]);
            // The line's last pixel has a top edge only.
            start.distance += i64::from(start.last[1]);
        }
        let end = search(both, p, [1, -1]);
        if start.distance + end.distance <= 2 {
            return Area::default();
        }
        let (a, b) = (start.distance, end.distance);
        let ends = [
            start.end_unless_lost(ends(self.left(plus(p, [-a, a])), self.top(plus(p, [-a - 1, a])))),
            end.end_unless_lost(ends(
                self.left(plus(p, [b + 1, -b - 1])),
                self.top(plus(p, [b + 1, -b])),
            )),
        ];
        AREAS.diagonal(ends, [a as usize, b as usize])
    }

    /// From the upper left to the lower right.
    fn falling(&self, p: Position) -> Area {
        let both = |q| [self.left(plus(q, [1, 0])), self.top(q)];
        let start = search(both, p, [-1, -1]);
        let mut end = Search::default();
        if self.left(plus(p, [1, 0])) {
            end = search(both, p, [1, 1]);
            end.distance += i64::from(end.last[1]);
        }
        if start.distance + end.distance <= 2 {
            return Area::default();
        }
        let (a, b) = (start.distance, end.distance);
        let ends = [
            start.end_unless_lost(ends(self.left(plus(p, [-a, -a - 1])), self.top(plus(p, [-a - 1, -a])))),
            end.end_unless_lost(ends(self.left(plus(p, [b + 1, b])), self.top(plus(p, [b + 1, b])))),
        ];
        AREAS.diagonal(ends, [a as usize, b as usize])
    }
}

fn ends(own: bool, other: bool) -> usize {
    usize::from(own) * end::OWN + usize::from(other) * end::OTHER
}

/// A walk along a diagonal.
#[derive(Default)]
struct Search {
    /// How many pixels have both of their edges.
    distance: i64,
    /// The edges of the pixel that ended the walk.
    last: [bool; 2],
}

impl Search {
    /// Where the walk did not come to an end, nothing is known of it.
    fn end_unless_lost(&self, end: usize) -> usize {
        if self.last == [true; 2] { end::OPEN } else { end }
    }
}

fn search(edges: impl Fn(Position) -> [bool; 2], p: Position, [i, j]: Position) -> Search {
    let mut search = Search::default();
    for steps in 1..=MAX_DIAGONAL as i64 {
        search.last = edges(plus(p, [steps * i, steps * j]));
        search.distance = steps - 1;
        if search.last != [true; 2] {
            break;
        }
    }
    search
}

/// A pixel and its neighbours, across either its left and right edge or its top and bottom one, whichever weigh more.
fn blended<R: Real>(color: &Image<Color<R>>, weights: &Image<Weights<R>>, [x, y]: Position, light: Light) -> Color<R> {
    let [[up, _], [left, _]] = weights.clamped(x, y);
    let right = weights.clamped(x + 1, y)[1][1];
    let down = weights.clamped(x, y + 1)[0][1];
    let centre = color.clamped(x, y);
    let is_horizontal = right.max(left) > down.max(up);
    let sides = if is_horizontal {
        [(right, [1, 0]), (left, [-1, 0])]
    } else {
        [(down, [0, 1]), (up, [0, -1])]
    };
    let sum = sides[0].0 + sides[1].0;
    if sum < R::new(1e-5) {
        return centre;
    }
    let centre = light.decoded(centre);
    let mixed = sides.into_iter().fold(Color::default(), |mixed, (weight, [i, j])| {
        let side = light.decoded(color.clamped(x + i, y + j));
        mixed + centre.lerp(side, weight) * (weight / sum)
    });
    light.encoded(mixed)
}
