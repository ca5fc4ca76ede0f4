// Partial sums of squared errors in four domains, of reference energy, and of pixels that are not finite. A workgroup
// sums 64 pixels of three channels, 192 terms, in f32; the host adds the workgroups in f64.

const GROUP: u32 = 64u;

struct Sums {
    linear: f32,
    display: f32,
    luma: f32,
    u8: f32,
    reference: f32,
    non_finite: f32,
}

@group(0) @binding(0) var reference_linear: texture_2d<f32>;
@group(0) @binding(1) var test_linear: texture_2d<f32>;
@group(0) @binding(2) var reference_shown: texture_2d<f32>;
@group(0) @binding(3) var test_shown: texture_2d<f32>;
@group(0) @binding(4) var<storage, read_write> partial_sums: array<Sums>;

var<workgroup> group: array<Sums, GROUP>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) n_workgroups: vec3u,
) {
    group[lane] = Sums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    if (all(id.xy < textureDimensions(test_shown))) {
        group[lane] = measure(id.xy);
    }
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (lane < half) {
            group[lane] = add(group[lane], group[lane + half]);
        }
    }
    if (lane == 0u) {
        partial_sums[workgroup.y * n_workgroups.x + workgroup.x] = group[0];
    }
}

fn measure(pixel: vec2u) -> Sums {
    let reference = textureLoad(reference_shown, pixel, 0);
    let test = textureLoad(test_shown, pixel, 0);
    let linear = textureLoad(test_linear, pixel, 0).rgb - textureLoad(reference_linear, pixel, 0).rgb;
    let display = test.rgb - reference.rgb;
    let y = luma(display); // Of the difference: the difference of two lumas would be rounded before it cancels.
    let codes = round(255.0 * test.rgb) - round(255.0 * reference.rgb);
    return Sums(
        dot(linear, linear),
        dot(display, display),
        y * y,
        dot(codes, codes),
        dot(reference.rgb, reference.rgb),
        max(test.a, reference.a),
    );
}

fn add(a: Sums, b: Sums) -> Sums {
    return Sums(
        a.linear + b.linear,
        a.display + b.display,
        a.luma + b.luma,
        a.u8 + b.u8,
        a.reference + b.reference,
        a.non_finite + b.non_finite,
    );
}
