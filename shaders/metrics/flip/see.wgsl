// FLIP's filters along columns, and what the eye then sees: colour in Hunt-adjusted CIELAB, strength of edges and points.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
// Shares of the wide and the narrow Gaussian of blue–yellow.
override wide_share: f32;
override narrow_share: f32;

@group(0) @binding(0) var color_rows: texture_2d<f32>;
@group(0) @binding(1) var feature_rows: texture_2d<f32>;
// Alpha is the strength of edges.
@group(0) @binding(2) var seen: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var seen_points: texture_storage_2d<r32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(seen))) {
        return;
    }
    let texel = vec2i(id.xy);
    var color = taps[0].color * texel_at(color_rows, texel);
    // Edges and points that lie along columns, then along rows: each derivative times the Gaussian across it.
    let centre = texel_at(feature_rows, texel);
    var feature = taps[0].feature.xyxz * centre.yxzx;
    for (var k = 1; k < i32(arrayLength(&taps)); k++) {
        let above = texel - vec2i(0, k);
        let below = texel + vec2i(0, k);
        color += taps[k].color * (texel_at(color_rows, below) + texel_at(color_rows, above));
        let signed = vec4f(1.0, -1.0, 1.0, 1.0) * texel_at(feature_rows, above).yxzx;
        feature += taps[k].feature.xyxz * (texel_at(feature_rows, below).yxzx + signed);
    }
    let lab = hunt_lab(vec3f(color.xy, wide_share * color.z + narrow_share * color.w));
    // Of Y from −16 to 100; features are defined for 0 to 1.
    let edge = length(feature.xy) / 116.0;
    let point = length(feature.zw) / 116.0;
    textureStore(seen, id.xy, vec4f(lab, edge));
    textureStore(seen_points, id.xy, vec4f(point, 0.0, 0.0, 0.0));
}
