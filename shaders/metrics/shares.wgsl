// What share of a pixel of a halved frame is of each class. Stands in for classes.wgsl.

const N_CLASSES: u32 = 4u;

@group(0) @binding(9) var shares: texture_2d<f32>;

fn share_of(pixel: vec2u, kind: u32) -> f32 {
    return textureLoad(shares, pixel, 0)[kind];
}
