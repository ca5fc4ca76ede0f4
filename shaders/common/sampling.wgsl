// Fetches and filters. A fetch outside the image takes the nearest edge texel. Filters are written with loads, not
// samplers: hardware interpolates with 8-bit fractions, which a feedback loop amplifies. Positions are in pixels, texel
// centres at +0.5. CPU twin: src/taa/reference/sampling.rs.

fn fetch(image: texture_2d<f32>, texel: vec2i) -> vec3f {
    return textureLoad(image, clamp(texel, vec2i(0), vec2i(textureDimensions(image)) - 1), 0).rgb;
}

fn sample_bilinear(image: texture_2d<f32>, position: vec2f) -> vec3f {
    let base = floor(position - 0.5);
    let f = position - 0.5 - base;
    let texel = vec2i(base);
    let top = lerp(fetch(image, texel), fetch(image, texel + vec2i(1, 0)), f.x);
    let bottom = lerp(fetch(image, texel + vec2i(0, 1)), fetch(image, texel + vec2i(1, 1)), f.x);
    return lerp(top, bottom, f.y);
}

// Between equals exactly their value, which `mix` is not: a box of flat colours must contain that colour.
fn lerp(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a + (b - a) * t;
}

// Weights of the texels at -1, 0, 1 and 2 along one axis, for the fraction f beyond texel 0.
fn catmull_rom_weights(f: f32) -> vec4f {
    return vec4f(
        f * (-0.5 + f * (1.0 - 0.5 * f)),
        1.0 + f * f * (-2.5 + 1.5 * f),
        f * (0.5 + f * (2.0 - 1.5 * f)),
        f * f * (-0.5 + 0.5 * f),
    );
}

// A row of 4×4 weighted texels: -1 to 2 beside `texel`.
fn row_of_4(image: texture_2d<f32>, texel: vec2i, w: vec4f) -> vec3f {
    return w.x * fetch(image, texel + vec2i(-1, 0)) + w.y * fetch(image, texel)
        + w.z * fetch(image, texel + vec2i(1, 0)) + w.w * fetch(image, texel + vec2i(2, 0));
}

// `b` and the weighted differences of the others from it, for weights whose sum is 1: between equals exactly their value.
fn spline(a: vec3f, b: vec3f, c: vec3f, d: vec3f, w: vec4f) -> vec3f {
    return b + (w.x * (a - b) + w.z * (c - b) + w.w * (d - b));
}

fn spline_row(image: texture_2d<f32>, texel: vec2i, w: vec4f) -> vec3f {
    return spline(
        fetch(image, texel + vec2i(-1, 0)),
        fetch(image, texel),
        fetch(image, texel + vec2i(1, 0)),
        fetch(image, texel + vec2i(2, 0)),
        w,
    );
}

// The separable Catmull-Rom spline over all 16 texels. May be negative.
fn sample_catmull_rom(image: texture_2d<f32>, position: vec2f) -> vec3f {
    let base = floor(position - 0.5);
    let f = position - 0.5 - base;
    let texel = vec2i(base);
    let wx = catmull_rom_weights(f.x);
    return spline(
        spline_row(image, texel + vec2i(0, -1), wx),
        spline_row(image, texel, wx),
        spline_row(image, texel + vec2i(0, 1), wx),
        spline_row(image, texel + vec2i(0, 2), wx),
        catmull_rom_weights(f.y),
    );
}

// Coefficients that the kernel of `quasi_cubic` finds beyond each edge of the image.
const QUASI_MARGIN: i32 = 2;

// φ = β³ + λ β³″ at the distances 1 + f, f, 1 - f and 2 - f (src/taa/reference/quasi_cubic.rs).
fn quasi_cubic_weights(f: f32) -> vec4f {
    const LAMBDA = 0.04;
    let g = 1.0 - f;
    return vec4f(
        g * (g * g / 6.0 + LAMBDA),
        2.0 / 3.0 + f * f * (0.5 * f - 1.0) + LAMBDA * (3.0 * f - 2.0),
        2.0 / 3.0 + g * g * (0.5 * g - 1.0) + LAMBDA * (3.0 * g - 2.0),
        f * (f * f / 6.0 + LAMBDA),
    );
}

// Of an image's coefficients, which its margin precedes. May be negative.
fn sample_quasi_cubic(coefficients: texture_2d<f32>, position: vec2f) -> vec3f {
    let base = floor(position - 0.5);
    let f = position - 0.5 - base;
    let texel = vec2i(base) + QUASI_MARGIN;
    let wx = quasi_cubic_weights(f.x);
    let wy = quasi_cubic_weights(f.y);
    return wy.x * row_of_4(coefficients, texel + vec2i(0, -1), wx) + wy.y * row_of_4(coefficients, texel, wx)
        + wy.z * row_of_4(coefficients, texel + vec2i(0, 1), wx) + wy.w * row_of_4(coefficients, texel + vec2i(0, 2), wx);
}

// The spline without its corners, renormalised: what five bilinear taps compute, here from the 12 texels they touch. It
// does not keep oblique ramps. May be negative.
fn sample_catmull_rom_5(image: texture_2d<f32>, position: vec2f) -> vec3f {
    let base = floor(position - 0.5);
    let f = position - 0.5 - base;
    let texel = vec2i(base);
    let wx = catmull_rom_weights(f.x);
    let wy = catmull_rom_weights(f.y);
    let top = wx.y * fetch(image, texel + vec2i(0, -1)) + wx.z * fetch(image, texel + vec2i(1, -1));
    let bottom = wx.y * fetch(image, texel + vec2i(0, 2)) + wx.z * fetch(image, texel + vec2i(1, 2));
    let sum = wy.x * top + wy.y * row_of_4(image, texel, wx)
        + wy.z * row_of_4(image, texel + vec2i(0, 1), wx) + wy.w * bottom;
    let inner_x = wx.y + wx.z;
    let inner_y = wy.y + wy.z;
    return sum / (inner_x * (wy.x + wy.w) + inner_y * (wx.x + inner_x + wx.w));
}

// Pulls a filtered value into the range of the 4 texels around `position`, which negative lobes overshoot at edges.
fn dering(image: texture_2d<f32>, position: vec2f, filtered: vec3f) -> vec3f {
    let texel = vec2i(floor(position - 0.5));
    let a = fetch(image, texel);
    let b = fetch(image, texel + vec2i(1, 0));
    let c = fetch(image, texel + vec2i(0, 1));
    let d = fetch(image, texel + vec2i(1, 1));
    return clamp(filtered, min(min(a, b), min(c, d)), max(max(a, b), max(c, d)));
}
