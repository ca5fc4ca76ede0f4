// The sum of FLIP over all pixels.

const N_TERMS: u32 = 1u;

@group(0) @binding(0) var<storage, read> map: array<f32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(strip: Strip) {
    sum_strip(strip);
}

fn sample_at(pixel: vec2u) -> Sample {
    return Sample(map[pixel.y * width + pixel.x]);
}
