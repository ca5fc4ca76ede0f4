// Adds up samples of pixels by class. An invocation takes a strip of a column, so at most 192 terms, in f32; neighbours in x
// read neighbouring texels. What becomes of its sums, strips_apart.wgsl or strips_together.wgsl say; the host adds those in f64.
// A pass gives `N_TERMS` and `sample_at`.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
// Rows of a strip, at most 64.
override n_rows: u32;
// Of the frame.
override width: u32;
override height: u32;

alias Sample = array<f32, N_TERMS>;

@group(0) @binding(8) var<storage, read_write> partial_sums: array<array<Sample, N_CLASSES>>;

struct Strip {
    @builtin(global_invocation_id) at: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) n_workgroups: vec3u,
}

fn sum_strip(strip: Strip) {
    let first = strip.at.y * n_rows;
    let end = select(0u, min(first + n_rows, height), strip.at.x < width);
    var sums: array<Sample, N_CLASSES>;
    for (var y = first; y < end; y++) {
        let pixel = vec2u(strip.at.x, y);
        let class_of_pixel = class_of(pixel);
        let sample = sample_at(pixel);
        // Every index is a constant once the loops are unrolled, which keeps the sums in registers.
        for (var kind = 0u; kind < N_CLASSES; kind++) {
            for (var term = 0u; term < N_TERMS; term++) {
                sums[kind][term] += select(0.0, sample[term], kind == class_of_pixel);
            }
        }
    }
    hand_in(strip, sums);
}
