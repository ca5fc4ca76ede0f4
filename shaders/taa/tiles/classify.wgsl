// Lists the tiles that have something to do. A tile is kept where all that its pixels would be computed from is, bit by bit,
// what it was in the frame before, and its history is what both textures hold: then the same arithmetic would show and
// store what is there. src/taa/tiles.rs says which recipes, and why. One invocation a tile.

override WORKGROUP_X: u32 = 64u;
override WORKGROUP_Y: u32 = 1u;
// Whether a pass looks at its neighbours' results.
override lists_beside: bool;

struct Wanted {
    // Of the flags in src/taa/changes.rs, those that a tile must have to be kept where it is.
    flags: u32,
    // And to be kept as part of a flat surface, wherever that moves.
    carried: u32,
    // Those that a tile must have now if it is to be kept in the next frame: as the one, or as the other.
    hopeful: vec2u,
    // Number of tiles along x and y.
    size: vec2u,
}

// What is noted of a tile's history: a pixel stored what was not there before; a pixel stored what is not its current colour;
// all that the tile reads of history was settled.
const CHANGED: u32 = 1u;
const UNSETTLED: u32 = 2u;
const READ_SETTLED: u32 = 4u;

@group(0) @binding(0) var<storage, read> frame_flags: array<u32>;
// First and last tile, x | y << 16 each, of which a tile reads history.
@group(0) @binding(1) var<storage, read> regions: array<vec2u>;
@group(0) @binding(2) var<storage, read> notes_before: array<u32>;
@group(0) @binding(3) var<storage, read_write> notes: array<u32>;
// Of each list workgroups a span, spans, 1, tiles; all 0.
@group(0) @binding(4) var<storage, read_write> heads: array<atomic<u32>>;
// Lists as listed.wgsl reads them: the tiles that are not kept;
@group(0) @binding(5) var computed: texture_storage_2d<r32uint, write>;
// those beside them, too, where `lists_beside`;
@group(0) @binding(6) var beside: texture_storage_2d<r32uint, write>;
// those that settle.wgsl looks at: of the others it is not worth knowing.
@group(0) @binding(7) var hopeful: texture_storage_2d<r32uint, write>;
@group(0) @binding(8) var<uniform> wanted: Wanted;

const TILE: u32 = 16u;
const HEAD: u32 = 4u;
const LIST_WIDTH: u32 = 256u;
const COMPUTED: u32 = 0u;
const BESIDE: u32 = 1u;
const HOPEFUL: u32 = 2u;

fn index_of(tile: vec2u) -> u32 {
    return tile.y * wanted.size.x + tile.x;
}

fn reads_settled(tile: vec2u) -> bool {
    let index = index_of(tile);
    if ((frame_flags[index] & wanted.carried) != wanted.carried) {
        return false;
    }
    let region = regions[index];
    var noted = 0u;
    for (var y = region.x >> 16u; y <= region.y >> 16u; y++) {
        for (var x = region.x & 0xffffu; x <= (region.y & 0xffffu); x++) {
            noted |= notes_before[index_of(vec2u(x, y))];
        }
    }
    return (noted & UNSETTLED) == 0u;
}

fn is_kept(tile: vec2u, reads_settled: bool) -> bool {
    let index = index_of(tile);
    let before = notes_before[index];
    let rests = (frame_flags[index] & wanted.flags) == wanted.flags && (before & CHANGED) == 0u;
    return rests || ((before & (READ_SETTLED | UNSETTLED)) == READ_SETTLED && reads_settled);
}

fn all_kept_beside(tile: vec2u) -> bool {
    var kept = true;
    for (var y = max(tile.y, 1u) - 1u; y <= min(tile.y + 1u, wanted.size.y - 1u); y++) {
        for (var x = max(tile.x, 1u) - 1u; x <= min(tile.x + 1u, wanted.size.x - 1u); x++) {
            let neighbour = vec2u(x, y);
            kept = kept && is_kept(neighbour, reads_settled(neighbour));
        }
    }
    return kept;
}

fn has(tile: vec2u, flags: u32) -> bool {
    return (frame_flags[index_of(tile)] & flags) == flags;
}

fn tiles_a_span() -> u32 {
    return max(WORKGROUP_X / TILE, 1u);
}

// Where the next tile of a list goes.
fn place_in(list: u32) -> vec2u {
    let place = atomicAdd(&heads[list * HEAD + 3u], 1u);
    if (place % tiles_a_span() == 0u) {
        atomicAdd(&heads[list * HEAD + 1u], 1u);
    }
    return vec2u(place % LIST_WIDTH, place / LIST_WIDTH);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (all(id.xy == vec2u(0u))) {
        let workgroups_a_span = tiles_a_span() * TILE * TILE / (WORKGROUP_X * WORKGROUP_Y * ROWS);
        for (var list = COMPUTED; list <= HOPEFUL; list++) {
            atomicStore(&heads[list * HEAD], workgroups_a_span);
            atomicStore(&heads[list * HEAD + 2u], 1u);
        }
    }
    if (any(id.xy >= wanted.size)) {
        return;
    }
    let index = index_of(id.xy);
    let listed = vec4u((id.x | (id.y << 16u)) + 1u);
    let settled = reads_settled(id.xy);
    let kept = is_kept(id.xy, settled);
    var noted = select(0u, READ_SETTLED, settled);
    if (kept) {
        // It stores nothing that could be noted.
        noted |= notes_before[index] & UNSETTLED;
    } else {
        textureStore(computed, place_in(COMPUTED), listed);
        if (has(id.xy, wanted.hopeful.x) || has(id.xy, wanted.hopeful.y)) {
            textureStore(hopeful, place_in(HOPEFUL), listed);
        } else {
            noted |= CHANGED | UNSETTLED;
        }
    }
    notes[index] = noted;
    if (lists_beside && !all_kept_beside(id.xy)) {
        textureStore(beside, place_in(BESIDE), listed);
    }
}
