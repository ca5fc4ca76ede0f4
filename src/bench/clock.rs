//! What a time is, and measuring one submission by it.

use crate::{
    gpu::{Gpu, GpuError, Readback, ReadbackPool, Timer},
    run::process_cpu_ms,
    taa::Step,
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
    /// Of each pass, where times are timestamps; a CPU adapter's passes are timed by [`time_again`].
    pub passes_ms: Vec<f64>,
    pub readback: Readback,
}

/// Records, submits and waits. Recording is not part of the cost: it is the same whatever the shaders do. Nor are timestamps
/// on a CPU adapter, which finishes all work for each of them.
pub fn cost<T>(
    gpu: &Gpu,
    timer: &mut Timer,
    record: impl FnOnce(&mut wgpu::CommandEncoder, &mut Timer, &mut Readback) -> Result<T, GpuError>,
) -> Result<(Cost, T), GpuError> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut readback = ReadbackPool::default().begin();
    let clock = Clock::of(gpu);
    let mut untimed = Timer::new(gpu, 0);
    let timer = match clock {
        Clock::ProcessCpu => &mut untimed,
        Clock::GpuTimestamps => timer,
    };
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
        ms: match clock {
            Clock::ProcessCpu => cpu_ms,
            Clock::GpuTimestamps => passes_ms.iter().sum(),
        },
        passes_ms,
        readback,
    };
    Ok((cost, recorded))
}

/// Runs passes again that ran before, and what they count anew, to time each: milliseconds of wall time.
pub fn time_again(gpu: &Gpu, timer: &mut Timer, steps: &[Step]) -> Result<Vec<f64>, GpuError> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut readback = ReadbackPool::default().begin();
    for step in steps {
        step.record(&mut encoder, timer);
    }
    let times = timer.finish(gpu, &mut encoder, &mut readback);
    let submission = gpu.scope("timing passes", || gpu.queue.submit([encoder.finish()]))?;
    readback.map();
    gpu.wait(submission)?;
    times.read(&readback)
}
