// Adds up to four renders to the sums that become a reference: a sum is read and written once for all of them. In f32: N sums
// of f16 values would stall after 2048 of them.

override WORKGROUP_X: u32;
override WORKGROUP_Y: u32;
// Also the sum after Karis's c / (1 + luma), which tames bright samples.
override TONEMAPPED: bool;

struct Parameters {
    // 1 to 4.
    n_renders: u32,
}

@group(0) @binding(0) var render_0: texture_2d<f32>;
@group(0) @binding(1) var render_1: texture_2d<f32>;
@group(0) @binding(2) var render_2: texture_2d<f32>;
@group(0) @binding(3) var render_3: texture_2d<f32>;
@group(0) @binding(4) var<storage, read_write> sum: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> tonemapped_sum: array<vec4f>;
@group(0) @binding(6) var<uniform> parameters: Parameters;

fn tonemapped(c: vec3f) -> vec4f {
    return vec4f(c / (1.0 + dot(c, vec3f(0.2126, 0.7152, 0.0722))), 1.0);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(render_0);
    if any(id.xy >= size) {
        return;
    }
    let i = id.y * size.x + id.x;
    var total = sum[i];
    var tonemapped_total = vec4f(0.0);
    if TONEMAPPED {
        tonemapped_total = tonemapped_sum[i];
    }
    // Written out: on lavapipe an array with an index that it does not know costs more than the sums.
    let a = textureLoad(render_0, id.xy, 0).rgb;
    total += vec4f(a, 1.0);
    tonemapped_total += tonemapped(a);
    if parameters.n_renders > 1u {
        let b = textureLoad(render_1, id.xy, 0).rgb;
        total += vec4f(b, 1.0);
        tonemapped_total += tonemapped(b);
    }
    if parameters.n_renders > 2u {
        let c = textureLoad(render_2, id.xy, 0).rgb;
        total += vec4f(c, 1.0);
        tonemapped_total += tonemapped(c);
    }
    if parameters.n_renders > 3u {
        let d = textureLoad(render_3, id.xy, 0).rgb;
        total += vec4f(d, 1.0);
        tonemapped_total += tonemapped(d);
    }
    sum[i] = total;
    if TONEMAPPED {
        tonemapped_sum[i] = tonemapped_total;
    }
}
