//! History prepared so that sampling it bilinearly loses little: for the filter `bfecc`.

use super::Builder;
use crate::{
    gpu::{GpuError, Pass, Texture},
    taa::{inputs::View, recorder::Recorder},
};

const ADVECT: &str = include_str!("../../../shaders/taa/temporal/advect.wgsl");
const COMPENSATE: &str = include_str!("../../../shaders/taa/temporal/compensate.wgsl");

#[derive(Debug)]
pub struct Compensation {
    advect: Pass,
    compensate: Pass,
    advected: Texture,
    compensated: Texture,
}

impl Compensation {
    pub const PASSES: [&str; 2] = ["advect", "compensate"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [advect, compensate] = Self::PASSES;
        let advect = builder.pass(advect, ADVECT, &[])?;
        let compensate = builder.pass(compensate, COMPENSATE, &[])?;
        builder.gpu.scope("making room for compensated history", || Self {
            advect,
            compensate,
            advected: builder.color("advected", builder.sizes.output),
            compensated: builder.color("compensated", builder.sizes.output),
        })
    }

    pub fn record(&self, recorder: &mut Recorder<'_>, view: View<'_>, history: &Texture) -> Result<(), GpuError> {
        let advect = view
            .bind_to(&self.advect)
            .bind("history", history)
            .bind("advected", &self.advected)
            .over(recorder.gpu, view.sizes().output)?;
        recorder.record(&advect);
        let compensate = view
            .bind_to(&self.compensate)
            .bind("history", history)
            .bind("advected", &self.advected)
            .bind("next_compensated", &self.compensated)
            .over(recorder.gpu, view.sizes().output)?;
        recorder.record(&compensate);
        Ok(())
    }

    /// The history to sample.
    pub fn compensated(&self) -> &Texture {
        &self.compensated
    }
}
