//! Raster pipelines that bind by WGSL name, as [`Pass`](super::Pass) does for compute.
//!
//! All pipelines of a [`Raster`] come from one text and share its layouts, so that what is bound for one of them is
//! bound for all: only overrides, entry points and targets differ.

use super::{
    Gpu, GpuError, Texture,
    reflection::{Binding, Reflection, UniformValue},
};
use std::collections::{BTreeMap, BTreeSet};

/// A text with entry points for vertices and fragments, and what it binds.
#[derive(Debug)]
pub struct Raster {
    label: String,
    module: wgpu::ShaderModule,
    /// By group.
    groups: Vec<wgpu::BindGroupLayout>,
    layout: wgpu::PipelineLayout,
    bindings: BTreeMap<String, Binding>,
    overrides: BTreeSet<String>,
    defaults: BTreeSet<String>,
}

/// What one pipeline of a [`Raster`] is.
#[derive(Clone, Debug, Default)]
pub struct RasterSpec<'a> {
    /// What errors call it.
    pub label: &'a str,
    /// Entry point for vertices.
    pub vertex: &'a str,
    /// Entry point for fragments; none where only depth is written.
    pub fragment: Option<&'a str>,
    /// Overrides without a value in the text must be here.
    pub overrides: &'a [(&'a str, f64)],
    /// Vertex buffers, by slot.
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    /// What the fragments write to.
    pub targets: &'a [Option<wgpu::ColorTargetState>],
    /// The depth test, on [`RasterSpec::DEPTH_FORMAT`].
    pub depth: Option<DepthTest>,
    /// Whether triangles seen from behind are left out. Front faces are counter-clockwise.
    pub cull: bool,
}

/// How a pipeline uses the depth buffer.
#[derive(Clone, Copy, Debug)]
pub struct DepthTest {
    /// What passes.
    pub compare: wgpu::CompareFunction,
    /// Whether what passes is kept.
    pub write: bool,
    /// Added to the depth, with the triangle's slope, to keep a shadow off its own caster.
    pub bias: wgpu::DepthBiasState,
}

impl RasterSpec<'_> {
    /// Format of every depth buffer.
    pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
}

/// What a name of a bind group stands for.
#[derive(Clone, Copy, Debug)]
pub enum RasterBound<'a> {
    /// A whole texture.
    Texture(&'a Texture),
    /// A sampler.
    Sampler(&'a wgpu::Sampler),
    /// A whole buffer.
    Buffer(&'a wgpu::Buffer),
    /// A uniform, field by field.
    Uniform(&'a [(&'a str, UniformValue)]),
}

