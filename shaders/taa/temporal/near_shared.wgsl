// What lies beside a pixel, at most one texel away, from the memory of its workgroup: on a GPU nine reads of a texel cost more
// than all else that a resolve does. Every invocation first brings its share of the texels under and around the group, which is
// GROUP_WIDTH × GROUP_HEIGHT pixels (constants from src/taa/temporal.rs). Stands in for near_cached.wgsl, to the same bits; `p`
// is the invocation's own pixel, and the only one.

// Channels apart: neighbours in x then read neighbouring words, one bank each.
var<workgroup> near_reds: array<f32, (GROUP_WIDTH + 2u) * (GROUP_HEIGHT + 2u)>;
var<workgroup> near_greens: array<f32, (GROUP_WIDTH + 2u) * (GROUP_HEIGHT + 2u)>;
var<workgroup> near_blues: array<f32, (GROUP_WIDTH + 2u) * (GROUP_HEIGHT + 2u)>;
var<workgroup> near_depths: array<f32, (GROUP_WIDTH + 2u) * (GROUP_HEIGHT + 2u)>;
var<workgroup> near_motions_px: array<vec2f, (GROUP_WIDTH + 2u) * (GROUP_HEIGHT + 2u)>;

// The texel before the group's first.
var<private> near_corner: vec2i;

// By all of a workgroup together, before anything else.
fn gather_near(invocation: Invocation) {
    near_corner = vec2i(corner_of(invocation)) - 1;
    let width = GROUP_WIDTH + 2u;
    for (var i = invocation.local; i < width * (GROUP_HEIGHT + 2u); i += GROUP_WIDTH * GROUP_HEIGHT) {
        let texel = clamped(near_corner + vec2i(vec2u(i % width, i / width)));
        if (looks_beside()) {
            let c = textureLoad(color, texel, 0);
            near_reds[i] = c.r;
            near_greens[i] = c.g;
            near_blues[i] = c.b;
        }
        if (dilation == DILATION_CLOSEST) {
            near_depths[i] = view_depth(texel);
        }
        if (dilation == DILATION_LONGEST) {
            near_motions_px[i] = textureLoad(motion, texel, 0).rg;
        }
    }
    workgroupBarrier();
}

fn step_down() {}

fn index_near(p: vec2i, o: vec2i) -> u32 {
    let at = vec2u(p + o - near_corner);
    return at.y * (GROUP_WIDTH + 2u) + at.x;
}

fn near_color(p: vec2i, o: vec2i) -> vec3f {
    if (looks_beside()) {
        let i = index_near(p, o);
        return vec3f(near_reds[i], near_greens[i], near_blues[i]);
    }
    return fetch(color, p + o);
}

fn near_depth(p: vec2i, o: vec2i) -> f32 {
    return near_depths[index_near(p, o)];
}

fn near_motion_px(p: vec2i, o: vec2i) -> vec2f {
    return near_motions_px[index_near(p, o)];
}
