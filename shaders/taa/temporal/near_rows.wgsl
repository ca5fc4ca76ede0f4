// What lies beside an invocation's pixels, at most one texel away, read once for all of them: what is below one is beside the
// next. For CPU adapters, where reading the nine is much of what a resolve costs. Stands in for near_cached.wgsl, to the same bits;
// `p` is the pixel that the invocation has come to.

// Three columns of texels, from the one above the first pixel to the one below the last. Every index is a constant once compilers
// have unrolled what uses it, so that they stay in registers.
const N_NEAR: u32 = 3u * (ROWS + 2u);

var<private> near_colors: array<vec3f, N_NEAR>;
var<private> near_depths: array<f32, N_NEAR>;
var<private> near_motions_px: array<vec2f, N_NEAR>;
var<private> near_row: i32;

// By an invocation, before anything else.
fn gather_near(invocation: Invocation) {
    let first = vec2i(pixel_of(invocation, 0u));
    for (var i = 0; i < i32(N_NEAR); i++) {
        let texel = clamped(first + vec2i(i % 3, i / 3) - 1);
        if (looks_beside()) {
            near_colors[i] = textureLoad(color, texel, 0).rgb;
        }
        if (dilation == DILATION_CLOSEST) {
            near_depths[i] = view_depth(texel);
        }
        if (dilation == DILATION_LONGEST) {
            near_motions_px[i] = textureLoad(motion, texel, 0).rg;
        }
    }
}

// To the next pixel.
fn step_down() {
    near_row++;
}

fn index_near(o: vec2i) -> i32 {
    return 3 * (near_row + o.y + 1) + o.x + 1;
}

fn near_color(p: vec2i, o: vec2i) -> vec3f {
    if (looks_beside()) {
        return near_colors[index_near(o)];
    }
    return fetch(color, p + o);
}

fn near_depth(p: vec2i, o: vec2i) -> f32 {
    return near_depths[index_near(o)];
}

fn near_motion_px(p: vec2i, o: vec2i) -> vec2f {
    return near_motions_px[index_near(o)];
}
