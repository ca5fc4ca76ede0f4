// The luma error of each pixel over time, as `Deviation` in src/metrics/temporal/track.rs keeps it, and what it comes to so
// far: the sum of the standard deviations, of how many pixels, and how many of them were not finite once.

const N_TERMS: u32 = 3u;

// The classes whose pixels count, one bit each.
override counted_classes: u32;

struct Moments {
    n: f32,
    mean: f32,
    // Below 0 for good once an error is not finite.
    squares: f32,
}

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var test_shown: texture_2d<f32>;
@group(0) @binding(2) var<storage, read_write> moments: array<Moments>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(strip: Strip) {
    sum_strip(strip);
}

fn sample_at(pixel: vec2u) -> Sample {
    let i = pixel.y * width + pixel.x;
    if (((counted_classes >> class_of(pixel)) & 1u) == 1u) {
        let test = textureLoad(test_shown, pixel, 0);
        let reference = textureLoad(reference_shown, pixel, 0);
        moments[i] = add(moments[i], luma(test.rgb - reference.rgb), max(test.a, reference.a) == 0.0);
    }
    let known = moments[i];
    if (known.n < 2.0) {
        return Sample();
    }
    return Sample(sqrt(max(known.squares, 0.0) / known.n), 1.0, f32(known.squares < 0.0));
}

fn add(before: Moments, error: f32, is_finite: bool) -> Moments {
    let away = error - before.mean;
    let n = before.n + 1.0;
    if (!is_finite || before.squares < 0.0) {
        return Moments(n, before.mean, -1.0);
    }
    let mean = before.mean + away / n;
    // Rounding may leave a product below 0.
    return Moments(n, mean, before.squares + max(away * (error - mean), 0.0));
}
