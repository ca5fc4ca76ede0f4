// Structural similarity summed over 16×16 windows by the class of the pixel in their middle, the f32 twin of
// src/metrics/ssim.rs, which derives the form in S = T + R and D = T − R. A workgroup reads the 26×26 pixels under its
// windows once, filters their columns, then rows.

const TILE: u32 = 16u;
const GROUP: u32 = TILE * TILE;
const HALF: u32 = 5u;
const INPUT: u32 = TILE + 2u * HALF;

// Which values are compared: see `Domain` in src/metrics/quantity.rs.
const DISPLAY: u32 = 0u;
const LUMA: u32 = 1u;
const U8: u32 = 2u;
override values: u32;

// What is compared: see `Part` in src/metrics/ssim.rs.
const WHOLE: u32 = 0u;
override part: u32;

// The window's weights by distance from its centre, and the constants of the index.
override w0: f32;
override w1: f32;
override w2: f32;
override w3: f32;
override w4: f32;
override w5: f32;
override c1: f32;
override c2: f32;

@group(0) @binding(0) var reference_shown: texture_2d<f32>;
@group(0) @binding(1) var test_shown: texture_2d<f32>;
// The index times the window's share of a class, and that share, of all channels together: of each workgroup.
@group(0) @binding(2) var<storage, read_write> partial_sums: array<array<vec2f, N_CLASSES>>;

// S and D less their values at the middle of the tile. Variances do not change by that, and no longer come out as the
// small difference of two large numbers.
var<workgroup> tile: array<array<vec2f, INPUT>, INPUT>;
// S, D, S² and D² filtered along y.
var<workgroup> columns: array<array<vec4f, INPUT>, TILE>;
var<workgroup> sums: array<vec2f, GROUP>;

// A pixel of both images.
struct Pair {
    reference: vec3f,
    test: vec3f,
}

// How many of the pixels under its workgroup an invocation reads.
const N_OWN: u32 = (INPUT * INPUT + GROUP - 1u) / GROUP;

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) n_workgroups: vec3u,
) {
    let origin = workgroup.xy * TILE;
    let middle_pair = pair_at(origin + INPUT / 2u);
    var own: array<Pair, N_OWN>;
    for (var n = 0u; n < N_OWN; n++) {
        let i = lane + n * GROUP;
        own[n] = pair_at(origin + vec2u(i % INPUT, i / INPUT));
    }
    let n_channels = select(3u, 1u, values == LUMA);
    var value = 0.0;
    for (var channel = 0u; channel < n_channels; channel++) {
        let middle = sum_and_difference(middle_pair, channel);
        for (var n = 0u; n < N_OWN; n++) {
            let i = lane + n * GROUP;
            if (i < INPUT * INPUT) {
                tile[i / INPUT][i % INPUT] = sum_and_difference(own[n], channel) - middle;
            }
        }
        workgroupBarrier();
        for (var i = lane; i < TILE * INPUT; i += GROUP) {
            columns[i / INPUT][i % INPUT] = filter_column(i % INPUT, i / INPUT);
        }
        workgroupBarrier();
        value += index(filter_row(local.x, local.y), middle);
    }
    let windows = textureDimensions(test_shown) - vec2u(2u * HALF);
    let is_window = all(origin + local.xy < windows);
    let group = workgroup.y * n_workgroups.x + workgroup.x;
    for (var kind = 0u; kind < N_CLASSES; kind++) {
        sums[lane] = vec2f(0.0);
        if (is_window) {
            sums[lane] = share_of(origin + local.xy + HALF, kind) * vec2f(value, f32(n_channels));
        }
        for (var half = GROUP / 2u; half > 0u; half /= 2u) {
            workgroupBarrier();
            if (lane < half) {
                sums[lane] += sums[lane + half];
            }
        }
        if (lane == 0u) {
            partial_sums[group][kind] = sums[0];
        }
        workgroupBarrier();
    }
}

// Pixels beyond the image are read from its edge, and only by windows that are not counted.
fn pair_at(pixel: vec2u) -> Pair {
    let inside = min(pixel, textureDimensions(test_shown) - vec2u(1u));
    return Pair(textureLoad(reference_shown, inside, 0).rgb, textureLoad(test_shown, inside, 0).rgb);
}

fn sum_and_difference(pair: Pair, channel: u32) -> vec2f {
    let r = value_of(pair.reference, channel);
    let t = value_of(pair.test, channel);
    return vec2f(t + r, t - r);
}

fn value_of(color: vec3f, channel: u32) -> f32 {
    if (values == LUMA) {
        return luma(color);
    }
    return select(color[channel], round(255.0 * color[channel]), values == U8);
}

fn moments(x: u32, y: u32) -> vec4f {
    let v = tile[y][x];
    return vec4f(v, v * v);
}

// Centred `HALF` rows below `y`.
fn filter_column(x: u32, y: u32) -> vec4f {
    return w0 * moments(x, y + 5u)
        + w1 * (moments(x, y + 4u) + moments(x, y + 6u))
        + w2 * (moments(x, y + 3u) + moments(x, y + 7u))
        + w3 * (moments(x, y + 2u) + moments(x, y + 8u))
        + w4 * (moments(x, y + 1u) + moments(x, y + 9u))
        + w5 * (moments(x, y) + moments(x, y + 10u));
}

// Centred `HALF` columns right of `x`.
fn filter_row(x: u32, y: u32) -> vec4f {
    return w0 * columns[y][x + 5u]
        + w1 * (columns[y][x + 4u] + columns[y][x + 6u])
        + w2 * (columns[y][x + 3u] + columns[y][x + 7u])
        + w3 * (columns[y][x + 2u] + columns[y][x + 8u])
        + w4 * (columns[y][x + 1u] + columns[y][x + 9u])
        + w5 * (columns[y][x] + columns[y][x + 10u]);
}

fn index(filtered: vec4f, middle: vec2f) -> f32 {
    let variance = filtered.zw - filtered.xy * filtered.xy;
    // Exactly 1 where nothing differs, however an adapter divides.
    let contrast = 1.0 - 2.0 * variance.y / (variance.x + variance.y + 2.0 * c2);
    if (part != WHOLE) {
        return contrast;
    }
    let mean = filtered.xy + middle;
    let luminance = mean * mean;
    return (1.0 - 2.0 * luminance.y / (luminance.x + luminance.y + 2.0 * c1)) * contrast;
}
