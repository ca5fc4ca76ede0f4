//! Draws a scene: uploads what it is made of once, and what moves once a frame; then any number of views.

use super::{
    model::{Alpha, Filter, Material, Mesh, Scene},
    moment::Moment,
    pipelines::{DeviceObject, Kind, Pipelines, SURFACE_FORMATS, Variant},
    texture::Mips,
};
use crate::{
    gpu::{Gpu, GpuError, Raster, RasterBound, RasterSpec, Texture},
    image::{Extent, Image},
};
use glam::{DMat4, DVec3};
use std::{ops::Range, sync::Arc};

/// How textures are looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texturing {
    /// Without, only the finest level is read.
    pub mipmaps: bool,
    /// Added to the level, before the nearest two are blended.
    pub mip_bias: f64,
}

/// One sample a pixel, or a grid of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// In pixels of the target.
    pub jitter_px: [f64; 2],
    pub seed: u32,
    /// Pixels of the target for one that textures are filtered for, along each axis.
    pub fineness: u32,
}

/// Where a view's colour goes.
#[derive(Debug)]
pub(super) struct ColorTarget {
    pub color: Texture,
    depth: Texture,
}

/// Where all that a frame holds goes, in the order of [`SURFACE_FORMATS`].
#[derive(Debug)]
pub(super) struct SurfaceTarget {
    pub images: [Texture; 4],
    depth: Texture,
}

impl ColorTarget {
    pub fn new(gpu: &Gpu, extent: Extent) -> Self {
        Self {
            color: Texture::target(gpu, "colour", extent, SURFACE_FORMATS[0]),
            depth: Texture::target(gpu, "depth test", extent, RasterSpec::DEPTH_FORMAT),
        }
    }
}

impl SurfaceTarget {
    pub fn new(gpu: &Gpu, extent: Extent) -> Self {
        Self {
            images: SURFACE_FORMATS.map(|format| Texture::target(gpu, "surface", extent, format)),
            depth: Texture::target(gpu, "depth test", extent, RasterSpec::DEPTH_FORMAT),
        }
    }
}

struct DeviceMesh {
    vertices: wgpu::Buffer,
    /// Of the frame before, where they deform.
    previous: Option<wgpu::Buffer>,
    indices: wgpu::Buffer,
    n_indices: u32,
}

/// Objects that are drawn at once.
struct Batch {
    mesh: usize,
    material: usize,
    objects: Range<u32>,
}

/// As `PointLight` in `frame.wgsl`.
#[derive(Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct DeviceLight {
    position: [f32; 3],
    range: f32,
    color: [f32; 3],
    padding: f32,
}

/// As many as `frame.wgsl` has room for.
const MAX_LIGHTS: usize = 4;

/// A scene on the device.
pub(super) struct Renderer {
    gpu: Gpu,
    pub scene: Arc<Scene>,
    texturing: Texturing,
    pipelines: Pipelines,
    meshes: Vec<DeviceMesh>,
    /// By material; the last is for the sky, which has none.
    materials: Vec<wgpu::BindGroup>,
    opaque: Vec<Batch>,
    blended: Vec<Batch>,
    objects: wgpu::Buffer,
    lights: wgpu::Buffer,
    shadow_map: Texture,
    /// Bound while the shadow map is drawn.
    no_shadow_map: Texture,
    shadow_sampler: wgpu::Sampler,
}

/// A frame that was uploaded, and is bound for its views.
pub(super) struct PreparedFrame {
    pub moment: Moment,
    group: wgpu::BindGroup,
    /// Blended batches from the farthest.
    blended: Vec<usize>,
}

