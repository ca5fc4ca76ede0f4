// The temporal resolve: dilate, reproject and filter history, box, rectify, weight, blend, store, show.
// Every block is chosen by an override named like the recipe's parameter (src/taa/recipe.rs), so a pipeline holds only
// the code its recipe needs. CPU twin: src/taa/reference/mod.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

override domain: u32;
override space: u32;
override dilation: u32;
override input_filter: u32;
override history_filter: u32;
override deringing: bool;
override neighbourhood: u32;
override unjitter_neighbourhood: bool;
override variance_window: u32;
override variance_gamma: f32;
override intersect_minmax: bool;
override rectify: u32;
override weight: u32;
override current_weight: f32;
override luma_feedback_lo: f32;
override luma_feedback_hi: f32;
override motion_weight: bool;
override motion_weight_from_px: f32;
override motion_weight_to_px: f32;
override hdr_weight: u32;
override motion_blur: bool;

struct Frame {
    // Separable weights of the 3×3 input filter at this frame's jitter; each axis sums to 1.
    input_weights_x: vec3f,
    input_weights_y: vec3f,
    // Texel (x, y) holds the scene at (x, y) + 0.5 + jitter_px; y down.
    jitter_px: vec2f,
    // 0 in the first frame and after a reset.
    has_history: u32,
}

// Current colour in the working domain, repaired.
@group(0) @binding(0) var color: texture_2d<f32>;
@group(0) @binding(1) var depth: texture_2d<f32>;
@group(0) @binding(2) var motion: texture_2d<f32>;
@group(0) @binding(3) var history: texture_2d<f32>;
@group(0) @binding(4) var next_history: HistoryStore;
// Linear RGB, after the output stage; never fed back.
@group(0) @binding(5) var shown: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var<uniform> frame: Frame;

const DILATION_NONE: u32 = 0u;
const DILATION_CLOSEST: u32 = 1u;
const DILATION_LONGEST: u32 = 2u;

const INPUT_TEXEL: u32 = 0u;
const INPUT_UNJITTER: u32 = 1u;
const INPUT_BLACKMAN_HARRIS: u32 = 2u;

const HISTORY_NONE: u32 = 0u;
const HISTORY_TEXEL: u32 = 1u;
const HISTORY_BILINEAR: u32 = 2u;
const HISTORY_CATMULL_ROM: u32 = 3u;
const HISTORY_CATMULL_ROM_5: u32 = 4u;

const WEIGHT_FIXED: u32 = 0u;
const WEIGHT_LUMA_FEEDBACK: u32 = 1u;
const WEIGHT_ANTIFLICKER: u32 = 2u;

const HDR_WEIGHT_KARIS: u32 = 1u;

// Texel offset of the i-th of 3×3: the centre first, then row by row, so that ties keep the first.
fn ring_offset(i: i32) -> vec2i {
    let n = select(i, 4, i == 0) - select(0, 1, i > 0 && i <= 4);
    return vec2i(n % 3, n / 3) - 1;
}

fn clamped(p: vec2i) -> vec2i {
    return clamp(p, vec2i(0), vec2i(textureDimensions(color)) - 1);
}

// Non-finite or non-positive depth is sky. Positive finite floats are the bit patterns 1 to 0x7f7fffff.
fn view_depth(p: vec2i) -> f32 {
    let z = textureLoad(depth, clamped(p), 0).r;
    return select(SKY_DEPTH, z, bitcast<u32>(z) - 1u < 0x7f7fffffu);
}
const SKY_DEPTH: f32 = 1e10;

struct Motion {
    px: vec2f,
    // False for a non-finite vector, or one longer than four images: the loader's or the engine's mistake.
    valid: bool,
    // |px|², 0 where invalid.
    length2: f32,
}

fn motion_at(p: vec2i) -> Motion {
    let px = textureLoad(motion, clamped(p), 0).rg;
    let size = textureDimensions(color);
    let longest = 4.0 * f32(max(size.x, size.y));
    // Compared as bits, which orders NaN and infinity above every finite length.
    let bits = bitcast<vec2u>(px) & vec2u(0x7fffffffu);
    let length2 = dot(px, px);
    let valid = max(bits.x, bits.y) <= bitcast<u32>(longest) && length2 <= longest * longest;
    return Motion(px, valid, select(0.0, length2, valid));
}

fn dilated_motion(p: vec2i) -> Motion {
    var best = 0;
    if (dilation == DILATION_CLOSEST) {
        var nearest = view_depth(p);
        for (var i = 1; i < 9; i++) {
            let z = view_depth(p + ring_offset(i));
            best = select(best, i, z < nearest);
            nearest = min(nearest, z);
        }
    }
    if (dilation == DILATION_LONGEST) {
        var longest = motion_at(p).length2;
        for (var i = 1; i < 9; i++) {
            let length2 = motion_at(p + ring_offset(i)).length2;
            best = select(best, i, length2 > longest);
            longest = max(longest, length2);
        }
    }
    return motion_at(p + ring_offset(best));
}

