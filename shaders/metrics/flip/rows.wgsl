// FLIP's filters along rows.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var opponent: texture_2d<f32>;
@group(0) @binding(1) var color_rows: texture_storage_2d<rgba32float, write>;
// Of lightness: the Gaussian and its derivatives.
@group(0) @binding(2) var feature_rows: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color_rows))) {
        return;
    }
    let texel = vec2i(id.xy);
    let centre = texel_at(opponent, texel);
    var color = taps[0].color * centre.xyzz;
    var feature = taps[0].feature * centre.xxxx;
    for (var k = 1; k < i32(arrayLength(&taps)); k++) {
        let before = texel_at(opponent, texel - vec2i(k, 0));
        let after = texel_at(opponent, texel + vec2i(k, 0));
        color += taps[k].color * (after + before).xyzz;
        feature += taps[k].feature * (after.xxxx + vec4f(1.0, -1.0, 1.0, 1.0) * before.x);
    }
    textureStore(color_rows, id.xy, color);
    textureStore(feature_rows, id.xy, feature);
}
