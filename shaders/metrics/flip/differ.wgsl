// FLIP of each pixel, where it is larger than what the map holds: HDR-FLIP is the largest over exposures.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var reference_seen: texture_2d<f32>;
@group(0) @binding(1) var reference_points: texture_2d<f32>;
@group(0) @binding(2) var test_seen: texture_2d<f32>;
@group(0) @binding(3) var test_points: texture_2d<f32>;
// Row by row.
@group(0) @binding(4) var<storage, read_write> map: array<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let extent = textureDimensions(test_seen);
    if (any(id.xy >= extent)) {
        return;
    }
    let reference = textureLoad(reference_seen, id.xy, 0);
    let test = textureLoad(test_seen, id.xy, 0);
    let edge = abs(reference.a - test.a);
    let point = abs(textureLoad(reference_points, id.xy, 0).r - textureLoad(test_points, id.xy, 0).r);
    let feature = sqrt(max(edge, point) * inverseSqrt(2.0));
    let i = id.y * extent.x + id.x;
    map[i] = max(map[i], power(difference(reference.rgb, test.rgb), 1.0 - feature));
}
