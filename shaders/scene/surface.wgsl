// What a fragment of a scene writes. What a material has not is folded away: every variant is its own pipeline.

// 0 opaque, 1 cut at one half, 2 stochastic, 3 blended.
override ALPHA: u32;
override TEXTURED: bool;
override LIT: bool;
override SPECULAR: bool;
override SHADOWED: bool;
override N_LIGHTS: u32;

const ALPHA_CUT = 1u;
const ALPHA_STOCHASTIC = 2u;
const ALPHA_BLENDED = 3u;

struct Material {
    color: vec3f,
    alpha: f32,
    emissive: vec3f,
    roughness: f32,
    // Reflectance at normal incidence; of metals their colour.
    specular: f32,
    metallic: f32,
    // How little history may be trusted.
    reactive: f32,
    // How much light comes through from behind.
    translucency: f32,
}

@group(2) @binding(0) var<uniform> material: Material;
@group(2) @binding(1) var base_texture: texture_2d<f32>;
@group(2) @binding(2) var base_sampler: sampler;

struct Surface {
    @location(0) color: vec4f,
    // Motion in pixels, y down; linear view depth; reactive mask.
    @location(1) geometry: vec4f,
    @location(2) id: u32,
    // And the linear view depth that the surface had in the frame before.
    @location(3) albedo: vec4f,
}

// Where the surface was behind the camera: so far that no history is there.
const NO_MOTION_PX = 1e6;
const SKY_DEPTH = 1e10;

// Uniform in 0 to 1, from two dimensions and a seed: combined by odd factors, then mixed by two multiplications and shifts.
fn hash(x: u32, y: u32, seed: u32) -> f32 {
    var h = x * 0x9e3779b9u ^ y * 0x85ebca6bu ^ seed * 0xc2b2ae35u;
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    h = h ^ (h >> 16u);
    return f32(h >> 8u) / 16777216.0;
}

fn base(tint: vec4f, uv: vec2f) -> vec4f {
    let paint = vec4f(material.color, material.alpha) * tint;
    if TEXTURED {
        return paint * textureSampleBias(base_texture, base_sampler, uv, view.mip_bias);
    }
    return paint;
}

fn kept(position: vec4f, seed: u32, alpha: f32) -> bool {
    if ALPHA == ALPHA_CUT {
        return alpha >= 0.5;
    }
    if ALPHA == ALPHA_STOCHASTIC {
        let px = vec2u(position.xy);
        return hash(px.x, px.y, view.seed ^ (seed * 0x9e3779b9u)) < alpha;
    }
    return true;
}

fn sky(direction: vec3f) -> vec3f {
    let up = direction.y;
    let above = mix(frame.sky_horizon, frame.sky_zenith, sqrt(saturate(up)));
    return mix(above, frame.sky_ground, smoothstep(0.0, 0.06, -up));
}

// 0 in shadow, 1 in the sun; between the four nearest texels of the map.
fn sunlight(world: vec3f) -> f32 {
    let at = frame.shadow_from_world * vec4f(world, 1.0);
    let uv = vec2f(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y);
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, uv, at.z);
    // Outside the map nothing throws a shadow.
    return select(lit, 1.0, any(abs(at.xy) > vec2f(1.0)) || at.z > 1.0);
}

// The fifth power: `pow` is a logarithm and an exponential.
fn fifth(x: f32) -> f32 {
    return x * x * (x * x) * x;
}

// Schlick's Fresnel term with Trowbridge and Reitz's distribution (GGX); visibility after Hammon 2017.
fn highlight(n: vec3f, v: vec3f, l: vec3f, f0: vec3f) -> vec3f {
    let h = normalize(l + v);
    let n_l = saturate(dot(n, l));
    let n_v = saturate(dot(n, v)) + 1e-4;
    let n_h = saturate(dot(n, h));
    let a = material.roughness * material.roughness;
    let d = n_h * n_h * (a * a - 1.0) + 1.0;
    let fresnel = f0 + (1.0 - f0) * fifth(1.0 - saturate(dot(v, h)));
    return fresnel * (a * a / (3.14159265 * d * d) * n_l * 0.5 / mix(2.0 * n_l * n_v, n_l + n_v, a));
}

// Radiance of one light over π, so that a white surface that faces a light of colour 1 is 1.
fn lit_by(n: vec3f, v: vec3f, l: vec3f, color: vec3f, albedo: vec3f, f0: vec3f) -> vec3f {
    let facing = dot(n, l);
    var diffuse = saturate(facing) + material.translucency * saturate(-facing);
    var light = albedo * (1.0 - material.metallic) * diffuse;
    if SPECULAR {
        light += highlight(n, v, l, f0) * 3.14159265;
    }
    return light * color;
}

fn lit_by_point(light: PointLight, world: vec3f, n: vec3f, v: vec3f, albedo: vec3f, f0: vec3f) -> vec3f {
    let to_light = light.position - world;
    let squared = dot(to_light, to_light);
    let inverse = inverseSqrt(squared);
    let fade = saturate(1.0 - squared * inverse / light.range);
    return lit_by(n, v, to_light * inverse, light.color * (fade * fade), albedo, f0);
}

