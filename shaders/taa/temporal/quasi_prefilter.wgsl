// The coefficients of history for `quasi_cubic`, along rows and then along columns: history through 1/P, where
// P(z) = d0 + d1 (z + 1/z) + d2 (z² + 1/z²). P is the product of a filter with two poles that runs forth and of its mirror
// image that runs back. Nothing of a texel is left 24 texels on (2⁻³⁵: of the brightest, 2⁻¹⁹), so a run of texels starts that
// far before itself instead of at the image's edge, and all runs of a line go at once.
//
// Beyond the edge history continues as the nearest edge texel; the kernel reaches 2 texels beyond, and coefficients do, too.
// CPU twin: src/taa/reference/quasi_cubic.rs, where P and the kernel are derived.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// Down the columns of what the first pass made, instead of along the rows of history.
override vertical: bool;

@group(0) @binding(10) var row_coefficients: texture_2d<f32>;
@group(0) @binding(11) var coefficients: texture_storage_2d<rgba32float, write>;

// y[i] = x[i] + FEEDBACK · (y[i-1], y[i-2]), of the poles -0.35659355 and -0.01324635: their sum and minus their product.
const FEEDBACK: vec2f = vec2f(-0.36983990, -0.0047235618);
// The recursion makes of a constant one over this.
const GAIN: f32 = 1.0 - FEEDBACK.x - FEEDBACK.y;

const RUN: i32 = 16;
const WARM_UP: i32 = 24;

// Along the line of texels through `p`, places of which begin at the margin.
fn texel_of_line(p: vec2i, i: i32) -> vec3f {
    if (vertical) {
        return fetch(row_coefficients, vec2i(p.x, i - QUASI_MARGIN));
    }
    return fetch(history, vec2i(i - QUASI_MARGIN, p.y));
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = vec2i(textureDimensions(coefficients));
    let axis = select(vec2i(1, 0), vec2i(0, 1), vertical);
    let p = vec2i(id.xy) * (1 + (RUN - 1) * axis);
    if (any(p >= size)) {
        return;
    }
    let first = dot(p, axis);
    var forth: array<vec3f, RUN + WARM_UP>;
    var y = texel_of_line(p, first - WARM_UP) / GAIN;
    var before = y;
    for (var i = 1 - WARM_UP; i < RUN + WARM_UP; i++) {
        let next = texel_of_line(p, first + i) + FEEDBACK.x * y + FEEDBACK.y * before;
        before = y;
        y = next;
        if (i >= 0) {
            forth[i] = y;
        }
    }
    y = y / GAIN;
    before = y;
    for (var i = RUN + WARM_UP - 2; i >= 0; i--) {
        let next = forth[i] + FEEDBACK.x * y + FEEDBACK.y * before;
        before = y;
        y = next;
        let at = p + i * axis;
        if (i < RUN && all(at < size)) {
            textureStore(coefficients, at, vec4f(GAIN * GAIN * y, 1.0));
        }
    }
}
