//! The raster pipelines of a scene: a variant for each kind of material, and what each variant draws to.

use super::model::{Alpha, Material, Scene, Vertex};
use crate::gpu::{DepthTest, Gpu, GpuError, Raster, RasterSpec};
use std::collections::BTreeMap;
use wgpu::TextureFormat;

/// Formats of what the surface pass writes: colour; motion, depth and reactive mask; object id; albedo.
pub(super) const SURFACE_FORMATS: [TextureFormat; 4] = [
    TextureFormat::Rgba32Float,
    TextureFormat::Rgba32Float,
    TextureFormat::R32Uint,
    TextureFormat::Rgba32Float,
];

/// What materials share a pipeline by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Kind {
    alpha: Alpha,
    textured: bool,
    lit: bool,
    specular: bool,
    two_sided: bool,
}

impl Kind {
    pub fn of(material: &Material) -> Self {
        Self {
            alpha: material.alpha,
            textured: material.texture.is_some(),
            lit: material.lit,
            specular: material.roughness.is_some(),
            two_sided: material.two_sided,
        }
    }
}

/// The pipelines of one kind of material.
#[derive(Debug)]
pub(super) struct Variant {
    /// Colour alone, where `depth` left it in front.
    pub color: wgpu::RenderPipeline,
    /// Depth alone, ahead of colour; none where colour decides what is seen through.
    pub depth: Option<wgpu::RenderPipeline>,
    /// Everything a frame holds.
    pub surface: wgpu::RenderPipeline,
    /// Depth from the sun.
    pub shadow: wgpu::RenderPipeline,
    /// Depth of the frame before.
    pub previous: wgpu::RenderPipeline,
}

/// All of a scene's.
#[derive(Debug)]
pub(super) struct Pipelines {
    pub raster: Raster,
    pub variants: BTreeMap<Kind, Variant>,
    pub sky_color: wgpu::RenderPipeline,
    pub sky_surface: wgpu::RenderPipeline,
}

const SOURCES: [&str; 2] = [
    include_str!("../../shaders/scene/surface.wgsl"),
    include_str!("../../shaders/scene/frame.wgsl"),
];
const ENTRIES: [&str; 12] = [
    "vs_color",
    "vs_depth",
    "vs_cut",
    "vs_surface",
    "vs_shadow",
    "vs_previous",
    "vs_sky",
    "fs_color",
    "fs_surface",
    "fs_cut",
    "fs_sky_color",
    "fs_sky_surface",
];

const STRIDE: u64 = size_of::<Vertex>() as u64;
const CURRENT: [wgpu::VertexAttribute; 3] = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x2];
const PREVIOUS: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![3 => Float32x3];

const OBJECT: [wgpu::VertexAttribute; 11] = wgpu::vertex_attr_array![
    4 => Float32x4, 5 => Float32x4, 6 => Float32x4,
    7 => Float32x4, 8 => Float32x4, 9 => Float32x4,
    10 => Float32x4, 11 => Float32x4, 12 => Float32x4,
    13 => Float32x4, 14 => Uint32,
];

/// An object's matrices and looks, as `Object` in `frame.wgsl` has them.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct DeviceObject {
    /// Rows x, y and w.
    pub clip_from_object: [[f32; 4]; 3],
    /// Rows x, y and w.
    pub previous_clip_from_object: [[f32; 4]; 3],
    /// Rows x, y and z.
    pub world_from_object: [[f32; 4]; 3],
    pub tint: [f32; 4],
    pub id: u32,
}

/// The vertices now, those of the frame before, which are the same where nothing deforms, and the objects.
const BUFFERS: [wgpu::VertexBufferLayout<'static>; 3] = [
    wgpu::VertexBufferLayout {
        array_stride: STRIDE,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &CURRENT,
    },
    wgpu::VertexBufferLayout {
        array_stride: STRIDE,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &PREVIOUS,
    },
    wgpu::VertexBufferLayout {
        array_stride: size_of::<DeviceObject>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &OBJECT,
    },
];

fn depth(compare: wgpu::CompareFunction, write: bool) -> Option<DepthTest> {
    let bias = wgpu::DepthBiasState::default();
    Some(DepthTest { compare, write, bias })
}

impl Pipelines {
    pub fn new(gpu: &Gpu, scene: &Scene, n_lights: usize) -> Result<Self, GpuError> {
        let raster = Raster::new(gpu, "scene", &SOURCES, &ENTRIES)?;
        let mut variants = BTreeMap::new();
        for material in &scene.materials {
            let kind = Kind::of(material);
            if let std::collections::btree_map::Entry::Vacant(entry) = variants.entry(kind) {
                entry.insert(variant(gpu, &raster, kind, scene.shadows.is_some(), n_lights)?);
            }
        }
        let sky = |label, fragment, targets: &[_]| {
            raster.pipeline(
                gpu,
                &RasterSpec {
                    label,
                    vertex: "vs_sky",
                    fragment: Some(fragment),
                    overrides: &overrides(Kind::of(&Material::default()), false, 0),
                    targets,
                    depth: depth(wgpu::CompareFunction::GreaterEqual, false),
                    ..RasterSpec::default()
                },
            )
        };
        Ok(Self {
            variants,
            sky_color: sky("sky, colour", "fs_sky_color", &opaque_targets()[..1])?,
            sky_surface: sky("sky, surface", "fs_sky_surface", &opaque_targets())?,
            raster,
        })
    }
}

