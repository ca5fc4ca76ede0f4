// Display values of a linear image: the f32 twin of src/metrics/display.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
override exposure: f32;
override tonemap: u32;

@group(0) @binding(0) var linear: texture_2d<f32>;
// Alpha is 1 where the colour is not finite, else 0.
@group(0) @binding(1) var shown: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(shown))) {
        return;
    }
    let color = textureLoad(linear, id.xy, 0).rgb;
    let bits = bitcast<vec3u>(color) & vec3u(0x7fffffffu);
    let is_bad = any(bits >= vec3u(0x7f800000u));
    let encoded = to_display(color, Display(exposure, tonemap));
    textureStore(shown, id.xy, vec4f(encoded, f32(is_bad)));
}
