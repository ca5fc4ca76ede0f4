// The temporal resolve: dilate, reproject and filter history, box, rectify, weight, blend, store, show.
// CPU twin: src/taa/reference/mod.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var next_history: HistoryStore;
// Linear RGB, after the output stage; where a pass for sharpening follows, what that needs: the working domain's colour. Alpha
// is the share of history in the blend, which only who looks at it reads.
@group(0) @binding(11) var shown: texture_storage_2d<rgba32float, write>;
// How many samples each pixel of history holds.
@group(0) @binding(12) var n_samples: texture_2d<f32>;
@group(0) @binding(13) var next_n_samples: texture_storage_2d<r32float, write>;

// History, `unrectified` as it was read at `at`, rectified and blended with `current`; `n` samples with this one. Alpha is the
// share of history.
fn accumulated(p: vec2i, at: Reprojection, unrectified: vec3f, current: vec3f, n: f32) -> vec4f {
    var h = unrectified;
    var bounds = ColorBox();
    if (neighbourhood != NEIGHBOURHOOD_NONE) {
        bounds = color_box(p, current, at);
        h = from_space(rectified(rectify, to_space(unrectified), to_space(current), bounds, domain, guards));
    }
    return blend(h, current, blend_weight(p, current, h, to_space(unrectified), bounds, at.motion, n));
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(invocation: Invocation) {
    gather_near(invocation);
    resolve(pixel_of(invocation, 0u));
    // No loop: with one around so much code lavapipe takes a third longer.
    if (ROWS == 2u) {
        step_down();
        resolve(pixel_of(invocation, 1u));
    }
}

fn resolve(id: vec2u) {
    if (any(id >= textureDimensions(shown))) {
        return;
    }
    let p = vec2i(id);
    var at = Reprojection();
    if (history_filter != HISTORY_NONE || motion_blur && sharpen == SHARPEN_NONE) {
        at = reprojected(p);
    }
    let has_history = history_filter != HISTORY_NONE && at.has_history;
    let current = current_color(p, has_history);
    var resolved = current;
    var history_share = 0.0;
    var n = 1.0;
    if (has_history) {
        if (counts_samples()) {
            n += fetch(n_samples, vec2i(floor(at.q))).r;
        }
        let blended = accumulated(p, at, filtered_history(at.q), current, n);
        resolved = blended.rgb;
        history_share = blended.a;
    }
    resolved = saturated(resolved);
    if (history_filter != HISTORY_NONE) {
        textureStore(next_history, id, vec4f(round_history(resolved), 1.0));
    }
    if (counts_samples()) {
        textureStore(next_n_samples, id, vec4f(n));
    }
    if (sharpen == SHARPEN_NONE) {
        if (motion_blur) {
            resolved = blur_along_motion(p, resolved, at.motion);
        }
        resolved = from_domain(resolved, domain);
    }
    textureStore(shown, id, vec4f(resolved, history_share));
}