// What is interpolated across a triangle a fraction of a pixel thin need not be finite: on lavapipe one of some millions of pixels
// of `blinds` is not.
fn lost(v: vec3f) -> bool {
    return any((bitcast<vec3u>(v) & vec3u(0x7f800000u)) == vec3u(0x7f800000u));
}

fn shade(world: vec3f, normal: vec3f, front: bool, albedo: vec3f) -> vec3f {
    let emitted = material.emissive * albedo;
    if !LIT {
        return emitted;
    }
    let n = normalize(select(-normal, normal, front));
    let v = normalize(frame.eye - world);
    let f0 = mix(vec3f(material.specular), albedo, material.metallic);
    var sun = 1.0;
    if SHADOWED {
        sun = sunlight(world);
    }
    var color = emitted + sun * lit_by(n, v, frame.sun_direction, frame.sun_color, albedo, f0);
    let from_sky = mix(frame.sky_ground, frame.sky_zenith, 0.5 + 0.5 * n.y);
    color += frame.ambient * albedo * (1.0 - material.metallic) * from_sky;
    if SPECULAR {
        let fresnel = f0 + (1.0 - f0) * fifth(1.0 - saturate(dot(n, v)));
        let smooth_part = (1.0 - material.roughness) * (1.0 - material.roughness);
        color += frame.ambient * smooth_part * fresnel * sky(reflect(-v, n));
    }
    // Written out: on lavapipe the loop with its checks costs as much as all the rest of the shading.
    if N_LIGHTS > 0u {
        color += lit_by_point(lights[0], world, n, v, albedo, f0);
    }
    if N_LIGHTS > 1u {
        color += lit_by_point(lights[1], world, n, v, albedo, f0);
    }
    if N_LIGHTS > 2u {
        color += lit_by_point(lights[2], world, n, v, albedo, f0);
    }
    if N_LIGHTS > 3u {
        color += lit_by_point(lights[3], world, n, v, albedo, f0);
    }
    return select(color, emitted + frame.ambient * albedo, lost(color));
}

// Premultiplied where it is blended.
fn covered(color: vec3f, alpha: f32) -> vec4f {
    if ALPHA == ALPHA_BLENDED {
        return vec4f(color * alpha, alpha);
    }
    return vec4f(color, 1.0);
}

@fragment
fn fs_color(in: ColorVarying, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    let paint = base(in.tint, in.uv);
    if !kept(in.position, in.seed, paint.a) {
        discard;
    }
    return covered(shade(in.world, in.normal, front, paint.rgb), paint.a);
}

fn motion_px(clip: vec3f, previous_clip: vec3f) -> vec2f {
    // Else a product that is rounded in one quotient and not in the other moves what stands still.
    if all(clip == previous_clip) {
        return vec2f(0.0);
    }
    if previous_clip.z <= 0.0 {
        return vec2f(NO_MOTION_PX);
    }
    let moved = previous_clip.xy / previous_clip.z - clip.xy / clip.z;
    return moved * vec2f(0.5, -0.5) * frame.size_px;
}

@fragment
fn fs_surface(in: SurfaceVarying, @builtin(front_facing) front: bool) -> Surface {
    let paint = base(in.tint, in.uv);
    if !kept(in.position, in.seed, paint.a) {
        discard;
    }
    var motion_depth = vec3f(motion_px(in.clip, in.previous_clip), in.clip.z);
    if lost(motion_depth) {
        motion_depth = vec3f(0.0, 0.0, frame.near / in.position.z);
    }
    var reactive = material.reactive;
    if ALPHA == ALPHA_BLENDED {
        reactive *= paint.a;
    }
    return Surface(
        covered(shade(in.world, in.normal, front, paint.rgb), paint.a),
        vec4f(motion_depth, reactive),
        in.id,
        vec4f(paint.rgb, in.previous_clip.z),
    );
}

// For depth alone: only what has holes needs it.
@fragment
fn fs_cut(in: DepthVarying) {
    if base(in.tint, in.uv).a < 0.5 {
        discard;
    }
}

fn sky_direction(ndc: vec2f) -> vec3f {
    return frame.ray_axis + ndc.x * frame.ray_x + ndc.y * frame.ray_y;
}

@fragment
fn fs_sky_color(in: SkyVarying) -> @location(0) vec4f {
    return vec4f(sky(normalize(sky_direction(in.ndc))), 1.0);
}

@fragment
fn fs_sky_surface(in: SkyVarying) -> Surface {
    let direction = sky_direction(in.ndc);
    let color = vec4f(sky(normalize(direction)), 1.0);
    let clip = frame.clip_from_direction * vec4f(direction, 0.0);
    let previous_clip = frame.previous_clip_from_direction * vec4f(direction, 0.0);
    let motion = motion_px(clip.xyw, previous_clip.xyw);
    return Surface(color, vec4f(motion, SKY_DEPTH, 0.0), 0u, vec4f(color.rgb, SKY_DEPTH));
}
