// A linear model for each pixel, from a stabilised feature to the colour, fitted recursively to the pixel's past and carried
// along its motion. What it predicts is the resolved colour.
// Iglesias-Guitian et al., "Pixel History Linear Models for Real-Time Temporal Filtering", 2016, sections 4 to 6.
// CPU twin: src/taa/reference/phlm2016.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// A column a channel: its coefficients against (1, feature).
@group(0) @binding(10) var<storage, read> coefficients: array<mat3x4f>;
@group(0) @binding(11) var<storage, read_write> next_coefficients: array<mat3x4f>;
@group(0) @binding(12) var<storage, read> covariances: array<Covariance>;
@group(0) @binding(13) var<storage, read_write> next_covariances: array<Covariance>;
// The feature's own history.
@group(0) @binding(14) var next_history: HistoryStore;
// The shown colour in the working domain, and in alpha of how many samples it is the mean.
@group(0) @binding(15) var mean: texture_2d<f32>;
@group(0) @binding(16) var next_mean: texture_storage_2d<rgba32float, write>;
@group(0) @binding(17) var<storage, read> moves: u32;
// Linear RGB.
@group(0) @binding(18) var shown: texture_storage_2d<rgba32float, write>;

// How much of the past the fit keeps each frame.
const FORGETTING: f32 = 0.998;
// Variance of a coefficient about which nothing is known.
const UNKNOWN: f32 = 1000.0;

// The upper triangle of a symmetric matrix: rows from the diagonal on.
struct Covariance {
    row_0: vec4f,
    row_1: vec3f,
    p_33: f32,
    row_2: vec2f,
}

struct Model {
    coefficients: mat3x4f,
    covariance: mat4x4f,
}

fn unpacked(c: Covariance) -> mat4x4f {
    return mat4x4f(
        c.row_0,
        vec4f(c.row_0.y, c.row_1),
        vec4f(c.row_0.z, c.row_1.y, c.row_2),
        vec4f(c.row_0.w, c.row_1.z, c.row_2.y, c.p_33),
    );
}

fn packed(p: mat4x4f) -> Covariance {
    return Covariance(p[0], p[1].yzw, p[3].w, p[2].zw);
}

fn unknown() -> mat4x4f {
    return mat4x4f(vec4f(UNKNOWN, 0.0, 0.0, 0.0), vec4f(0.0, UNKNOWN, 0.0, 0.0), vec4f(0.0, 0.0, UNKNOWN, 0.0), vec4f(0.0, 0.0, 0.0, UNKNOWN));
}

// A model that knows one colour and nothing else.
fn constant_model(c: vec3f) -> Model {
    return Model(mat3x4f(vec4f(c.r, 0.0, 0.0, 0.0), vec4f(c.g, 0.0, 0.0, 0.0), vec4f(c.b, 0.0, 0.0, 0.0)), unknown());
}

fn texel_index(p: vec2i) -> u32 {
    let texel = vec2u(clamped(p));
    return texel.y * textureDimensions(color).x + texel.x;
}

fn interpolated_coefficients(q: vec2f) -> mat3x4f {
    let base = floor(q - 0.5);
    let f = q - 0.5 - base;
    let p = vec2i(base);
    let a = coefficients[texel_index(p)];
    let b = coefficients[texel_index(p + vec2i(1, 0))];
    let c = coefficients[texel_index(p + vec2i(0, 1))];
    let d = coefficients[texel_index(p + vec2i(1, 1))];
    let top = a + (b - a) * f.x;
    let bottom = c + (d - c) * f.x;
    return top + (bottom - top) * f.y;
}

// What the 3×3 says of a pixel; colours are RGB of the working domain.
struct Surroundings {
    bounds: ColorBox,
    // Binomial mean, (1 2 1)/4 along each axis.
    low: vec3f,
    luma_lo: f32,
    luma_hi: f32,
}

