// Means of 2×2 pixels. A side of odd length is first given a zero in front: see `halved` in src/metrics/ms_ssim.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var finer: texture_2d<f32>;
@group(0) @binding(1) var coarser: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(coarser))) {
        return;
    }
    let n_zeros = vec2i(textureDimensions(finer) % 2u);
    let first = 2 * vec2i(id.xy) - n_zeros;
    var sum = vec4f(0.0);
    for (var dy = 0; dy < 2; dy++) {
        for (var dx = 0; dx < 2; dx++) {
            let texel = first + vec2i(dx, dy);
            if (all(texel >= vec2i(0))) {
                sum += textureLoad(finer, texel, 0);
            }
        }
    }
    textureStore(coarser, id.xy, 0.25 * sum);
}
