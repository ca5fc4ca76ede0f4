// What the least-squares fit of the luma error e by the patterns of ghosting g and blur b needs: gg, bb, gb, ge, be.

const N_TERMS: u32 = 5u;

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var test_shown: texture_2d<f32>;
@group(0) @binding(2) var patterns: texture_2d<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(strip: Strip) {
    sum_strip(strip);
}

fn sample_at(pixel: vec2u) -> Sample {
    let error = luma(textureLoad(test_shown, pixel, 0).rgb - textureLoad(reference_shown, pixel, 0).rgb);
    let pattern = textureLoad(patterns, pixel, 0).xy;
    let products = pattern * error;
    return Sample(
        pattern.x * pattern.x,
        pattern.y * pattern.y,
        pattern.x * pattern.y,
        products.x,
        products.y,
    );
}
