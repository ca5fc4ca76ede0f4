// A pass over the tiles of a list, which classify.wgsl or the host (src/taa/tiles.rs) made. Stands in for every_pixel.wgsl.
// A workgroup is a piece of a span: of as many tiles, one after the other in the list, as make the span as wide as the workgroup.
// Neighbours in the list are mostly neighbours in the image, and CPU adapters are fast only where they walk along rows.

// Workgroups a span, spans, 1, tiles; and of every tile x | y << 16, plus one. 0 ends the list.
@group(0) @binding(40) var<storage, read> tile_list: array<u32>;

const TILE: u32 = 16u;
const HEAD: u32 = 4u;

struct Invocation {
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) local: u32,
}

// Outside every image where the list has ended.
fn pixel_of(invocation: Invocation) -> vec2u {
    let width = max(WORKGROUP_X, TILE);
    let index = invocation.workgroup.x * (WORKGROUP_X * WORKGROUP_Y) + invocation.local;
    let x = index % width;
    let tile = tile_list[HEAD + invocation.workgroup.y * (width / TILE) + x / TILE] - 1u;
    return TILE * vec2u(tile & 0xffffu, tile >> 16u) + vec2u(x % TILE, index / width);
}

// The first pixel of the invocation's workgroup, where that is as wide as a tile.
fn corner_of(invocation: Invocation) -> vec2u {
    let tile = tile_list[HEAD + invocation.workgroup.y] - 1u;
    let row = invocation.workgroup.x * (WORKGROUP_X * WORKGROUP_Y) / TILE;
    return TILE * vec2u(tile & 0xffffu, tile >> 16u) + vec2u(0u, row);
}