impl Renderer {
    pub fn new(gpu: &Gpu, scene: Arc<Scene>, texturing: Texturing) -> Result<Self, GpuError> {
        let n_lights = (scene.lighting)(0.0).points.len();
        assert!(n_lights <= MAX_LIGHTS, "a scene has at most {MAX_LIGHTS} lamps");
        let pipelines = Pipelines::new(gpu, &scene, n_lights)?;
        let side = scene.shadows.map_or(1, |region| region.side);
        let depth = |side| Texture::target(gpu, "shadow map", Extent::new(side, side), RasterSpec::DEPTH_FORMAT);
        let (opaque, blended) = batches(&scene);
        gpu.scope("uploading a scene", || {
            Ok::<_, GpuError>(Self {
                gpu: gpu.clone(),
                meshes: scene.meshes.iter().map(|mesh| upload(gpu, mesh)).collect(),
                materials: bind_materials(gpu, &pipelines.raster, &scene, texturing)?,
                opaque,
                blended,
                objects: buffer(
                    gpu,
                    "objects",
                    scene.objects.len().max(1) * size_of::<DeviceObject>(),
                    wgpu::BufferUsages::VERTEX,
                ),
                lights: buffer(
                    gpu,
                    "lights",
                    MAX_LIGHTS * size_of::<DeviceLight>(),
                    wgpu::BufferUsages::UNIFORM,
                ),
                shadow_map: depth(side),
                no_shadow_map: depth(1),
                shadow_sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                    label: Some("shadow"),
                    mag_filter: wgpu::FilterMode::Linear,
                    min_filter: wgpu::FilterMode::Linear,
                    compare: Some(wgpu::CompareFunction::LessEqual),
                    ..wgpu::SamplerDescriptor::default()
                }),
                pipelines,
                texturing,
                scene,
            })
        })?
    }

    /// Uploads the scene at a time in frames, whose motion since the time before is counted in pixels of `extent`, and draws
    /// its shadows.
    pub fn prepare(&self, times: [f64; 2], extent: Extent, aspect: f64) -> Result<PreparedFrame, GpuError> {
        let moment = Moment::new(&self.scene, times, aspect);
        self.upload_deformed(times);
        self.upload_objects(&moment);
        let shadow_group = self.bind_frame(&moment, extent, &self.no_shadow_map)?;
        if self.scene.shadows.is_some() {
            self.draw_shadows(&shadow_group)?;
        }
        let world_from_view = moment.camera.view;
        let mut blended: Vec<(f64, usize)> = self
            .blended
            .iter()
            .enumerate()
            .map(|(i, batch)| {
                let at = moment.objects[batch.objects.start as usize][0].transform_point3(DVec3::ZERO);
                (-world_from_view.transform_point3(at).z, i)
            })
            .collect();
        blended.sort_by(|a, b| b.0.total_cmp(&a.0));
        Ok(PreparedFrame {
            group: self.bind_frame(&moment, extent, &self.shadow_map)?,
            moment,
            blended: blended.into_iter().map(|(_, i)| i).collect(),
        })
    }

    fn upload_deformed(&self, [now, before]: [f64; 2]) {
        for (mesh, device) in self.scene.meshes.iter().zip(&self.meshes) {
            let (Some(deform), Some(previous)) = (&mesh.deform, &device.previous) else {
                continue;
            };
            for (buffer, time) in [(&device.vertices, now), (previous, before)] {
                let vertices = deform(time, &mesh.vertices);
                self.gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&vertices));
            }
        }
    }

    fn upload_objects(&self, moment: &Moment) {
        let clip = [moment.camera.from_world(), moment.previous_camera.from_world()];
        let rows = |matrix: DMat4, kept: [usize; 3]| kept.map(|i| matrix.row(i).as_vec4().to_array());
        let objects: Vec<_> = self
            .scene
            .objects
            .iter()
            .zip(&moment.objects)
            .map(|(object, [now, before])| DeviceObject {
                clip_from_object: rows(clip[0] * *now, [0, 1, 3]),
                previous_clip_from_object: rows(clip[1] * *before, [0, 1, 3]),
                world_from_object: rows(*now, [0, 1, 2]),
                tint: object.tint,
                id: object.id,
            })
            .collect();
        self.gpu
            .queue
            .write_buffer(&self.objects, 0, bytemuck::cast_slice(&objects));
        let lights: Vec<_> = moment
            .lighting
            .points
            .iter()
            .map(|light| DeviceLight {
                position: light.position.as_vec3().to_array(),
                range: light.range as f32,
                color: light.color,
                padding: 0.0,
            })
            .collect();
        self.gpu
            .queue
            .write_buffer(&self.lights, 0, bytemuck::cast_slice(&lights));
    }

    fn bind_frame(&self, moment: &Moment, extent: Extent, shadow_map: &Texture) -> Result<wgpu::BindGroup, GpuError> {
        let vector = |v: DVec3| v.as_vec3().to_array();
        let columns = |matrix: DMat4| matrix.as_mat4().to_cols_array_2d();
        let light = &moment.lighting;
        let [axis, x, y] = moment.camera.rays();
        let fields = [
            ("eye", vector(moment.camera.eye()).into()),
            ("size_px", [extent.width as f32, extent.height as f32].into()),
            ("sun_direction", vector(light.sun_direction.normalize()).into()),
            ("sun_color", light.sun_color.into()),
            ("sky_zenith", light.sky_zenith.into()),
            ("sky_horizon", light.sky_horizon.into()),
            ("sky_ground", light.sky_ground.into()),
            ("ambient", light.ambient.into()),
            ("near", (self.scene.near as f32).into()),
            ("shadow_from_world", columns(moment.shadow_from_world).into()),
            ("ray_axis", vector(axis).into()),
            ("ray_x", vector(x).into()),
            ("ray_y", vector(y).into()),
            ("clip_from_direction", columns(moment.camera.from_direction()).into()),
            (
                "previous_clip_from_direction",
                columns(moment.previous_camera.from_direction()).into(),
            ),
        ];
        self.pipelines.raster.bind(
            &self.gpu,
            0,
            &[
                ("frame", RasterBound::Uniform(&fields)),
                ("lights", RasterBound::Buffer(&self.lights)),
                ("shadow_map", RasterBound::Texture(shadow_map)),
                ("shadow_sampler", RasterBound::Sampler(&self.shadow_sampler)),
            ],
        )
    }

    fn bind_view(&self, view: View, extent: Extent) -> Result<wgpu::BindGroup, GpuError> {
        let ndc = |i: usize, side: u32, sign: f64| (sign * 2.0 * view.jitter_px[i] / f64::from(side)) as f32;
        let fields = [
            (
                "jitter_ndc",
                [ndc(0, extent.width, 1.0), ndc(1, extent.height, -1.0)].into(),
            ),
            (
                "mip_bias",
                ((self.texturing.mip_bias + f64::from(view.fineness.ilog2())) as f32).into(),
            ),
            ("seed", view.seed.into()),
        ];
        self.pipelines
            .raster
            .bind(&self.gpu, 1, &[("view", RasterBound::Uniform(&fields))])
    }

    fn draw_shadows(&self, group: &wgpu::BindGroup) -> Result<(), GpuError> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let no_view = View {
            jitter_px: [0.0; 2],
            seed: 0,
            fineness: 1,
        };
        let view = self.bind_view(no_view, Extent::new(1, 1))?;
        {
            let mut pass = begin(&mut encoder, "shadows", &[], &self.shadow_map, Some(1.0));
            pass.set_bind_group(0, group, &[]);
            pass.set_bind_group(1, &view, &[]);
            for batch in &self.opaque {
                if self.scene.materials[batch.material].casts_shadow {
                    self.draw(&mut pass, batch, |variant| Some(&variant.shadow));
                }
            }
        }
        self.gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Records a view of colour alone.
    pub fn draw_color(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &PreparedFrame,
        view: View,
        target: &ColorTarget,
    ) -> Result<(), GpuError> {
        let view = self.bind_view(view, target.color.extent())?;
        {
            // Shading costs far more than rasterising: first find what is in front.
            let mut pass = begin(encoder, "depth", &[], &target.depth, Some(0.0));
            pass.set_bind_group(0, &frame.group, &[]);
            pass.set_bind_group(1, &view, &[]);
            for batch in &self.opaque {
                self.draw(&mut pass, batch, |variant| variant.depth.as_ref());
            }
        }
        let mut pass = begin(encoder, "colour", &[&target.color], &target.depth, None);
        self.draw_all(&mut pass, frame, &view, &self.pipelines.sky_color, |variant| {
            Some(&variant.color)
        });
        Ok(())
    }

    /// Records a view of everything a frame holds.
    pub fn draw_surface(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &PreparedFrame,
        view: View,
        target: &SurfaceTarget,
    ) -> Result<(), GpuError> {
        let view = self.bind_view(view, target.images[0].extent())?;
        let mut pass = begin(encoder, "surface", &target.images.each_ref(), &target.depth, Some(0.0));
        self.draw_all(&mut pass, frame, &view, &self.pipelines.sky_surface, |variant| {
            Some(&variant.surface)
        });
        Ok(())
    }

    /// Records the depth that the frame before had, without jitter: near / w.
    pub fn draw_previous_depth(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &PreparedFrame,
        depth: &Texture,
    ) -> Result<(), GpuError> {
        let no_jitter = View {
            jitter_px: [0.0; 2],
            seed: 0,
            fineness: 1,
        };
        let view = self.bind_view(no_jitter, depth.extent())?;
        let mut pass = begin(encoder, "previous depth", &[], depth, Some(0.0));
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, &view, &[]);
        for batch in &self.opaque {
            self.draw(&mut pass, batch, |variant| Some(&variant.previous));
        }
        Ok(())
    }

    fn draw_all<'a>(
        &'a self,
        pass: &mut wgpu::RenderPass<'_>,
        frame: &PreparedFrame,
        view: &wgpu::BindGroup,
        sky: &wgpu::RenderPipeline,
        pipeline: impl Fn(&'a Variant) -> Option<&'a wgpu::RenderPipeline>,
    ) {
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, view, &[]);
        for batch in &self.opaque {
            self.draw(pass, batch, &pipeline);
        }
        pass.set_pipeline(sky);
        pass.set_bind_group(2, self.materials.last(), &[]);
        pass.draw(0..3, 0..1);
        for &i in &frame.blended {
            self.draw(pass, &self.blended[i], &pipeline);
        }
    }

    fn draw<'a>(
        &'a self,
        pass: &mut wgpu::RenderPass<'_>,
        batch: &Batch,
        pipeline: impl Fn(&'a Variant) -> Option<&'a wgpu::RenderPipeline>,
    ) {
        let mesh = &self.meshes[batch.mesh];
        let kind = Kind::of(&self.scene.materials[batch.material]);
        let Some(pipeline) = pipeline(&self.pipelines.variants[&kind]) else {
            return;
        };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(2, &self.materials[batch.material], &[]);
        pass.set_vertex_buffer(0, mesh.vertices.slice(..));
        pass.set_vertex_buffer(1, mesh.previous.as_ref().unwrap_or(&mesh.vertices).slice(..));
        pass.set_vertex_buffer(2, self.objects.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.n_indices, 0, batch.objects.clone());
    }
}

