// SMAA's edges, and the areas that lines through them cut off (src/taa/smaa_area.rs). From 40 on are bindings of its own.

const EDGE_LEFT: u32 = 1u;
const EDGE_TOP: u32 = 2u;

@group(0) @binding(40) var smaa_edges: texture_2d<u32>;
// By what crosses the start and the end of a line, and by the distance to both: along rows and columns, then along diagonals.
@group(0) @binding(41) var<storage, read> areas: array<vec2f>;

// Of a line along a row or column, the farthest ends, texels: 32 steps of two, of which the first towards the start begins on
// the pixel itself.
const MAX_TO_START: i32 = 63;
const MAX_TO_END: i32 = 64;
// Of a diagonal: 16 steps of one.
const MAX_DIAGONAL: i32 = 16;

const N_ENDS: i32 = 4;
const FIRST_DIAGONAL: i32 = N_ENDS * N_ENDS * (MAX_TO_START + 1) * (MAX_TO_END + 1);

// What crosses an end: edges on the side of the pixel itself (1) and on the other side (2).
fn ends(own: bool, other: bool) -> i32 {
    return select(0, 1, own) + select(0, 2, other);
}

// The share of the pixel that the other side covers, and of the pixel on the other side that this one covers.
fn orthogonal_area(start: i32, end: i32, to_start: i32, to_end: i32) -> vec2f {
    let line = start * N_ENDS + end;
    return areas[(line * (MAX_TO_START + 1) + to_start) * (MAX_TO_END + 1) + to_end];
}

fn diagonal_area(start: i32, end: i32, to_start: i32, to_end: i32) -> vec2f {
    let line = start * N_ENDS + end;
    return areas[FIRST_DIAGONAL + (line * (MAX_DIAGONAL + 1) + to_start) * (MAX_DIAGONAL + 1) + to_end];
}

fn edges_at(p: vec2i) -> u32 {
    return textureLoad(smaa_edges, clamp(p, vec2i(0), vec2i(textureDimensions(smaa_edges)) - 1), 0).r;
}

fn has(p: vec2i, edge: u32) -> bool {
    return (edges_at(p) & edge) != 0u;
}
