// SMAA, first pass: where luma has an edge at the left or at the top of a pixel that no neighbouring edge outshines.
// Jimenez et al., "SMAA: Enhanced Subpixel Morphological Antialiasing", 2012, 4.1. CPU twin: src/taa/reference/smaa.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

// EDGE_LEFT and EDGE_TOP.
@group(0) @binding(10) var next_edges: texture_storage_2d<r32uint, write>;

// The least luma difference of an edge, of the preset ultra.
const THRESHOLD: f32 = 0.05;
// An edge beside another of more than so many times its contrast is none.
const LOCAL_CONTRAST: f32 = 2.0;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    let l = edge_luma(p);
    let left = edge_luma(p + vec2i(-1, 0));
    let top = edge_luma(p + vec2i(0, -1));
    let right = edge_luma(p + vec2i(1, 0));
    let bottom = edge_luma(p + vec2i(0, 1));
    let contrast = abs(l - vec2f(left, top));
    let beyond = abs(l - vec2f(right, bottom));
    let before = abs(vec2f(left, top) - vec2f(edge_luma(p + vec2i(-2, 0)), edge_luma(p + vec2i(0, -2))));
    let most = max(contrast, max(beyond, before));
    let is_edge = (contrast >= vec2f(THRESHOLD)) & (LOCAL_CONTRAST * contrast >= vec2f(max(most.x, most.y)));
    textureStore(next_edges, id.xy, vec4u(select(0u, EDGE_LEFT, is_edge.x) | select(0u, EDGE_TOP, is_edge.y)));
}
