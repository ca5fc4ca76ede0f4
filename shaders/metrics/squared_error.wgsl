// Partial sums of squared errors in four domains, of reference energy, and of pixels that are not finite. An invocation
// sums a strip of 64 rows of one column, 192 terms, in f32; the host adds the strips in f64. Neighbours in x read
// neighbouring texels, and nothing waits at a barrier.

const STRIP: u32 = 64u;

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

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

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let extent = textureDimensions(test_shown);
    let first = id.y * STRIP;
    if (id.x >= extent.x || first >= extent.y) {
        return;
    }
    var sums = Sums();
    for (var y = first; y < min(first + STRIP, extent.y); y++) {
        sums = add(sums, measure(vec2u(id.x, y)));
    }
    partial_sums[id.y * extent.x + id.x] = sums;
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
