//! A compute pass that binds by WGSL name.
//!
//! ```text
//! pass.bind("color", &color).bind("history", &history).uniform("frame", &[("jitter_px", jitter.into())]).dispatch(extent)?
//! ```
//! A missing, unknown or twice-bound name is an error that names the pass, and so is an override or a uniform's field.

use super::{Gpu, GpuError, Texture};
use crate::image::Extent;
use std::collections::BTreeMap;
use wgpu::naga::{self, valid::GlobalUse as Use};

/// A compiled compute shader and what it binds.
#[derive(Debug)]
pub struct Pass {
    label: String,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// By WGSL name; only what the entry point uses.
    bindings: BTreeMap<String, Binding>,
    workgroup: [u32; 2],
}

#[derive(Debug)]
struct Binding {
    index: u32,
    uniform: Option<UniformLayout>,
    access: Access,
}

/// What a shader does with what is bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// Looks at its values, and not at its size alone.
    pub reads: bool,
    /// Changes them.
    pub writes: bool,
    /// They are `u32`.
    pub integers: bool,
}

#[derive(Debug)]
struct UniformLayout {
    /// Bytes.
    size: u32,
    /// Byte offset and size of each field.
    fields: BTreeMap<String, (u32, u32)>,
}

/// One field of a uniform.
#[derive(Clone, Copy, Debug)]
pub enum UniformValue {
    /// `u32`
    U32(u32),
    /// `f32`
    F32(f32),
    /// `vec2f`
    Vec2([f32; 2]),
    /// `vec3f`
    Vec3([f32; 3]),
}

impl UniformValue {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::U32(value) => bytemuck::bytes_of(value),
            Self::F32(value) => bytemuck::bytes_of(value),
            Self::Vec2(value) => bytemuck::bytes_of(value),
            Self::Vec3(value) => bytemuck::bytes_of(value),
        }
    }
}

macro_rules! from {
    ($($type:ty => $variant:ident),*) => {
        $(impl From<$type> for UniformValue {
            fn from(value: $type) -> Self {
                Self::$variant(value)
            }
        })*
    };
}
from!(u32 => U32, f32 => F32, [f32; 2] => Vec2, [f32; 3] => Vec3);

/// A resource that a name can be bound to.
#[derive(Clone, Copy, Debug)]
pub enum Bound<'a> {
    /// A whole texture.
    Texture(&'a Texture),
    /// A whole buffer.
    Buffer(&'a wgpu::Buffer),
}

impl<'a> From<&'a Texture> for Bound<'a> {
    fn from(texture: &'a Texture) -> Self {
        Self::Texture(texture)
    }
}

impl<'a> From<&'a wgpu::Buffer> for Bound<'a> {
    fn from(buffer: &'a wgpu::Buffer) -> Self {
        Self::Buffer(buffer)
    }
}

impl Pass {
    /// Compiles the entry point `main` of `sources` joined together. WGSL's module scope has no order, so the pass comes
    /// first (its errors then carry its own line numbers) and shared files follow. `overrides` are set by name; those
    /// named `WORKGROUP_X` and `WORKGROUP_Y` are set here.
    pub fn new(gpu: &Gpu, label: &str, sources: &[&str], overrides: &[(&str, f64)]) -> Result<Self, GpuError> {
        let error = |message: String| GpuError::Pass {
            pass: label.to_owned(),
            message,
        };
        let source = sources.join("\n");
        let reflected = Reflection::new(&source).map_err(error)?;
        let mut constants = overrides.to_vec();
        let mut workgroup = reflected.workgroup;
        if reflected.overrides.contains("WORKGROUP_X") {
            workgroup = gpu.workgroup();
            constants.push(("WORKGROUP_X", f64::from(workgroup[0])));
            constants.push(("WORKGROUP_Y", f64::from(workgroup[1])));
        }
        if let Some((name, _)) = constants.iter().find(|(name, _)| !reflected.overrides.contains(*name)) {
            return Err(error(format!("the shader has no override `{name}`")));
        }
        if let Some(name) = reflected
            .overrides
            .iter()
            .find(|name| !constants.iter().any(|(set, _)| set == name))
        {
            return Err(error(format!("override `{name}` is not set")));
        }
        let pipeline = gpu
            .scope(label, || {
                let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(label),
                    source: wgpu::ShaderSource::Wgsl(source.into()),
                });
                gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(label),
                    layout: None,
                    module: &module,
                    entry_point: Some("main"),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &constants,
                        zero_initialize_workgroup_memory: false,
                    },
                    cache: None,
                })
            })
            .map_err(|cause| error(cause.to_string()))?;
        Ok(Self {
            label: label.to_owned(),
            layout: pipeline.get_bind_group_layout(0),
            pipeline,
            bindings: reflected.bindings,
            workgroup,
        })
    }

    /// Starts an invocation, with nothing bound.
    pub fn start(&self) -> Invocation<'_> {
        Invocation {
            pass: self,
            bound: Vec::new(),
            uniforms: Vec::new(),
        }
    }

    /// Starts an invocation by binding the first name.
    pub fn bind<'a>(&'a self, name: &'static str, resource: impl Into<Bound<'a>>) -> Invocation<'a> {
        self.start().bind(name, resource)
    }

    /// The label that errors and times carry.
    pub fn label(&self) -> &str {
        &self.label
    }

    fn error(&self, message: String) -> GpuError {
        GpuError::Pass {
            pass: self.label.clone(),
            message,
        }
    }
}

