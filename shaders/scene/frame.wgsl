// What a frame of a scene binds, and the stages for vertices. Depth is reversed with no far plane: near / w.

struct Frame {
    eye: vec3f,
    size_px: vec2f,
    // Towards the sun.
    sun_direction: vec3f,
    sun_color: vec3f,
    sky_zenith: vec3f,
    sky_horizon: vec3f,
    sky_ground: vec3f,
    ambient: f32,
    // Distance at which clipping begins, which is clip z everywhere.
    near: f32,
    shadow_from_world: mat4x4f,
    // World directions of the view's axis and of one unit of ndc x and y beside it.
    ray_axis: vec3f,
    ray_x: vec3f,
    ray_y: vec3f,
    clip_from_direction: mat4x4f,
    previous_clip_from_direction: mat4x4f,
}

struct PointLight {
    position: vec3f,
    // Distance at which it has faded to nothing.
    range: f32,
    color: vec3f,
}

// One sample a pixel of the frame.
struct View {
    // 2 J / size, y up: texel (x, y) holds the scene at its centre plus this.
    jitter_ndc: vec2f,
    mip_bias: f32,
    seed: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lights: array<PointLight, 4>;
@group(0) @binding(2) var shadow_map: texture_depth_2d;
@group(0) @binding(3) var shadow_sampler: sampler_comparison;
@group(1) @binding(0) var<uniform> view: View;

struct Vertex {
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) previous_position: vec3f,
}

// An object, as instances have it: rows of its matrices, without clip z's and without the world's last. Attributes, not a
// storage buffer: on lavapipe reading matrices from one costs more than all the rest of a vertex.
struct Object {
    @location(4) clip_x: vec4f,
    @location(5) clip_y: vec4f,
    @location(6) clip_w: vec4f,
    @location(7) previous_clip_x: vec4f,
    @location(8) previous_clip_y: vec4f,
    @location(9) previous_clip_w: vec4f,
    @location(10) world_x: vec4f,
    @location(11) world_y: vec4f,
    @location(12) world_z: vec4f,
    // RGB multiplies the material's colour, a its alpha.
    @location(13) tint: vec4f,
    @location(14) id: u32,
}

struct ColorVarying {
    @builtin(position) @invariant position: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) @interpolate(flat) tint: vec4f,
    // Pixels of stochastic alpha are drawn anew for each of these.
    @location(4) @interpolate(flat) seed: u32,
}

struct SurfaceVarying {
    @builtin(position) position: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) @interpolate(flat) tint: vec4f,
    @location(4) @interpolate(flat) seed: u32,
    @location(5) @interpolate(flat) id: u32,
    // Clip x, y, w without jitter, now and in the frame before.
    @location(6) clip: vec3f,
    @location(7) previous_clip: vec3f,
}

struct DepthVarying {
    @builtin(position) @invariant position: vec4f,
    @location(0) uv: vec2f,
    @location(1) @interpolate(flat) tint: vec4f,
}

// Clip x, y and w.
fn clip_of(object: Object, position: vec3f) -> vec3f {
    let at = vec4f(position, 1.0);
    return vec3f(dot(object.clip_x, at), dot(object.clip_y, at), dot(object.clip_w, at));
}

fn previous_clip_of(object: Object, position: vec3f) -> vec3f {
    let at = vec4f(position, 1.0);
    return vec3f(
        dot(object.previous_clip_x, at),
        dot(object.previous_clip_y, at),
        dot(object.previous_clip_w, at),
    );
}

fn jittered(clip: vec3f) -> vec4f {
    return vec4f(clip.xy - view.jitter_ndc * clip.z, frame.near, clip.z);
}

fn world_of(object: Object, position: vec3f) -> vec3f {
    let at = vec4f(position, 1.0);
    return vec3f(dot(object.world_x, at), dot(object.world_y, at), dot(object.world_z, at));
}

// Normals follow the cofactors, which is right for every scaling and needs no inverse.
fn world_normal(object: Object, normal: vec3f) -> vec3f {
    let x = object.world_x.xyz;
    let y = object.world_y.xyz;
    let z = object.world_z.xyz;
    return vec3f(dot(cross(y, z), normal), dot(cross(z, x), normal), dot(cross(x, y), normal));
}

@vertex
fn vs_color(vertex: Vertex, object: Object, @builtin(instance_index) seed: u32) -> ColorVarying {
    return ColorVarying(
        jittered(clip_of(object, vertex.position)),
        world_of(object, vertex.position),
        world_normal(object, vertex.normal),
        vertex.uv,
        object.tint,
        seed,
    );
}

@vertex
fn vs_surface(vertex: Vertex, object: Object, @builtin(instance_index) seed: u32) -> SurfaceVarying {
    let clip = clip_of(object, vertex.position);
    return SurfaceVarying(
        jittered(clip),
        world_of(object, vertex.position),
        world_normal(object, vertex.normal),
        vertex.uv,
        object.tint,
        seed,
        object.id,
        clip,
        previous_clip_of(object, vertex.previous_position),
    );
}

// Depth alone, exactly as `vs_color` has it: what lies behind is then never shaded.
@vertex
fn vs_depth(vertex: Vertex, object: Object) -> @builtin(position) @invariant vec4f {
    return jittered(clip_of(object, vertex.position));
}

// The same of what has holes.
@vertex
fn vs_cut(vertex: Vertex, object: Object) -> DepthVarying {
    return DepthVarying(jittered(clip_of(object, vertex.position)), vertex.uv, object.tint);
}

// The scene as the sun sees it.
@vertex
fn vs_shadow(vertex: Vertex, object: Object) -> DepthVarying {
    let world = vec4f(world_of(object, vertex.position), 1.0);
    return DepthVarying(frame.shadow_from_world * world, vertex.uv, object.tint);
}

// The scene as the frame before saw it.
@vertex
fn vs_previous(vertex: Vertex, object: Object) -> DepthVarying {
    let clip = previous_clip_of(object, vertex.previous_position);
    return DepthVarying(vec4f(clip.xy, frame.near, clip.z), vertex.uv, object.tint);
}

struct SkyVarying {
    @builtin(position) position: vec4f,
    @location(0) ndc: vec2f,
}

// One triangle over the whole image, at the far end.
@vertex
fn vs_sky(@builtin(vertex_index) index: u32) -> SkyVarying {
    let corner = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    return SkyVarying(vec4f(corner, 0.0, 1.0), corner + view.jitter_ndc);
}
