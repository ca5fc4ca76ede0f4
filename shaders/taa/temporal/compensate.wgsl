// History plus half of what bilinear sampling forth and back loses of it: sampled bilinearly once more, the errors cancel.
// Back and forth error compensation and correction (Dupont and Liu 2003), as the survey of Yang et al. 2020 has it in 6.1.1.
// CPU twin: src/taa/reference/sampling.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var advected: texture_2d<f32>;
@group(0) @binding(11) var next_compensated: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(next_compensated))) {
        return;
    }
    let p = vec2i(id.xy);
    let h = fetch(history, p);
    let back = sample_bilinear(advected, vec2f(p) + 0.5 - usable_motion(p));
    textureStore(next_compensated, id.xy, vec4f(h + 0.5 * (h - back), 1.0));
}