/// A pass on its way to a dispatch.
#[derive(Debug)]
pub struct Invocation<'a> {
    pass: &'a Pass,
    bound: Vec<(&'static str, Bound<'a>)>,
    uniforms: Vec<(&'static str, Vec<(&'static str, UniformValue)>)>,
}

impl<'a> Invocation<'a> {
    /// Binds a texture or buffer.
    pub fn bind(mut self, name: &'static str, resource: impl Into<Bound<'a>>) -> Self {
        self.bound.push((name, resource.into()));
        self
    }

    /// Fills a uniform, field by field.
    pub fn uniform(mut self, name: &'static str, fields: &[(&'static str, UniformValue)]) -> Self {
        self.uniforms.push((name, fields.to_vec()));
        self
    }

    /// Binds a texture or buffer where the pass uses that name: for what several passes share.
    pub fn offer(self, name: &'static str, resource: impl Into<Bound<'a>>) -> Self {
        match self.pass.bindings.contains_key(name) {
            true => self.bind(name, resource),
            false => self,
        }
    }

    /// Fills a uniform where the pass uses that name.
    pub fn offer_uniform(self, name: &'static str, fields: &[(&'static str, UniformValue)]) -> Self {
        match self.pass.bindings.contains_key(name) {
            true => self.uniform(name, fields),
            false => self,
        }
    }

    /// A dispatch that covers `extent`, ready to be recorded any number of times.
    pub fn over(self, gpu: &Gpu, extent: Extent) -> Result<Dispatch<'a>, GpuError> {
        let pass = self.pass;
        let mut uniform_buffers = Vec::with_capacity(self.uniforms.len());
        for (name, fields) in &self.uniforms {
            let index = pass.binding(name)?.index;
            uniform_buffers.push((index, pass.uniform_buffer(gpu, name, fields)?));
        }
        let mut entries: Vec<_> = uniform_buffers
            .iter()
            .map(|(index, buffer)| wgpu::BindGroupEntry {
                binding: *index,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        for (name, bound) in &self.bound {
            entries.push(wgpu::BindGroupEntry {
                binding: pass.binding(name)?.index,
                resource: match bound {
                    Bound::Texture(texture) => wgpu::BindingResource::TextureView(texture.view()),
                    Bound::Buffer(buffer) => buffer.as_entire_binding(),
                },
            });
        }
        for (name, binding) in &pass.bindings {
            match entries.iter().filter(|entry| entry.binding == binding.index).count() {
                1 => {}
                0 => return Err(pass.error(format!("`{name}` is not bound"))),
                _ => return Err(pass.error(format!("`{name}` is bound twice"))),
            }
        }
        let bind_group = gpu
            .scope(&pass.label, || {
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some(&pass.label),
                    layout: &pass.layout,
                    entries: &entries,
                })
            })
            .map_err(|cause| pass.error(cause.to_string()))?;
        Ok(Dispatch {
            pass,
            bound: self.bound,
            bind_group,
            workgroups: [
                extent.width.div_ceil(pass.workgroup[0]),
                extent.height.div_ceil(pass.workgroup[1]),
            ],
        })
    }
}

/// A pass with everything bound.
#[derive(Debug)]
pub struct Dispatch<'a> {
    pass: &'a Pass,
    bound: Vec<(&'static str, Bound<'a>)>,
    bind_group: wgpu::BindGroup,
    workgroups: [u32; 2],
}

impl<'a> Dispatch<'a> {
    /// The label of its pass.
    pub fn label(&self) -> &'a str {
        &self.pass.label
    }

    /// The textures and buffers that it reads or writes, by the names they have in WGSL.
    pub fn bound(&self) -> impl Iterator<Item = (&'static str, Bound<'a>, Access)> {
        let access = |name: &str| self.pass.bindings[name].access;
        self.bound.iter().map(move |&(name, bound)| (name, bound, access(name)))
    }

    /// Records the pass, timed where `timestamps` is given.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, timestamps: Option<wgpu::ComputePassTimestampWrites<'_>>) {
        self.record_workgroups(encoder, timestamps, self.workgroups);
    }

    /// Records the pass over its first workgroup alone.
    pub fn record_corner(&self, encoder: &mut wgpu::CommandEncoder) {
        self.record_workgroups(encoder, None, [1, 1]);
    }

    fn record_workgroups(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timestamps: Option<wgpu::ComputePassTimestampWrites<'_>>,
        [x, y]: [u32; 2],
    ) {
        let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(&self.pass.label),
            timestamp_writes: timestamps,
        });
        compute.set_pipeline(&self.pass.pipeline);
        compute.set_bind_group(0, &self.bind_group, &[]);
        compute.dispatch_workgroups(x, y, 1);
    }
}

