// Adds up samples of pixels by class. An invocation takes a strip of 64 rows of one column, so at most 192 terms, in f32;
// the host adds the strips in f64. Neighbours in x read neighbouring texels, and nothing waits at a barrier. A pass gives
// `N_TERMS` and `sample_at`.

const STRIP: u32 = 64u;

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
// Of the frame.
override width: u32;
override height: u32;

alias Sample = array<f32, N_TERMS>;

@group(0) @binding(8) var<storage, read_write> partial_sums: array<array<Sample, N_CLASSES>>;

fn sum_strip(strip: vec2u) {
    let first = strip.y * STRIP;
    if (strip.x >= width || first >= height) {
        return;
    }
    var sums: array<Sample, N_CLASSES>;
    for (var y = first; y < min(first + STRIP, height); y++) {
        let pixel = vec2u(strip.x, y);
        let class_of_pixel = class_of(pixel);
        let sample = sample_at(pixel);
        // Every index is a constant once the loops are unrolled, which keeps the sums in registers.
        for (var kind = 0u; kind < N_CLASSES; kind++) {
            for (var term = 0u; term < N_TERMS; term++) {
                sums[kind][term] += select(0.0, sample[term], kind == class_of_pixel);
            }
        }
    }
    partial_sums[strip.y * width + strip.x] = sums;
}
