//! What binding by name needs to know of a shader's text: where each name is bound, and how uniforms are laid out.

use super::Gpu;
use std::collections::{BTreeMap, BTreeSet};
use wgpu::naga::{self, valid::GlobalUse};

/// A name that a shader binds.
#[derive(Debug)]
pub(super) struct Binding {
    pub group: u32,
    pub index: u32,
    pub kind: wgpu::BindingType,
    /// Of the entry points together.
    pub access: Access,
    uniform: Option<UniformLayout>,
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
    /// `vec2u`
    Vec2U([u32; 2]),
    /// `vec3f`
    Vec3([f32; 3]),
    /// `vec4f`
    Vec4([f32; 4]),
    /// `mat4x4f`, column by column
    Mat4([[f32; 4]; 4]),
}

impl UniformValue {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::U32(value) => bytemuck::bytes_of(value),
            Self::F32(value) => bytemuck::bytes_of(value),
            Self::Vec2(value) => bytemuck::bytes_of(value),
            Self::Vec2U(value) => bytemuck::bytes_of(value),
            Self::Vec3(value) => bytemuck::bytes_of(value),
            Self::Vec4(value) => bytemuck::bytes_of(value),
            Self::Mat4(value) => bytemuck::bytes_of(value),
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
from!(u32 => U32, f32 => F32, [f32; 2] => Vec2, [u32; 2] => Vec2U, [f32; 3] => Vec3, [f32; 4] => Vec4, [[f32; 4]; 4] => Mat4);

impl Binding {
    /// A buffer for this uniform, filled field by field; or what does not fit.
    pub fn uniform_buffer(
        &self,
        gpu: &Gpu,
        name: &str,
        fields: &[(&str, UniformValue)],
    ) -> Result<wgpu::Buffer, String> {
        let Some(layout) = &self.uniform else {
            return Err(format!("`{name}` is not a uniform"));
        };
        if let Some(missing) = layout
            .fields
            .keys()
            .find(|field| !fields.iter().any(|(set, _)| set == field))
        {
            return Err(format!("`{name}.{missing}` is not set"));
        }
        let mut bytes = vec![0; layout.size as usize];
        for (field, value) in fields {
            let &(offset, size) = layout
                .fields
                .get(*field)
                .ok_or_else(|| format!("`{name}` has no field `{field}`"))?;
            let value = value.bytes();
            if value.len() != size as usize {
                return Err(format!("`{name}.{field}` has {size} bytes, not {}", value.len()));
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

/// A shader's bindings and overrides.
pub(super) struct Reflection {
    /// By WGSL name; only what the entry points use.
    pub bindings: BTreeMap<String, Binding>,
    pub overrides: BTreeSet<String>,
    /// Those that the text gives a value to.
    pub defaults: BTreeSet<String>,
    /// Of the first entry point, where that is a compute shader.
    pub workgroup: Option<[u32; 2]>,
}

impl Reflection {
    /// Reads `source` as its `entries` use it.
    pub fn new(source: &str, entries: &[&str]) -> Result<Self, String> {
        let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
        let info = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::all())
            .validate(&module)
            .map_err(|error| error.emit_to_string(source))?;
        let entries = entries
            .iter()
            .map(|name| {
                let index = module.entry_points.iter().position(|entry| entry.name == *name);
                index.ok_or_else(|| format!("the shader has no entry point `{name}`"))
            })
            .collect::<Result<Vec<usize>, String>>()?;
        let mut bindings = BTreeMap::new();
        for (handle, variable) in module.global_variables.iter() {
            let (Some(name), Some(binding)) = (&variable.name, &variable.binding) else {
                continue;
            };
            let uses = entries.iter().map(|&entry| info.get_entry_point(entry)[handle]);
            let uses = uses.fold(GlobalUse::empty(), |all, uses| all | uses);
            if uses.is_empty() {
                continue;
            }
            let uniform = (variable.space == naga::AddressSpace::Uniform).then(|| uniform_layout(&module, variable.ty));
            bindings.insert(
                name.clone(),
                Binding {
                    group: binding.group,
                    index: binding.binding,
                    kind: binding_type(&module, variable),
                    access: Access {
                        reads: uses.intersects(GlobalUse::READ | GlobalUse::ATOMIC),
                        writes: uses.intersects(GlobalUse::WRITE | GlobalUse::ATOMIC),
                        integers: is_integer(&module, variable.ty),
                    },
                    uniform,
                },
            );
        }
        let named = |only_defaults: bool| {
            let kept = move |item: &naga::Override| !only_defaults || item.init.is_some();
            module
                .overrides
                .iter()
                .filter_map(move |(_, item)| kept(item).then(|| item.name.clone())?)
        };
        let first = entries.first().map(|&entry| &module.entry_points[entry]);
        Ok(Self {
            bindings,
            overrides: named(false).collect(),
            defaults: named(true).collect(),
            workgroup: first
                .filter(|entry| entry.stage == naga::ShaderStage::Compute)
                .map(|entry| [entry.workgroup_size[0], entry.workgroup_size[1]]),
        })
    }
}

/// What a layout says of a variable. Storage textures are written by compute passes, whose layouts wgpu derives.
fn binding_type(module: &naga::Module, variable: &naga::GlobalVariable) -> wgpu::BindingType {
    let buffer = |ty| wgpu::BindingType::Buffer {
        ty,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    match (variable.space, &module.types[variable.ty].inner) {
        (naga::AddressSpace::Uniform, _) => buffer(wgpu::BufferBindingType::Uniform),
        (naga::AddressSpace::Storage { access }, _) => buffer(wgpu::BufferBindingType::Storage {
            read_only: !access.contains(naga::StorageAccess::STORE),
        }),
        (_, naga::TypeInner::Sampler { comparison: true }) => {
            wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)
        }
        (_, naga::TypeInner::Sampler { comparison: false }) => {
            wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)
        }
        (_, naga::TypeInner::Image { class, .. }) => wgpu::BindingType::Texture {
            sample_type: match class {
                naga::ImageClass::Depth { .. } => wgpu::TextureSampleType::Depth,
                naga::ImageClass::Sampled {
                    kind: naga::ScalarKind::Uint,
                    ..
                } => wgpu::TextureSampleType::Uint,
                _ => wgpu::TextureSampleType::Float { filterable: true },
            },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        },
        _ => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
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
