// A pass over the tiles of a list, which classify.wgsl or the host (src/taa/tiles.rs) made. Stands in for every_pixel.wgsl.
// A workgroup is a piece of a span: of as many tiles, one after the other in the list, as make the span as wide as the workgroup.
// Neighbours in the list are mostly neighbours in the image, and CPU adapters are fast only where they walk along rows. An
// invocation takes ROWS pixels, one below the other.

// Of every tile x | y << 16, plus one, row by row. A texture, because CPU adapters read buffers lane by lane. What follows the last
// tile in its span is 0, or a tile of an earlier frame: computed anew or twice, it is what it was. A pass
// that counts must be given a list that ends with 0.
@group(0) @binding(40) var tile_list: texture_2d<u32>;

const TILE: u32 = 16u;
const LIST_WIDTH: u32 = 256u;

struct Invocation {
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) local: u32,
}

// The first pixel of a tile; of none, outside every image.
fn tile_at(place: u32) -> vec2u {
    let tile = textureLoad(tile_list, vec2u(place % LIST_WIDTH, place / LIST_WIDTH), 0).r - 1u;
    return TILE * vec2u(tile & 0xffffu, tile >> 16u);
}

fn pixel_of(invocation: Invocation, row: u32) -> vec2u {
    let width = max(WORKGROUP_X, TILE);
    let index = invocation.workgroup.x * (WORKGROUP_X * WORKGROUP_Y) + invocation.local;
    let x = index % width;
    let tile = tile_at(invocation.workgroup.y * (width / TILE) + x / TILE);
    return tile + vec2u(x % TILE, index / width * ROWS + row);
}

// The first pixel of the invocation's workgroup, where that is as wide as a tile.
fn corner_of(invocation: Invocation) -> vec2u {
    let row = invocation.workgroup.x * (WORKGROUP_X * WORKGROUP_Y * ROWS) / TILE;
    return tile_at(invocation.workgroup.y) + vec2u(0u, row);
}
