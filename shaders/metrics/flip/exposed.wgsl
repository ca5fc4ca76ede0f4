// Lightness and two chromas of a linear image at one of HDR-FLIP's exposures.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

struct Exposure {
    factor: f32,
}

@group(0) @binding(0) var linear: texture_2d<f32>;
@group(0) @binding(1) var opponent: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var<uniform> exposure: Exposure;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(opponent))) {
        return;
    }
    let light = aces(exposure.factor * textureLoad(linear, id.xy, 0).rgb);
    textureStore(opponent, id.xy, vec4f(ycxcz(light), 0.0));
}

// As FLIP uses it, which lets 0.6 of the exposure through. The upper bound keeps squares finite.
fn aces(exposed: vec3f) -> vec3f {
    let c = 0.6 * clamp(exposed, vec3f(0.0), vec3f(1e9));
    return min(c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14), vec3f(1.0));
}
