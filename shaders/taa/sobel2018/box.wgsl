// A box as wide as the pixel is aliased: where nothing is, it shrinks onto the current colour and ghosts with it.
// Oliveros Labrador, Improved Sampling for Temporal Anti-Aliasing, 2018, 4.2 to 4.4. From 30 on are bindings of its own.
// CPU twin: src/taa/reference/sobel2018.rs.

@group(0) @binding(30) var stable_edges: texture_2d<f32>;

// View depth as a share of the far plane's distance, 0 to 1.
fn relative_depth(z: f32) -> f32 {
    return min(z / frame.far, 1.0);
}

// 0 to 1, from edges, other objects and depths that stand out among their neighbours or over time.
fn aliased(p: vec2i, at: Reprojection) -> f32 {
    let centre_id = object_id_at(p);
    var nearest = 1.0;
    var farthest = 0.0;
    var depth_sum = 0.0;
    var n_other = 0.0;
    var cross = 0.0;
    var square = 0.0;
    for (var i = 0; i < 9; i++) {
        let o = p + vec2i(i % 3, i / 3) - 1;
        let d = relative_depth(view_depth(o));
        nearest = min(nearest, d);
        farthest = max(farthest, d);
        depth_sum += d;
        n_other += select(0.0, 1.0, object_id_at(o) != centre_id);
        let edge = fetch(stable_edges, o).r;
        square += edge;
        cross += select(0.0, edge, i % 2 == 1 || i == 4);
    }
    let other = n_other / 9.0;
    let edge = mix(cross / 5.0, square / 9.0, saturate(other + fetch(stable_edges, p).r));
    return saturate(edge + depth_deviation(p, at, nearest, farthest, depth_sum / 9.0) + other);
}

// By how far the depth, now and before, leaves its neighbours' range: squared in space, to the fourth power in time.
fn depth_deviation(p: vec2i, at: Reprojection, nearest: f32, farthest: f32, mean: f32) -> f32 {
    let range = min(mean - nearest, farthest - mean);
    if (range < 0.002) {
        return 0.0;
    }
    let now = (relative_depth(view_depth(p)) - mean) / range;
    var before = 0.0;
    if (at.has_history) {
        before = (relative_depth(previous_view_depth(vec2i(floor(at.q)))) - mean) / range;
    }
    let before2 = before * before;
    return now * now + before2 * before2;
}

fn sobel_box(p: vec2i, current: vec3f, at: Reprojection) -> ColorBox {
    let a = cross_box(p);
    let b = box3(p);
    let t = aliased(p, at);
    let c = to_space(current);
    return ColorBox(
        mix(c, mix(a.lo, b.lo, t), t),
        mix(c, mix(a.hi, b.hi, t), t),
        mix(a.mean, b.mean, t),
    );
}
