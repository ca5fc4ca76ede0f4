// Display values of a linear image: the f32 twin of src/metrics/display.rs. The accuracy is that of f32 on every
// adapter, because errors here do not cancel in metrics: pow, whose error is the driver's affair, is not used.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
override exposure: f32;
override tonemap: u32;

const TONEMAP_NONE: u32 = 0u;
const TONEMAP_REINHARD_MAX: u32 = 1u;
const TONEMAP_ACES: u32 = 2u;

@group(0) @binding(0) var linear: texture_2d<f32>;
// Alpha is 1 where the colour is not finite, else 0.
@group(0) @binding(1) var shown: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(shown))) {
        return;
    }
    let color = textureLoad(linear, id.xy, 0).rgb;
    let bits = bitcast<vec3u>(color) & vec3u(0x7fffffffu);
    let is_bad = any(bits >= vec3u(0x7f800000u));
    // The upper bound keeps squares finite; every tone map is white to the last bit long before it.
    let exposed = clamp(color * exposure, vec3f(0.0), vec3f(1e9));
    let encoded = srgb_encode(clamp(tonemapped(exposed), vec3f(0.0), vec3f(1.0)));
    textureStore(shown, id.xy, vec4f(encoded, f32(is_bad)));
}

fn tonemapped(c: vec3f) -> vec3f {
    switch tonemap {
        case TONEMAP_REINHARD_MAX: {
            return c / (1.0 + max3(c));
        }
        case TONEMAP_ACES: {
            return c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14);
        }
        default: {
            return c;
        }
    }
}

// x^(1/2.4) = x^(1/3) · x^(1/12), and the second factor is the fourth root of the first.
fn srgb_encode(x: vec3f) -> vec3f {
    let root = cube_root(max(x, vec3f(0.0031308)));
    return select(1.055 * (root * sqrt(sqrt(root))) - 0.055, 12.92 * x, x <= vec3f(0.0031308));
}
