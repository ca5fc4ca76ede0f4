//! The areas of SMAA: how much of the two pixels beside an edge lies on the wrong side of the line that the edge stands for.
//! Jimenez, Echevarria, Sousa and Gutierrez, "SMAA: Enhanced Subpixel Morphological Antialiasing", 2012, 3.1 and 3.2.
//!
//! The publication keeps them in a texture of 8 bits. Here they are computed at the first use and rounded to 2⁻¹⁶ instead:
//! areas that are equal by symmetry are equal exactly, and blending weights made of them compare so in f32 and in f64.

use std::sync::LazyLock;

/// The farthest ends that the search finds, in texels: 32 steps of two, of which the first towards the start begins on the
/// pixel itself.
pub const MAX_TO_START: usize = 63;
/// The same towards the end.
pub const MAX_TO_END: usize = 64;
/// The farthest end of a diagonal: 16 steps of one.
pub const MAX_DIAGONAL: usize = 16;

/// Up to this length, pixels, the area under an edge whose both ends bend to one side is exaggerated.
const SMOOTHED_LENGTH: f64 = 32.0;
/// Diagonals are sampled at so many points along either axis of a pixel, the first and last on its border.
const N_SAMPLES: i64 = 30;

const N_ENDS: usize = 4;
const N_ORTHOGONAL: usize = N_ENDS * N_ENDS * (MAX_TO_START + 1) * (MAX_TO_END + 1);

/// All areas.
pub static AREAS: LazyLock<Areas> = LazyLock::new(Areas::new);

/// Edges that cross a line at one of its ends: bits.
pub mod end {
    /// None does.
    pub const OPEN: usize = 0;
    /// On the side of the pixel itself; for diagonals across it.
    pub const OWN: usize = 1;
    /// On the other side; for diagonals along the line.
    pub const OTHER: usize = 2;
    /// Both.
    pub const BOTH: usize = OWN | OTHER;
}

/// A pixel's share that the other side covers, and the share of the pixel on the other side that this one covers.
pub type Area = [f32; 2];

/// Areas by what crosses both ends of a line, and by a pixel's distance from them.
#[derive(Debug)]
pub struct Areas {
    /// First those of edges along rows or columns, then those of diagonals, as [`Areas::table`] says.
    table: Vec<Area>,
}

impl Areas {
    fn new() -> Self {
        let ends = || (0..N_ENDS).flat_map(|start| (0..N_ENDS).map(move |end| [start, end]));
        let orthogonal = ends().flat_map(|ends| {
            let knots = knots(ends);
            let distances = (0..=MAX_TO_START).flat_map(|a| (0..=MAX_TO_END).map(move |b| [a, b]));
            distances.map(move |distances| interpolated(&knots, distances))
        });
        let diagonal = ends().flat_map(|ends| {
            let distances = (0..=MAX_DIAGONAL).flat_map(|a| (0..=MAX_DIAGONAL).map(move |b| [a, b]));
            distances.map(move |distances| diagonal(ends, distances))
        });
        let table = orthogonal.chain(diagonal).map(|area| area.map(rounded)).collect();
        Self { table }
    }

    /// Of an edge along a row or column, by the crossings at its start and end and the distance to both.
    pub fn orthogonal(&self, [start, end]: [usize; 2], [to_start, to_end]: [usize; 2]) -> Area {
        let line = start * N_ENDS + end;
        self.table[(line * (MAX_TO_START + 1) + to_start) * (MAX_TO_END + 1) + to_end]
    }

    /// Of a diagonal, likewise.
    pub fn diagonal(&self, [start, end]: [usize; 2], [to_start, to_end]: [usize; 2]) -> Area {
        let line = start * N_ENDS + end;
        self.table[N_ORTHOGONAL + (line * (MAX_DIAGONAL + 1) + to_start) * (MAX_DIAGONAL + 1) + to_end]
    }

    /// All of them, the last index changing fastest: `[start][end][to_start][to_end]` of edges, then of diagonals.
    pub fn table(&self) -> &[Area] {
        &self.table
    }
}

fn rounded(area: f64) -> f32 {
    ((area * 65_536.0).round() / 65_536.0) as f32
}

/// The distances that the publication's texture holds are squares.
const N_KNOTS: usize = 9;
type Knots = [[[f64; 2]; N_KNOTS]; N_KNOTS];

fn knots(ends: [usize; 2]) -> Knots {
    std::array::from_fn(|a| std::array::from_fn(|b| orthogonal(ends, [(a * a) as f64, (b * b) as f64])))
}

