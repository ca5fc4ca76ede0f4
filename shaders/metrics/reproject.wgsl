// Where pixels come from: the f32 twin of `Source` and `Warp` in src/metrics/temporal/step.rs.

// The largest difference in luma between a pixel and where it came from.
override reprojects_within: f32;

// Stands for the change of a pixel that does not come from within the image, or from something else. Luma changes by
// `reprojects_within` at most.
const DISOCCLUDED_CHANGE: f32 = 2.0;

// A bilinear sample: its upper left texel, and the way to the next, right and down.
struct Source {
    texel: vec2i,
    fraction: vec2f,
    is_inside: bool,
}

// The whole and the fraction of the motion are taken apart before the pixel's coordinate is added, which would round it.
fn source_of(pixel: vec2u, motion_px: vec2f, extent: vec2u) -> Source {
    let bits = bitcast<vec2u>(motion_px) & vec2u(0x7fffffffu);
    // What is not finite lies beyond 2²³ as well, and so beyond every image.
    if (any(bits >= vec2u(0x4b000000u))) {
        return Source(vec2i(0), vec2f(0.0), false);
    }
    let whole = floor(motion_px);
    let fraction = motion_px - whole;
    let texel = vec2i(pixel) + vec2i(whole);
    let last = vec2i(extent) - 1;
    let is_before_end = (texel < last) | ((texel == last) & (fraction == vec2f(0.0)));
    return Source(texel, fraction, all(texel >= vec2i(0)) && all(is_before_end));
}

// Alpha is the largest of the four texels': a flag does not fade where its texel weighs nothing.
fn sample(image: texture_2d<f32>, source: Source) -> vec4f {
    let next = min(source.texel + 1, vec2i(textureDimensions(image)) - 1);
    let a = textureLoad(image, source.texel, 0);
    let b = textureLoad(image, vec2i(next.x, source.texel.y), 0);
    let c = textureLoad(image, vec2i(source.texel.x, next.y), 0);
    let d = textureLoad(image, next, 0);
    let above = a.rgb + source.fraction.x * (b.rgb - a.rgb);
    let below = c.rgb + source.fraction.x * (d.rgb - c.rgb);
    return vec4f(above + source.fraction.y * (below - above), max(max(a.a, b.a), max(c.a, d.a)));
}

// Luma of a reference's pixel minus where it came from in the previous one.
fn change_along(motion_px: vec2f, pixel: vec2u, reference: texture_2d<f32>, previous: texture_2d<f32>) -> f32 {
    let source = source_of(pixel, motion_px, textureDimensions(reference));
    if (!source.is_inside) {
        return DISOCCLUDED_CHANGE;
    }
    let now = textureLoad(reference, pixel, 0);
    let before = sample(previous, source);
    let change = luma(now.rgb - before.rgb);
    let is_found = abs(change) <= reprojects_within && max(now.a, before.a) == 0.0;
    return select(DISOCCLUDED_CHANGE, change, is_found);
}