/// A pass that first clears everything, or nothing: after a pass of depth, every pixel is drawn to, the last by the sky.
fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &str,
    targets: &[&Texture],
    depth: &Texture,
    cleared_depth: Option<f32>,
) -> wgpu::RenderPass<'e> {
    let color_attachments: Vec<_> = targets
        .iter()
        .map(|target| {
            Some(wgpu::RenderPassColorAttachment {
                view: target.view(),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: match cleared_depth {
                        Some(_) => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        None => wgpu::LoadOp::Load,
                    },
                    store: wgpu::StoreOp::Store,
                },
            })
        })
        .collect();
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &color_attachments,
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth.view(),
            depth_ops: Some(wgpu::Operations {
                load: cleared_depth.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear),
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}

/// Opaque objects that follow one another and share mesh and material, and blended ones each alone.
fn batches(scene: &Scene) -> (Vec<Batch>, Vec<Batch>) {
    let (mut opaque, mut blended): (Vec<Batch>, Vec<Batch>) = Default::default();
    for (i, object) in scene.objects.iter().enumerate() {
        let i = i as u32;
        let alone = Batch {
            mesh: object.mesh,
            material: object.material,
            objects: i..i + 1,
        };
        if scene.materials[object.material].alpha == Alpha::Blended {
            blended.push(alone);
            continue;
        }
        match opaque.last_mut() {
            Some(last) if last.objects.end == i && last.mesh == object.mesh && last.material == object.material => {
                last.objects.end += 1;
            }
            _ => opaque.push(alone),
        }
    }
    (opaque, blended)
}

