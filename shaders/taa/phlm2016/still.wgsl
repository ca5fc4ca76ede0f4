// Whether anything moves: a frame without motion shows a running mean instead of the model.
// Iglesias-Guitian et al., "Pixel History Linear Models for Real-Time Temporal Filtering", 2016, 5.2.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var<storage, read_write> moves: atomic<u32>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let m = motion_at(vec2i(id.xy));
    if (!m.valid || any(m.px != vec2f(0.0))) {
        atomicStore(&moves, 1u);
    }
}
