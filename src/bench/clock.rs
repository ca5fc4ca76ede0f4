//! What a time is, and measuring one submission by it.

use crate::{
    gpu::{Gpu, GpuError, Readback, ReadbackPool, Timer},
    run::process_cpu_ms,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a time is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// CPU time of the whole process from the submission of a frame's passes to their end: on a CPU adapter wall times move
    /// with whatever else the machine does.
    ProcessCpu,
    /// Timestamps on the device around each pass, summed.
    GpuTimestamps,
}

impl Clock {
    pub(super) fn of(gpu: &Gpu) -> Self {
        match gpu.is_cpu() {
            true => Self::ProcessCpu,
            false => Self::GpuTimestamps,
        }
    }

    /// For people.
    pub fn description(self) -> &'static str {
        match self {
            Self::ProcessCpu => "CPU time of the process",
            Self::GpuTimestamps => "GPU timestamps",
        }
    }
}

/// What one submission cost.
pub struct Cost {
    pub ms: f64,
    pub passes_ms: Vec<f64>,
    pub readback: Readback,
}

/// Records, submits and waits. Recording is not part of the cost: it is the same whatever the shaders do.
pub fn cost<T>(
    gpu: &Gpu,
    timer: &mut Timer,
    record: impl FnOnce(&mut wgpu::CommandEncoder, &mut Timer, &mut Readback) -> Result<T, GpuError>,
) -> Result<(Cost, T), GpuError> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut readback = ReadbackPool::default().begin();
    let recorded = record(&mut encoder, timer, &mut readback)?;
    let times = timer.finish(gpu, &mut encoder, &mut readback);
    let commands = encoder.finish();
    let before = process_cpu_ms();
    let submission = gpu.scope("submitting a frame", || gpu.queue.submit([commands]))?;
    readback.map();
    gpu.wait(submission)?;
    let cpu_ms = process_cpu_ms() - before;
    let passes_ms = times.read(&readback)?;
    let cost = Cost {
        ms: match Clock::of(gpu) {
            Clock::ProcessCpu => cpu_ms,
            Clock::GpuTimestamps => passes_ms.iter().sum(),
        },
        passes_ms,
        readback,
    };
    Ok((cost, recorded))
}
