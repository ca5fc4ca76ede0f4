// How strong the edge through a pixel is, from lit luma, unlit luma and depth together: a surface's edge shows in one of
// them even where light or texture hides it from the others.
// Oliveros Labrador, Improved Sampling for Temporal Anti-Aliasing, 2018, 4.3. CPU twin: src/taa/reference/sobel2018.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var edges: texture_storage_2d<r32float, write>;

// Lit luma, unlit luma, depth.
fn features(p: vec2i) -> vec3f {
    let c = textureLoad(color, clamped(p), 0);
    return vec3f(luma(c.rgb), c.a, relative_depth(view_depth(p)));
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(invocation: Invocation) {
    for (var row = 0u; row < ROWS; row++) {
        find_edge(pixel_of(invocation, row));
    }
}

fn find_edge(id: vec2u) {
    if (any(id >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id);
    let nw = features(p + vec2i(-1, -1));
    let n = features(p + vec2i(0, -1));
    let ne = features(p + vec2i(1, -1));
    let w = features(p + vec2i(-1, 0));
    let e = features(p + vec2i(1, 0));
    let sw = features(p + vec2i(-1, 1));
    let s = features(p + vec2i(0, 1));
    let se = features(p + vec2i(1, 1));
    let gx = (ne - nw) + 2.0 * (e - w) + (se - sw);
    let gy = (sw - nw) + 2.0 * (s - n) + (se - ne);
    let g = saturate(dot(vec3f(0.7, 0.3, 1.0), sqrt(gx * gx + gy * gy)));
    textureStore(edges, id, vec4f(g * sqrt(3.0 - 2.0 * g)));
}
