// FXAA 3.11, quality preset 39: where luma has an edge, walks along it to both of its ends and reads the colour up to half a
// texel across it, the farther the nearer an end is. Texels that stand out from their surroundings are blurred as well.
// Lottes, "FXAA", NVIDIA 2009 to 2011, with the defaults of its quality settings. CPU twin: src/taa/reference/fxaa.rs.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;

@group(0) @binding(10) var antialiased: texture_storage_2d<rgba32float, write>;

// How much of the sub-pixel blur is applied.
const SUBPIXEL: f32 = 0.75;
// The least contrast of an edge: this share of the brightest texel, but never less than the second number.
const CONTRAST: f32 = 0.166;
const CONTRAST_MIN: f32 = 0.0833;

// Where the walk along an edge looks, texels; the last is where it gives up. Between texels it sees the mean of both.
const N_LOOKS: i32 = 11;
const LOOKS = array<f32, 12>(1.0, 2.0, 3.0, 4.0, 5.0, 6.5, 8.5, 10.5, 12.5, 14.5, 18.5, 26.5);

// Lumas of the 3×3 around a texel.
struct Lumas {
    middle: f32,
    // Above, left, right, below.
    sides: vec4f,
    // Above left, above right, below left, below right.
    corners: vec4f,
}

fn lumas_around(p: vec2i) -> Lumas {
    return Lumas(
        edge_luma(p),
        vec4f(
            edge_luma(p + vec2i(0, -1)),
            edge_luma(p + vec2i(-1, 0)),
            edge_luma(p + vec2i(1, 0)),
            edge_luma(p + vec2i(0, 1)),
        ),
        vec4f(
            edge_luma(p + vec2i(-1, -1)),
            edge_luma(p + vec2i(1, -1)),
            edge_luma(p + vec2i(-1, 1)),
            edge_luma(p + vec2i(1, 1)),
        ),
    );
}

// The range of the cross; 0 where it is too small for an edge.
fn contrast_of(l: Lumas) -> f32 {
    let darkest = min(l.middle, min(min(l.sides.x, l.sides.y), min(l.sides.z, l.sides.w)));
    let brightest = max(l.middle, max(max(l.sides.x, l.sides.y), max(l.sides.z, l.sides.w)));
    let contrast = brightest - darkest;
    return select(0.0, contrast, contrast >= max(CONTRAST_MIN, CONTRAST * brightest));
}

// Whether luma bends more down the columns of the 3×3 than along its rows.
fn is_horizontal(l: Lumas) -> bool {
    let nw = l.corners.x;
    let ne = l.corners.y;
    let sw = l.corners.z;
    let se = l.corners.w;
    let n = l.sides.x;
    let w = l.sides.y;
    let e = l.sides.z;
    let s = l.sides.w;
    let down = abs(nw - 2.0 * w + sw) + 2.0 * abs(n - 2.0 * l.middle + s) + abs(ne - 2.0 * e + se);
    let across = abs(nw - 2.0 * n + ne) + 2.0 * abs(w - 2.0 * l.middle + e) + abs(sw - 2.0 * s + se);
    return down >= across;
}

// How much a texel differs from its surroundings, 0 to 1, as a distance to blur over.
fn subpixel_offset(l: Lumas, contrast: f32) -> f32 {
    let surroundings = (2.0 * dot(l.sides, vec4f(1.0)) + dot(l.corners, vec4f(1.0))) / 12.0;
    let share = smoothstep(0.0, 1.0, abs(surroundings - l.middle) / contrast);
    return SUBPIXEL * share * share;
}

// The border between two rows or columns of texels that an edge follows.
struct Edge {
    // Along the border, and across it from the texel to the other side.
    along: vec2i,
    across: vec2i,
    // Luma on the border beside the texel: the mean of both sides, as everywhere along it.
    luma: f32,
    // An edge ends where that has changed by so much.
    end: f32,
}

fn edge_of(l: Lumas) -> Edge {
    let horizontal = is_horizontal(l);
    let before = select(l.sides.y, l.sides.x, horizontal);
    let after = select(l.sides.z, l.sides.w, horizontal);
    let step_before = abs(before - l.middle);
    let step_after = abs(after - l.middle);
    let is_before = step_before >= step_after;
    let across = select(vec2i(1, 0), vec2i(0, 1), horizontal);
    return Edge(
        vec2i(1) - across,
        select(across, -across, is_before),
        0.5 * (l.middle + select(after, before, is_before)),
        0.25 * max(step_before, step_after),
    );
}

struct End {
    // From the texel, texels.
    distance: f32,
    // Luma there less that beside the texel.
    change: f32,
}

fn border_luma(texel: vec2i, edge: Edge) -> f32 {
    return 0.5 * (edge_luma(texel) + edge_luma(texel + edge.across));
}

// Where the border's luma changes, towards `direction`.
fn end_of(p: vec2i, edge: Edge, direction: i32) -> End {
    var looks = LOOKS;
    var end = End();
    for (var i = 0; i < N_LOOKS; i++) {
        end.distance = looks[i];
        let texel = p + direction * i32(floor(looks[i])) * edge.along;
        var l = border_luma(texel, edge);
        if (fract(looks[i]) != 0.0) {
            l = 0.5 * (l + border_luma(texel + direction * edge.along, edge));
        }
        end.change = l - edge.luma;
        if (abs(end.change) >= edge.end) {
            return end;
        }
    }
    end.distance = looks[N_LOOKS];
    return end;
}

// How far across the edge to read: half a texel at the end of an edge towards which the texel sticks out, 0 in its middle.
fn edge_offset(p: vec2i, l: Lumas, edge: Edge) -> f32 {
    let a = end_of(p, edge, -1);
    let b = end_of(p, edge, 1);
    let is_a = a.distance < b.distance;
    let change = select(b.change, a.change, is_a);
    let sticks_out = (change < 0.0) != (l.middle < edge.luma);
    return select(0.0, 0.5 - min(a.distance, b.distance) / (a.distance + b.distance), sticks_out);
}

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(color))) {
        return;
    }
    let p = vec2i(id.xy);
    let c = textureLoad(color, p, 0);
    let l = lumas_around(p);
    let contrast = contrast_of(l);
    var rgb = c.rgb;
    if (contrast > 0.0) {
        let edge = edge_of(l);
        let offset = max(edge_offset(p, l, edge), subpixel_offset(l, contrast));
        rgb = encoded(lerp(decoded(rgb), decoded(fetch(color, p + edge.across)), offset));
    }
    textureStore(antialiased, id.xy, vec4f(rgb, c.a));
}
