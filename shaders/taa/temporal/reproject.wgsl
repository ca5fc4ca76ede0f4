// Where a pixel's surface was in the previous frame, and whether history can be trusted there. CPU twin:
// src/taa/reference/reproject.rs.

const DILATION_NONE: u32 = 0u;
const DILATION_CLOSEST: u32 = 1u;
const DILATION_LONGEST: u32 = 2u;

// Texel offset of the i-th of 3×3: the centre first, then row by row, so that ties keep the first.
fn ring_offset(i: i32) -> vec2i {
    let n = select(i, 4, i == 0) - select(0, 1, i > 0 && i <= 4);
    return vec2i(n % 3, n / 3) - 1;
}

fn clamped(p: vec2i) -> vec2i {
    return clamp(p, vec2i(0), vec2i(textureDimensions(color)) - 1);
}

const SKY_DEPTH: f32 = 1e10;

// Non-finite or non-positive depth is sky. Positive finite floats are the bit patterns 1 to 0x7f7fffff.
fn depth_or_sky(z: f32) -> f32 {
    return select(SKY_DEPTH, z, bitcast<u32>(z) - 1u < 0x7f7fffffu);
}

fn view_depth(p: vec2i) -> f32 {
    return depth_or_sky(textureLoad(depth, clamped(p), 0).r);
}

fn previous_view_depth(p: vec2i) -> f32 {
    return depth_or_sky(textureLoad(previous_depth, clamped(p), 0).r);
}

fn object_id_at(p: vec2i) -> u32 {
    return textureLoad(object_id, clamp(p, vec2i(0), vec2i(textureDimensions(object_id)) - 1), 0).r;
}

struct Motion {
    // The texel whose vector it is.
    texel: vec2i,
    px: vec2f,
    // False for a non-finite vector, or one longer than four images: the loader's or the engine's mistake.
    valid: bool,
    // |px|², 0 where invalid.
    length2: f32,
}

fn motion_at(p: vec2i) -> Motion {
    return motion_of(p, textureLoad(motion, clamped(p), 0).rg);
}

fn motion_of(p: vec2i, px: vec2f) -> Motion {
    let size = textureDimensions(color);
    let longest = 4.0 * f32(max(size.x, size.y));
    // Compared as bits, which orders NaN and infinity above every finite length.
    let bits = bitcast<vec2u>(px) & vec2u(0x7fffffffu);
    let length2 = dot(px, px);
    let valid = max(bits.x, bits.y) <= bitcast<u32>(longest) && length2 <= longest * longest;
    return Motion(p, px, valid, select(0.0, length2, valid));
}

// For an output pixel, in output pixels.
fn dilated_motion(output_pixel: vec2i) -> Motion {
    let p = input_texel(output_pixel);
    var best = 0;
    if (dilation == DILATION_CLOSEST) {
        var nearest = near_depth(p, vec2i(0));
        for (var i = 1; i < 9; i++) {
            let z = near_depth(p, ring_offset(i));
            best = select(best, i, z < nearest);
            nearest = min(nearest, z);
        }
    }
    if (dilation == DILATION_LONGEST) {
        var longest = motion_of(p, near_motion_px(p, vec2i(0))).length2;
        for (var i = 1; i < 9; i++) {
            let length2 = motion_of(p, near_motion_px(p, ring_offset(i))).length2;
            best = select(best, i, length2 > longest);
            longest = max(longest, length2);
        }
    }
    return on_output(motion_at(p + ring_offset(best)));
}

fn on_output(m: Motion) -> Motion {
    if (!upsamples()) {
        return m;
    }
    let px = m.px * scale();
    return Motion(m.texel, px, m.valid, select(0.0, dot(px, px), m.valid));
}

struct Reprojection {
    // Position in the previous frame; pixels, texel centres at +0.5.
    q: vec2f,
    motion: Motion,
    // False where history is absent.
    has_history: bool,
}

fn reprojected(p: vec2i) -> Reprojection {
    if (!reproject) {
        return Reprojection(vec2f(p) + 0.5, Motion(), frame.has_history != 0u);
    }
    return reprojected_by(p, dilated_motion(p));
}

// Where `m` leads from the output pixel `p`.
fn reprojected_by(p: vec2i, m: Motion) -> Reprojection {
    let q = vec2f(p) + 0.5 + m.px;
    let is_outside = any(q < vec2f(0.0)) || any(q > frame.output_size);
    var has_history = frame.has_history != 0u && m.valid && !is_outside;
    if (reject_depth && has_history) {
        has_history = depth_fits(m.texel, q);
    }
    if (reject_id && has_history) {
        let before = clamped(vec2i(floor(input_position(q))));
        has_history = object_id_at(input_texel(p)) == textureLoad(previous_object_id, before, 0).r;
    }
    return Reprojection(q, m, has_history);
}

// Whether one of the four previous depths around `q` is that of the surface at `texel`.
fn depth_fits(texel: vec2i, q: vec2f) -> bool {
    let expected = view_depth(texel);
    let corner = vec2i(floor(input_position(q) - 0.5));
    var error = abs(expected - previous_view_depth(corner));
    error = min(error, abs(expected - previous_view_depth(corner + vec2i(1, 0))));
    error = min(error, abs(expected - previous_view_depth(corner + vec2i(0, 1))));
    error = min(error, abs(expected - previous_view_depth(corner + vec2i(1, 1))));
    return error <= reject_depth_tolerance * expected;
}

// The motion that carries history to `p`, in pixels; 0 where it is unusable.
fn usable_motion(p: vec2i) -> vec2f {
    let m = reprojected(p).motion;
    return select(vec2f(0.0), m.px, m.valid);
}
