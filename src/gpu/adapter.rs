//! Finding an adapter by name or index, and opening its device.

use super::{GpuError, Workgroup, pass::Variant, workgroup};
use crate::run::report::AdapterInfo;
use std::sync::{Arc, OnceLock};

/// An adapter with its device and queue. Open one a process: lavapipe keeps what a closed device held.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// Creates resources.
    pub device: wgpu::Device,
    /// Takes commands.
    pub queue: wgpu::Queue,
    second: Arc<OnceLock<(wgpu::Device, wgpu::Queue)>>,
    info: wgpu::AdapterInfo,
    pub(super) variant: Variant,
    workgroup: Workgroup,
}

/// What to do where there is no adapter at all.
pub const NO_DRIVER: &str = "no Vulkan adapter found: install a GPU driver, or Mesa's software renderer with \
     `apt-get install libvulkan1 mesa-vulkan-drivers`";

/// The adapters that could be opened, in the order of their index.
pub fn adapters() -> Vec<AdapterInfo> {
    let found = enumerate();
    found.iter().map(|adapter| describe(&adapter.get_info())).collect()
}

impl Gpu {
    /// Opens the adapter whose index in [`adapters`] or part of whose name is `wanted` (case does not matter); the
    /// first GPU, else the first software renderer, where nothing is wanted.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] says what to install or which adapters there are.
    pub fn open(wanted: Option<&str>) -> Result<Arc<Self>, GpuError> {
        let mut found = enumerate();
        if found.is_empty() {
            return Err(GpuError::NoAdapter(NO_DRIVER.to_owned()));
        }
        let index = match wanted {
            Some(wanted) => find(&found, wanted)?,
            None => found
                .iter()
                .position(|adapter| adapter.get_info().device_type != wgpu::DeviceType::Cpu)
                .unwrap_or(0),
        };
        let adapter = found.swap_remove(index);
        let info = adapter.get_info();
        let (device, queue) = request(&adapter)?;
        // On a CPU a row: its lanes then read neighbouring texels.
        let untuned = match info.device_type {
            wgpu::DeviceType::Cpu => Workgroup::new(64, 1),
            _ => Workgroup::new(8, 8),
        };
        Ok(Arc::new(Self {
            workgroup: workgroup::tuned(&describe(&info)).unwrap_or(untuned),
            device,
            queue,
            second: Arc::default(),
            info,
            variant: Variant::default(),
        }))
    }

    /// Another device of the same adapter, opened once: a CPU adapter does the work of a device on one thread. It has an
    /// instance of its own, for devices of one instance wait for each other to rasterise.
    ///
    /// # Errors
    /// What the driver says, also where the adapter is gone.
    pub fn second(&self) -> Result<Self, GpuError> {
        let (device, queue) = match self.second.get() {
            Some(known) => known.clone(),
            None => {
                let same = enumerate().into_iter().find(|adapter| adapter.get_info() == self.info);
                let gone = || GpuError::NoAdapter(format!("{} is gone", self.info.name));
                let opened = request(&same.ok_or_else(gone)?)?;
                self.second.get_or_init(|| opened).clone()
            }
        };
        let variant = Variant {
            // Pipelines belong to a device.
            cache: None,
            ..self.variant.clone()
        };
        Ok(Self {
            device,
            queue,
            ..self.with(variant)
        })
    }

    /// Name, kind and driver, as reports carry them.
    pub fn info(&self) -> AdapterInfo {
        describe(&self.info)
    }

