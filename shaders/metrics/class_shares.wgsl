// What share of a pixel is of each class, before the frame is halved: one of them is 1.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(0) var class_shares: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(class_shares))) {
        return;
    }
    textureStore(class_shares, id.xy, vec4f(vec4u(class_of(id.xy)) == vec4u(0u, 1u, 2u, 3u)));
}
