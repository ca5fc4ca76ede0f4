// How much a reference changes along its motion, for every preset that is compared with it.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var motion: texture_2d<f32>;
@group(0) @binding(1) var reference_shown: texture_2d<f32>;
@group(0) @binding(2) var previous_shown: texture_2d<f32>;
@group(0) @binding(3) var change: texture_storage_2d<r32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(change))) {
        return;
    }
    let motion_px = textureLoad(motion, id.xy, 0).xy;
    textureStore(change, id.xy, vec4f(change_along(motion_px, id.xy, reference_shown, previous_shown), 0.0, 0.0, 0.0));
}
