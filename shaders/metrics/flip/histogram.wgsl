// How many pixels of each class have a FLIP in each of `n_bins` equal bins of 0 to 1. Pixels without any difference are in
// none: the host knows how many are missing, and equal images would make all invocations wait for one counter.

override WORKGROUP_X: u32 = 8u;
override WORKGROUP_Y: u32 = 8u;
override width: u32;
override height: u32;
override n_bins: u32;

@group(0) @binding(0) var<storage, read> map: array<f32>;
// Class after class.
@group(0) @binding(1) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= width || id.y >= height) {
        return;
    }
    let flip = map[id.y * width + id.x];
    if (flip > 0.0) {
        let bin = min(u32(flip * f32(n_bins)), n_bins - 1u);
        atomicAdd(&counts[class_of(id.xy) * n_bins + bin], 1u);
    }
}
