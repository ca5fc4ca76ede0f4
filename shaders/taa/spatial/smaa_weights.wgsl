// SMAA, second pass: follows the line of edges that a pixel is on to both of its ends. What crosses it there tells which line
// was sampled, and so how much the pixels on its two sides cover of each other.
// Jimenez et al., "SMAA: Enhanced Subpixel Morphological Antialiasing", 2012, section 3; the preset ultra.
// CPU twin: src/taa/reference/smaa.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// Across the top edge: the pixel's share that its upper neighbour covers, and what it covers of that; across the left edge
// the same.
@group(0) @binding(10) var next_weights: texture_storage_2d<rgba32float, write>;

// How much of the blending is left at corners.
const CORNER_ROUNDING: f32 = 0.25;

// A row of top edges or a column of left ones.
struct Axis {
    along: vec2i,
    // From the other side to the pixel.
    across: vec2i,
    edge: u32,
    // The edges that end the line.
    crossing: u32,
}

// Whether the line is crossed, on either side, where it enters `q` from the pixel before.
fn is_crossed(q: vec2i, axis: Axis) -> bool {
    return ((edges_at(q) | edges_at(q - axis.across)) & axis.crossing) != 0u;
}

fn distance_to_start(p: vec2i, axis: Axis) -> i32 {
    for (var i = 0; i < MAX_TO_START; i++) {
        let q = p - i * axis.along;
        if (is_crossed(q, axis) || !has(q - axis.along, axis.edge)) {
            return i;
        }
    }
    return MAX_TO_START;
}

fn distance_to_end(p: vec2i, axis: Axis) -> i32 {
    for (var i = 0; i < MAX_TO_END; i++) {
        let q = p + (i + 1) * axis.along;
        if (is_crossed(q, axis) || !has(q, axis.edge)) {
            return i;
        }
    }
    return MAX_TO_END;
}

fn ends_at(q: vec2i, axis: Axis) -> i32 {
    return ends(has(q, axis.crossing), has(q - axis.across, axis.crossing));
}

fn line_weights(p: vec2i, axis: Axis) -> vec2f {
    let to_start = distance_to_start(p, axis);
    let to_end = distance_to_end(p, axis);
    // Where the line starts, and where it has ended.
    let first = p - to_start * axis.along;
    let beyond = p + (to_end + 1) * axis.along;
    let area = orthogonal_area(ends_at(first, axis), ends_at(beyond, axis), to_start, to_end);
    // A corner: an edge that crosses the nearer end goes on for a second pixel. In a line's middle both ends are near.
    let near = vec2<bool>(to_start <= to_end, to_start >= to_end);
    let share = (1.0 - CORNER_ROUNDING) * select(1.0, 0.5, all(near));
    let own = vec2<bool>(has(first + axis.across, axis.crossing), has(beyond + axis.across, axis.crossing));
    let other = vec2<bool>(has(first - 2 * axis.across, axis.crossing), has(beyond - 2 * axis.across, axis.crossing));
    let n_corners = vec2f(count(near & own), count(near & other));
    return area * saturate(1.0 - share * n_corners);
}

fn count(b: vec2<bool>) -> f32 {
    return select(0.0, 1.0, b.x) + select(0.0, 1.0, b.y);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    var has_left = has(p, EDGE_LEFT);
    var weights = vec4f(0.0);
    if (has(p, EDGE_TOP)) {
        let diagonal = rising(p) + falling(p);
        // Diagonals go first: a pixel on one has no other lines.
        if (any(diagonal > vec2f(0.0))) {
            weights = vec4f(diagonal, 0.0, 0.0);
            has_left = false;
        } else {
            let row = Axis(vec2i(1, 0), vec2i(0, 1), EDGE_TOP, EDGE_LEFT);
            weights = vec4f(line_weights(p, row), 0.0, 0.0);
        }
    }
    if (has_left) {
        let column = Axis(vec2i(0, 1), vec2i(1, 0), EDGE_LEFT, EDGE_TOP);
        weights = vec4f(weights.xy, line_weights(p, column));
    }
    textureStore(next_weights, id.xy, weights);
}
