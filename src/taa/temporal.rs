//! The temporal pass (`shaders/taa/temporal`), and the passes before it that some of its blocks need.

mod chain;
mod moments;

use super::{
    Carried, Fault, Inputs, Precision, Recipe,
    fault::planted,
    recipe::{HistoryFilter, Sharpen},
    recorder::Recorder,
    sobel2018::Edges,
};
use crate::{
    gpu::{Gpu, GpuError, Pass, Texture},
    image::Extent,
    sequence::Sizes,
};
use chain::{COMPENSATION, Chain, DIFFERENCE};
use moments::Moments;
use wgpu::TextureFormat;

/// What every pass of a recipe is compiled with.
const SHARED: [&str; 11] = [
    include_str!("../../shaders/taa/temporal/recipe.wgsl"),
    include_str!("../../shaders/taa/temporal/reproject.wgsl"),
    include_str!("../../shaders/taa/temporal/filters.wgsl"),
    include_str!("../../shaders/taa/temporal/upsample.wgsl"),
    include_str!("../../shaders/taa/temporal/neighbourhood.wgsl"),
    include_str!("../../shaders/taa/temporal/weight.wgsl"),
    include_str!("../../shaders/taa/temporal/output.wgsl"),
    include_str!("../../shaders/taa/sobel2018/box.wgsl"),
    include_str!("../../shaders/common/rectify.wgsl"),
    include_str!("../../shaders/common/sampling.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];
const RESOLVE: &str = include_str!("../../shaders/taa/temporal/resolve.wgsl");
const SHARPEN: &str = include_str!("../../shaders/taa/temporal/sharpen.wgsl");
const HISTORY_F16: &str = include_str!("../../shaders/taa/temporal/history_f16.wgsl");
const HISTORY_F32: &str = include_str!("../../shaders/taa/temporal/history_f32.wgsl");

/// What the passes of a recipe are made from.
#[derive(Clone, Copy, Debug)]
pub struct Builder<'a> {
    pub gpu: &'a Gpu,
    pub recipe: &'a Recipe,
    pub precision: Precision,
    pub sizes: Sizes,
    pub fault: Option<Fault<'a>>,
}

impl Builder<'_> {
    /// Compiles a pass of the recipe; `overrides` are its own.
    pub fn pass(&self, name: &str, text: &str, overrides: &[(&str, f64)]) -> Result<Pass, GpuError> {
        let store = match self.precision {
            Precision::F16 => HISTORY_F16,
            Precision::F32 => HISTORY_F32,
        };
        let sources: Vec<_> = [text].into_iter().chain(SHARED).chain([store]).collect();
        let sources = planted(self.fault, name, &sources)?;
        let sources: Vec<_> = sources.iter().map(|source| &**source).collect();
        let overrides = [&self.recipe.overrides(), overrides].concat();
        Pass::new(self.gpu, name, &sources, &overrides)
    }

    /// The format of a colour's history.
    pub fn history_format(&self) -> TextureFormat {
        match self.precision {
            Precision::F16 => TextureFormat::Rgba16Float,
            Precision::F32 => TextureFormat::Rgba32Float,
        }
    }

    /// A 32-bit colour image.
    pub fn color(&self, label: &str, extent: Extent) -> Texture {
        Texture::new(self.gpu, label, extent, TextureFormat::Rgba32Float)
    }
}

/// The passes of a temporal recipe and what they keep.
#[derive(Debug)]
pub struct Temporal {
    compensation: Option<Chain>,
    difference: Option<Chain>,
    moments: Option<Moments>,
    edges: Option<Edges>,
    resolve: Pass,
    /// And the resolved image it reads, in the working domain.
    sharpen: Option<(Pass, Texture)>,
    history: Carried,
    n_samples: Carried,
    /// Bound where a recipe does not read what another would.
    nothing: Texture,
}

