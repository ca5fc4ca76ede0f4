// History carried along the motion onto this frame's grid, so that it can be carried back and compared with itself.
// CPU twin: src/taa/reference/sampling.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var advected: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(advected))) {
        return;
    }
    let p = vec2i(id.xy);
    textureStore(advected, id.xy, vec4f(sample_bilinear(history, vec2f(p) + 0.5 + usable_motion(p)), 1.0));
}
