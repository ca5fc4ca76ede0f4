// The weights of FLIP's filters (src/metrics/flip/filters.rs) at each distance from the centre.

struct Tap {
    // Lightness, red–green, and the wide and the narrow Gaussian of blue–yellow.
    color: vec4f,
    // The Gaussian of features and its first and second derivative, the former odd.
    feature: vec4f,
}

@group(0) @binding(6) var<storage, read> taps: array<Tap>;

// Beyond the image its edge goes on.
fn texel_at(image: texture_2d<f32>, texel: vec2i) -> vec4f {
    return textureLoad(image, clamp(texel, vec2i(0), vec2i(textureDimensions(image)) - 1), 0);
}
