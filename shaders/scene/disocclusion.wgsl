// Whether the frame before saw the surface that a pixel shows now: 0 seen, 1 hidden or outside, 0.5 at an edge.

override WORKGROUP_X: u32;
override WORKGROUP_Y: u32;

struct Parameters {
    jitter_px: vec2f,
    near: f32,
}

@group(0) @binding(0) var geometry: texture_2d<f32>;
// In its alpha: the view depth that the surface had.
@group(0) @binding(1) var albedo: texture_2d<f32>;
@group(0) @binding(2) var previous_depth: texture_depth_2d;
@group(0) @binding(3) var mask: texture_storage_2d<r32float, write>;
@group(0) @binding(4) var<uniform> parameters: Parameters;

// Relative; what interpolation of f32 depths may be wrong by on curved and steep surfaces.
const TOLERANCE = 2e-3;

fn disoccluded(px: vec2u) -> f32 {
    let size = vec2f(textureDimensions(geometry));
    let finer = vec2i(textureDimensions(previous_depth));
    let q = vec2f(px) + 0.5 + parameters.jitter_px + textureLoad(geometry, px, 0).xy;
    if !all(q >= vec2f(0.0)) || !all(q <= size) {
        return 1.0;
    }
    // What the depth buffer held there: linear in the image along every plane, so that interpolation is exact.
    let expected = parameters.near / textureLoad(albedo, px, 0).a;
    let at = q * vec2f(finer) / size - 0.5;
    let corner = vec2i(floor(at));
    let f = at - floor(at);
    var d: array<f32, 4>;
    for (var i = 0; i < 4; i++) {
        let texel = clamp(corner + vec2i(i & 1, i >> 1u), vec2i(0), finer - 1);
        d[i] = textureLoad(previous_depth, texel, 0);
    }
    let nearest = max(max(d[0], d[1]), max(d[2], d[3]));
    let farthest = min(min(d[0], d[1]), min(d[2], d[3]));
    let interpolated = mix(mix(d[0], d[1], f.x), mix(d[2], d[3], f.x), f.y);
    if abs(interpolated - expected) <= TOLERANCE * expected || nearest <= 1e-9 && expected <= 1e-9 {
        return 0.0;
    }
    return select(0.5, 1.0, farthest > expected * (1.0 + TOLERANCE) + 1e-9);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if all(id.xy < textureDimensions(geometry)) {
        textureStore(mask, id.xy, vec4f(disoccluded(id.xy)));
    }
}
