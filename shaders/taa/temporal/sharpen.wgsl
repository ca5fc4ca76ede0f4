// The output stage where it looks at neighbours of the resolved image: sharpens, then blurs along fast motion.
// CPU twin: src/taa/reference/output.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// In the working domain, not rounded. Alpha is the share of history, which goes on as it is.
@group(0) @binding(10) var resolved: texture_2d<f32>;
@group(0) @binding(11) var shown: texture_storage_2d<rgba32float, write>;

const SHARPEN_XU: u32 = 1u;
const SHARPEN_NORMALISED: u32 = 2u;
const SHARPEN_RCAS: u32 = 3u;

fn sharpened(p: vec2i) -> vec3f {
    let c = fetch(resolved, p);
    let n = fetch(resolved, p + vec2i(0, -1));
    let w = fetch(resolved, p + vec2i(-1, 0));
    let e = fetch(resolved, p + vec2i(1, 0));
    let s = fetch(resolved, p + vec2i(0, 1));
    let ring = n + w + e + s;
    switch (sharpen) {
        case SHARPEN_XU: { return c + sharpen_strength * (4.0 * c - ring); }
        case SHARPEN_NORMALISED: { return c + sharpen_strength * (c - 0.25 * ring); }
        case SHARPEN_RCAS: {
            let lo = min(c, min(min(n, w), min(e, s)));
            let hi = max(c, max(max(n, w), max(e, s)));
            let lobe = sharpen_strength * contrast_limited_lobe(lo, hi);
            return (c + lobe * ring) / (1.0 + 4.0 * lobe);
        }
        default: { return c; }
    }
}

// The most negative weight of a neighbour that keeps every channel of (c + lobe Σ) / (1 + 4 lobe) within 0 to 1, whatever
// the five texels are between `lo` and `hi`; at most 3/16. The idea of AMD's Robust Contrast Adaptive Sharpening.
fn contrast_limited_lobe(lo: vec3f, hi: vec3f) -> f32 {
    let stays_positive = lo / max(4.0 * hi, vec3f(1e-7));
    let stays_below_one = (1.0 - hi) / max(4.0 * (1.0 - lo), vec3f(1e-7));
    let limit = min(stays_positive, stays_below_one);
    return -clamp(min(limit.r, min(limit.g, limit.b)), 0.0, 0.1875);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(invocation: Invocation) {
    for (var row = 0u; row < ROWS; row++) {
        sharpen_pixel(pixel_of(invocation, row));
    }
}

fn sharpen_pixel(id: vec2u) {
    if (any(id >= textureDimensions(shown))) {
        return;
    }
    let p = vec2i(id);
    var c = max(sharpened(p), vec3f(0.0));
    if (domain == DOMAIN_TONEMAPPED) {
        c = min(c, vec3f(TONEMAPPED_MAX));
    }
    if (domain == DOMAIN_DISPLAY) {
        c = saturate(c);
    }
    if (motion_blur) {
        c = blur_along_motion(p, c, dilated_motion(p));
    }
    textureStore(shown, id, vec4f(from_domain(c, domain), textureLoad(resolved, p, 0).a));
}
