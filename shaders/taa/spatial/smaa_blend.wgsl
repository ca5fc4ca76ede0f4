// SMAA, third pass: a pixel takes of its neighbours what they cover of it, across its left and right edges or across its top
// and bottom ones, whichever weigh more.
// Jimenez et al., "SMAA: Enhanced Subpixel Morphological Antialiasing", 2012, 4.3. CPU twin: src/taa/reference/smaa.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var weights: texture_2d<f32>;
@group(0) @binding(11) var antialiased: texture_storage_2d<rgba32float, write>;

fn weights_at(p: vec2i) -> vec4f {
    return textureLoad(weights, clamped(p), 0);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    let c = textureLoad(color, p, 0);
    let own = weights_at(p);
    // Of the neighbours before and beyond.
    let vertical = vec2f(own.x, weights_at(p + vec2i(0, 1)).y);
    let horizontal = vec2f(own.z, weights_at(p + vec2i(1, 0)).w);
    let is_horizontal = max(horizontal.x, horizontal.y) > max(vertical.x, vertical.y);
    let w = select(vertical, horizontal, is_horizontal);
    var rgb = c.rgb;
    if (w.x + w.y >= 1e-5) {
        let across = select(vec2i(0, 1), vec2i(1, 0), is_horizontal);
        let centre = decoded(rgb);
        let before = lerp(centre, decoded(fetch(color, p - across)), w.x);
        let beyond = lerp(centre, decoded(fetch(color, p + across)), w.y);
        rgb = encoded((w.x * before + w.y * beyond) / (w.x + w.y));
    }
    textureStore(antialiased, id.xy, vec4f(rgb, c.a));
}
