//! Pixel history linear models (`shaders/taa/phlm2016`): the fit of every pixel, and what it is carried in.

use super::{Carried, inputs::View, recorder::Recorder, temporal::Builder};
use crate::gpu::{Bound, Gpu, GpuError, Pass, Texture};
use wgpu::{BufferUsages, TextureFormat};

const STILL: &str = include_str!("../../shaders/taa/phlm2016/still.wgsl");
const MODEL: &str = include_str!("../../shaders/taa/phlm2016/model.wgsl");

/// Bytes a pixel: three channels' coefficients.
const COEFFICIENTS_SIZE: u64 = 48;
/// Bytes a pixel: half of a symmetric 4×4, padded.
const COVARIANCE_SIZE: u64 = 48;

/// The passes, and their state in f32 but for the feature.
#[derive(Debug)]
pub struct Phlm {
    still: Pass,
    model: Pass,
    /// Not 0 where anything moved in this frame: one `u32`.
    moves: wgpu::Buffer,
    coefficients: Carried<wgpu::Buffer>,
    covariances: Carried<wgpu::Buffer>,
    feature: Carried,
    /// The shown colour, and of how many samples it is the mean.
    mean: Carried,
}

impl Phlm {
    pub const PASSES: [&str; 2] = ["still", "model"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [still, model] = Self::PASSES;
        let still = builder.pass(still, STILL, &[])?;
        let model = builder.pass(model, MODEL, &[])?;
        let (gpu, extent) = (builder.gpu, builder.sizes.render);
        let n_pixels = extent.n_pixels() as u64;
        if n_pixels * COEFFICIENTS_SIZE.max(COVARIANCE_SIZE) > gpu.max_buffer() {
            return Err(GpuError::Unsupported {
                adapter: gpu.info().name,
                message: format!("has too small buffers for `phlm2016` at {extent}; use smaller frames"),
            });
        }
        let buffers = |label, size| Carried::of([0, 1].map(|_| buffer(gpu, label, n_pixels * size)));
        gpu.scope("making room for models", || Self {
            still,
            model,
            moves: buffer(gpu, "moves", 4),
            coefficients: buffers("coefficients", COEFFICIENTS_SIZE),
            covariances: buffers("covariances", COVARIANCE_SIZE),
            feature: Carried::new(gpu, "feature", extent, builder.history_format()),
            mean: Carried::new(gpu, "mean", extent, TextureFormat::Rgba32Float),
        })
    }

    pub fn record(&mut self, recorder: &mut Recorder<'_>, view: View<'_>, shown: &Texture) -> Result<(), GpuError> {
        self.coefficients.advance();
        self.covariances.advance();
        self.feature.advance();
        self.mean.advance();
        let still = view
            .bind_to(&self.still)
            .bind("moves", &self.moves)
            .over(recorder.gpu, view.sizes().render)?;
        recorder.record_counting(&still, &[&self.moves])?;
        let model = view
            .bind_to(&self.model)
            .bind("coefficients", self.coefficients.previous())
            .bind("next_coefficients", self.coefficients.current())
            .bind("covariances", self.covariances.previous())
            .bind("next_covariances", self.covariances.current())
            .bind("history", self.feature.previous())
            .bind("next_history", self.feature.current())
            .bind("mean", self.mean.previous())
            .bind("next_mean", self.mean.current())
            .bind("moves", &self.moves)
            .bind("shown", shown)
            .over(recorder.gpu, view.sizes().render)?;
        recorder.record(&model)
    }

    /// What it leaves to the next frame.
    pub fn kept(&self) -> Vec<(&'static str, Bound<'_>)> {
        vec![
            ("feature", self.feature.current().into()),
            ("coefficients", self.coefficients.current().into()),
            ("covariances", self.covariances.current().into()),
            ("mean", self.mean.current().into()),
        ]
    }
}

fn buffer(gpu: &Gpu, label: &str, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
