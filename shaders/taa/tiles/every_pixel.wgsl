// A pass over every pixel, by invocations of ROWS pixels each, one below the other (a constant from src/taa/tiles.rs). Stands in
// for listed.wgsl where nothing is skipped, so that no binding is left of it.

struct Invocation {
    @builtin(global_invocation_id) global: vec3u,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) local: u32,
}

fn pixel_of(invocation: Invocation, row: u32) -> vec2u {
    return invocation.global.xy * vec2u(1u, ROWS) + vec2u(0u, row);
}

// The first pixel of the invocation's workgroup.
fn corner_of(invocation: Invocation) -> vec2u {
    return invocation.workgroup.xy * vec2u(WORKGROUP_X, WORKGROUP_Y * ROWS);
}
