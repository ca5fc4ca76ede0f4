// Moves an image and does nothing else: what no resolve can be faster than.

override WORKGROUP_X: u32;
override WORKGROUP_Y: u32;

@group(0) @binding(0) var source: texture_2d<f32>;
@group(0) @binding(1) var destination: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if all(id.xy < textureDimensions(destination)) {
        textureStore(destination, id.xy, textureLoad(source, id.xy, 0));
    }
}