fn buffer(gpu: &Gpu, label: &str, size: usize, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size as u64,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn upload(gpu: &Gpu, mesh: &Mesh) -> DeviceMesh {
    let buffer = |usage, bytes: &[u8]| {
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("mesh"),
            size: bytes.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&buffer, 0, bytes);
        buffer
    };
    let vertices = || buffer(wgpu::BufferUsages::VERTEX, bytemuck::cast_slice(&mesh.vertices));
    DeviceMesh {
        vertices: vertices(),
        previous: mesh.deform.is_some().then(vertices),
        indices: buffer(wgpu::BufferUsages::INDEX, bytemuck::cast_slice(&mesh.indices)),
        n_indices: mesh.indices.len() as u32,
    }
}

fn sampler(gpu: &Gpu, filter: Filter, mipmaps: bool) -> wgpu::Sampler {
    let blended = filter == Filter::Trilinear;
    let between = |yes| {
        if yes {
            wgpu::FilterMode::Linear
        } else {
            wgpu::FilterMode::Nearest
        }
    };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("texture"),
        address_mode_u: wgpu::AddressMode::Repeat,
        address_mode_v: wgpu::AddressMode::Repeat,
        mag_filter: between(blended),
        min_filter: between(blended),
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        lod_max_clamp: if blended && mipmaps { 32.0 } else { 0.0 },
        ..wgpu::SamplerDescriptor::default()
    })
}

