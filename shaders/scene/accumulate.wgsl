// Adds one render to the sums that become a reference. In f32: N sums of f16 values would stall after 2048 of them.

override WORKGROUP_X: u32;
override WORKGROUP_Y: u32;
// Also the sum after Karis's c / (1 + luma), which tames bright samples.
override TONEMAPPED: bool;

@group(0) @binding(0) var render: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> sum: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> tonemapped_sum: array<vec4f>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(render);
    if any(id.xy >= size) {
        return;
    }
    let c = textureLoad(render, id.xy, 0).rgb;
    let i = id.y * size.x + id.x;
    sum[i] += vec4f(c, 1.0);
    if TONEMAPPED {
        tonemapped_sum[i] += vec4f(c / (1.0 + dot(c, vec3f(0.2126, 0.7152, 0.0722))), 1.0);
    }
}
