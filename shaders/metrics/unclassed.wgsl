// Where no metric asks for a mask: all pixels are of one class. Stands in for classes.wgsl.

const N_CLASSES: u32 = 1u;

fn class_of(pixel: vec2u) -> u32 {
    return 0u;
}

fn share_of(pixel: vec2u, kind: u32) -> f32 {
    return 1.0;
}