fn current_color(p: vec2i) -> vec3f {
    switch (input_filter) {
        case INPUT_UNJITTER: { return sample_bilinear(color, vec2f(p) + 0.5 - frame.jitter_px); }
        case INPUT_BLACKMAN_HARRIS: {
            var sum = vec3f(0.0);
            for (var i = 0; i < 9; i++) {
                sum += frame.input_weights_x[i % 3] * frame.input_weights_y[i / 3] * fetch(color, p + vec2i(i % 3, i / 3) - 1);
            }
            return sum;
        }
        default: { return fetch(color, p); }
    }
}

fn filtered_history(q: vec2f) -> vec3f {
    var h: vec3f;
    switch (history_filter) {
        case HISTORY_BILINEAR: { return sample_bilinear(history, q); }
        case HISTORY_CATMULL_ROM: { h = sample_catmull_rom(history, q); }
        case HISTORY_CATMULL_ROM_5: { h = sample_catmull_rom_5(history, q); }
        default: { return fetch(history, vec2i(floor(q))); }
    }
    h = max(h, vec3f(0.0));
    if (deringing) {
        h = dering(history, q, h);
    }
    return h;
}

// The weight of the current colour. `rectified` and `current` are RGB; `unrectified` and the box are in `space`.
fn blend_weight(current: vec3f, rectified: vec3f, unrectified: vec3f, bounds: ColorBox, motion_px: f32) -> f32 {
    var a = current_weight;
    if (weight == WEIGHT_LUMA_FEEDBACK) {
        // INSIDE: trust history less where its luma still differs after rectification.
        let l0 = luma(current);
        let l1 = luma(rectified);
        let agreement = 1.0 - abs(l0 - l1) / max(max(l0, l1), 0.2);
        a = 1.0 - mix(luma_feedback_lo, luma_feedback_hi, agreement * agreement);
    }
    if (weight == WEIGHT_ANTIFLICKER) {
        // Karis: blend less where history is about to be clamped, which is where clamping flickers.
        let base = mix(0.04, 0.2, saturate(motion_px / 40.0));
        let lo = box_luma(bounds.lo);
        let hi = box_luma(bounds.hi);
        let l = box_luma(unrectified);
        let to_edge = max(0.0, min(l - lo, hi - l));
        a = min(1.0, base * (1.0 + 3.0 * saturate(2.0 * to_edge / max(hi - lo, 1e-7))));
    }
    if (motion_weight) {
        a = max(a, saturate((motion_px - motion_weight_from_px) / (motion_weight_to_px - motion_weight_from_px)));
    }
    return a;
}

fn box_luma(c: vec3f) -> f32 {
    if (space == SPACE_YCOCG) {
        return c.x;
    }
    return luma(c);
}

fn blend(h: vec3f, current: vec3f, a: f32) -> vec3f {
    if (hdr_weight == HDR_WEIGHT_KARIS) {
        let wh = (1.0 - a) / (1.0 + luma(h));
        let wc = a / (1.0 + luma(current));
        return (h * wh + current * wc) / (wh + wc);
    }
    return mix(h, current, a);
}

// INSIDE: where motion is fast, show the current frame blurred along it instead of a history that cannot keep up.
fn blur_along_motion(p: vec2i, resolved: vec3f, m: Motion) -> vec3f {
    let keep = 1.0 - saturate((sqrt(m.length2) - 2.0) / 13.0);
    if (keep == 1.0) {
        return resolved;
    }
    var sum = vec3f(0.0);
    for (var i = -3; i <= 3; i++) {
        sum += sample_bilinear(color, vec2f(p) + 0.5 - frame.jitter_px + m.px * (f32(i) / 6.0));
    }
    return mix(sum / 7.0, resolved, keep);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(color);
    if (any(id.xy >= size)) {
        return;
    }
    let p = vec2i(id.xy);
    let current = current_color(p);
    var resolved = current;
    var m = Motion();
    if (history_filter != HISTORY_NONE || motion_blur) {
        m = dilated_motion(p);
    }
    if (history_filter != HISTORY_NONE) {
        let q = vec2f(p) + 0.5 + m.px;
        let absent = frame.has_history == 0u || !m.valid || any(q < vec2f(0.0)) || any(q > vec2f(size));
        if (!absent) {
            let unrectified = filtered_history(q);
            var h = unrectified;
            var bounds = ColorBox();
            if (neighbourhood != NEIGHBOURHOOD_NONE) {
                bounds = color_box(p);
                h = from_space(rectified(rectify, to_space(unrectified), to_space(current), bounds, domain));
            }
            let a = blend_weight(current, h, to_space(unrectified), bounds, sqrt(m.length2));
            resolved = blend(h, current, a);
        }
    }
    resolved = min(resolved, vec3f(F16_MAX));
    textureStore(next_history, id.xy, vec4f(round_history(resolved), 1.0));
    if (motion_blur) {
        resolved = blur_along_motion(p, resolved, m);
    }
    textureStore(shown, id.xy, vec4f(from_domain(resolved, domain), 1.0));
}
