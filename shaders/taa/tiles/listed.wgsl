// A pass over the tiles that classify.wgsl listed, dispatched indirectly: a workgroup is a piece of a tile, however it is
// shaped. Stands in for every_pixel.wgsl. From 40 on are bindings of its own.

@group(0) @binding(40) var<storage, read> listed_tiles: array<u32>;
// What this frame's history is like, a tile each; row by row (classify.wgsl).
@group(0) @binding(41) var<storage, read_write> notes: array<atomic<u32>>;

// Whether the recipe asks what is settled (src/taa/tiles.rs).
override notes_settled: bool;

const TILE: u32 = 16u;
const CHANGED: u32 = 1u;
const UNSETTLED: u32 = 2u;

struct Invocation {
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) local: u32,
}

// The tile that the workgroup is a piece of. From its list and not from a pixel, an index is the same for all of them, which
// CPU adapters load once.
var<private> own_tile: vec2u;

fn pixel_of(invocation: Invocation) -> vec2u {
    let listed = listed_tiles[invocation.workgroup.x];
    own_tile = vec2u(listed & 0xffffu, listed >> 16u);
    let index = invocation.workgroup.y * (WORKGROUP_X * WORKGROUP_Y) + invocation.local;
    return TILE * own_tile + vec2u(index % TILE, index / TILE);
}

// The first pixel of the invocation's workgroup: it is as wide as a tile.
fn corner_of(invocation: Invocation) -> vec2u {
    let listed = listed_tiles[invocation.workgroup.x];
    let row = invocation.workgroup.y * (WORKGROUP_X * WORKGROUP_Y) / TILE;
    return TILE * vec2u(listed & 0xffffu, listed >> 16u) + vec2u(0u, row);
}

fn are_equal(a: vec3f, b: vec3f) -> bool {
    return all(bitcast<vec3u>(a) == bitcast<vec3u>(b));
}

fn note(tile: vec2u, noted: u32) {
    let index = tile.y * ((textureDimensions(color).x + TILE - 1u) / TILE) + tile.x;
    // Most pixels of a tile note the same: looking first is cheaper than writing it again.
    if ((atomicLoad(&notes[index]) & noted) != noted) {
        atomicOr(&notes[index], noted);
    }
}

// Notes for the next frame that what is stored is not what was there before, or not `settled`, bit by bit.
fn note_stored(c: vec3f, before: vec3f, settled: vec3f) {
    let unsettled = notes_settled && !are_equal(c, settled);
    note(own_tile, select(CHANGED, 0u, are_equal(c, before)) | select(0u, UNSETTLED, unsettled));
}

// The same of a value at `p` that pixels of the 3×3 around it look at, for all of their tiles.
fn note_changed_beside(p: vec2u, c: f32, before: f32) {
    if (bitcast<u32>(c) == bitcast<u32>(before)) {
        return;
    }
    let first = (p - min(p, vec2u(1u))) / TILE;
    let last = min(p + 1u, textureDimensions(color) - 1u) / TILE;
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            note(vec2u(x, y), CHANGED);
        }
    }
}
