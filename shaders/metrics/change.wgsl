// How the errors of an image differ from those of the frame before, pixel by pixel: squared and summed over display RGB,
// and of luma.

const N_TERMS: u32 = 2u;

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var test_shown: texture_2d<f32>;
@group(0) @binding(2) var previous_errors: texture_2d<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(strip: Strip) {
    sum_strip(strip);
}

fn sample_at(pixel: vec2u) -> Sample {
    let errors = textureLoad(test_shown, pixel, 0).rgb - textureLoad(reference_shown, pixel, 0).rgb;
    let changes = errors - textureLoad(previous_errors, pixel, 0).rgb;
    return Sample(dot(changes, changes), luma(changes));
}
