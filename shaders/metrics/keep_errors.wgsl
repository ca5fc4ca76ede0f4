// Keeps an image's errors for the next frame: test minus reference, display RGB.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var test_shown: texture_2d<f32>;
@group(0) @binding(2) var errors: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(errors))) {
        return;
    }
    textureStore(errors, id.xy, textureLoad(test_shown, id.xy, 0) - textureLoad(reference_shown, id.xy, 0));
}
