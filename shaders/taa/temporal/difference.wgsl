// How far reprojected history is from the current colour; 0 where it is absent. Its local mean tells a change from
// noise (Yang et al., Amortized Supersampling, 2009). CPU twin: src/taa/reference/amortized.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var difference: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    let at = reprojected(p);
    var d = vec3f(0.0);
    if (at.has_history) {
        d = filtered_history(at.q) - fetch(color, p);
    }
    textureStore(difference, id.xy, vec4f(d, 0.0));
}
