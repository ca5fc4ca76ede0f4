// The class of each pixel, for passes that keep their sums by class: see src/metrics/mask.rs. Stands in for unclassed.wgsl.

const N_CLASSES: u32 = 4u;

@group(0) @binding(9) var classes: texture_2d<u32>;

fn class_of(pixel: vec2u) -> u32 {
    return textureLoad(classes, pixel, 0).r;
}

fn share_of(pixel: vec2u, kind: u32) -> f32 {
    return f32(class_of(pixel) == kind);
}
