//! Checkerboard rendering (`shaders/taa/checkerboard`): the pixels that a frame did not shade.

use super::{Carried, inputs::View, recorder::Recorder, temporal::Builder};
use crate::{
    gpu::{Bound, GpuError, Pass, Texture},
    image::Extent,
};
use wgpu::TextureFormat;

const RESOLVE: &str = include_str!("../../shaders/taa/checkerboard/resolve.wgsl");

#[derive(Debug)]
pub struct Checkerboard {
    resolve: Pass,
    history: Carried,
    /// Bound for the history filters that are refused.
    nothing: Texture,
}

impl Checkerboard {
    pub const PASSES: [&str; 1] = ["resolve"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [resolve] = Self::PASSES;
        let resolve = builder.pass(resolve, RESOLVE, &[])?;
        let (gpu, extent) = (builder.gpu, builder.sizes.render);
        gpu.scope("making room for history", || Self {
            resolve,
            history: Carried::new(gpu, "history", extent, builder.history_format()),
            nothing: Texture::new(gpu, "nothing", Extent::new(1, 1), TextureFormat::Rgba32Float),
        })
    }

    pub fn record(&mut self, recorder: &mut Recorder<'_>, view: View<'_>, shown: &Texture) -> Result<(), GpuError> {
        self.history.advance();
        let resolve = view
            .bind_to(&self.resolve)
            .bind("history", self.history.previous())
            .bind("prefiltered", &self.nothing)
            .bind("next_history", self.history.current())
            .bind("shown", shown)
            .over(recorder.gpu, view.sizes().render)?;
        recorder.record(&resolve)
    }

    /// What it leaves to the next frame.
    pub fn kept(&self) -> Vec<(&'static str, Bound<'_>)> {
        vec![("history", self.history.current().into())]
    }
}
