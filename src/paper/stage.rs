//! Frames from memory through several systems at once: nothing is written, nothing is scored.

use super::{PaperError, subject::Subject};
use crate::{
    gpu::{Gpu, ReadbackPool, Timer},
    image::{Extent, Image},
    sequence::{Channels, Frame, frame::Rgb},
    taa::{Inputs, Precision, Recipe, Repeat, Resolver},
};
use std::{collections::BTreeSet, time::Instant};

/// Resolves frames one after another.
pub struct Stage<'g> {
    gpu: &'g Gpu,
    output: Extent,
    inputs: Inputs,
    resolvers: Vec<Resolver>,
    timer: Timer,
    pool: ReadbackPool,
}

impl<'g> Stage<'g> {
    /// Room for `subjects` and frames like `first`.
    pub fn new(gpu: &'g Gpu, subjects: &[Subject], precision: Precision, first: &Frame) -> Result<Self, PaperError> {
        let recipes = subjects
            .iter()
            .map(Subject::recipe)
            .collect::<Result<Vec<Recipe>, _>>()?;
        let sizes = first.sizes();
        let available = Channels {
            depth: first.depth.is_some(),
            motion: first.motion_px.is_some(),
            object_id: first.object_id.is_some(),
            albedo: first.albedo.is_some(),
            reactive: first.reactive.is_some(),
            unjittered_color: first.unjittered_color.is_some(),
            reference: false,
            several: first.several(),
        };
        let none = Channels {
            several: available.several,
            ..Channels::default()
        };
        let channels = recipes.iter().fold(none, |all, recipe| {
            all.union(recipe.required_channels())
                .union(recipe.optional_channels().intersection(available))
        });
        let wanted: BTreeSet<_> = recipes.iter().map(Recipe::preparation).collect();
        let n_passes: usize = recipes.iter().map(|recipe| recipe.passes().len()).sum();
        let n_merges = usize::from(available.several.is_some());
        let resolvers = recipes
            .into_iter()
            .map(|recipe| Resolver::new(gpu, recipe, precision, sizes));
        Ok(Self {
            gpu,
            output: sizes.output,
            inputs: Inputs::new(gpu, sizes, channels, &wanted)?,
            resolvers: resolvers.collect::<Result<_, _>>()?,
            timer: Timer::new(gpu, (n_merges + wanted.len() + n_passes) as u32),
            pool: ReadbackPool::default(),
        })
    }

    /// Resolves `frame` with each of the `systems`, by index. The time of its passes in milliseconds: by their timestamps, on an
    /// adapter that is a CPU by the clock, and 0 on others without timestamps.
    pub fn resolve(&mut self, frame: &Frame, systems: impl IntoIterator<Item = usize>) -> Result<f64, PaperError> {
        self.inputs.upload(self.gpu, frame)?;
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.inputs
            .prepare(self.gpu, &mut encoder, &mut self.timer, Repeat::Timed(1))?;
        for index in systems {
            self.resolvers[index].resolve(self.gpu, &mut encoder, &self.inputs, &mut self.timer, Repeat::Timed(1))?;
        }
        let mut readback = self.pool.begin();
        let times = self.timer.finish(self.gpu, &mut encoder, &mut readback);
        let commands = encoder.finish();
        let begin = Instant::now();
        let submission = self.gpu.queue.submit([commands]);
        readback.map();
        self.gpu.wait(submission)?;
        if self.gpu.is_cpu() {
            // Late in a long run lavapipe's timestamps were seen to say next to nothing.
            return Ok(begin.elapsed().as_secs_f64() * 1e3);
        }
        Ok(times.read(&readback)?.into_iter().sum())
    }

    /// What a system showed last.
    pub fn shown(&self, system: usize) -> Result<Image<Rgb>, PaperError> {
        let texture = self.resolvers[system].shown();
        let mut readback = self.pool.begin();
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let slot = readback.copy_texture(self.gpu, &mut encoder, texture);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        readback.map();
        self.gpu.wait(submission)?;
        Ok(readback.rgb(slot, self.output)?)
    }
}