/// Between squares, a sampler interpolates along the roots.
fn interpolated(knots: &Knots, distances: [usize; 2]) -> [f64; 2] {
    let roots = distances.map(|d| (d as f64).sqrt());
    let below = roots.map(|root| (root as usize).min(N_KNOTS - 2));
    let [a, b] = [0, 1].map(|i| roots[i] - below[i] as f64);
    std::array::from_fn(|side| {
        let knot = |i: usize, j: usize| knots[below[0] + i][below[1] + j][side];
        knot(0, 0) * (1.0 - a) * (1.0 - b)
            + knot(1, 0) * a * (1.0 - b)
            + knot(0, 1) * (1.0 - a) * b
            + knot(1, 1) * a * b
    })
}

/// The line through an edge goes half a pixel to the side where another edge crosses an end of it; from an end that nothing
/// crosses it is flat up to the middle.
fn orthogonal([start, end]: [usize; 2], [to_start, to_end]: [f64; 2]) -> [f64; 2] {
    let height = |end| match end {
        end::OWN => -0.5,
        end::OTHER => 0.5,
        _ => 0.0,
    };
    let (mut from, mut to) = (height(start), height(end));
    // What is crossed on both sides might go either way: away from the other end.
    if start == end::BOTH {
        from = -to;
    }
    if end == end::BOTH {
        to = -from;
    }
    let length = to_start + to_end + 1.0;
    let under = |line| area_under(line, to_start);
    if from == -to {
        return under([[0.0, from], [length, to]]);
    }
    let halves = [[[0.0, from], [0.5 * length, 0.0]], [[0.5 * length, 0.0], [length, to]]].map(under);
    let smoothed = |area: f64| {
        let flat = (length / SMOOTHED_LENGTH).min(1.0);
        (2.0 * area).sqrt() * 0.5 * (1.0 - flat) + area * flat
    };
    std::array::from_fn(|side| {
        let [a, b] = halves.map(|half| half[side]);
        if from == to { smoothed(a) + smoothed(b) } else { a + b }
    })
}

/// Between a line and the axis from `x` to `x + 1`: what lies below the axis, and above.
fn area_under([[x0, y0], [x1, y1]]: [[f64; 2]; 2], x: f64) -> [f64; 2] {
    let (from, to) = (x0.max(x), x1.min(x + 1.0));
    if from >= to {
        return [0.0; 2];
    }
    let at = |x: f64| (y0 * (x1 - x) + y1 * (x - x0)) / (x1 - x0);
    let (a, b) = (at(from), at(to));
    let width = to - from;
    // Where the line changes sides, a triangle on each.
    let part = |a: f64, b: f64| match (a > 0.0, b > 0.0) {
        (true, true) => 0.5 * (a + b) * width,
        (true, false) => 0.5 * a * width * a / (a - b),
        (false, true) => 0.5 * b * width * b / (b - a),
        (false, false) => 0.0,
    };
    [part(-a, -b), part(a, b)]
}

/// Where nothing crosses the end of a diagonal, the line may go on in two ways, and where two edges do as well: the mean.
fn diagonal([start, end]: [usize; 2], [to_start, to_end]: [usize; 2]) -> [f64; 2] {
    let length = (to_start + to_end + 1) as i64;
    let starts = match start {
        end::OPEN => [[0, 0], [1, 0]],
        end::OWN => [[1, 0]; 2],
        end::OTHER => [[1, 1]; 2],
        _ => [[1, 1], [1, 0]],
    };
    let ends = match end {
        end::OPEN => [[0, 0], [1, 0]],
        end::OWN => [[1, 1]; 2],
        end::OTHER => [[1, 0]; 2],
        _ => [[1, 1], [1, 0]],
    }
    .map(|[x, y]| [x + length, y + length]);
    let ways = [0, 1].map(|way| beside_diagonal([starts[way], ends[way]], to_start as i64));
    std::array::from_fn(|side| 0.5 * (ways[0][side] + ways[1][side]))
}

/// Of the pixel that the line leaves at its lower right the share above, and of the one over that the share below.
fn beside_diagonal(line: [[i64; 2]; 2], to_start: i64) -> [f64; 2] {
    let below = |[x, y]: [i64; 2]| share_below(line, [x + to_start, y + to_start]);
    [1.0 - below([1, 0]), below([1, 1])]
}

/// The share of a pixel's samples strictly to the right of a line, found in integers: many lie on it.
fn share_below([[x0, y0], [x1, y1]]: [[i64; 2]; 2], [x, y]: [i64; 2]) -> f64 {
    let n = N_SAMPLES - 1;
    let is_below = |i: i64, j: i64| {
        let from_middle = [2 * (n * x + i) - n * (x0 + x1), 2 * (n * y + j) - n * (y0 + y1)];
        (y1 - y0) * from_middle[0] - (x1 - x0) * from_middle[1] > 0
    };
    let samples = (0..N_SAMPLES).flat_map(|j| (0..N_SAMPLES).map(move |i| (i, j)));
    let n_below = samples.filter(|&(i, j)| is_below(i, j)).count();
    n_below as f64 / (N_SAMPLES * N_SAMPLES) as f64
}

