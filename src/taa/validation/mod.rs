//! A recipe on the adapter and on its twin at once, pass by pass: whether a GPU and its driver compute what they should, and
//! which pass they get wrong.
//!
//! Two twins in f64 go along. One runs by itself, and what it shows is held against what the GPU shows: errors of all passes
//! and all frames so far. The other is set, after every pass, to what the GPU's pass wrote: it computes each pass from the
//! GPU's own inputs, so that a pass answers for its own errors and for no others. Both have a shadow in f32, which says
//! where 32-bit arithmetic does not determine the result. Slow: a frame takes seconds, not milliseconds.

mod agreement;
mod report;

pub use agreement::{Agreement, Bounds, Compared, Worst};
pub use report::{Bisection, FrameAgreement, Overview, PassAgreement, Validation, shown};

use super::{
    Fault, Inputs, Precision, Recipe, Recorder, Repeat, Resolver, Watch,
    reference::{Plane, Twin},
};
use crate::{
    gpu::{Access, Bound, Dispatch, Gpu, GpuError, Readback, ReadbackPool, Timer},
    image::Extent,
    sequence::{Channels, Frame, Sizes},
};
use std::{collections::BTreeSet, mem};

/// One recipe on both sides.
#[derive(Debug)]
pub struct Validator<'a> {
    gpu: &'a Gpu,
    inputs: Inputs,
    resolver: Resolver,
    timer: Timer,
    pool: ReadbackPool,
    /// Run by themselves.
    alone: Twins,
    /// Are set to what each pass of the GPU wrote.
    following: Twins,
    /// The pass whose twin computes what the GPU goes on with.
    swapped: Option<&'a str>,
    counted: Bounds,
    promised: Option<Bounds>,
}

impl<'a> Validator<'a> {
    /// Compiles the passes of `recipe` and makes room for frames of `sizes` with `channels`. What `swapped` names is computed
    /// by the twin, and the GPU goes on with that. `fault` is a mistake in the GPU's passes, for tests.
    pub fn new(
        gpu: &'a Gpu,
        recipe: &Recipe,
        precision: Precision,
        (sizes, channels): (Sizes, Channels),
        swapped: Option<&'a str>,
        fault: Option<Fault<'_>>,
    ) -> Result<Self, GpuError> {
        let twins = Twins {
            f64: Twin::new(recipe.clone(), precision),
            f32: Twin::new(recipe.clone(), precision),
        };
        let wanted = BTreeSet::from([recipe.preparation()]);
        Ok(Self {
            gpu,
            inputs: Inputs::tracking(gpu, sizes, channels, &wanted, None, fault)?,
            resolver: Resolver::with_fault(gpu, recipe.clone(), precision, sizes, fault)?,
            timer: Timer::new(gpu, 0),
            pool: ReadbackPool::default(),
            following: twins.clone(),
            alone: twins,
            swapped,
            counted: Bounds::of_passes(recipe),
            promised: Bounds::of_frames(recipe, precision),
        })
    }

    /// What is allowed of passes, and of the frames shown, where anything is promised of those.
    pub fn bounds(&self) -> (Bounds, Option<Bounds>) {
        (self.counted, self.promised)
    }

    /// Resolves the next frame on both sides.
    pub fn frame(&mut self, frame: &Frame) -> Result<FrameAgreement, GpuError> {
        self.inputs.upload(self.gpu, frame)?;
        self.following.f64.begin(frame);
        self.following.f32.begin(frame);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut follow = Follow {
            twins: &mut self.following,
            frame,
            swapped: self.swapped,
            bounds: self.counted,
            pool: &self.pool,
            passes: Vec::new(),
            shown: None,
        };
        let mut recorder = Recorder {
            gpu: self.gpu,
            encoder: &mut encoder,
            timer: &mut self.timer,
            repeat: Repeat::Timed(1),
            watch: Some(&mut follow),
        };
        self.inputs.record(&mut recorder)?;
        self.resolver.record(&mut recorder, &self.inputs)?;
        let Follow { passes, shown, .. } = follow;
        let shown = shown.expect("the last pass shows");
        let scales = [shown.scales[0]; 3];
        let compared = Compared {
            twin: Plane::new(shown.name, scales, &self.alone.f64.resolve(frame).shown, |color| color),
            witness: Some(Plane::new(
                shown.name,
                scales,
                &self.alone.f32.resolve(frame).shown,
                |color| color,
            )),
            gpu: shown,
        };
        Ok(FrameAgreement {
            index: frame.index,
            reset: frame.reset,
            shown: Agreement::of(&[compared], self.counted, self.promised),
            passes,
        })
    }
}

/// The twin, and what says how far 32-bit arithmetic is from it.
#[derive(Clone, Debug)]
struct Twins {
    f64: Twin<f64>,
    f32: Twin<f32>,
}

impl Twins {
    fn keep(&mut self, pass: &str, plane: &Plane<f64>) {
        self.f64.keep(pass, plane);
        self.f32.keep(pass, &plane.to_f32());
    }
}

/// Holds each pass against the twin as soon as it has run.
#[derive(Debug)]
struct Follow<'a> {
    twins: &'a mut Twins,
    frame: &'a Frame,
    swapped: Option<&'a str>,
    bounds: Bounds,
    pool: &'a ReadbackPool,
    passes: Vec<PassAgreement>,
    /// The last image under that name.
    shown: Option<Plane<f64>>,
}

