// Lightness and two chromas of what a display shows.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var shown: texture_2d<f32>;
@group(0) @binding(1) var opponent: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(opponent))) {
        return;
    }
    let encoded = textureLoad(shown, id.xy, 0);
    let light = vec3f(decode(encoded.r), decode(encoded.g), decode(encoded.b));
    textureStore(opponent, id.xy, vec4f(ycxcz(light), 0.0));
}

// Linear light of an sRGB-encoded value.
fn decode(encoded: f32) -> f32 {
    let base = (encoded + 0.055) / 1.055;
    return select(base * base * power(base, 0.4), encoded / 12.92, encoded <= 0.04045);
}
