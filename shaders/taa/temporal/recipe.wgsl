// What every pass of a recipe sees: the recipe's parameters, each an override of the same name (src/taa/recipe.rs), so that
// a pipeline holds only the code its recipe needs; and the frame. Passes bind what is their own from 10 on.

override phlm_printed: bool;
override domain: u32;
override spatial_decodes: bool;
override space: u32;
override dilation: u32;
override input_filter: u32;
override history_filter: u32;
override reproject: bool;
override deringing: bool;
override neighbourhood: u32;
override chroma_from_luma: bool;
override unjitter_neighbourhood: bool;
override variance_window: u32;
override variance_gamma: f32;
override prefilter_moments: bool;
override intersect_minmax: bool;
override rectify: u32;
override reject_depth: bool;
override reject_depth_tolerance: f32;
override reject_id: bool;
override weight: u32;
override current_weight: f32;
override luma_feedback_lo: f32;
override luma_feedback_hi: f32;
override count_weight_min: f32;
override reactive: bool;
override motion_weight: bool;
override motion_weight_from_px: f32;
override motion_weight_to_px: f32;
override hdr_weight: u32;
override sharpen: u32;
override sharpen_strength: f32;
override motion_blur: bool;
// Off: the literal formulas, without what keeps them finite and bounded.
override guards: bool;

struct Frame {
    // Separable weights of the 3×3 input filter at this frame's jitter; each axis sums to 1.
    input_weights_x: vec3f,
    input_weights_y: vec3f,
    // Texel (x, y) holds the scene at (x, y) + 0.5 + jitter_px; y down.
    jitter_px: vec2f,
    // 0 in the first frame and after a reset.
    has_history: u32,
    // Distance of the far plane in units of depth, finite.
    far: f32,
    // Of history and of what is shown, pixels; that of color unless the recipe upsamples.
    output_size: vec2f,
    // Where the frame is a checkerboard, x + y is even (0) or odd (1) in the texels that were shaded.
    parity: u32,
}

// Current colour in the working domain, repaired; in alpha the luma of the unlit colour, for recipes that read it.
@group(0) @binding(0) var color: texture_2d<f32>;
@group(0) @binding(1) var depth: texture_2d<f32>;
@group(0) @binding(2) var previous_depth: texture_2d<f32>;
@group(0) @binding(3) var object_id: texture_2d<u32>;
@group(0) @binding(4) var previous_object_id: texture_2d<u32>;
@group(0) @binding(5) var motion: texture_2d<f32>;
@group(0) @binding(6) var<uniform> frame: Frame;
@group(0) @binding(7) var history: texture_2d<f32>;

// What is stored saturates: neither it nor a sum of it overflows.
fn saturated(c: vec3f) -> vec3f {
    if (!guards) {
        return c;
    }
    return min(c, vec3f(F16_MAX));
}