impl Watch for Follow<'_> {
    fn recorded(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        _counters: &[&wgpu::Buffer],
    ) -> Result<(), GpuError> {
        let pass = dispatch.label();
        let expected = self.twins.f64.compute(pass, self.frame);
        let mut readback = self.pool.begin();
        let written: Vec<_> = dispatch.bound().filter(|(.., access)| access.writes).collect();
        let outputs = expected.iter().map(|plane| {
            let found = written.iter().find(|(name, ..)| *name == plane.name);
            let &(_, bound, access) = found.ok_or_else(|| GpuError::Pass {
                pass: pass.to_owned(),
                message: format!("does not write `{}`, as its twin does", plane.name),
            })?;
            Ok(Output::copy(bound, access, gpu, encoder, &mut readback))
        });
        let outputs = outputs.collect::<Result<Vec<_>, GpuError>>()?;
        let recorded = mem::replace(encoder, gpu.device.create_command_encoder(&Default::default()));
        let submission = gpu.scope("validating a pass", || gpu.queue.submit([recorded.finish()]))?;
        readback.map();
        gpu.wait(submission)?;
        let mut compared = Vec::with_capacity(outputs.len());
        let mut next = Vec::with_capacity(outputs.len());
        for (output, expected) in outputs.iter().zip(expected) {
            let texels = output.read(&readback, expected.extent)?;
            let written = texels.plane(&expected);
            next.push(match self.swapped == Some(pass) {
                true => output.write(gpu, texels, &expected)?,
                false => written.clone(),
            });
            compared.push(Compared {
                gpu: written,
                twin: expected,
                witness: None,
            });
        }
        let agreement = self.agreement(pass, compared);
        for plane in next {
            self.twins.keep(pass, &plane);
            if plane.name == "shown" {
                self.shown = Some(plane);
            }
        }
        self.passes.push(PassAgreement {
            pass: pass.to_owned(),
            agreement,
        });
        Ok(())
    }
}

impl Follow<'_> {
    /// Asks the witness only where a pixel is beyond the bound.
    fn agreement(&self, pass: &str, mut compared: Vec<Compared>) -> Agreement {
        let found = Agreement::of(&compared, self.bounds, Some(self.bounds));
        if found.n_beyond == 0 {
            return found;
        }
        for (compared, witness) in compared.iter_mut().zip(self.twins.f32.compute(pass, self.frame)) {
            compared.witness = Some(witness);
        }
        Agreement::of(&compared, self.bounds, Some(self.bounds))
    }
}

/// What a pass wrote, on its way back.
struct Output<'a> {
    bound: Bound<'a>,
    access: Access,
    slot: usize,
}

/// Texels of a texture or elements of a buffer as the GPU keeps them, which may be more channels than the twin has.
struct Texels {
    values: Vec<f32>,
    n_channels: usize,
}

impl<'a> Output<'a> {
    fn copy(
        bound: Bound<'a>,
        access: Access,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        readback: &mut Readback,
    ) -> Self {
        let slot = match bound {
            Bound::Texture(texture) => readback.copy_texture(gpu, encoder, texture),
            Bound::Buffer(buffer) => readback.copy_buffer(gpu, encoder, buffer, buffer.size()),
        };
        Self { bound, access, slot }
    }

    fn read(&self, readback: &Readback, extent: Extent) -> Result<Texels, GpuError> {
        let values = match self.bound {
            Bound::Texture(texture) => readback.floats(self.slot, texture)?,
            Bound::Buffer(_) => {
                let bytes = readback.bytes(self.slot)?;
                let words = bytes.chunks_exact(4).map(|word| std::array::from_fn(|i| word[i]));
                // A count of texels is below 2²⁴, and so exact.
                let value = |word| match self.access.integers {
                    true => u32::from_le_bytes(word) as f32,
                    false => f32::from_le_bytes(word),
                };
                words.map(value).collect()
            }
        };
        let n_channels = values.len() / extent.n_pixels();
        Ok(Texels { values, n_channels })
    }

    /// Puts the twin's plane in the place of what the pass wrote; returns it as rounded by that.
    fn write(&self, gpu: &Gpu, mut texels: Texels, plane: &Plane<f64>) -> Result<Plane<f64>, GpuError> {
        let n_channels = plane.scales.len();
        let stored = texels.values.chunks_exact_mut(texels.n_channels);
        for (texel, values) in stored.zip(plane.values.chunks_exact(n_channels)) {
            for (stored, &value) in texel.iter_mut().zip(values) {
                *stored = value as f32;
            }
        }
        gpu.scope("swapping a pass", || match self.bound {
            Bound::Texture(texture) => texture.write_floats(gpu, &texels.values),
            Bound::Buffer(buffer) if self.access.integers => {
                let numbers: Vec<_> = texels.values.iter().map(|&value| value as u32).collect();
                gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&numbers));
            }
            Bound::Buffer(buffer) => gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&texels.values)),
        })?;
        Ok(texels.plane(plane))
    }
}

impl Texels {
    /// The channels that `like` has.
    fn plane(&self, like: &Plane<f64>) -> Plane<f64> {
        let texels = self.values.chunks_exact(self.n_channels);
        let channels = texels.flat_map(|texel| &texel[..like.scales.len()]);
        Plane {
            values: channels.map(|&value| f64::from(value)).collect(),
            ..like.clone()
        }
    }
}
