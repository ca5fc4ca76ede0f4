// The colour box around a pixel, in the recipe's colour space. CPU twin: src/taa/reference/neighbourhood.rs.

const NEIGHBOURHOOD_NONE: u32 = 0u;
const NEIGHBOURHOOD_CROSS: u32 = 1u;
const NEIGHBOURHOOD_BOX3: u32 = 2u;
const NEIGHBOURHOOD_ROUNDED: u32 = 3u;
const NEIGHBOURHOOD_VARIANCE: u32 = 4u;
const NEIGHBOURHOOD_SOBEL: u32 = 5u;
const NEIGHBOURHOOD_SHRUNK: u32 = 6u;

// Of variance_window² texels, where `prefilter_moments` is on. From 22 on are bindings of this file's own.
@group(0) @binding(22) var window_means: texture_2d<f32>;
@group(0) @binding(23) var window_variances: texture_2d<f32>;

// Whether colours beside a pixel are read.
fn looks_beside() -> bool {
    return neighbourhood != NEIGHBOURHOOD_NONE || input_filter == INPUT_BLACKMAN_HARRIS;
}

fn to_space(rgb: vec3f) -> vec3f {
    if (space == SPACE_YCOCG) {
        return rgb_to_ycocg(rgb);
    }
    return rgb;
}

fn from_space(c: vec3f) -> vec3f {
    if (space == SPACE_YCOCG) {
        return max(ycocg_to_rgb(c), vec3f(0.0));
    }
    return c;
}

// The texel at offset `o`, or, un-jittered, what the jitter-free grid would hold there.
fn neighbour(p: vec2i, o: vec2i) -> vec3f {
    if (unjitter_neighbourhood) {
        return to_space(sample_bilinear(color, vec2f(p + o) + 0.5 - frame.jitter_px));
    }
    return to_space(near_color(p, o));
}

fn empty_box() -> ColorBox {
    return ColorBox(vec3f(F16_MAX), vec3f(-F16_MAX), vec3f(0.0));
}

fn extend(bounds: ColorBox, c: vec3f) -> ColorBox {
    return ColorBox(min(bounds.lo, c), max(bounds.hi, c), bounds.mean + c);
}

// Of the texel and the four beside it; sums where means will be.
fn cross_sums(p: vec2i) -> ColorBox {
    let c = neighbour(p, vec2i(0));
    var bounds = ColorBox(c, c, c);
    bounds = extend(bounds, neighbour(p, vec2i(0, -1)));
    bounds = extend(bounds, neighbour(p, vec2i(-1, 0)));
    bounds = extend(bounds, neighbour(p, vec2i(1, 0)));
    bounds = extend(bounds, neighbour(p, vec2i(0, 1)));
    return bounds;
}

fn cross_box(p: vec2i) -> ColorBox {
    let sums = cross_sums(p);
    return ColorBox(sums.lo, sums.hi, sums.mean * (1.0 / 5.0));
}

fn box3(p: vec2i) -> ColorBox {
    let c = neighbour(p, vec2i(-1));
    var bounds = ColorBox(c, c, c);
    for (var i = 1; i < 9; i++) {
        bounds = extend(bounds, neighbour(p, vec2i(i % 3, i / 3) - 1));
    }
    bounds.mean *= 1.0 / 9.0;
    return bounds;
}

// Pedersen, INSIDE: the corners of the 3×3 count half.
fn rounded_box(p: vec2i) -> ColorBox {
    let a = cross_sums(p);
    var b = extend(a, neighbour(p, vec2i(-1, -1)));
    b = extend(b, neighbour(p, vec2i(1, -1)));
    b = extend(b, neighbour(p, vec2i(-1, 1)));
    b = extend(b, neighbour(p, vec2i(1, 1)));
    return ColorBox(0.5 * (a.lo + b.lo), 0.5 * (a.hi + b.hi), a.mean * (1.0 / 10.0) + b.mean * (1.0 / 18.0));
}

struct Distribution {
    mean: vec3f,
    sigma: vec3f,
}

// Moments are taken about the centre texel, because m2/N - μ² cancels where the neighbourhood is bright and flat.
fn distribution(p: vec2i) -> Distribution {
    let centre = select(vec3f(0.0), neighbour(p, vec2i(0)), guards);
    let radius = i32(variance_window) / 2;
    var m1 = vec3f(0.0);
    var m2 = vec3f(0.0);
    for (var y = -radius; y <= radius; y++) {
        for (var x = -radius; x <= radius; x++) {
            let d = neighbour(p, vec2i(x, y)) - centre;
            m1 += d;
            m2 += d * d;
        }
    }
    let per_texel = 1.0 / f32(variance_window * variance_window);
    let offset = m1 * per_texel;
    let variance = m2 * per_texel - offset * offset;
    return Distribution(centre + offset, sqrt(select(variance, max(vec3f(0.0), variance), guards)));
}

// Salvi, variance clipping: mean ± γ σ over n×n texels.
fn variance_box(p: vec2i) -> ColorBox {
    var d: Distribution;
    if (prefilter_moments) {
        d = Distribution(fetch(window_means, p), sqrt(fetch(window_variances, p)));
    } else {
        d = distribution(p);
    }
    let bounds = ColorBox(d.mean - variance_gamma * d.sigma, d.mean + variance_gamma * d.sigma, d.mean);
    if (!intersect_minmax) {
        return bounds;
    }
    let minmax = box3(p);
    let lo = max(bounds.lo, minmax.lo);
    let hi = min(bounds.hi, minmax.hi);
    let empty = any(lo > hi);
    return ColorBox(select(lo, minmax.lo, empty), select(hi, minmax.hi, empty), d.mean);
}

// The box around the output pixel `output_pixel`, whose current colour is `current`, in RGB, and whose history is `at`.
fn color_box(output_pixel: vec2i, current: vec3f, at: Reprojection) -> ColorBox {
    let p = input_texel(output_pixel);
    var bounds: ColorBox;
    switch (neighbourhood) {
        case NEIGHBOURHOOD_CROSS: { bounds = cross_box(p); }
        case NEIGHBOURHOOD_BOX3: { bounds = box3(p); }
        case NEIGHBOURHOOD_ROUNDED: { bounds = rounded_box(p); }
        case NEIGHBOURHOOD_VARIANCE: { bounds = variance_box(p); }
        case NEIGHBOURHOOD_SOBEL: { bounds = sobel_box(p, current, at); }
        case NEIGHBOURHOOD_SHRUNK: { bounds = shrunk_box(output_pixel); }
        default: {}
    }
    if (chroma_from_luma) {
        bounds = narrow_chroma(bounds, to_space(current).yz);
    }
    return bounds;
}

// INSIDE, bonus slides: chroma may differ from the current colour's by an eighth of luma's range.
fn narrow_chroma(bounds: ColorBox, chroma: vec2f) -> ColorBox {
    let extent = 0.125 * (bounds.hi.x - bounds.lo.x);
    return ColorBox(
        vec3f(bounds.lo.x, chroma - extent),
        vec3f(bounds.hi.x, chroma + extent),
        vec3f(bounds.mean.x, chroma),
    );
}
