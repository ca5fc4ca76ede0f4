//! The temporal pass (`shaders/taa/temporal`), and the passes before it that some of its blocks need.

use super::{Carried, Inputs, Precision, Recipe, recipe::Weight, recorder::Recorder};
use crate::{
    gpu::{Gpu, GpuError, Pass, Texture},
    image::Extent,
};
use wgpu::TextureFormat;

/// What every pass of a recipe is compiled with.
const SHARED: [&str; 9] = [
    include_str!("../../shaders/taa/temporal/recipe.wgsl"),
    include_str!("../../shaders/taa/temporal/reproject.wgsl"),
    include_str!("../../shaders/taa/temporal/filters.wgsl"),
    include_str!("../../shaders/taa/temporal/neighbourhood.wgsl"),
    include_str!("../../shaders/taa/temporal/weight.wgsl"),
    include_str!("../../shaders/taa/temporal/output.wgsl"),
    include_str!("../../shaders/common/rectify.wgsl"),
    include_str!("../../shaders/common/sampling.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];
const RESOLVE: &str = include_str!("../../shaders/taa/temporal/resolve.wgsl");
const DIFFERENCE: &str = include_str!("../../shaders/taa/temporal/difference.wgsl");
const DIFFERENCE_ROWS: &str = include_str!("../../shaders/taa/temporal/difference_rows.wgsl");
const HISTORY_F16: &str = include_str!("../../shaders/taa/temporal/history_f16.wgsl");
const HISTORY_F32: &str = include_str!("../../shaders/taa/temporal/history_f32.wgsl");

/// Compiles a pass of `recipe`.
pub fn pass(gpu: &Gpu, name: &str, text: &str, recipe: &Recipe, precision: Precision) -> Result<Pass, GpuError> {
    let store = match precision {
        Precision::F16 => HISTORY_F16,
        Precision::F32 => HISTORY_F32,
    };
    let mut sources = vec![text];
    sources.extend(SHARED);
    sources.push(store);
    Pass::new(gpu, name, &sources, &recipe.overrides())
}

/// The passes of a temporal recipe and what they keep.
#[derive(Debug)]
pub struct Temporal {
    difference: Option<Difference>,
    resolve: Pass,
    history: Carried,
    n_samples: Carried,
    /// Bound where a recipe does not read what another would.
    nothing: Texture,
}

impl Temporal {
    /// The names of the passes, in the order recorded.
    pub fn passes(recipe: &Recipe) -> Vec<&'static str> {
        let mut passes = Vec::new();
        if recipe.weight == Weight::Amortized {
            passes.extend(["difference", "difference_rows"]);
        }
        passes.push("resolve");
        passes
    }

    pub fn new(gpu: &Gpu, recipe: &Recipe, precision: Precision, extent: Extent) -> Result<Self, GpuError> {
        let difference = (recipe.weight == Weight::Amortized)
            .then(|| Difference::new(gpu, recipe, precision, extent))
            .transpose()?;
        let resolve = pass(gpu, "resolve", RESOLVE, recipe, precision)?;
        let history_format = match precision {
            Precision::F16 => TextureFormat::Rgba16Float,
            Precision::F32 => TextureFormat::Rgba32Float,
        };
        let unused = Extent::new(1, 1);
        let counted = if recipe.weight.counts() { extent } else { unused };
        gpu.scope("making room for history", || Self {
            difference,
            resolve,
            history: Carried::new(gpu, "history", extent, history_format),
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
        if let Some(difference) = &self.difference {
            difference.record(recorder, recipe, inputs, history)?;
        }
        let dispatch = inputs
            .bind_to(&self.resolve, recipe)
            .bind("history", history)
            .bind("next_history", self.history.current())
            .bind("n_samples", self.n_samples.previous())
            .bind("next_n_samples", self.n_samples.current())
            .bind("reactive_mask", &inputs.reactive)
            .bind(
                "difference_rows",
                self.difference
                    .as_ref()
                    .map_or(&self.nothing, |difference| &difference.rows),
            )
            .bind("shown", shown)
            .over(recorder.gpu, inputs.extent())?;
        recorder.record(&dispatch);
        Ok(())
    }
}

/// The mean difference of history and current colour over rows of 7, for [`Weight::Amortized`].
#[derive(Debug)]
struct Difference {
    of_pixel: Pass,
    of_row: Pass,
    pixels: Texture,
    rows: Texture,
}

impl Difference {
    fn new(gpu: &Gpu, recipe: &Recipe, precision: Precision, extent: Extent) -> Result<Self, GpuError> {
        let of_pixel = pass(gpu, "difference", DIFFERENCE, recipe, precision)?;
        let of_row = pass(gpu, "difference_rows", DIFFERENCE_ROWS, recipe, precision)?;
        gpu.scope("making room for differences", || Self {
            of_pixel,
            of_row,
            pixels: Texture::new(gpu, "difference", extent, TextureFormat::Rgba32Float),
            rows: Texture::new(gpu, "difference rows", extent, TextureFormat::Rgba32Float),
        })
    }

    fn record(
        &self,
        recorder: &mut Recorder<'_>,
        recipe: &Recipe,
        inputs: &Inputs,
        history: &Texture,
    ) -> Result<(), GpuError> {
        let of_pixel = inputs
            .bind_to(&self.of_pixel, recipe)
            .bind("history", history)
            .bind("difference", &self.pixels)
            .over(recorder.gpu, inputs.extent())?;
        recorder.record(&of_pixel);
        let of_row = self
            .of_row
            .bind("difference", &self.pixels)
            .bind("rows", &self.rows)
            .over(recorder.gpu, inputs.extent())?;
        recorder.record(&of_row);
        Ok(())
    }
}
