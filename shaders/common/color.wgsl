// Colour spaces and the repair of hostile texels. CPU twin: src/taa/reference/color.rs.

// The largest finite f16, and its bits as f32: nothing larger is ever stored.
const F16_MAX: f32 = 65504.0;
const F16_MAX_BITS: u32 = 0x477fe000u;

const SPACE_RGB: u32 = 0u;
const SPACE_YCOCG: u32 = 1u;

// Rec. 709 luma, always of RGB.
fn luma(rgb: vec3f) -> f32 {
    return dot(rgb, vec3f(0.2126, 0.7152, 0.0722));
}

fn rgb_to_ycocg(c: vec3f) -> vec3f {
    return vec3f(
        0.25 * c.r + 0.5 * c.g + 0.25 * c.b,
        0.5 * c.r - 0.5 * c.b,
        -0.25 * c.r + 0.5 * c.g - 0.25 * c.b,
    );
}

fn ycocg_to_rgb(c: vec3f) -> vec3f {
    return vec3f(c.x + c.y - c.z, c.x + c.z, c.x - c.y - c.z);
}

fn max3(c: vec3f) -> f32 {
    return max(c.r, max(c.g, c.b));
}

// Hostile: NaN, infinite, negative or above F16_MAX. Floats of one sign order like their bits, so one unsigned
// comparison finds all four; min, max and x != x hide a NaN from some drivers. -0 is not hostile.
fn is_hostile(x: f32) -> bool {
    let bits = bitcast<u32>(x);
    return bits > F16_MAX_BITS && bits != 0x80000000u;
}

// NaN, negatives and -Inf become 0; +Inf and what is above F16_MAX become F16_MAX.
fn repair(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let too_large = bits > F16_MAX_BITS && bits <= 0x7f800000u;
    return select(select(x, 0.0, is_hostile(x)), F16_MAX, too_large);
}

fn any_hostile(c: vec3f) -> bool {
    return is_hostile(c.r) || is_hostile(c.g) || is_hostile(c.b);
}

fn repaired(c: vec3f) -> vec3f {
    return vec3f(repair(c.r), repair(c.g), repair(c.b));
}
