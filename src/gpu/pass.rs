//! A compute pass that binds by WGSL name.
//!
//! ```text
//! pass.bind("color", &color).bind("history", &history).uniform("frame", &[("jitter_px", jitter.into())]).dispatch(extent)?
//! ```
//! A missing, unknown or twice-bound name is an error that names the pass, and so is an override or a uniform's field.

use super::{
    Gpu, GpuError, Texture, Workgroup,
    reflection::{Access, Binding, Reflection, UniformValue},
};
use crate::image::Extent;
use sha2::{Digest, Sha256};
use std::{
    collections::{BTreeMap, HashMap},
    sync::{Arc, Mutex, PoisonError},
};

/// A compiled compute shader and what it binds.
#[derive(Clone, Debug)]
pub struct Pass {
    label: String,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// By WGSL name; only what the entry point uses.
    bindings: Arc<BTreeMap<String, Binding>>,
    workgroup: [u32; 2],
}

/// How the passes of a device are compiled, where not as usual.
#[derive(Clone, Debug, Default)]
pub struct Variant {
    /// The workgroup of passes that leave it open.
    pub workgroup: Option<Workgroup>,
    /// Whether passes that can do so keep what a workgroup's invocations read in common in its own memory.
    pub workgroup_memory: Option<bool>,
    /// Passes compiled before, for whoever compiles the same ones again and again.
    pub cache: Option<Arc<PassCache>>,
}

/// Compiled passes, by the hash of their text, overrides and workgroup.
#[derive(Debug)]
pub struct PassCache<P = Pass>(Mutex<HashMap<[u8; 32], P>>);

/// Where there are more, all are forgotten: whoever posts jobs may try parameters without end.
const MAX_CACHED: usize = 512;

impl<P> Default for PassCache<P> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<P: Clone> PassCache<P> {
    fn get_or_compile(&self, key: &str, compile: impl FnOnce() -> Result<P, GpuError>) -> Result<P, GpuError> {
        let key = Sha256::digest(key).into();
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pass) = known().get(&key) {
            return Ok(pass.clone());
        }
        let pass = compile()?;
        let mut known = known();
        if known.len() >= MAX_CACHED {
            known.clear();
        }
        known.insert(key, pass.clone());
        Ok(pass)
    }
}

/// A resource that a name can be bound to.
#[derive(Clone, Copy, Debug)]
pub enum Bound<'a> {
    /// A whole texture.
    Texture(&'a Texture),
    /// A whole buffer.
    Buffer(&'a wgpu::Buffer),
}

impl Bound<'_> {
    /// Size in memory, without the driver's padding.
    pub fn n_bytes(self) -> u64 {
        match self {
            Self::Texture(texture) => texture.n_bytes(),
            Self::Buffer(buffer) => buffer.size(),
        }
    }
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
    /// named `WORKGROUP_X` and `WORKGROUP_Y` are the adapter's.
    pub fn new(gpu: &Gpu, label: &str, sources: &[&str], overrides: &[(&str, f64)]) -> Result<Self, GpuError> {
        let source = sources.join("\n");
        let compile = || Self::compile(gpu, label, &source, overrides);
        match &gpu.variant().cache {
            Some(cache) => cache.get_or_compile(
                &format!("{label} {overrides:?} {:?} {source}", gpu.workgroup()),
                compile,
            ),
            None => compile(),
        }
    }

    fn compile(gpu: &Gpu, label: &str, source: &str, overrides: &[(&str, f64)]) -> Result<Self, GpuError> {
        let error = |message: String| GpuError::Pass {
            pass: label.to_owned(),
            message,
        };
        let reflected = Reflection::new(source, &["main"]).map_err(error)?;
        let mut constants = overrides.to_vec();
        let mut workgroup = reflected.workgroup.unwrap_or([1, 1]);
        if reflected.overrides.contains("WORKGROUP_X") {
            let Workgroup { x, y } = gpu.workgroup();
            workgroup = [x, y];
            constants.extend([("WORKGROUP_X", f64::from(x)), ("WORKGROUP_Y", f64::from(y))]);
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
            bindings: Arc::new(reflected.bindings),
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

    /// How many invocations run together.
    pub fn workgroup(&self) -> Workgroup {
        let [x, y] = self.workgroup;
        Workgroup { x, y }
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
        let [x, y] = self.pass.workgroup;
        let workgroups = Workgroups::Of([extent.width.div_ceil(x), extent.height.div_ceil(y)]);
        self.ready(gpu, workgroups)
    }

    /// A dispatch of as many workgroups as three words of `workgroups`, `offset` bytes into it, say when it runs.
    pub fn indirect(self, gpu: &Gpu, workgroups: &wgpu::Buffer, offset: u64) -> Result<Dispatch<'a>, GpuError> {
        self.ready(gpu, Workgroups::In(workgroups.clone(), offset))
    }

    fn ready(self, gpu: &Gpu, workgroups: Workgroups) -> Result<Dispatch<'a>, GpuError> {
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
        for (name, binding) in pass.bindings.iter() {
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
            workgroups,
        })
    }
}

/// A pass with everything bound, to be recorded any number of times whatever becomes of what it was made from.
#[derive(Clone, Debug)]
pub struct Kept {
    pipeline: wgpu::ComputePipeline,
    bind_group: wgpu::BindGroup,
    workgroups: Workgroups,
}

