// Rectification: history against the colour box of the current neighbourhood. CPU twin: src/taa/reference/rectify.rs.

struct ColorBox {
    lo: vec3f,
    hi: vec3f,
    mean: vec3f,
}

const RECTIFY_NONE: u32 = 0u;
const RECTIFY_CLAMP: u32 = 1u;
const RECTIFY_CLIP_CENTRE: u32 = 2u;
const RECTIFY_CLIP_CURRENT: u32 = 3u;

// The smallest half extent a box is given per channel: below f16's own step, the rounding of history in one flat channel
// would throw it outside and so collapse all three onto the centre.
fn smallest_half_extent(centre: vec3f, domain: u32, guarded: bool) -> vec3f {
    if (!guarded) {
        return vec3f(0.0);
    }
    if (domain == DOMAIN_LINEAR) {
        return 0x1p-11 * max(centre, vec3f(1.0));
    }
    return vec3f(0x1p-11);
}

// Pulls `history` towards the box centre until it is inside, keeping its direction from the centre.
// Clamping each channel is cheaper but shifts hue when one channel leaves the box first.
// Pedersen, "Temporal Reprojection Anti-Aliasing in INSIDE", GDC 2016.
fn clip_centre(history: vec3f, bounds: ColorBox, domain: u32, guarded: bool) -> vec3f {
    let centre = 0.5 * (bounds.lo + bounds.hi);
    let half_extent = max(0.5 * (bounds.hi - bounds.lo), smallest_half_extent(centre, domain, guarded));
    let offset = history - centre;
    let u = max3(abs(offset) / half_extent);
    return select(history, centre + offset / u, u > 1.0);
}

// How far each channel of `c` lies outside the box; 0 within rounding of it. Without the allowance, a channel that is
// flat but for the last bit would drag all three the whole way, on one adapter and not on the next.
fn beyond(c: vec3f, bounds: ColorBox, guarded: bool) -> vec3f {
    let excess = c - clamp(c, bounds.lo, bounds.hi);
    let rounding = 0x1p-20 * max(vec3f(1.0), max(abs(bounds.lo), abs(bounds.hi)));
    return select(vec3f(0.0), excess, abs(excess) > select(vec3f(0.0), rounding, guarded));
}

// The point nearest to `history` inside the box on the segment that ends at the current colour, or at the box's mean
// where the current colour is itself outside (a variance box can exclude it).
// Salvi, "An Excursion in Temporal Supersampling", GDC 2016.
fn clip_current(history: vec3f, current: vec3f, bounds: ColorBox, guarded: bool) -> vec3f {
    let end = select(bounds.mean, current, all(beyond(current, bounds, guarded) == vec3f(0.0)));
    let direction = end - history;
    // How far each channel must travel. One that is inside need not, and only there can its direction be 0.
    let excess = beyond(history, bounds, guarded);
    let travel = select(-excess / direction, vec3f(0.0), excess == vec3f(0.0));
    return clamp(history + direction * saturate(max3(travel)), bounds.lo, bounds.hi);
}

// `history`, `current` and the box share one colour space. `guarded`: with what keeps flat boxes from collapsing colours.
fn rectified(kind: u32, history: vec3f, current: vec3f, bounds: ColorBox, domain: u32, guarded: bool) -> vec3f {
    switch (kind) {
        case RECTIFY_CLAMP: { return clamp(history, bounds.lo, bounds.hi); }
        case RECTIFY_CLIP_CENTRE: { return clip_centre(history, bounds, domain, guarded); }
        case RECTIFY_CLIP_CURRENT: { return clip_current(history, current, bounds, guarded); }
        default: { return history; }
    }
}
