// Once a frame for all recipes that read it alike: repairs hostile texels, counts them, and maps colour into the working
// domain, so that the 3×3 reads of the resolve need neither.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
override domain: u32;
// Store the luma of the unlit colour in alpha.
override with_albedo: bool;
override guards: bool;

@group(0) @binding(0) var input_color: texture_2d<f32>;
@group(0) @binding(1) var color: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var<storage, read_write> repaired_texels: atomic<u32>;
@group(0) @binding(3) var input_albedo: texture_2d<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(invocation: Invocation) {
    for (var row = 0u; row < ROWS; row++) {
        prepare(pixel_of(invocation, row));
    }
}

fn prepare(id: vec2u) {
    if (any(id >= textureDimensions(color))) {
        return;
    }
    // Alpha is 0 where one of several samples was repaired when they were merged.
    let raw = textureLoad(input_color, id, 0);
    let prepared = to_domain(select(raw.rgb, repaired(raw.rgb), guards), domain);
    var unlit_luma = luma(prepared);
    var hostile = any_hostile(raw.rgb) || raw.a == 0.0;
    if (with_albedo) {
        let albedo = textureLoad(input_albedo, id, 0).rgb;
        unlit_luma = luma(select(albedo, repaired(albedo), guards));
        hostile = hostile || any_hostile(albedo);
    }
    if (hostile) {
        atomicAdd(&repaired_texels, 1u);
    }
    textureStore(color, id, vec4f(prepared, unlit_luma));
}
