// What a display shows of linear colour, and back: exposure, tone mapping, the sRGB transfer function. In f32 on every
// adapter, because errors here do not cancel in metrics. CPU twins: src/metrics/display.rs, src/taa/reference/display.rs.

const TONEMAP_NONE: u32 = 0u;
const TONEMAP_REINHARD_MAX: u32 = 1u;
const TONEMAP_ACES: u32 = 2u;

// The inverse of c / (1 + max) is finite up to here; brighter colours clip (at 2047).
const TONEMAPPED_MAX: f32 = 1.0 - 0x1p-11;

struct Display {
    // Factor on linear colour.
    exposure: f32,
    tonemap: u32,
}

// 0 to 1.
fn to_display(linear: vec3f, display: Display) -> vec3f {
    // The upper bound keeps squares finite; every tone map is white to the last bit long before it.
    let exposed = clamp(linear * display.exposure, vec3f(0.0), vec3f(1e9));
    return srgb_encode(saturate(tonemapped(exposed, display.tonemap)));
}

// Of a colour within 0 to 1; the brightest that is shown as such where many are.
fn from_display(shown: vec3f, display: Display) -> vec3f {
    return untonemapped(srgb_decode(saturate(shown)), display.tonemap) / display.exposure;
}

fn tonemapped(c: vec3f, tonemap: u32) -> vec3f {
    switch tonemap {
        case TONEMAP_REINHARD_MAX: { return reinhard_max(c); }
        case TONEMAP_ACES: { return c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14); }
        default: { return c; }
    }
}

fn untonemapped(t: vec3f, tonemap: u32) -> vec3f {
    switch tonemap {
        case TONEMAP_REINHARD_MAX: { return inverse_reinhard_max(t); }
        case TONEMAP_ACES: {
            // The positive root of (2.51 - 2.43 t) c² + (0.03 - 0.59 t) c - 0.14 t, in the form that is 0 at 0.
            let a = 2.51 - 2.43 * t;
            let b = 0.03 - 0.59 * t;
            return 0.28 * t / (b + sqrt(b * b + 0.56 * a * t));
        }
        default: { return t; }
    }
}

fn reinhard_max(c: vec3f) -> vec3f {
    return c / (1.0 + max3(c));
}

fn inverse_reinhard_max(t: vec3f) -> vec3f {
    return t / (1.0 - min(max3(t), TONEMAPPED_MAX));
}

// x^(1/2.4) = x^(1/3) · x^(1/12), and the second factor is the fourth root of the first.
fn srgb_encode(x: vec3f) -> vec3f {
    let root = cube_root(max(x, vec3f(0.0031308)));
    return select(1.055 * (root * sqrt(sqrt(root))) - 0.055, 12.92 * x, x <= vec3f(0.0031308));
}

// x^2.4 = x² · (x^(1/5))².
fn srgb_decode(x: vec3f) -> vec3f {
    let base = (max(x, vec3f(0.04045)) + 0.055) / 1.055;
    let power = base * fifth_root(base);
    return select(power * power, x / 12.92, x <= vec3f(0.04045));
}
