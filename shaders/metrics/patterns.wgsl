// The errors of luma that a ghost of the previous frame and a blur, the mean of 3×3 pixels, would make of a reference. The
// image's edge goes on beyond it.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var previous_shown: texture_2d<f32>;
@group(0) @binding(2) var patterns: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let extent = textureDimensions(patterns);
    if (any(id.xy >= extent)) {
        return;
    }
    let here = textureLoad(reference_shown, id.xy, 0).rgb;
    // Of differences: a sum of nine values would lose their last digits.
    var around = vec3f(0.0);
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let texel = clamp(vec2i(id.xy) + vec2i(dx, dy), vec2i(0), vec2i(extent) - 1);
            around += textureLoad(reference_shown, texel, 0).rgb - here;
        }
    }
    let ghost = luma(textureLoad(previous_shown, id.xy, 0).rgb - here);
    textureStore(patterns, id.xy, vec4f(ghost, luma(around) / 9.0, 0.0, 0.0));
}