impl Kept {
    /// Records it into a pass that others may share.
    pub fn record(&self, compute: &mut wgpu::ComputePass<'_>) {
        self.workgroups.dispatch(compute, &self.pipeline, &self.bind_group);
    }
}

/// A pass with everything bound.
#[derive(Debug)]
pub struct Dispatch<'a> {
    pass: &'a Pass,
    bound: Vec<(&'static str, Bound<'a>)>,
    bind_group: wgpu::BindGroup,
    workgroups: Workgroups,
}

/// How many workgroups run.
#[derive(Clone, Debug)]
enum Workgroups {
    Of([u32; 2]),
    In(wgpu::Buffer, u64),
}

impl<'a> Dispatch<'a> {
    /// The same, to be kept.
    pub fn keep(&self) -> Kept {
        Kept {
            pipeline: self.pass.pipeline.clone(),
            bind_group: self.bind_group.clone(),
            workgroups: self.workgroups.clone(),
        }
    }

    /// The label of its pass.
    pub fn label(&self) -> &'a str {
        &self.pass.label
    }

    /// The textures and buffers that it reads or writes, by the names they have in WGSL.
    pub fn bound(&self) -> impl Iterator<Item = (&'static str, Bound<'a>, Access)> {
        let access = |name: &str| self.pass.bindings[name].access;
        self.bound.iter().map(move |&(name, bound)| (name, bound, access(name)))
    }

    /// What the pass must move at the least: every image and buffer bound once, twice what it reads and writes. Bytes.
    pub fn n_bytes(&self) -> u64 {
        let moved = self
            .bound()
            .map(|(_, bound, access)| bound.n_bytes() * (u64::from(access.reads) + u64::from(access.writes)));
        moved.sum()
    }

    /// Records the pass, timed where `timestamps` is given.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, timestamps: Option<wgpu::ComputePassTimestampWrites<'_>>) {
        self.record_workgroups(encoder, timestamps, &self.workgroups);
    }

    /// Records the pass over its first workgroup alone.
    pub fn record_corner(&self, encoder: &mut wgpu::CommandEncoder) {
        self.record_workgroups(encoder, None, &Workgroups::Of([1, 1]));
    }

    /// Records the pass over nothing, timed all the same: where its results are there already.
    pub fn record_nothing(&self, encoder: &mut wgpu::CommandEncoder, timestamps: wgpu::ComputePassTimestampWrites<'_>) {
        self.record_workgroups(encoder, Some(timestamps), &Workgroups::Of([0, 0]));
    }

    /// Whether it is for the device to say how much of it runs.
    pub fn is_indirect(&self) -> bool {
        matches!(self.workgroups, Workgroups::In(..))
    }

    fn record_workgroups(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timestamps: Option<wgpu::ComputePassTimestampWrites<'_>>,
        workgroups: &Workgroups,
    ) {
        let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(&self.pass.label),
            timestamp_writes: timestamps,
        });
        workgroups.dispatch(&mut compute, &self.pass.pipeline, &self.bind_group);
    }
}

impl Workgroups {
    fn dispatch(
        &self,
        compute: &mut wgpu::ComputePass<'_>,
        pipeline: &wgpu::ComputePipeline,
        bind_group: &wgpu::BindGroup,
    ) {
        compute.set_pipeline(pipeline);
        compute.set_bind_group(0, bind_group, &[]);
        match self {
            Self::Of([x, y]) => compute.dispatch_workgroups(*x, *y, 1),
            Self::In(buffer, offset) => compute.dispatch_workgroups_indirect(buffer, *offset),
        }
    }
}

impl Pass {
    fn binding(&self, name: &str) -> Result<&Binding, GpuError> {
        self.bindings
            .get(name)
            .ok_or_else(|| self.error(format!("the shader uses no binding `{name}`")))
    }

    fn uniform_buffer(&self, gpu: &Gpu, name: &str, fields: &[(&str, UniformValue)]) -> Result<wgpu::Buffer, GpuError> {
        let buffer = self.binding(name)?.uniform_buffer(gpu, name, fields);
        buffer.map_err(|problem| self.error(problem))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pass_is_compiled_once_until_there_are_too_many() {
        let cache = PassCache::<usize>::default();
        let mut n_compiled = 0;
        let mut get = |key: usize| {
            let compile = || {
                n_compiled += 1;
                Ok(n_compiled)
            };
            cache.get_or_compile(&key.to_string(), compile).unwrap()
        };
        assert_eq!([0, 1, 0, 1].map(&mut get), [1, 2, 1, 2]);
        for key in 2..MAX_CACHED {
            get(key);
        }
        assert_eq!(get(0), 1);
        assert_eq!(get(MAX_CACHED), MAX_CACHED + 1);
        assert_eq!(get(0), MAX_CACHED + 2, "all were forgotten");
    }

    #[test]
    fn what_does_not_compile_is_tried_again() {
        let cache = PassCache::<usize>::default();
        let fails = || {
            Err(GpuError::Pass {
                pass: "resolve".to_owned(),
                message: "no such override".to_owned(),
            })
        };
        cache.get_or_compile("", fails).unwrap_err();
        assert_eq!(cache.get_or_compile("", || Ok(1)).unwrap(), 1);
    }
}