fn surroundings(p: vec2i) -> Surroundings {
    let c = fetch(color, p);
    var s = Surroundings(ColorBox(c, c, vec3f(0.0)), vec3f(0.0), luma(c), luma(c));
    for (var i = 0; i < 9; i++) {
        let o = vec2i(i % 3, i / 3) - 1;
        let c = fetch(color, p + o);
        s.bounds = extend(s.bounds, c);
        s.low += c / f32(4 << u32(abs(o.x) + abs(o.y)));
        s.luma_lo = min(s.luma_lo, luma(c));
        s.luma_hi = max(s.luma_hi, luma(c));
    }
    s.bounds.mean *= 1.0 / 9.0;
    return s;
}

// The feature's history, refreshed where it is about to leave the range of the present.
fn feature(at: Reprojection, s: Surroundings) -> vec3f {
    let h = clamp(sample_bilinear(history, at.q), s.bounds.lo, s.bounds.hi);
    let l = max(0.0, min(luma(h) - s.luma_lo, s.luma_hi - luma(h)));
    let range = max(s.luma_hi - s.luma_lo, select(0.0, 1e-4, guards));
    let motion_px = sqrt(at.motion.length2);
    if (phlm_printed) {
        return mix(h, s.low, saturate(l * l * (0.125 + 0.25 * motion_px * l) / (l + range)));
    }
    return mix(h, s.low, max(0.02, saturate(l * (0.125 + 0.25 * motion_px * l) / (l + range))));
}

// Recursive least squares: the model after it has seen that `x` gave `y`.
fn updated(model: Model, x: vec4f, y: vec3f) -> Model {
    let error = y - x * model.coefficients;
    let px = model.covariance * x;
    let gain = px / (FORGETTING + select(dot(x, px), max(0.0, dot(x, px)), guards));
    var p = model.covariance;
    for (var i = 0; i < 4; i++) {
        p[i] = (p[i] - gain * px[i]) / FORGETTING;
    }
    let fitted = mat3x4f(
        model.coefficients[0] + gain * error.r,
        model.coefficients[1] + gain * error.g,
        model.coefficients[2] + gain * error.b,
    );
    return Model(fitted, bounded(p));
}

// Where the feature does not change, forgetting would let the covariance grow without end, and rounding makes it indefinite:
// then an element off the diagonal is larger than those on it allow.
fn bounded(p: mat4x4f) -> mat4x4f {
    if (!guards) {
        return p;
    }
    let diagonal = vec4f(p[0].x, p[1].y, p[2].z, p[3].w);
    if (any(diagonal <= vec4f(0.0))) {
        return unknown();
    }
    for (var i = 0; i < 4; i++) {
        if (any(p[i] * p[i] > diagonal[i] * diagonal)) {
            return unknown();
        }
    }
    let trace = dot(diagonal, vec4f(1.0));
    return p * min(1.0, 4.0 * UNKNOWN / trace);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    let y = current_color(p, true);
    let s = surroundings(p);
    let at = reprojected(p);
    var z = fetch(color, p);
    var model = constant_model(y);
    if (at.has_history) {
        z = feature(at, s);
        model = Model(interpolated_coefficients(at.q), unpacked(covariances[texel_index(vec2i(floor(at.q)))]));
    }
    let x = vec4f(1.0, z);
    let predicted = x * model.coefficients;
    if (any(predicted < s.bounds.lo - 1e-4) || any(predicted > s.bounds.hi + 1e-4)) {
        model = constant_model(clip_current(predicted, y, s.bounds, guards));
    }
    model = updated(model, x, y);
    let index = texel_index(p);
    next_coefficients[index] = model.coefficients;
    next_covariances[index] = packed(model.covariance);
    textureStore(next_history, id.xy, vec4f(round_history(z), 1.0));

    var resolved = saturated(max(x * model.coefficients, vec3f(0.0)));
    var n = 1.0;
    if (frame.has_history != 0u && moves == 0u) {
        let previous = textureLoad(mean, id.xy, 0);
        n = previous.a + 1.0;
        resolved = previous.rgb + (y - previous.rgb) / n;
    }
    textureStore(next_mean, id.xy, vec4f(resolved, n));
    textureStore(shown, id.xy, vec4f(from_domain(resolved, domain), 1.0));
}