fn overrides(kind: Kind, shadowed: bool, n_lights: usize) -> [(&'static str, f64); 6] {
    [
        ("ALPHA", f64::from(kind.alpha as u32)),
        ("TEXTURED", f64::from(u8::from(kind.textured))),
        ("LIT", f64::from(u8::from(kind.lit))),
        ("SPECULAR", f64::from(u8::from(kind.specular))),
        ("SHADOWED", f64::from(u8::from(shadowed))),
        ("N_LIGHTS", n_lights as f64),
    ]
}

fn opaque_targets() -> [Option<wgpu::ColorTargetState>; 4] {
    SURFACE_FORMATS.map(|format| Some(format.into()))
}

/// Blended surfaces change the colour, and raise the reactive mask; motion, depth, id and albedo stay those behind.
fn blended_targets() -> [Option<wgpu::ColorTargetState>; 4] {
    let component = |operation, dst_factor| wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor,
        operation,
    };
    let over = component(wgpu::BlendOperation::Add, wgpu::BlendFactor::OneMinusSrcAlpha);
    let larger = component(wgpu::BlendOperation::Max, wgpu::BlendFactor::One);
    let blends = [
        (Some(over), wgpu::ColorWrites::ALL),
        (Some(larger), wgpu::ColorWrites::ALPHA),
        (None, wgpu::ColorWrites::empty()),
        (None, wgpu::ColorWrites::empty()),
    ];
    std::array::from_fn(|i| {
        let (blend, write_mask) = blends[i];
        Some(wgpu::ColorTargetState {
            format: SURFACE_FORMATS[i],
            blend: blend.map(|component| wgpu::BlendState {
                color: component,
                alpha: component,
            }),
            write_mask,
        })
    })
}

fn variant(gpu: &Gpu, raster: &Raster, kind: Kind, shadowed: bool, n_lights: usize) -> Result<Variant, GpuError> {
    let blended = kind.alpha == Alpha::Blended;
    let targets = if blended { blended_targets() } else { opaque_targets() };
    let overrides_of = |alpha| overrides(Kind { alpha, ..kind }, shadowed, n_lights);
    let (overrides, overrides_without_holes) = (overrides_of(kind.alpha), overrides_of(Alpha::Opaque));
    let base = RasterSpec {
        overrides: &overrides,
        buffers: &BUFFERS,
        depth: depth(wgpu::CompareFunction::GreaterEqual, !blended),
        cull: !kind.two_sided,
        ..RasterSpec::default()
    };
    let holes = (kind.alpha != Alpha::Opaque).then_some("fs_cut");
    let depth_vertex = match kind.alpha {
        Alpha::Opaque => Some("vs_depth"),
        Alpha::Cut => Some("vs_cut"),
        Alpha::Stochastic | Alpha::Blended => None,
    };
    let color = RasterSpec {
        label: "scene, colour",
        vertex: "vs_color",
        fragment: Some("fs_color"),
        targets: &targets[..1],
        ..base.clone()
    };
    let color_after_depth = RasterSpec {
        overrides: &overrides_without_holes,
        depth: depth(wgpu::CompareFunction::Equal, false),
        ..color.clone()
    };
    let pipeline = |spec: RasterSpec<'_>| raster.pipeline(gpu, &spec);
    Ok(Variant {
        color: pipeline(if depth_vertex.is_some() {
            color_after_depth
        } else {
            color
        })?,
        depth: depth_vertex
            .map(|vertex| {
                pipeline(RasterSpec {
                    label: "scene, depth",
                    vertex,
                    fragment: holes,
                    ..base.clone()
                })
            })
            .transpose()?,
        surface: pipeline(RasterSpec {
            label: "scene, surface",
            vertex: "vs_surface",
            fragment: Some("fs_surface"),
            targets: &targets,
            ..base.clone()
        })?,
        shadow: pipeline(RasterSpec {
            label: "scene, shadow",
            vertex: "vs_shadow",
            fragment: holes,
            depth: Some(DepthTest {
                compare: wgpu::CompareFunction::LessEqual,
                write: true,
                bias: wgpu::DepthBiasState {
                    constant: 2,
                    slope_scale: 2.0,
                    clamp: 0.0,
                },
            }),
            ..base.clone()
        })?,
        previous: pipeline(RasterSpec {
            label: "scene, previous depth",
            vertex: "vs_previous",
            fragment: holes,
            depth: depth(wgpu::CompareFunction::GreaterEqual, true),
            ..base
        })?,
    })
}
