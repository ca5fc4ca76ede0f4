// Means over 7 texels of a row, the first half of a separable 7×7 mean; the resolve takes the other.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var difference: texture_2d<f32>;
@group(0) @binding(11) var rows: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(difference))) {
        return;
    }
    var sum = vec3f(0.0);
    for (var x = -3; x <= 3; x++) {
        sum += fetch(difference, vec2i(id.xy) + vec2i(x, 0));
    }
    textureStore(rows, id.xy, vec4f(sum / 7.0, 0.0));
}