impl Raster {
    /// Compiles `sources`, joined together, for all of `entries`.
    pub fn new(gpu: &Gpu, label: &str, sources: &[&str], entries: &[&str]) -> Result<Self, GpuError> {
        let error = |message: String| GpuError::Pass {
            pass: label.to_owned(),
            message,
        };
        let source = sources.join("\n");
        let reflected = Reflection::new(&source, entries).map_err(error)?;
        let n_groups = reflected.bindings.values().map(|binding| binding.group + 1).max();
        let groups: Vec<_> = (0..n_groups.unwrap_or(0))
            .map(|group| {
                let entries: Vec<_> = reflected
                    .bindings
                    .values()
                    .filter(|binding| binding.group == group)
                    .map(|binding| wgpu::BindGroupLayoutEntry {
                        binding: binding.index,
                        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
                        ty: binding.kind,
                        count: None,
                    })
                    .collect();
                gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries: &entries,
                })
            })
            .collect();
        let layouts: Vec<_> = groups.iter().map(Some).collect();
        let (module, layout) = gpu
            .scope(label, || {
                let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(label),
                    source: wgpu::ShaderSource::Wgsl(source.into()),
                });
                let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(label),
                    bind_group_layouts: &layouts,
                    immediate_size: 0,
                });
                (module, layout)
            })
            .map_err(|cause| error(cause.to_string()))?;
        Ok(Self {
            label: label.to_owned(),
            module,
            groups,
            layout,
            bindings: reflected.bindings,
            overrides: reflected.overrides,
            defaults: reflected.defaults,
        })
    }

    fn error(&self, message: String) -> GpuError {
        GpuError::Pass {
            pass: self.label.clone(),
            message,
        }
    }

    /// Compiles one pipeline.
    pub fn pipeline(&self, gpu: &Gpu, spec: &RasterSpec<'_>) -> Result<wgpu::RenderPipeline, GpuError> {
        let set = |name: &str| spec.overrides.iter().any(|(known, _)| *known == name);
        if let Some((name, _)) = spec.overrides.iter().find(|(name, _)| !self.overrides.contains(*name)) {
            return Err(self.error(format!("the shader has no override `{name}`")));
        }
        if let Some(name) = self.overrides.difference(&self.defaults).find(|name| !set(name)) {
            return Err(self.error(format!("override `{name}` is not set")));
        }
        let options = wgpu::PipelineCompilationOptions {
            constants: spec.overrides,
            zero_initialize_workgroup_memory: false,
        };
        let buffers: Vec<_> = spec.buffers.iter().cloned().map(Some).collect();
        gpu.scope(spec.label, || {
            gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(spec.label),
                layout: Some(&self.layout),
                vertex: wgpu::VertexState {
                    module: &self.module,
                    entry_point: Some(spec.vertex),
                    compilation_options: options.clone(),
                    buffers: &buffers,
                },
                primitive: wgpu::PrimitiveState {
                    cull_mode: spec.cull.then_some(wgpu::Face::Back),
                    ..wgpu::PrimitiveState::default()
                },
                depth_stencil: spec.depth.map(|test| wgpu::DepthStencilState {
                    format: RasterSpec::DEPTH_FORMAT,
                    depth_write_enabled: Some(test.write),
                    depth_compare: Some(test.compare),
                    stencil: wgpu::StencilState::default(),
                    bias: test.bias,
                }),
                multisample: wgpu::MultisampleState::default(),
                fragment: spec.fragment.map(|entry| wgpu::FragmentState {
                    module: &self.module,
                    entry_point: Some(entry),
                    compilation_options: options.clone(),
                    targets: spec.targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        })
    }

    /// Binds every name of a group. A missing, unknown or twice-bound name is an error.
    pub fn bind(&self, gpu: &Gpu, group: u32, bound: &[(&str, RasterBound<'_>)]) -> Result<wgpu::BindGroup, GpuError> {
        let in_group = |binding: &&Binding| binding.group == group;
        let mut buffers = Vec::new();
        for (name, resource) in bound {
            let binding = self.bindings.get(*name).filter(in_group);
            let binding = binding.ok_or_else(|| self.error(format!("group {group} has no binding `{name}`")))?;
            buffers.push(match resource {
                RasterBound::Uniform(fields) => {
                    let buffer = binding.uniform_buffer(gpu, name, fields);
                    Some(buffer.map_err(|problem| self.error(problem))?)
                }
                _ => None,
            });
        }
        for (name, _) in self.bindings.iter().filter(|(_, binding)| in_group(binding)) {
            match bound.iter().filter(|(set, _)| set == name).count() {
                1 => {}
                0 => return Err(self.error(format!("`{name}` is not bound"))),
                _ => return Err(self.error(format!("`{name}` is bound twice"))),
            }
        }
        let entries: Vec<_> = bound
            .iter()
            .zip(&buffers)
            .map(|((name, resource), uniform)| wgpu::BindGroupEntry {
                binding: self.bindings[*name].index,
                resource: match (resource, uniform) {
                    (_, Some(buffer)) => buffer.as_entire_binding(),
                    (RasterBound::Texture(texture), _) => wgpu::BindingResource::TextureView(texture.view()),
                    (RasterBound::Sampler(sampler), _) => wgpu::BindingResource::Sampler(sampler),
                    (RasterBound::Buffer(buffer), _) => buffer.as_entire_binding(),
                    (RasterBound::Uniform(_), None) => unreachable!("a uniform was given its buffer above"),
                },
            })
            .collect();
        gpu.scope(&self.label, || {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(&self.label),
                layout: &self.groups[group as usize],
                entries: &entries,
            })
        })
    }
}
