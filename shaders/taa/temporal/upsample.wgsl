// From the input's grid to the output's, which is as fine or up to four times finer along each axis. Jittered samples fall
// anywhere among the output's pixels: each counts by its distance from a pixel's centre, in output pixels. Where a recipe
// does not upsample, the two grids are one and all of this folds away.
// Yang, Liu and Salvi, "A Survey of Temporal Antialiasing Techniques", 2020, 5.1 and 5.2, equations 7 to 10.
// CPU twin: src/taa/reference/upsample.rs.

// What rounding may put on the wrong side of a limit, in output pixels (squared): places that are fractions of small
// numbers meet the limits below exactly, and whole columns of them.
const NEARLY: f32 = 0x1p-16;

fn upsamples() -> bool {
    return input_filter == INPUT_UPSAMPLE;
}

// Output pixels for an input pixel, along each axis.
fn scale() -> vec2f {
    if (upsamples()) {
        return frame.output_size / vec2f(textureDimensions(color));
    }
    return vec2f(1.0);
}

struct Footing {
    // The input texel that contains the centre of an output pixel.
    texel: vec2i,
    // How far beyond the texel's corner the centre lies, 0 to 1.
    fraction: vec2f,
}

// In integers, because centres often lie on a texel's border, where a rounded quotient may fall to either side.
fn footing(p: vec2i) -> Footing {
    let centre = (2u * vec2u(p) + 1u) * textureDimensions(color);
    let size = 2u * vec2u(frame.output_size);
    let texel = centre / size;
    return Footing(vec2i(texel), vec2f(centre - texel * size) / vec2f(size));
}

fn input_texel(p: vec2i) -> vec2i {
    if (upsamples()) {
        return footing(p).texel;
    }
    return p;
}

// Of a position in the output.
fn input_position(q: vec2f) -> vec2f {
    if (upsamples()) {
        return q / scale();
    }
    return q;
}

// The 3×3 samples around the texel under an output pixel's centre.
struct Samples {
    texel: vec2i,
    // Their places along each axis less the centre's, output pixels.
    x: vec3f,
    y: vec3f,
}

fn samples_around(p: vec2i) -> Samples {
    let at = footing(p);
    let s = scale();
    let first = frame.jitter_px - at.fraction;
    return Samples(at.texel, s.x * (vec3f(-0.5, 0.5, 1.5) + first.x), s.y * (vec3f(-0.5, 0.5, 1.5) + first.y));
}

// The kernel is the product of its axes.
fn kernel(d: vec3f) -> vec3f {
    return exp(-2.29 * d * d);
}

// The mean of the samples. Without history to keep, the kernel is as wide as the input's pixels, because few output pixels
// have a sample near them.
fn upsampled(p: vec2i, has_history: bool) -> vec3f {
    let s = samples_around(p);
    let unit = select(1.0 / scale(), vec2f(1.0), has_history);
    let wx = kernel(unit.x * s.x);
    let wy = kernel(unit.y * s.y);
    var sum = vec3f(0.0);
    for (var i = 0; i < 9; i++) {
        sum += wx[i % 3] * wy[i / 3] * fetch(color, s.texel + vec2i(i % 3, i / 3) - 1);
    }
    return sum / (dot(wx, vec3f(1.0)) * dot(wy, vec3f(1.0)));
}

// How much the current colour can be trusted, 0 to 1: the kernel at the nearest sample.
fn confidence(p: vec2i) -> f32 {
    if (upsamples()) {
        let s = samples_around(p);
        return max3(kernel(s.x)) * max3(kernel(s.y));
    }
    return 1.0;
}

// Of the samples within 1.5 output pixels of the centre, and of the four that surround it. The whole 3×3 covers ever more of
// the output as the scale grows, and such a box would let ghosts pass.
fn shrunk_box(p: vec2i) -> ColorBox {
    let s = samples_around(p);
    // Along each axis the last sample not beyond the centre, and the next.
    let before = vec2i(i32(s.x[1] <= NEARLY), i32(s.y[1] <= NEARLY));
    var bounds = empty_box();
    var n = 0.0;
    for (var i = 0; i < 9; i++) {
        let o = vec2i(i % 3, i / 3);
        let d = vec2f(s.x[o.x], s.y[o.y]);
        let surrounds = all(o >= before) && all(o <= before + 1);
        if (surrounds || dot(d, d) <= 2.25 + NEARLY) {
            bounds = extend(bounds, to_space(fetch(color, s.texel + o - 1)));
            n += 1.0;
        }
    }
    bounds.mean /= n;
    return bounds;
}
