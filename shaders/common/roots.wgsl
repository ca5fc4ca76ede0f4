// Roots whose accuracy is that of f32 on every adapter: the error of pow is the driver's affair. Dividing a float's bits by
// n divides its exponent by n, which is right to some percent; each of Halley's steps cubes the error, so two reach f32.

// Needs normal x > 0.
fn cube_root(x: vec3f) -> vec3f {
    var root = bitcast<vec3f>(bitcast<vec3u>(x) / 3u + vec3u(0x2a514067u));
    for (var step = 0; step < 2; step++) {
        let cube = root * root * root;
        root = root * (cube + 2.0 * x) / (2.0 * cube + x);
    }
    return root;
}

// Needs normal x > 0.
fn fifth_root(x: vec3f) -> vec3f {
    var root = bitcast<vec3f>(bitcast<vec3u>(x) / 5u + vec3u(0x32c819acu));
    for (var step = 0; step < 2; step++) {
        let square = root * root;
        let power = square * square * root;
        root = root * (2.0 * power + 3.0 * x) / (3.0 * power + 2.0 * x);
    }
    return root;
}
