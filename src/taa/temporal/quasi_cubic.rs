//! The coefficients of history for the filter `quasi_cubic`, by a recursive filter along rows and columns.

use super::Builder;
use crate::{
    gpu::{GpuError, Pass, Texture},
    image::Extent,
    taa::{inputs::View, recorder::Recorder},
};

const PREFILTER: &str = include_str!("../../../shaders/taa/temporal/quasi_prefilter.wgsl");

/// `RUN` of the shader: texels that one invocation makes.
const RUN: u32 = 16;
/// `QUASI_MARGIN` of the shaders: coefficients beyond each edge.
const MARGIN: u32 = 2;

#[derive(Debug)]
pub struct Coefficients {
    along_rows: Pass,
    along_columns: Pass,
    rows: Texture,
    coefficients: Texture,
}

impl Coefficients {
    pub const PASSES: [&str; 2] = ["prefilter_rows", "prefilter_columns"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [rows, columns] = Self::PASSES;
        let along_rows = builder.pass(rows, PREFILTER, &[("vertical", 0.0)])?;
        let along_columns = builder.pass(columns, PREFILTER, &[("vertical", 1.0)])?;
        let Extent { width, height } = builder.sizes.output;
        let width = width + 2 * MARGIN;
        builder.gpu.scope("making room for coefficients", || Self {
            along_rows,
            along_columns,
            rows: builder.color("row coefficients", Extent::new(width, height)),
            coefficients: builder.color("coefficients", Extent::new(width, height + 2 * MARGIN)),
        })
    }

    pub fn record(&self, recorder: &mut Recorder<'_>, view: View<'_>, history: &Texture) -> Result<(), GpuError> {
        // The pass over rows reads none, but a texture that is written may not be bound for reading as well.
        let Extent { width, height } = self.rows.extent();
        let rows = view
            .bind_to(&self.along_rows)
            .bind("history", history)
            .bind("row_coefficients", &self.coefficients)
            .bind("coefficients", &self.rows)
            .over(recorder.gpu, Extent::new(width.div_ceil(RUN), height))?;
        recorder.record(&rows)?;
        let Extent { width, height } = self.coefficients.extent();
        let columns = view
            .bind_to(&self.along_columns)
            .bind("history", history)
            .bind("row_coefficients", &self.rows)
            .bind("coefficients", &self.coefficients)
            .over(recorder.gpu, Extent::new(width, height.div_ceil(RUN)))?;
        recorder.record(&columns)
    }

    /// Of history, in both directions; texel (2, 2) is that of pixel (0, 0).
    pub fn coefficients(&self) -> &Texture {
        &self.coefficients
    }
}
