// Several samples, or layers, of each pixel made one before anything else reads the frame. Samples: the mean of their colours,
// and the motion of the one that moves farthest, because a silhouette moves with what passes. Layers, front to back: each over
// what lies behind it, and the motion of the one that takes most of the light. Depth is that of the same.
// Salvi, "An Excursion in Temporal Supersampling", GDC 2016. CPU twin: src/taa/reference/merge.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// Instead of samples.
override layered: bool;
// Colours are multiplied by their layer's opacity already.
override premultiplied: bool;
override with_motion: bool;
override with_depth: bool;

// One layer of the array for each sample or layer; of motion and depth one in all, where they share it.
@group(0) @binding(0) var item_colors: texture_2d_array<f32>;
@group(0) @binding(1) var item_opacities: texture_2d_array<f32>;
@group(0) @binding(2) var item_motions: texture_2d_array<f32>;
@group(0) @binding(3) var item_depths: texture_2d_array<f32>;
// Linear RGB; in alpha 0 where something had to be repaired, which `prepare` counts.
@group(0) @binding(4) var merged_color: texture_storage_2d<rgba32float, write>;
// Finite: what cannot be used is longer than any image.
@group(0) @binding(5) var merged_motion: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var merged_depth: texture_storage_2d<r32float, write>;

const UNUSABLE_PX: f32 = 1e30;
const SKY_DEPTH: f32 = 1e10;

fn motion_of(item: i32, p: vec2i) -> vec2f {
    return textureLoad(item_motions, p, min(item, i32(textureNumLayers(item_motions)) - 1), 0).rg;
}

fn depth_of(item: i32, p: vec2i) -> f32 {
    let z = textureLoad(item_depths, p, min(item, i32(textureNumLayers(item_depths)) - 1), 0).r;
    return select(SKY_DEPTH, z, bitcast<u32>(z) - 1u < 0x7f7fffffu);
}

// Compared as bits, which orders NaN and infinity above every finite length.
fn is_usable(px: vec2f) -> bool {
    let size = textureDimensions(item_colors);
    let longest = 4.0 * f32(max(size.x, size.y));
    let bits = bitcast<vec2u>(px) & vec2u(0x7fffffffu);
    return max(bits.x, bits.y) <= bitcast<u32>(longest) && dot(px, px) <= longest * longest;
}

// Within 0 to 1; NaN is 0.
fn repaired_opacity(a: f32) -> f32 {
    return select(clamp(a, 0.0, 1.0), 0.0, (bitcast<u32>(a) & 0x7fffffffu) > 0x7f800000u);
}

// Negative ones have the sign bit, and so the larger bits; -0 is none of them.
fn is_hostile_opacity(a: f32) -> bool {
    let bits = bitcast<u32>(a);
    return bits > 0x3f800000u && bits != 0x80000000u;
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(merged_color))) {
        return;
    }
    let p = vec2i(id.xy);
    let n = i32(textureNumLayers(item_colors));
    var sum = vec3f(0.0);
    var transmittance = 1.0;
    var is_clean = 1.0;
    var kept = 0;
    var best = -1.0;
    for (var i = 0; i < n; i++) {
        let raw = textureLoad(item_colors, p, i, 0).rgb;
        var hostile = any_hostile(raw);
        var score = 0.0;
        if (layered) {
            let opacity = textureLoad(item_opacities, p, i, 0).r;
            hostile = hostile || is_hostile_opacity(opacity);
            score = transmittance * repaired_opacity(opacity);
            sum += repaired(raw) * select(score, transmittance, premultiplied);
            transmittance *= 1.0 - repaired_opacity(opacity);
        } else {
            sum += repaired(raw);
            if (with_motion) {
                let m = motion_of(i, p);
                score = select(0.0, dot(m, m), is_usable(m));
            }
        }
        is_clean = select(is_clean, 0.0, hostile);
        kept = select(kept, i, score > best);
        best = max(best, score);
    }
    if (!layered) {
        sum /= f32(n);
    }
    textureStore(merged_color, id.xy, vec4f(min(sum, vec3f(F16_MAX)), is_clean));
    if (with_motion) {
        let m = motion_of(kept, p);
        textureStore(merged_motion, id.xy, vec4f(select(vec2f(UNUSABLE_PX), m, is_usable(m)), 0.0, 0.0));
    }
    if (with_depth) {
        textureStore(merged_depth, id.xy, vec4f(depth_of(kept, p)));
    }
}
