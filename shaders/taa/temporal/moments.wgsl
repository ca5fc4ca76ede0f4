// Mean and variance of n×n texels from two passes over n texels, rows first. Each invocation makes n outputs in a line from
// the 2n texels they cover: sums from the middle outwards, so that an output is the sum of a tail and a head. Cost for a
// pixel does not depend on n, and as nothing is ever subtracted from a sum, a bright texel leaves no rounding behind it.
//
// Moments are taken about the texel in the middle of the 2n, because m2/n - μ² cancels where they are bright and alike. The
// second pass adds the variance of the rows' means to the mean of their variances.
// Salvi, "An Excursion in Temporal Supersampling", GDC 2016. CPU twin: src/taa/reference/neighbourhood.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// Down the columns of what the first pass made, instead of along the rows of colour.
override vertical: bool;

@group(0) @binding(10) var row_means: texture_2d<f32>;
@group(0) @binding(11) var row_variances: texture_2d<f32>;
@group(0) @binding(12) var means: texture_storage_2d<rgba32float, write>;
@group(0) @binding(13) var variances: texture_storage_2d<rgba32float, write>;

struct Moments {
    m1: vec3f,
    m2: vec3f,
}

// The moments of one texel about `shift`.
fn moments_of(p: vec2i, shift: vec3f) -> Moments {
    if (vertical) {
        let d = fetch(row_means, p) - shift;
        return Moments(d, d * d + fetch(row_variances, p));
    }
    let d = neighbour(p, vec2i(0)) - shift;
    return Moments(d, d * d);
}

fn sum(a: Moments, b: Moments) -> Moments {
    return Moments(a.m1 + b.m1, a.m2 + b.m2);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = vec2i(textureDimensions(color));
    let n = i32(variance_window);
    let axis = select(vec2i(1, 0), vec2i(0, 1), vertical);
    let first = vec2i(id.xy) * (1 + (n - 1) * axis);
    if (any(first >= size)) {
        return;
    }
    let middle = first + n / 2 * axis;
    var shift: vec3f;
    if (vertical) {
        shift = fetch(row_means, middle);
    } else {
        shift = neighbour(middle, vec2i(0));
    }
    if (!guards) {
        shift = vec3f(0.0);
    }
    // tails[i]: texels i to n - 1 of the first n.
    var tails: array<Moments, 31>;
    var tail = Moments();
    for (var i = n - 1; i >= 0; i--) {
        tail = sum(tail, moments_of(middle + (i + 1 - n) * axis, shift));
        tails[i] = tail;
    }
    var head = Moments();
    for (var i = 0; i < n; i++) {
        let p = first + i * axis;
        if (any(p >= size)) {
            return;
        }
        let window = sum(tails[i], head);
        let offset = window.m1 / f32(n);
        textureStore(means, p, vec4f(shift + offset, 0.0));
        let variance = window.m2 / f32(n) - offset * offset;
        textureStore(variances, p, vec4f(select(variance, max(vec3f(0.0), variance), guards), 0.0));
        head = sum(head, moments_of(middle + (i + 1) * axis, shift));
    }
}