/// One group a material, and one more for the sky.
fn bind_materials(
    gpu: &Gpu,
    raster: &Raster,
    scene: &Scene,
    texturing: Texturing,
) -> Result<Vec<wgpu::BindGroup>, GpuError> {
    let white = Mips::new(Image::filled(Extent::new(1, 1), [1.0; 4]));
    let white = Texture::mipmapped(gpu, "white", &white.levels);
    let textures: Vec<_> = scene
        .textures
        .iter()
        .map(|mips| Texture::mipmapped(gpu, "texture", &mips.levels))
        .collect();
    let samplers = [Filter::Trilinear, Filter::Nearest].map(|filter| sampler(gpu, filter, texturing.mipmaps));
    let sky = Material::default();
    let bind = |material: &Material| {
        let fields = [
            ("color", material.color.into()),
            ("alpha", material.opacity.into()),
            ("emissive", material.emissive.into()),
            ("roughness", material.roughness.unwrap_or(1.0).into()),
            ("specular", material.specular.into()),
            ("metallic", material.metallic.into()),
            ("reactive", material.reactive.into()),
            ("translucency", material.translucency.into()),
        ];
        let texture = material.texture.map_or(&white, |index| &textures[index]);
        raster.bind(
            gpu,
            2,
            &[
                ("material", RasterBound::Uniform(&fields)),
                ("base_texture", RasterBound::Texture(texture)),
                (
                    "base_sampler",
                    RasterBound::Sampler(&samplers[material.filter as usize]),
                ),
            ],
        )
    };
    scene.materials.iter().chain([&sky]).map(bind).collect()
}