#[cfg(test)]
mod tests {
    use super::{
        end::{BOTH, OPEN, OTHER, OWN},
        *,
    };

    #[test]
    fn areas_computed_by_hand() {
        let area = |ends, distances| AREAS.orthogonal(ends, distances).map(f64::from);
        // A step of one pixel: the line falls from ½ to -½, a triangle of ½ · ½ / 2 on each side.
        assert_eq!(area([OTHER, OWN], [0, 0]), [0.125, 0.125]);
        // Half of a pixel: a triangle with sides ½ and ½.
        assert_eq!(area([OWN, OPEN], [0, 0]), [0.125, 0.0]);
        // Of ten pixels the first: from ½ down to ½ - ½/5 = 0.4.
        let found = orthogonal([OTHER, OPEN], [0.0, 9.0]);
        assert!((found[1] - 0.45).abs() < 1e-12 && found[0] == 0.0, "{found:?}");
        // And the distance 9 is a square, which interpolation keeps.
        assert!((area([OTHER, OPEN], [0, 9])[1] - 0.45).abs() < 1e-5);
        // A short one whose both ends bend down: both triangles of 1/8 are √(1/4)/2 = 1/4 when short, here 31/32 of it.
        let expected = 2.0 * (0.25 * 31.0 / 32.0 + 0.125 / 32.0);
        assert!((area([OWN, OWN], [0, 0])[0] - expected).abs() < 1e-5);
        // A long one is not exaggerated: 9 + 25 + 1 pixels; the tenth from 0.5 (1 - 9/17.5) to 0.5 (1 - 10/17.5).
        let expected = 0.5 * (1.0 - 9.5 / 17.5);
        assert!((area([OWN, OWN], [9, 25])[0] - expected).abs() < 1e-5);
    }

    #[test]
    fn without_crossings_there_is_no_area() {
        for distances in [[0, 0], [3, 40], [63, 64]] {
            for ends in [[OPEN, OPEN], [BOTH, OPEN], [OPEN, BOTH], [BOTH, BOTH]] {
                assert_eq!(AREAS.orthogonal(ends, distances), [0.0; 2], "{ends:?}");
            }
        }
    }

    #[test]
    fn mirrored_lines_have_equal_areas() {
        let mirrored = |end: usize| [OPEN, OTHER, OWN, BOTH][end];
        for (start, end) in (0..4).flat_map(|start| (0..4).map(move |end| (start, end))) {
            for (a, b) in (0..=63).flat_map(|a| (0..=63).map(move |b| (a, b))) {
                let [below, above] = AREAS.orthogonal([start, end], [a, b]);
                assert_eq!(AREAS.orthogonal([end, start], [b, a]), [below, above]);
                let turned = AREAS.orthogonal([mirrored(start), mirrored(end)], [a, b]);
                assert_eq!(turned, [above, below]);
            }
        }
    }

    #[test]
    fn no_pixel_gives_more_than_half_to_a_step_nor_more_than_itself_to_anything() {
        let table = AREAS.table();
        let (orthogonal, diagonal) = table.split_at(N_ORTHOGONAL);
        assert_eq!(diagonal.len(), 16 * 17 * 17);
        assert!(orthogonal.iter().flatten().all(|area| (0.0..=0.5).contains(area)));
        assert!(diagonal.iter().flatten().all(|area| (0.0..=1.0).contains(area)));
    }

    /// A diagonal that may go on either way cuts a half off one of both pixels or off the other. Samples on the line, 30 of 900
    /// or one at a corner, count as above it.
    #[test]
    fn a_diagonal_cuts_a_quarter_off_both_pixels() {
        let [own, other] = AREAS.diagonal([OPEN, OPEN], [5, 5]).map(f64::from);
        assert!((own - 0.5 * 466.0 / 900.0).abs() < 1e-5 && (other - 0.5 * 435.0 / 900.0).abs() < 1e-5);
        // From the corner below to the corner above, the middle pixel of an odd length is cut like that one.
        let [own, other] = AREAS.diagonal([OWN, OWN], [5, 5]).map(f64::from);
        assert!((own - other).abs() < 0.04 && (0.1..0.2).contains(&own), "{own} {other}");
    }

    /// Halfway between squares a sampler gives the mean, which is not the area itself.
    #[test]
    fn between_squares_areas_are_interpolated_along_the_roots() {
        let knot = |d: f64| orthogonal([OTHER, OPEN], [0.0, d])[1];
        let t = 6.0_f64.sqrt() - 2.0;
        let expected = knot(4.0) * (1.0 - t) + knot(9.0) * t;
        let found = f64::from(AREAS.orthogonal([OTHER, OPEN], [0, 6])[1]);
        assert!((found - expected).abs() < 1e-5);
        assert!((found - knot(6.0)).abs() > 1e-4);
    }
}