impl Pass {
    fn binding(&self, name: &str) -> Result<&Binding, GpuError> {
        self.bindings
            .get(name)
            .ok_or_else(|| self.error(format!("the shader uses no binding `{name}`")))
    }

    fn uniform_buffer(&self, gpu: &Gpu, name: &str, fields: &[(&str, UniformValue)]) -> Result<wgpu::Buffer, GpuError> {
        let Some(layout) = &self.binding(name)?.uniform else {
            return Err(self.error(format!("`{name}` is not a uniform")));
        };
        if let Some(missing) = layout
            .fields
            .keys()
            .find(|field| !fields.iter().any(|(set, _)| set == field))
        {
            return Err(self.error(format!("`{name}.{missing}` is not set")));
        }
        let mut bytes = vec![0; layout.size as usize];
        for (field, value) in fields {
            let &(offset, size) = layout
                .fields
                .get(*field)
                .ok_or_else(|| self.error(format!("`{name}` has no field `{field}`")))?;
            let value = value.bytes();
            if value.len() != size as usize {
                return Err(self.error(format!("`{name}.{field}` has {size} bytes, not {}", value.len())));
            }
            bytes[offset as usize..][..value.len()].copy_from_slice(value);
        }
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size: u64::from(layout.size),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&buffer, 0, &bytes);
        Ok(buffer)
    }
}

/// What `Pass` needs to know of a shader's text.
struct Reflection {
    bindings: BTreeMap<String, Binding>,
    overrides: std::collections::BTreeSet<String>,
    workgroup: [u32; 2],
}

impl Reflection {
    fn new(source: &str) -> Result<Self, String> {
        let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
        let info = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::all())
            .validate(&module)
            .map_err(|error| error.emit_to_string(source))?;
        let entry = module
            .entry_points
            .iter()
            .position(|entry| entry.name == "main")
            .ok_or("the shader has no entry point `main`")?;
        let uses = info.get_entry_point(entry);
        let mut bindings = BTreeMap::new();
        for (handle, variable) in module.global_variables.iter() {
            let (Some(name), Some(binding)) = (&variable.name, &variable.binding) else {
                continue;
            };
            if uses[handle].is_empty() {
                continue;
            }
            let uniform = (variable.space == naga::AddressSpace::Uniform).then(|| uniform_layout(&module, variable.ty));
            bindings.insert(
                name.clone(),
                Binding {
                    index: binding.binding,
                    uniform,
                    access: Access {
                        reads: uses[handle].intersects(Use::READ | Use::ATOMIC),
                        writes: uses[handle].intersects(Use::WRITE | Use::ATOMIC),
                        integers: is_integer(&module, variable.ty),
                    },
                },
            );
        }
        let [x, y, _] = module.entry_points[entry].workgroup_size;
        Ok(Self {
            bindings,
            overrides: module
                .overrides
                .iter()
                .filter_map(|(_, item)| item.name.clone())
                .collect(),
            workgroup: [x, y],
        })
    }
}

/// Size of a uniform struct, and where its fields lie.
fn uniform_layout(module: &naga::Module, ty: naga::Handle<naga::Type>) -> UniformLayout {
    let layout = |handle: naga::Handle<naga::Type>| module.types[handle].inner.size(module.to_ctx());
    let members = match &module.types[ty].inner {
        naga::TypeInner::Struct { members, .. } => members.as_slice(),
        _ => &[],
    };
    UniformLayout {
        size: layout(ty),
        fields: members
            .iter()
            .filter_map(|member| Some((member.name.clone()?, (member.offset, layout(member.ty)))))
            .collect(),
    }
}

/// Whether values of a type are `u32`; of a structure, whether its first field is.
fn is_integer(module: &naga::Module, ty: naga::Handle<naga::Type>) -> bool {
    match &module.types[ty].inner {
        naga::TypeInner::Scalar(scalar) | naga::TypeInner::Atomic(scalar) => scalar.kind == naga::ScalarKind::Uint,
        naga::TypeInner::Vector { scalar, .. } => scalar.kind == naga::ScalarKind::Uint,
        naga::TypeInner::Array { base, .. } => is_integer(module, *base),
        naga::TypeInner::Struct { members, .. } => members.first().is_some_and(|first| is_integer(module, first.ty)),
        naga::TypeInner::Image { class, .. } => match class {
            naga::ImageClass::Sampled { kind, .. } => *kind == naga::ScalarKind::Uint,
            naga::ImageClass::Storage { format, .. } => naga::Scalar::from(*format).kind == naga::ScalarKind::Uint,
            _ => false,
        },
        _ => false,
    }
}
