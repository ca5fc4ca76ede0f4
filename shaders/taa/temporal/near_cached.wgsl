// What lies beside a pixel, at most one texel away, read where it is wanted: in passes that look farther, or not at all.

fn gather_near(invocation: Invocation) {}

fn step_down() {}

fn near_color(p: vec2i, o: vec2i) -> vec3f {
    return fetch(color, p + o);
}

fn near_depth(p: vec2i, o: vec2i) -> f32 {
    return view_depth(p + o);
}

fn near_motion_px(p: vec2i, o: vec2i) -> vec2f {
    return textureLoad(motion, clamped(p + o), 0).rg;
}
