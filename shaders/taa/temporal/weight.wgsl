// How much the current colour counts in the blend. From 20 on are bindings of its own.
// CPU twin: src/taa/reference/weight.rs.

@group(0) @binding(20) var reactive_mask: texture_2d<f32>;
@group(0) @binding(21) var difference_rows: texture_2d<f32>;

const WEIGHT_FIXED: u32 = 0u;
const WEIGHT_LUMA_FEEDBACK: u32 = 1u;
const WEIGHT_ANTIFLICKER: u32 = 2u;
const WEIGHT_COUNT: u32 = 3u;
const WEIGHT_AMORTIZED: u32 = 4u;

const HDR_WEIGHT_KARIS: u32 = 1u;

// The weight of the current colour. `rectified` and `current` are RGB; `unrectified` and the box are in `space`.
fn blend_weight(p: vec2i, current: vec3f, rectified: vec3f, unrectified: vec3f, bounds: ColorBox, m: Motion, n: f32) -> f32 {
    let motion_px = sqrt(m.length2);
    var a = current_weight;
    switch (weight) {
        case WEIGHT_LUMA_FEEDBACK: { a = luma_feedback(luma(current), luma(rectified)); }
        case WEIGHT_ANTIFLICKER: {
            a = antiflicker(box_luma(bounds.lo), box_luma(bounds.hi), box_luma(unrectified), motion_px);
        }
        case WEIGHT_COUNT: { a = max(1.0 / n, count_weight_min); }
        case WEIGHT_AMORTIZED: { a = amortized(p, m.px, n); }
        default: {}
    }
    a *= confidence(p);
    if (reactive) {
        a = max(a, reactive_at(input_texel(p)));
    }
    if (motion_weight) {
        a = max(a, saturate((motion_px - motion_weight_from_px) / (motion_weight_to_px - motion_weight_from_px)));
    }
    return a;
}

// INSIDE: trust history less where its luma still differs after rectification.
fn luma_feedback(l0: f32, l1: f32) -> f32 {
    let agreement = 1.0 - abs(l0 - l1) / max(max(l0, l1), 0.2);
    return 1.0 - mix(luma_feedback_lo, luma_feedback_hi, agreement * agreement);
}

// Karis: blend less where history is about to be clamped, which is where clamping flickers.
fn antiflicker(lo: f32, hi: f32, l: f32, motion_px: f32) -> f32 {
    let base = mix(0.04, 0.2, saturate(motion_px / 40.0));
    let to_edge = max(0.0, min(l - lo, hi - l));
    return min(1.0, base * (1.0 + 3.0 * saturate(2.0 * to_edge / max(hi - lo, select(0.0, 1e-7, guards)))));
}

// Yang et al. 2009: shorter histories where they differ from the present on average, and where the fraction of the motion
// makes bilinear resampling blur. `difference_rows` holds means over rows of 7; averaging 7 of them makes 7×7.
fn amortized(p: vec2i, motion_px: vec2f, n: f32) -> f32 {
    var sum = vec3f(0.0);
    for (var y = -3; y <= 3; y++) {
        sum += fetch(difference_rows, p + vec2i(0, y));
    }
    let difference = max3(abs(sum / 7.0));
    let f = fract(motion_px);
    let blur = 0.5 * dot(f, 1.0 - f);
    return max(1.0 / n, max(saturate(1.0 - 0.05 / max(difference, select(0.0, 1e-6, guards))), blur / (blur + 0.5)));
}

// Within 0 to 1; what is not finite counts as 0.
fn reactive_at(p: vec2i) -> f32 {
    let bits = bitcast<u32>(textureLoad(reactive_mask, p, 0).r);
    return select(0.0, saturate(bitcast<f32>(bits)), (bits & 0x7fffffffu) < 0x7f800000u);
}

fn counts_samples() -> bool {
    return weight == WEIGHT_COUNT || weight == WEIGHT_AMORTIZED;
}

fn box_luma(c: vec3f) -> f32 {
    if (space == SPACE_YCOCG) {
        return c.x;
    }
    return luma(c);
}

// And the share of history in it.
fn blend(h: vec3f, current: vec3f, a: f32) -> vec4f {
    if (hdr_weight == HDR_WEIGHT_KARIS) {
        let wh = (1.0 - a) / (1.0 + luma(h));
        let wc = a / (1.0 + luma(current));
        return vec4f((h * wh + current * wc) / (wh + wc), wh / (wh + wc));
    }
    return vec4f(lerp(h, current, a), 1.0 - a);
}
