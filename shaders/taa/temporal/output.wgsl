// The output stage: what is shown and never fed back. CPU twin: src/taa/reference/output.rs.

const SHARPEN_NONE: u32 = 0u;

// INSIDE: where motion is fast, show the current frame blurred along it instead of a history that cannot keep up.
fn blur_along_motion(p: vec2i, resolved: vec3f, m: Motion) -> vec3f {
    let keep = 1.0 - saturate((sqrt(m.length2) - 2.0) / 13.0);
    if (keep == 1.0) {
        return resolved;
    }
    var sum = vec3f(0.0);
    for (var i = -3; i <= 3; i++) {
        sum += sample_bilinear(color, input_position(vec2f(p) + 0.5 + m.px * (f32(i) / 6.0)) - frame.jitter_px);
    }
    return mix(sum / 7.0, resolved, keep);
}
