// What is measured pixel by pixel on two images: how many pixels there are and how many are not finite, squared errors in
// four domains, reference energy, and relative errors.

const N_TERMS: u32 = 9u;

// What src/metrics/relative_error.rs adds to denominators.
override rel_mse_floor: f32;
override smape_floor: f32;

@group(0) @binding(0) var reference_linear: texture_2d<f32>;
@group(0) @binding(1) var test_linear: texture_2d<f32>;
@group(0) @binding(2) var reference_shown: texture_2d<f32>;
@group(0) @binding(3) var test_shown: texture_2d<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(strip: Strip) {
    sum_strip(strip);
}

fn sample_at(pixel: vec2u) -> Sample {
    let reference = textureLoad(reference_shown, pixel, 0);
    let test = textureLoad(test_shown, pixel, 0);
    let r = textureLoad(reference_linear, pixel, 0).rgb;
    let t = textureLoad(test_linear, pixel, 0).rgb;
    let linear = t - r;
    let relative = linear * linear / (r * r + rel_mse_floor);
    let symmetric = 2.0 * abs(linear) / (abs(t) + abs(r) + smape_floor);
    let display = test.rgb - reference.rgb;
    let y = luma(display); // Of the difference: the difference of two lumas would be rounded before it cancels.
    let codes = round(255.0 * test.rgb) - round(255.0 * reference.rgb);
    return Sample(
        1.0,
        max(test.a, reference.a),
        dot(linear, linear),
        dot(display, display),
        y * y,
        dot(codes, codes),
        dot(reference.rgb, reference.rgb),
        relative.r + relative.g + relative.b,
        symmetric.r + symmetric.g + symmetric.b,
    );
}
