// What a frame of a scene binds, and the stages for vertices. Depth is reversed with no far plane: near / w.

struct Object {
    clip_from_object: mat4x4f,
    previous_clip_from_object: mat4x4f,
    world_from_object: mat4x4f,
    // RGB multiplies the material's colour, a its alpha.
    tint: vec4f,
    id: u32,
    // Pixels of stochastic alpha are drawn anew for each of these.
    seed: u32,
}

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
@group(0) @binding(1) var<storage, read> objects: array<Object>;
@group(0) @binding(2) var<uniform> lights: array<PointLight, 4>;
@group(0) @binding(3) var shadow_map: texture_depth_2d;
@group(0) @binding(4) var shadow_sampler: sampler_comparison;
@group(1) @binding(0) var<uniform> view: View;

struct Vertex {
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) previous_position: vec3f,
}

struct ColorVarying {
    @builtin(position) @invariant position: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) @interpolate(flat) object: u32,
}

struct SurfaceVarying {
    @builtin(position) position: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) @interpolate(flat) object: u32,
    // Clip x, y, w without jitter, now and in the frame before.
    @location(4) clip: vec3f,
    @location(5) previous_clip: vec3f,
}

struct DepthVarying {
    @builtin(position) position: vec4f,
    @location(0) uv: vec2f,
    @location(1) @interpolate(flat) object: u32,
}

fn jittered(clip: vec4f) -> vec4f {
    return vec4f(clip.xy - view.jitter_ndc * clip.w, clip.zw);
}

// Normals follow the cofactors, which is right for every scaling and needs no inverse.
fn world_normal(object: u32, normal: vec3f) -> vec3f {
    let m = objects[object].world_from_object;
    let cofactor = mat3x3f(cross(m[1].xyz, m[2].xyz), cross(m[2].xyz, m[0].xyz), cross(m[0].xyz, m[1].xyz));
    return cofactor * normal;
}

@vertex
fn vs_color(vertex: Vertex, @builtin(instance_index) object: u32) -> ColorVarying {
    let at = vec4f(vertex.position, 1.0);
    return ColorVarying(
        jittered(objects[object].clip_from_object * at),
        (objects[object].world_from_object * at).xyz,
        world_normal(object, vertex.normal),
        vertex.uv,
        object,
    );
}

@vertex
fn vs_surface(vertex: Vertex, @builtin(instance_index) object: u32) -> SurfaceVarying {
    let at = vec4f(vertex.position, 1.0);
    let clip = objects[object].clip_from_object * at;
    let previous_clip = objects[object].previous_clip_from_object * vec4f(vertex.previous_position, 1.0);
    return SurfaceVarying(
        jittered(clip),
        (objects[object].world_from_object * at).xyz,
        world_normal(object, vertex.normal),
        vertex.uv,
        object,
        clip.xyw,
        previous_clip.xyw,
    );
}

// Depth alone, exactly as `vs_color` has it: what lies behind is then never shaded.
@vertex
fn vs_depth(vertex: Vertex, @builtin(instance_index) object: u32) -> @builtin(position) @invariant vec4f {
    return jittered(objects[object].clip_from_object * vec4f(vertex.position, 1.0));
}

// The scene as the sun sees it.
@vertex
fn vs_shadow(vertex: Vertex, @builtin(instance_index) object: u32) -> DepthVarying {
    let world = objects[object].world_from_object * vec4f(vertex.position, 1.0);
    return DepthVarying(frame.shadow_from_world * world, vertex.uv, object);
}

// The scene as the frame before saw it.
@vertex
fn vs_previous(vertex: Vertex, @builtin(instance_index) object: u32) -> DepthVarying {
    let clip = objects[object].previous_clip_from_object * vec4f(vertex.previous_position, 1.0);
    return DepthVarying(clip, vertex.uv, object);
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
