//! One recipe on the GPU: its specialised passes and what they keep from frame to frame.

use super::{
    Fault, Inputs, Options, Recipe,
    checkerboard::Checkerboard,
    phlm2016::Phlm,
    recipe::Algorithm,
    recorder::{Recorder, Repeat, Step},
    skip::Skip,
    spatial::Antialiasing,
    temporal::{Builder, Temporal},
    tiles::{CLASSIFY_PASS, Kept, SETTLE_PASS, Shares, Tiles},
};
use crate::{
    gpu::{Bound, Gpu, GpuError, Readback, Texture, Timer},
    sequence::Sizes,
};
use wgpu::TextureFormat;

/// A recipe's passes, their state and the image they show.
#[derive(Debug)]
pub struct Resolver {
    recipe: Recipe,
    antialiasing: Option<Antialiasing>,
    passes: Passes,
    shown: Texture,
}

/// The passes of one algorithm and what they keep from frame to frame.
#[derive(Debug)]
enum Passes {
    Temporal(Box<Temporal>),
    Phlm2016(Box<Phlm>),
    Checkerboard(Box<Checkerboard>),
}

impl Resolver {
    /// Compiles the passes of `recipe` and makes room for frames of `sizes`. A [`super::Precision`] alone will do for `options`.
    pub fn new(gpu: &Gpu, recipe: Recipe, options: impl Into<Options>, sizes: Sizes) -> Result<Self, GpuError> {
        Self::with_fault(gpu, recipe, options, sizes, None)
    }

    /// The same with a mistake in one pass.
    pub fn with_fault(
        gpu: &Gpu,
        recipe: Recipe,
        options: impl Into<Options>,
        sizes: Sizes,
        fault: Option<Fault<'_>>,
    ) -> Result<Self, GpuError> {
        let options = options.into();
        let refused = |message: String| GpuError::Pass {
            pass: "resolve".to_owned(),
            message,
        };
        recipe.check_gpu().map_err(|error| refused(error.to_string()))?;
        recipe.check_sizes(sizes).map_err(|error| refused(error.to_string()))?;
        let builder = Builder {
            gpu,
            precision: recipe.precision(options.precision),
            keeps_tiles: recipe.keeps_tiles(options.skip, sizes),
            recipe: &recipe,
            sizes,
            fault,
        };
        let antialiasing = Antialiasing::new(builder)?;
        let passes = match recipe.algorithm {
            Algorithm::Temporal => Passes::Temporal(Box::new(Temporal::new(builder)?)),
            Algorithm::Phlm2016 => Passes::Phlm2016(Box::new(Phlm::new(builder)?)),
            Algorithm::Checkerboard => Passes::Checkerboard(Box::new(Checkerboard::new(builder)?)),
        };
        gpu.scope("making room for the shown image", || Self {
            antialiasing,
            passes,
            shown: Texture::new(gpu, "shown", sizes.output, TextureFormat::Rgba32Float),
            recipe,
        })
    }

    /// The parameters it was built from.
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// Records the passes of [`Recipe::passes`] for the frame in `inputs`, as often as `repeat` says: what is read is never
    /// written, so that running one again changes nothing. Where tiles are skipped, the inputs must track changes.
    pub fn resolve(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        inputs: &Inputs,
        timer: &mut Timer,
        repeat: Repeat,
    ) -> Result<(), GpuError> {
        let mut recorder = Recorder {
            gpu,
            encoder,
            timer,
            repeat,
            watch: None,
        };
        self.record(&mut recorder, inputs)
    }

    /// Records the passes of [`Recipe::passes`] for the frame in `inputs`.
    pub fn record(&mut self, recorder: &mut Recorder<'_>, inputs: &Inputs) -> Result<(), GpuError> {
        let mut view = inputs.view(&self.recipe);
        if let Some(antialiasing) = &self.antialiasing {
            antialiasing.record(recorder, view)?;
            view = view.with_color(antialiasing.antialiased());
        }
        match &mut self.passes {
            Passes::Temporal(temporal) => temporal.record(recorder, view, &self.shown),
            Passes::Phlm2016(phlm) => phlm.record(recorder, view, &self.shown),
            Passes::Checkerboard(checkerboard) => checkerboard.record(recorder, view, &self.shown),
        }
    }

    /// Copies back which tiles of the last frame were kept; none where the recipe keeps none.
    pub fn copy_kept(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, readback: &mut Readback) -> Option<Kept> {
        Some(self.tiles()?.copy_back(gpu, encoder, readback))
    }

    /// The same of how many they are.
    pub fn copy_shares(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        readback: &mut Readback,
    ) -> Option<Shares> {
        Some(self.tiles()?.copy_shares(gpu, encoder, readback))
    }

    fn tiles(&self) -> Option<&Tiles> {
        match &self.passes {
            Passes::Temporal(temporal) => temporal.tiles(),
            Passes::Phlm2016(_) | Passes::Checkerboard(_) => None,
        }
    }

    /// The same passes, to be recorded whenever a frame like the one in `inputs` follows one like that before it. Call it
    /// once a frame of an even number of frames that repeat: the history written by the last is the one that the first reads.
    pub fn steps(&mut self, gpu: &Gpu, inputs: &Inputs) -> Result<Vec<Step>, GpuError> {
        let mut steps: Vec<Step> = Vec::new();
        // Recorded for the sake of who watches, and never submitted.
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.record(
            &mut Recorder {
                gpu,
                encoder: &mut encoder,
                timer: &mut Timer::new(gpu, 0),
                repeat: Repeat::Timed(1),
                watch: Some(&mut steps),
            },
            inputs,
        )?;
        Ok(steps)
    }

    /// Everything that the last frame leaves to the next, by name. The first is the colour's history, or what stands for it.
    pub fn kept(&self) -> Vec<(&'static str, Bound<'_>)> {
        match &self.passes {
            Passes::Temporal(temporal) => temporal.kept(),
            Passes::Phlm2016(phlm) => phlm.kept(),
            Passes::Checkerboard(checkerboard) => checkerboard.kept(),
        }
    }

    /// The resolved image of the last frame after the output stage: linear RGB, `rgba32float`.
    pub fn shown(&self) -> &Texture {
        &self.shown
    }
}

impl Recipe {
    /// The names of the passes that a [`Resolver`] records for one frame, in order.
    pub fn passes(&self) -> Vec<&'static str> {
        let mut passes = Antialiasing::passes(self.spatial).to_vec();
        match self.algorithm {
            Algorithm::Temporal => passes.extend(Temporal::passes(self)),
            Algorithm::Phlm2016 => passes.extend(Phlm::PASSES),
            Algorithm::Checkerboard => passes.extend(Checkerboard::PASSES),
        }
        passes
    }

    /// The same where `skip` is asked for.
    pub fn passes_skipping(&self, skip: Skip, sizes: Sizes) -> Vec<&'static str> {
        if !self.keeps_tiles(skip, sizes) {
            return self.passes();
        }
        let settle = self.uses_history().then_some(SETTLE_PASS);
        [CLASSIFY_PASS].into_iter().chain(self.passes()).chain(settle).collect()
    }
}
