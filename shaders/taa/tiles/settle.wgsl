// Notes what a frame left in those tiles that may be kept in the next one: whether a pixel stored what was not there before, and
// whether it stored what is not its current colour, bit by bit (src/taa/tiles.rs).

override WORKGROUP_X: u32 = 64u;
override WORKGROUP_Y: u32 = 1u;
// Whether the recipe asks what is settled.
override notes_settled: bool;
// Whether it keeps a history of edges, at which the resolve looks within 3×3 texels.
override keeps_edges: bool;

@group(0) @binding(10) var stored: texture_2d<f32>;
@group(0) @binding(11) var edge_history: texture_2d<f32>;
@group(0) @binding(12) var stored_edges: texture_2d<f32>;
// A tile each, row by row; classify.wgsl has the bits.
@group(0) @binding(13) var<storage, read_write> notes: array<atomic<u32>>;

const CHANGED: u32 = 1u;
const UNSETTLED: u32 = 2u;

fn differ(a: vec3f, b: vec3f) -> bool {
    return any(bitcast<vec3u>(a) != bitcast<vec3u>(b));
}

fn edges_differ(p: vec2i) -> bool {
    var found = false;
    for (var i = 0; i < 9; i++) {
        let o = p + vec2i(i % 3, i / 3) - 1;
        found = found || differ(fetch(stored_edges, o), fetch(edge_history, o));
    }
    return found;
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(invocation: Invocation) {
    for (var row = 0u; row < ROWS; row++) {
        settle(pixel_of(invocation, row));
    }
}

fn settle(id: vec2u) {
    if (any(id >= textureDimensions(stored))) {
        return;
    }
    let p = vec2i(id);
    let c = fetch(stored, p);
    var noted = select(0u, CHANGED, differ(c, fetch(history, p)));
    if (keeps_edges) {
        noted |= select(0u, CHANGED, edges_differ(p));
    }
    // Where colour is flat, whatever the input's filter finds is the texel's own.
    if (notes_settled) {
        noted |= select(0u, UNSETTLED, differ(c, round_history(fetch(color, p))));
    }
    let index = (id.y / TILE) * ((textureDimensions(stored).x + TILE - 1u) / TILE) + id.x / TILE;
    // Most pixels of a tile note the same: looking first is cheaper than writing it again.
    if ((atomicLoad(&notes[index]) & noted) != noted) {
        atomicOr(&notes[index], noted);
    }
}
