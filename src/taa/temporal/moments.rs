//! Mean and variance of a window of any size, by two separable passes.

use super::Builder;
use crate::{
    gpu::{GpuError, Pass, Texture},
    image::Extent,
    taa::{inputs::View, recorder::Recorder},
};

const MOMENTS: &str = include_str!("../../../shaders/taa/temporal/moments.wgsl");

#[derive(Debug)]
pub struct Moments {
    /// Side, texels.
    window: u32,
    along_rows: Pass,
    along_columns: Pass,
    rows: Distribution,
    windows: Distribution,
    /// Bound to the pass over rows, which starts from the frame's colour.
    nothing: Texture,
}

#[derive(Debug)]
struct Distribution {
    means: Texture,
    variances: Texture,
}

impl Moments {
    pub const PASSES: [&str; 2] = ["moments_rows", "moments_columns"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [rows, columns] = Self::PASSES;
        let along_rows = builder.pass(rows, MOMENTS, &[("vertical", 0.0)])?;
        let along_columns = builder.pass(columns, MOMENTS, &[("vertical", 1.0)])?;
        let distribution = || Distribution {
            means: builder.color("means", builder.sizes.render),
            variances: builder.color("variances", builder.sizes.render),
        };
        builder.gpu.scope("making room for moments", || Self {
            window: builder.recipe.variance_window,
            along_rows,
            along_columns,
            rows: distribution(),
            windows: distribution(),
            nothing: builder.color("nothing", Extent::new(1, 1)),
        })
    }

    pub fn record(&self, recorder: &mut Recorder<'_>, view: View<'_>) -> Result<(), GpuError> {
        let Extent { width, height } = view.sizes().render;
        let n = self.window;
        let rows = view
            .bind_to(&self.along_rows)
            .bind("row_means", &self.nothing)
            .bind("row_variances", &self.nothing)
            .bind("means", &self.rows.means)
            .bind("variances", &self.rows.variances)
            .over(recorder.gpu, Extent::new(width.div_ceil(n), height))?;
        recorder.record_unless(view.is_repeat(), &rows)?;
        let columns = view
            .bind_to(&self.along_columns)
            .bind("row_means", &self.rows.means)
            .bind("row_variances", &self.rows.variances)
            .bind("means", &self.windows.means)
            .bind("variances", &self.windows.variances)
            .over(recorder.gpu, Extent::new(width, height.div_ceil(n)))?;
        recorder.record_unless(view.is_repeat(), &columns)
    }

    /// The mean of each pixel's window.
    pub fn means(&self) -> &Texture {
        &self.windows.means
    }

    /// The variance of each pixel's window.
    pub fn variances(&self) -> &Texture {
        &self.windows.variances
    }
}
