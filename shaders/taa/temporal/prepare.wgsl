// Once a frame and domain, shared by every recipe that works in it: repairs hostile texels, counts them, and maps colour
// into the working domain, so that the 3×3 reads of the resolve need neither.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
override domain: u32;

@group(0) @binding(0) var input_color: texture_2d<f32>;
@group(0) @binding(1) var color: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var<storage, read_write> repaired_texels: atomic<u32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let raw = textureLoad(input_color, id.xy, 0).rgb;
    if (is_hostile(raw.r) || is_hostile(raw.g) || is_hostile(raw.b)) {
        atomicAdd(&repaired_texels, 1u);
    }
    let repaired = vec3f(repair(raw.r), repair(raw.g), repair(raw.b));
    textureStore(color, id.xy, vec4f(to_domain(repaired, domain), 1.0));
}
