// Adds one render to the sums that become a reference. In f32: N sums of f16 values would stall after 2048 of them.

override WORKGROUP_X: u32;
override WORKGROUP_Y: u32;
// Texels of the render for one of the sums, along each axis.
override FINENESS: u32;
// Also the sum after Karis's c / (1 + luma), which tames bright samples.
override TONEMAPPED: bool;

@group(0) @binding(0) var render: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> sum: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> tonemapped_sum: array<vec4f>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(render) / FINENESS;
    if any(id.xy >= size) {
        return;
    }
    var added = vec4f(0.0);
    var added_tonemapped = vec4f(0.0);
    for (var y = 0u; y < FINENESS; y++) {
        for (var x = 0u; x < FINENESS; x++) {
            let c = textureLoad(render, id.xy * FINENESS + vec2u(x, y), 0).rgb;
            added += vec4f(c, 1.0);
            added_tonemapped += vec4f(c / (1.0 + dot(c, vec3f(0.2126, 0.7152, 0.0722))), 1.0);
        }
    }
    let i = id.y * size.x + id.x;
    sum[i] += added;
    if TONEMAPPED {
        tonemapped_sum[i] += added_tonemapped;
    }
}