impl Temporal {
    /// The names of the passes, in the order recorded.
    pub fn passes(recipe: &Recipe) -> Vec<&'static str> {
        let mut passes = Vec::new();
        if needs_compensation(recipe) {
            passes.extend(chain::names(COMPENSATION));
        }
        if recipe.finds_differences() {
            passes.extend(chain::names(DIFFERENCE));
        }
        if needs_moments(recipe) {
            passes.extend(Moments::PASSES);
        }
        if recipe.finds_edges() {
            passes.extend(Edges::PASSES);
        }
        passes.push("resolve");
        if recipe.sharpen != Sharpen::None {
            passes.push("sharpen");
        }
        passes
    }

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let Builder { gpu, recipe, .. } = builder;
        let extent = builder.sizes.output;
        let compensation = needs_compensation(recipe)
            .then(|| Chain::new(builder, COMPENSATION, extent))
            .transpose()?;
        let difference = recipe
            .finds_differences()
            .then(|| Chain::new(builder, DIFFERENCE, builder.sizes.render))
            .transpose()?;
        let moments = needs_moments(recipe).then(|| Moments::new(builder)).transpose()?;
        let edges = recipe.finds_edges().then(|| Edges::new(builder)).transpose()?;
        let resolve = builder.pass("resolve", RESOLVE, &[])?;
        let sharpen = (recipe.sharpen != Sharpen::None)
            .then(|| builder.pass("sharpen", SHARPEN, &[]))
            .transpose()?;
        let unused = Extent::new(1, 1);
        let counted = if recipe.weight.counts() { extent } else { unused };
        // What is stored beyond a texture's edge is dropped.
        let kept = if recipe.uses_history() { extent } else { unused };
        gpu.scope("making room for history", || Self {
            compensation,
            difference,
            moments,
            edges,
            resolve,
            sharpen: sharpen.map(|pass| (pass, builder.color("resolved", extent))),
            history: Carried::new(gpu, "history", kept, builder.history_format()),
            n_samples: Carried::new(gpu, "samples", counted, TextureFormat::R32Float),
            nothing: Texture::new(gpu, "nothing", unused, TextureFormat::Rgba32Float),
        })
    }

    /// Records the frame's passes; the last writes `shown`.
    pub fn record(
        &mut self,
        recorder: &mut Recorder<'_>,
        recipe: &Recipe,
        inputs: &Inputs,
        shown: &Texture,
    ) -> Result<(), GpuError> {
        self.history.advance();
        self.n_samples.advance();
        let history = self.history.previous();
        let nothing = &self.nothing;
        if let Some(compensation) = &self.compensation {
            compensation.record(recorder, recipe, inputs, &[("history", history)])?;
        }
        let compensated = self.compensation.as_ref().map_or(nothing, Chain::made);
        if let Some(difference) = &self.difference {
            let read = [("history", history), ("compensated", compensated)];
            difference.record(recorder, recipe, inputs, &read)?;
        }
        if let Some(moments) = &self.moments {
            moments.record(recorder, recipe, inputs)?;
        }
        if let Some(edges) = &mut self.edges {
            edges.record(recorder, recipe, inputs)?;
        }
        let resolve = inputs
            .bind_to(&self.resolve, recipe)
            .bind("history", history)
            .bind("compensated", compensated)
            .bind("next_history", self.history.current())
            .bind("n_samples", self.n_samples.previous())
            .bind("next_n_samples", self.n_samples.current())
            .bind("reactive_mask", &inputs.reactive)
            .bind("difference_rows", self.difference.as_ref().map_or(nothing, Chain::made))
            .bind("window_means", self.moments.as_ref().map_or(nothing, Moments::means))
            .bind(
                "window_variances",
                self.moments.as_ref().map_or(nothing, Moments::variances),
            )
            .bind("stable_edges", self.edges.as_ref().map_or(nothing, Edges::stable))
            .bind("shown", self.sharpen.as_ref().map_or(shown, |(_, resolved)| resolved))
            .over(recorder.gpu, inputs.sizes().output)?;
        recorder.record(&resolve)?;
        if let Some((sharpen, resolved)) = &self.sharpen {
            let bound = match recipe.motion_blur {
                true => inputs.bind_to(sharpen, recipe),
                false => inputs.bind_no_image_to(sharpen),
            };
            let sharpen = bound
                .bind("resolved", resolved)
                .bind("shown", shown)
                .over(recorder.gpu, inputs.sizes().output)?;
            recorder.record(&sharpen)?;
        }
        Ok(())
    }
}

fn needs_compensation(recipe: &Recipe) -> bool {
    recipe.history_filter == HistoryFilter::Bfecc
}

fn needs_moments(recipe: &Recipe) -> bool {
    recipe.uses_history() && recipe.prefilter_moments
}
