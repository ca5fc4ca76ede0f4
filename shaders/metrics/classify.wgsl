// The class of each pixel: see src/metrics/mask.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
// What a class is the sum of.
override moving: u32;
override disoccluded: u32;
// Motion in pixels from which on a pixel moves.
override moves_from_px: f32;

@group(0) @binding(0) var motion: texture_2d<f32>;
@group(0) @binding(1) var reference_shown: texture_2d<f32>;
@group(0) @binding(2) var previous_shown: texture_2d<f32>;
@group(0) @binding(3) var classified: texture_storage_2d<r32uint, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(classified))) {
        return;
    }
    let motion_px = textureLoad(motion, id.xy, 0).xy;
    // Compared as bits, which order like positive floats: a vector that is not finite moves.
    let stands = bitcast<u32>(dot(motion_px, motion_px)) < bitcast<u32>(moves_from_px * moves_from_px);
    let is_lost = change_along(motion_px, id.xy, reference_shown, previous_shown) == DISOCCLUDED_CHANGE;
    textureStore(classified, id.xy, vec4u(select(moving, 0u, stands) + select(0u, disoccluded, is_lost)));
}