    /// Whether the adapter runs on the host's own cores.
    pub fn is_cpu(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Whether 32-bit float targets can be blended.
    pub fn can_blend_f32(&self) -> bool {
        self.device.features().contains(wgpu::Features::FLOAT32_BLENDABLE)
    }

    /// The largest width or height of a texture.
    pub fn max_side(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }

    /// The largest buffer that a pass can bind, bytes.
    pub fn max_buffer(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
    }

    /// How its passes are compiled.
    pub fn variant(&self) -> &Variant {
        &self.variant
    }

    /// The same device, whose passes are compiled as `variant` says.
    pub fn with(&self, variant: Variant) -> Self {
        Self {
            variant,
            ..self.clone()
        }
    }

    /// The same device, which compiles no pass twice.
    pub fn caching(&self) -> Self {
        self.with(Variant {
            cache: Some(Default::default()),
            ..self.variant.clone()
        })
    }

    /// The workgroup of passes that leave it open: the variant's, else as tuned for this adapter, else a good guess.
    pub fn workgroup(&self) -> Workgroup {
        self.variant.workgroup.unwrap_or(self.workgroup)
    }

    /// Whether passes that can do so keep what a workgroup's invocations read in common in its own memory: on a GPU reading it
    /// again costs more, on a CPU waiting for each other does.
    pub fn uses_workgroup_memory(&self) -> bool {
        self.variant.workgroup_memory.unwrap_or(!self.is_cpu())
    }

    /// Bytes that resources now take on the device; none where the backend does not count them.
    pub fn allocated_bytes(&self) -> Option<u64> {
        let report = self.device.generate_allocator_report()?;
        Some(report.total_allocated_bytes)
    }

    /// Runs `work` and turns what wgpu reports meanwhile into an error that says what was being done.
    pub fn scope<T>(&self, activity: &str, work: impl FnOnce() -> T) -> Result<T, GpuError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work();
        // Scopes nest: the last pushed goes first.
        let errors = [
            pollster::block_on(validation.pop()),
            pollster::block_on(internal.pop()),
            pollster::block_on(memory.pop()),
        ];
        match errors.into_iter().flatten().next() {
            None => Ok(result),
            Some(error) => Err(GpuError::Device {
                activity: activity.to_owned(),
                message: error.to_string(),
            }),
        }
    }

    /// Waits until `submission` is done and its buffers are mapped.
    pub fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::Wait {
                submission_index: Some(submission),
                timeout: None,
            })
            .map(drop)
            .map_err(|error| GpuError::Device {
                activity: "waiting for the adapter".to_owned(),
                message: error.to_string(),
            })
    }
}

fn request(adapter: &wgpu::Adapter) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    let opened = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        label: Some("afterimage"),
        // Times are left out of the report where the adapter has no timestamps; scenes with transparent layers are
        // refused where it cannot blend 32-bit floats.
        required_features: adapter.features()
            & (wgpu::Features::TIMESTAMP_QUERY
                | wgpu::Features::FLOAT32_BLENDABLE
                | wgpu::Features::FLOAT32_FILTERABLE),
        required_limits: adapter.limits(),
        ..Default::default()
    }));
    opened.map_err(|error| GpuError::Unsupported {
        adapter: adapter.get_info().name,
        message: error.to_string(),
    })
}

fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        // Before every indirect dispatch wgpu would check its size in a pass of its own; ours come from our own lists.
        flags: wgpu::InstanceFlags::from_build_config() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
}

fn find(found: &[wgpu::Adapter], wanted: &str) -> Result<usize, GpuError> {
    let by_index = wanted.parse::<usize>().ok().filter(|&index| index < found.len());
    let by_name = || {
        let wanted = wanted.to_lowercase();
        found
            .iter()
            .position(|adapter| adapter.get_info().name.to_lowercase().contains(&wanted))
    };
    by_index.or_else(by_name).ok_or_else(|| {
        let names: Vec<_> = found
            .iter()
            .enumerate()
            .map(|(index, adapter)| format!("{index}: {}", adapter.get_info().name))
            .collect();
        GpuError::NoAdapter(format!("no adapter matches `{wanted}`; there are {}", names.join(", ")))
    })
}

fn describe(info: &wgpu::AdapterInfo) -> AdapterInfo {
    AdapterInfo {
        name: info.name.clone(),
        backend: format!("{:?}", info.backend),
        kind: format!("{:?}", info.device_type),
        driver: info.driver.clone(),
        driver_version: info.driver_info.clone(),
    }
}
