// The edge image through a temporal resolve of its own, in one channel: jittered edges would make the box flicker. Rounded
// box, clamp, luma feedback, as the colour's resolve but without its tone map and output stage.
// CPU twin: src/taa/reference/sobel2018.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var edges: texture_2d<f32>;
@group(0) @binding(11) var edge_history: texture_2d<f32>;
@group(0) @binding(12) var next_edge_history: texture_storage_2d<r32float, write>;
// What the resolve uses: as the history, but not rounded.
@group(0) @binding(13) var stabilised: texture_storage_2d<r32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(invocation: Invocation) {
    for (var row = 0u; row < ROWS; row++) {
        stabilise(pixel_of(invocation, row));
    }
}

fn stabilise(id: vec2u) {
    if (any(id >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id);
    var stable = sample_bilinear(edges, vec2f(p) + 0.5 - frame.jitter_px).r;
    let at = reprojected(p);
    if (at.has_history) {
        let bounds = rounded_range(p);
        let h = clamp(sample_bilinear(edge_history, at.q).r, bounds.x, bounds.y);
        stable = mix(h, stable, luma_feedback(stable, h));
    }
    textureStore(next_edge_history, id, vec4f(round_history(vec3f(stable)), 0.0));
    textureStore(stabilised, id, vec4f(stable));
}

// The average of the ranges of the cross and of the 3×3.
fn rounded_range(p: vec2i) -> vec2f {
    var cross = vec2f(fetch(edges, p).r);
    for (var i = 1; i < 9; i += 2) {
        let e = fetch(edges, p + vec2i(i % 3, i / 3) - 1).r;
        cross = vec2f(min(cross.x, e), max(cross.y, e));
    }
    var square = cross;
    for (var i = 0; i < 9; i += 2) {
        let e = fetch(edges, p + vec2i(i % 3, i / 3) - 1).r;
        square = vec2f(min(square.x, e), max(square.y, e));
    }
    return 0.5 * (cross + square);
}
