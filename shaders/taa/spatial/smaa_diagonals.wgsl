// SMAA's diagonals: stairs of one pixel a step. In a rising one every pixel of the line has edges at its left and top, in a
// falling one at its right and top. Jimenez et al. 2012, 3.2. CPU twin: src/taa/reference/smaa.rs.

struct Walk {
    // How many pixels have both of the edges.
    distance: i32,
    // The edges of the pixel that ended the walk: at the side, at the top.
    last: vec2<bool>,
}

// Where the walk did not come to an end, nothing is known of that.
fn end_unless_lost(walk: Walk, end: i32) -> i32 {
    return select(end, 0, all(walk.last));
}

// `side` is where the vertical edge is: 0 at the pixel's left, 1 at its right.
fn walk_diagonal(p: vec2i, step: vec2i, side: i32) -> Walk {
    var walk = Walk();
    for (var i = 1; i <= MAX_DIAGONAL; i++) {
        let q = p + i * step;
        walk = Walk(i - 1, vec2<bool>(has(q + vec2i(side, 0), EDGE_LEFT), has(q, EDGE_TOP)));
        if (!all(walk.last)) {
            break;
        }
    }
    return walk;
}

// A line's first or last pixel, which has a top edge only, is beyond those that have both.
fn with_last(walk: Walk) -> Walk {
    return Walk(walk.distance + select(0, 1, walk.last.y), walk.last);
}

// From the lower left to the upper right.
fn rising(p: vec2i) -> vec2f {
    var start = Walk();
    if (has(p, EDGE_LEFT)) {
        start = with_last(walk_diagonal(p, vec2i(-1, 1), 0));
    }
    let end = walk_diagonal(p, vec2i(1, -1), 0);
    let a = start.distance;
    let b = end.distance;
    if (a + b <= 2) {
        return vec2f(0.0);
    }
    let first = ends(has(p + vec2i(-a, a), EDGE_LEFT), has(p + vec2i(-a - 1, a), EDGE_TOP));
    let last = ends(has(p + vec2i(b + 1, -b - 1), EDGE_LEFT), has(p + vec2i(b + 1, -b), EDGE_TOP));
    return diagonal_area(end_unless_lost(start, first), end_unless_lost(end, last), a, b);
}

// From the upper left to the lower right.
fn falling(p: vec2i) -> vec2f {
    let start = walk_diagonal(p, vec2i(-1, -1), 1);
    var end = Walk();
    if (has(p + vec2i(1, 0), EDGE_LEFT)) {
        end = with_last(walk_diagonal(p, vec2i(1, 1), 1));
    }
    let a = start.distance;
    let b = end.distance;
    if (a + b <= 2) {
        return vec2f(0.0);
    }
    let first = ends(has(p + vec2i(-a, -a - 1), EDGE_LEFT), has(p + vec2i(-a - 1, -a), EDGE_TOP));
    let last = ends(has(p + vec2i(b + 1, b), EDGE_LEFT), has(p + vec2i(b + 1, b), EDGE_TOP));
    // The table has rising lines, of which this is one turned over.
    return diagonal_area(end_unless_lost(start, first), end_unless_lost(end, last), a, b).yx;
}
