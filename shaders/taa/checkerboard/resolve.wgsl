// Checkerboard rendering: each frame shades two opposing pixels of every 2×2, the next frame the other two. What was shaded
// stays as it is; the rest is history rectified by the shaded neighbours, or where there is none, interpolated from them.
// Yang, Liu and Salvi, "A Survey of Temporal Antialiasing Techniques", 2020, 5.3. CPU twin: src/taa/reference/checkerboard.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var next_history: HistoryStore;
// Linear RGB.
@group(0) @binding(11) var shown: texture_storage_2d<rgba32float, write>;

const N_SIDES: i32 = 4;

// The neighbours of a pixel across its edges, which are those of the other parity, row by row.
fn side(i: i32) -> vec2i {
    switch (i) {
        case 0: { return vec2i(0, -1); }
        case 1: { return vec2i(-1, 0); }
        case 2: { return vec2i(1, 0); }
        default: { return vec2i(0, 1); }
    }
}

fn is_shaded(p: vec2i) -> bool {
    return (u32(p.x + p.y) & 1u) == frame.parity;
}

// Beyond the image's edge the nearest texel is the pixel itself, which was not shaded.
fn is_inside(p: vec2i) -> bool {
    return all(p >= vec2i(0)) && all(p < vec2i(textureDimensions(color)));
}

// Dilated over the sides; invalid where none of them is inside.
fn motion_of_sides(p: vec2i) -> Motion {
    var best = Motion();
    var best_score = -3.0e38;
    for (var i = 0; i < N_SIDES; i++) {
        let texel = p + side(i);
        if (!is_inside(texel)) {
            continue;
        }
        let m = motion_at(texel);
        var score = m.length2;
        if (dilation == DILATION_CLOSEST) {
            score = -view_depth(texel);
        }
        if (score > best_score) {
            best = m;
            best_score = score;
        }
    }
    return best;
}

// How much opposite sides count: the more, the more they are alike, for an edge runs along them and not between. A pair cut
// by the image's edge counts as one that differs as much as tone-mapped colours can.
fn pair_weight(a: vec2i, b: vec2i) -> f32 {
    var difference = 1.0;
    if (is_inside(a) && is_inside(b)) {
        difference = abs(luma(fetch(color, a)) - luma(fetch(color, b)));
    }
    return 1.0 / (difference + 1e-3);
}

struct Sides {
    // In the recipe's space.
    bounds: ColorBox,
    // RGB; black where no side is inside.
    interpolated: vec3f,
}

fn sides_of(p: vec2i) -> Sides {
    let horizontal = pair_weight(p + side(1), p + side(2));
    let vertical = pair_weight(p + side(0), p + side(3));
    var bounds = empty_box();
    var n = 0.0;
    var sum = vec3f(0.0);
    var weights = 0.0;
    for (var i = 0; i < N_SIDES; i++) {
        let texel = p + side(i);
        if (is_inside(texel)) {
            let c = fetch(color, texel);
            let w = select(vertical, horizontal, i == 1 || i == 2);
            bounds = extend(bounds, to_space(c));
            n += 1.0;
            sum += w * c;
            weights += w;
        }
    }
    bounds.mean /= max(n, 1.0);
    return Sides(bounds, select(vec3f(0.0), sum / weights, n > 0.0));
}

fn filled(p: vec2i) -> vec3f {
    let s = sides_of(p);
    let at = reprojected_by(p, motion_of_sides(p));
    if (!at.has_history) {
        return s.interpolated;
    }
    let h = to_space(filtered_history(at.q));
    return from_space(rectified(rectify, h, to_space(s.interpolated), s.bounds, domain, guards));
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    var resolved: vec3f;
    if (is_shaded(p)) {
        resolved = fetch(color, p);
    } else {
        resolved = filled(p);
    }
    resolved = saturated(resolved);
    textureStore(next_history, id.xy, vec4f(round_history(resolved), 1.0));
    textureStore(shown, id.xy, vec4f(from_domain(resolved, domain), 1.0));
}
