// What spatial filters decide by and what they mix. CPU twin: src/taa/reference/spatial.rs.

// In steps of 2⁻¹⁶ sums and differences of lumas are exact, so that equal contrasts, which every flat edge and every
// diagonal has, compare equal on every adapter.
const LUMA_STEPS: f32 = 0x1p16;

fn edge_luma(p: vec2i) -> f32 {
    return floor(LUMA_STEPS * luma(fetch(color, p)) + 0.5) / LUMA_STEPS;
}

// Eyes see edges in display values, but what a pixel covers adds up in light. Samplers of sRGB textures decode likewise.
fn decoded(c: vec3f) -> vec3f {
    if (spatial_decodes && domain == DOMAIN_DISPLAY) {
        return srgb_decode(c);
    }
    return c;
}

fn encoded(c: vec3f) -> vec3f {
    if (spatial_decodes && domain == DOMAIN_DISPLAY) {
        return srgb_encode(c);
    }
    return c;
}
