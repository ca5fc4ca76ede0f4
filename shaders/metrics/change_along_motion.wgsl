// How an image's luma changes along the motion, compared with its reference's: how many pixels come from within the image,
// the squared difference, and how much more the image changes. Written in errors, (T − W T) − (R − W R) = E − W E, so that
// what both images have in common is never rounded.

const N_TERMS: u32 = 3u;

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var test_shown: texture_2d<f32>;
@group(0) @binding(2) var previous_errors: texture_2d<f32>;
@group(0) @binding(3) var motion: texture_2d<f32>;
@group(0) @binding(4) var change: texture_2d<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(strip: Strip) {
    sum_strip(strip);
}

fn sample_at(pixel: vec2u) -> Sample {
    let reference_change = textureLoad(change, pixel, 0).r;
    if (reference_change == DISOCCLUDED_CHANGE) {
        return Sample();
    }
    let source = source_of(pixel, textureLoad(motion, pixel, 0).xy, vec2u(width, height));
    let errors = textureLoad(test_shown, pixel, 0).rgb - textureLoad(reference_shown, pixel, 0).rgb;
    let difference = luma(errors - sample(previous_errors, source).rgb);
    return Sample(1.0, difference * difference, abs(reference_change + difference) - abs(reference_change));
}
