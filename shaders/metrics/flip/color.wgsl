// FLIP's colour spaces: the twin of src/metrics/flip/color.rs, where they are explained.

// The spread of colour differences: see QC, PC and PT there.
override difference_exponent: f32;
override knee_at: f32;
override knee_to: f32;

// Rows of the matrices between linear RGB and XYZ over that of white, and the difference of the most different colours.
struct Colors {
    to_x: vec3f,
    to_y: vec3f,
    to_z: vec3f,
    from_r: vec3f,
    from_g: vec3f,
    from_b: vec3f,
    largest: f32,
}

@group(0) @binding(7) var<uniform> colors: Colors;

fn to_xyz(rgb: vec3f) -> vec3f {
    return vec3f(dot(colors.to_x, rgb), dot(colors.to_y, rgb), dot(colors.to_z, rgb));
}

fn ycxcz(rgb: vec3f) -> vec3f {
    let xyz = to_xyz(rgb);
    return vec3f(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z));
}

fn hunt_lab(seen: vec3f) -> vec3f {
    let y = (seen.x + 16.0) / 116.0;
    let filtered = vec3f(y + seen.y / 500.0, y, y - seen.z / 200.0);
    let rgb = vec3f(dot(colors.from_r, filtered), dot(colors.from_g, filtered), dot(colors.from_b, filtered));
    let root = lab_root(to_xyz(clamp(rgb, vec3f(0.0), vec3f(1.0))));
    let l = 116.0 * root.y - 16.0;
    return vec3f(l, 0.01 * l * 500.0 * (root.x - root.y), 0.01 * l * 200.0 * (root.y - root.z));
}

fn lab_root(t: vec3f) -> vec3f {
    const DELTA = 6.0 / 29.0;
    let straight = t / (3.0 * DELTA * DELTA) + 4.0 / 29.0;
    let is_curved = t > vec3f(DELTA * DELTA * DELTA);
    return select(straight, cube_root(max(t, vec3f(DELTA * DELTA * DELTA))), is_curved);
}

fn difference(a: vec3f, b: vec3f) -> f32 {
    let difference = power(abs(a.x - b.x) + length(a.yz - b.yz), difference_exponent);
    let knee = knee_at * colors.largest;
    if (difference < knee) {
        return knee_to / knee * difference;
    }
    return knee_to + (difference - knee) / (colors.largest - knee) * (1.0 - knee_to);
}
