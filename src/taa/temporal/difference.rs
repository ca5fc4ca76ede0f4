//! How far history is from the current colour, over rows of 7 texels: what the weight `amortized` looks at.

use super::Builder;
use crate::{
    gpu::{GpuError, Pass, Texture},
    taa::{inputs::View, recorder::Recorder},
};

const OF_PIXEL: &str = include_str!("../../../shaders/taa/temporal/difference.wgsl");
const OF_ROW: &str = include_str!("../../../shaders/taa/temporal/difference_rows.wgsl");

#[derive(Debug)]
pub struct Difference {
    of_pixel: Pass,
    of_row: Pass,
    pixels: Texture,
    rows: Texture,
}

impl Difference {
    pub const PASSES: [&str; 2] = ["difference", "difference_rows"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [pixel, row] = Self::PASSES;
        let of_pixel = builder.pass(pixel, OF_PIXEL, &[])?;
        let of_row = builder.pass(row, OF_ROW, &[])?;
        builder.gpu.scope("making room for differences", || Self {
            of_pixel,
            of_row,
            pixels: builder.color("difference", builder.sizes.render),
            rows: builder.color("difference rows", builder.sizes.render),
        })
    }

    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        view: View<'_>,
        history: &Texture,
        prefiltered: &Texture,
    ) -> Result<(), GpuError> {
        let of_pixel = view
            .bind_to(&self.of_pixel)
            .bind("history", history)
            .bind("prefiltered", prefiltered)
            .bind("difference", &self.pixels)
            .over(recorder.gpu, view.sizes().render)?;
        recorder.record(&of_pixel);
        let of_row = self
            .of_row
            .bind("difference", &self.pixels)
            .bind("rows", &self.rows)
            .over(recorder.gpu, view.sizes().render)?;
        recorder.record(&of_row);
        Ok(())
    }

    /// Means over rows of 7.
    pub fn rows(&self) -> &Texture {
        &self.rows
    }
}
