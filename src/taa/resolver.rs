//! One recipe on the GPU: its specialised pipeline and its history.

use super::{Inputs, Precision, Recipe, recipe::InputFilter};
use crate::{
    gpu::{Gpu, GpuError, Pass, Texture, Timer},
    image::Extent,
};
use wgpu::TextureFormat;

/// A recipe's resolve pass, its history and the image it shows.
#[derive(Debug)]
pub struct Resolver {
    recipe: Recipe,
    resolve: Pass,
    /// History is read from one and written to the other; `latest` says which was written last.
    history: [Texture; 2],
    latest: usize,
    shown: Texture,
}

const RESOLVE: [&str; 5] = [
    include_str!("../../shaders/taa/temporal/resolve.wgsl"),
    include_str!("../../shaders/taa/temporal/neighbourhood.wgsl"),
    include_str!("../../shaders/common/rectify.wgsl"),
    include_str!("../../shaders/common/sampling.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];
const HISTORY_F16: &str = include_str!("../../shaders/taa/temporal/history_f16.wgsl");
const HISTORY_F32: &str = include_str!("../../shaders/taa/temporal/history_f32.wgsl");

impl Resolver {
    /// Compiles the pipeline for `recipe` and makes its history for frames of `extent`.
    pub fn new(gpu: &Gpu, recipe: Recipe, precision: Precision, extent: Extent) -> Result<Self, GpuError> {
        let (store, format) = match precision {
            Precision::F16 => (HISTORY_F16, TextureFormat::Rgba16Float),
            Precision::F32 => (HISTORY_F32, TextureFormat::Rgba32Float),
        };
        let mut sources = RESOLVE.to_vec();
        sources.push(store);
        let resolve = Pass::new(gpu, "resolve", &sources, &recipe.overrides())?;
        gpu.scope("making room for history", || Self {
            resolve,
            history: ["history 0", "history 1"].map(|label| Texture::new(gpu, label, extent, format)),
            latest: 0,
            shown: Texture::new(gpu, "shown", extent, TextureFormat::Rgba32Float),
            recipe,
        })
    }

    /// The parameters it was built from.
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// Records the resolve of the frame in `inputs`, `repeat` times: it reads one history and writes the other, so that
    /// running it again changes nothing.
    pub fn resolve(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        inputs: &Inputs,
        timer: &mut Timer,
        repeat: u32,
    ) -> Result<(), GpuError> {
        let [x, y] = inputs.jitter_px();
        let next = 1 - self.latest;
        let dispatch = self
            .resolve
            .bind("color", inputs.prepared(self.recipe.source, self.recipe.domain))
            .bind("depth", &inputs.depth)
            .bind("motion", &inputs.motion)
            .bind("history", &self.history[self.latest])
            .bind("next_history", &self.history[next])
            .bind("shown", &self.shown)
            .uniform(
                "frame",
                &[
                    ("input_weights_x", InputFilter::axis_weights(x).map(|w| w as f32).into()),
                    ("input_weights_y", InputFilter::axis_weights(y).map(|w| w as f32).into()),
                    ("jitter_px", [x as f32, y as f32].into()),
                    ("has_history", u32::from(inputs.has_history()).into()),
                ],
            )
            .over(gpu, inputs.extent())?;
        for _ in 0..repeat {
            dispatch.record(encoder, timer.time());
        }
        self.latest = next;
        Ok(())
    }

    /// The resolved image of the last frame after the output stage: linear RGB, `rgba32float`.
    pub fn shown(&self) -> &Texture {
        &self.shown
    }
}

impl InputFilter {
    /// Weights of the samples at -1, 0 and 1 along one axis, where all are shifted by `jitter_px`. The kernel
    /// `exp(-2.29 d²)` is the product of its axes, and so is its normalisation.
    pub(super) fn axis_weights(jitter_px: f64) -> [f64; 3] {
        let weights = [-1.0, 0.0, 1.0].map(|offset: f64| {
            let d = offset + jitter_px;
            libm::exp(-2.29 * d * d)
        });
        let sum: f64 = weights.iter().sum();
        weights.map(|weight| weight / sum)
    }
}
