//! Passes that add up samples of pixels, and their partial sums on the way back to the host, which adds them in f64.

use super::{
    super::mask::{ByClass, N_CLASSES},
    Recording, Setup,
};
use crate::{
    gpu::{Gpu, GpuError, Invocation, Pass, Readback, Texture, Workgroup},
    image::Extent,
};
use std::array;

const SUMS: &str = include_str!("../../../shaders/metrics/sums.wgsl");
const STRIPS_APART: &str = include_str!("../../../shaders/metrics/strips_apart.wgsl");
const STRIPS_TOGETHER: &str = include_str!("../../../shaders/metrics/strips_together.wgsl");
const CLASSES: &str = include_str!("../../../shaders/metrics/classes.wgsl");
const UNCLASSED: &str = include_str!("../../../shaders/metrics/unclassed.wgsl");

/// Rows that an invocation of `sums.wgsl` sums: on a CPU many, which leaves few sums; on a GPU so few that all of it has work.
const ROWS_APART: u32 = 64;
const ROWS_TOGETHER: u32 = 8;

/// Adds up `N` terms (`N_TERMS` of its shader) over the pixels of each class.
#[derive(Debug)]
pub struct SumPass<const N: usize> {
    pass: Pass,
    partial_sums: PartialSums<N>,
    strips: Extent,
}

/// The partial sums of `N` terms and each class that a pass writes, one run of them after another.
#[derive(Debug)]
pub struct PartialSums<const N: usize> {
    buffer: wgpu::Buffer,
    n_classes: usize,
}

/// Partial sums on their way back.
#[derive(Clone, Copy, Debug)]
pub struct Copied<const N: usize> {
    slot: usize,
    n_classes: usize,
}

impl Setup<'_> {
    /// How many classes passes tell apart.
    pub fn n_classes(&self) -> usize {
        if self.has_masks { N_CLASSES } else { 1 }
    }

    /// The WGSL that tells them apart.
    pub fn classes_wgsl(&self) -> &'static str {
        if self.has_masks { CLASSES } else { UNCLASSED }
    }
}

impl<const N: usize> SumPass<N> {
    /// A pass of `shader` and the files that it shares with others.
    pub fn new(
        setup: &Setup,
        label: &str,
        shader: &'static str,
        shared: &[&'static str],
        overrides: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let Extent { width, height } = setup.extent;
        let Workgroup { x, y } = setup.gpu.workgroup();
        let (strips_wgsl, n_rows, runs) = match setup.gpu.uses_workgroup_memory() {
            true => (STRIPS_TOGETHER, ROWS_TOGETHER, Extent::new(x, y)),
            false => (STRIPS_APART, ROWS_APART, Extent::new(1, 1)),
        };
        let strips = Extent::new(width, height.div_ceil(n_rows));
        let n_runs = strips.width.div_ceil(runs.width) as usize * strips.height.div_ceil(runs.height) as usize;
        let sources = [&[shader, SUMS, strips_wgsl, setup.classes_wgsl()], shared].concat();
        let frame = [("width", width), ("height", height), ("n_rows", n_rows)].map(|(name, n)| (name, f64::from(n)));
        Ok(Self {
            pass: Pass::new(setup.gpu, label, &sources, &[&frame, overrides].concat())?,
            partial_sums: PartialSums::new(setup, n_runs)?,
            strips,
        })
    }

    /// Starts an invocation; `classes` are read where there are masks.
    pub fn start<'a>(&'a self, classes: Option<&'a Texture>) -> Invocation<'a> {
        let invocation = self.pass.bind("partial_sums", &self.partial_sums.buffer);
        match classes {
            Some(classes) => invocation.offer("classes", classes),
            None => invocation,
        }
    }

    /// Records the pass with everything bound, and the copy of its sums.
    pub fn record(&self, recording: &mut Recording, invocation: Invocation) -> Result<Copied<N>, GpuError> {
        recording.dispatch(invocation, self.strips)?;
        Ok(self.partial_sums.copy(recording))
    }
}

impl<const N: usize> PartialSums<N> {
    /// Room for `n` runs.
    pub fn new(setup: &Setup, n: usize) -> Result<Self, GpuError> {
        let n_classes = setup.n_classes();
        Ok(Self {
            buffer: storage(
                setup.gpu,
                "partial sums",
                n * n_classes * N * size_of::<f32>(),
                wgpu::BufferUsages::COPY_SRC,
            )?,
            n_classes,
        })
    }

    /// For binding.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Records the copy back of what a pass has written.
    pub fn copy(&self, recording: &mut Recording) -> Copied<N> {
        Copied {
            slot: recording.copy(&self.buffer),
            n_classes: self.n_classes,
        }
    }
}

impl<const N: usize> Copied<N> {
    /// Every term by class; all in the first class where nobody knows the frame's classes.
    pub fn totals(&self, readback: &Readback, knows_classes: bool) -> Result<[ByClass<f64>; N], GpuError> {
        let mut totals = [ByClass::<f64>::default(); N];
        let bytes = readback.bytes(self.slot)?;
        let (partials, _) = bytes.as_chunks::<4>();
        for run in partials.chunks_exact(N * self.n_classes) {
            for (class, terms) in run.chunks_exact(N).enumerate() {
                for (total, term) in totals.iter_mut().zip(terms) {
                    total[class] += f64::from(f32::from_le_bytes(*term));
                }
            }
        }
        Ok(match knows_classes {
            true => totals,
            false => totals.map(|classes| array::from_fn(|class| if class == 0 { classes.iter().sum() } else { 0.0 })),
        })
    }
}

/// A storage buffer, zero at first.
pub fn storage(gpu: &Gpu, label: &str, size: usize, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
    gpu.scope(&format!("making room for {label}"), || {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: size as u64,
            usage: wgpu::BufferUsages::STORAGE | usage,
            mapped_at_creation: false,
        })
    })
}
