// How a recipe reads the current colour and history. CPU twin: src/taa/reference/{mod,sampling}.rs.

const INPUT_TEXEL: u32 = 0u;
const INPUT_UNJITTER: u32 = 1u;
const INPUT_BLACKMAN_HARRIS: u32 = 2u;
const INPUT_UPSAMPLE: u32 = 3u;

const HISTORY_NONE: u32 = 0u;
const HISTORY_TEXEL: u32 = 1u;
const HISTORY_BILINEAR: u32 = 2u;
const HISTORY_CATMULL_ROM: u32 = 3u;
const HISTORY_CATMULL_ROM_5: u32 = 4u;
const HISTORY_BFECC: u32 = 5u;
const HISTORY_QUASI_CUBIC: u32 = 6u;

// What `bfecc` and `quasi_cubic` make of history before it is sampled. From 25 on are bindings of this file's own.
@group(0) @binding(25) var prefiltered: texture_2d<f32>;

fn current_color(p: vec2i, has_history: bool) -> vec3f {
    switch (input_filter) {
        case INPUT_UNJITTER: { return sample_bilinear(color, vec2f(p) + 0.5 - frame.jitter_px); }
        case INPUT_BLACKMAN_HARRIS: {
            // Differences from the centre are weighted, so that a flat colour comes out exactly, whatever the jitter.
            let centre = near_color(p, vec2i(0));
            var sum = vec3f(0.0);
            for (var i = 0; i < 9; i++) {
                let c = near_color(p, vec2i(i % 3, i / 3) - 1);
                sum += frame.input_weights_x[i % 3] * frame.input_weights_y[i / 3] * (c - centre);
            }
            return centre + sum;
        }
        case INPUT_UPSAMPLE: { return upsampled(p, has_history); }
        default: { return near_color(p, vec2i(0)); }
    }
}

fn filtered_history(q: vec2f) -> vec3f {
    var h: vec3f;
    switch (history_filter) {
        case HISTORY_BILINEAR: { return sample_bilinear(history, q); }
        case HISTORY_CATMULL_ROM: { h = sample_catmull_rom(history, q); }
        case HISTORY_CATMULL_ROM_5: { h = sample_catmull_rom_5(history, q); }
        case HISTORY_BFECC: { h = sample_bilinear(prefiltered, q); }
        case HISTORY_QUASI_CUBIC: { h = sample_quasi_cubic(prefiltered, q); }
        default: { return fetch(history, vec2i(floor(q))); }
    }
    h = max(h, vec3f(0.0));
    if (deringing) {
        h = dering(history, q, h);
    }
    return h;
}
