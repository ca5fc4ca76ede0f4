//! The same metrics on the device, for adapters that are faster at it than the host: the image under test never leaves
//! the device, only partial sums do. f32, within 1e-3 dB and 1e-5 of the CPU's values.

use super::{
    Display, FrameScores, Metric, MetricError,
    mask::{ByMask, by_mask},
    quantity::{Domain, Quantity, Sums, quantities},
    reference::{check_sizes, values},
    ssim,
};
use crate::{
    gpu::{Gpu, GpuError, Pass, Readback, Texture, Timer},
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use std::collections::BTreeMap;
use wgpu::TextureFormat;

const COLOR: &str = include_str!("../../shaders/common/color.wgsl");
const DISPLAY: &str = include_str!("../../shaders/metrics/display.wgsl");
const SQUARED_ERROR: &str = include_str!("../../shaders/metrics/squared_error.wgsl");
const SSIM: &str = include_str!("../../shaders/metrics/ssim.wgsl");

/// Rows that an invocation of `squared_error.wgsl` sums.
const STRIP: u32 = 64;
/// Side in windows of a workgroup of `ssim.wgsl`.
const SSIM_GROUP: u32 = 16;

/// Why frames cannot be measured on the device.
#[derive(Debug, thiserror::Error)]
pub enum GpuMetricError {
    /// The images do not suit the metrics.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// The passes for a set of metrics, and the reference of the frame at hand. Frames must be finite below 1e18 in linear
/// colour, whose squares are summed in f32.
#[derive(Debug)]
pub struct GpuMetrics {
    metrics: Vec<Metric>,
    extent: Extent,
    display: Pass,
    squared_error: Pass,
    error_sums: wgpu::Buffer,
    ssim: Vec<SsimPass>,
    reference: Prepared,
    test_shown: Texture,
}

/// The reference, linear and as shown.
#[derive(Debug)]
struct Prepared {
    linear: Texture,
    shown: Texture,
}

/// SSIM of one domain.
#[derive(Debug)]
struct SsimPass {
    domain: Domain,
    pass: Pass,
    sums: wgpu::Buffer,
}

/// What [`GpuMetrics::record`] asked for, to be read once its submission is done.
#[derive(Debug)]
pub struct Recorded {
    metrics: Vec<Metric>,
    extent: Extent,
    errors: usize,
    ssim: Vec<(Domain, usize)>,
}

/// Whether the device can compute `metric`.
pub fn computes(metric: Metric) -> bool {
    metric.mask().is_none()
        && matches!(
            metric.definition().quantity,
            Quantity::SquaredError(_) | Quantity::Ssim(_)
        )
}

impl GpuMetrics {
    /// Compiles the passes for `metrics`, all of which [`computes`], on frames of `extent`.
    pub fn new(gpu: &Gpu, extent: Extent, display: Display, metrics: &[Metric]) -> Result<Self, GpuMetricError> {
        check_sizes(metrics, extent, extent)?;
        let overrides = [
            ("exposure", display.exposure),
            ("tonemap", f64::from(display.tonemap as u32)),
        ];
        let ssim = quantities(metrics).into_iter().filter_map(|quantity| match quantity {
            Quantity::Ssim(domain) => Some(SsimPass::new(gpu, extent, domain)),
            _ => None,
        });
        let texture = |label| Texture::new(gpu, label, extent, TextureFormat::Rgba32Float);
        Ok(Self {
            metrics: metrics.to_vec(),
            extent,
            display: Pass::new(gpu, "metrics: display", &[DISPLAY, COLOR], &overrides)?,
            squared_error: Pass::new(gpu, "metrics: squared error", &[SQUARED_ERROR, COLOR], &[])?,
            error_sums: sums_buffer(gpu, strips(extent).n_pixels() * size_of::<ErrorSums>())?,
            ssim: ssim.collect::<Result<_, _>>()?,
            reference: gpu.scope("making room for a reference", || Prepared {
                linear: texture("reference"),
                shown: texture("shown reference"),
            })?,
            test_shown: gpu.scope("making room for a shown image", || texture("shown test"))?,
        })
    }

    /// Uploads the reference of the frames recorded from now on, linear RGB, and records its display transform.
    pub fn set_reference(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        reference: &Image<Rgb>,
        timer: &mut Timer,
    ) -> Result<(), GpuMetricError> {
        check_sizes(&[], reference.extent(), self.extent)?;
        gpu.scope("uploading a reference", || {
            self.reference.linear.write_rgb(gpu, reference);
        })?;
        self.show(gpu, encoder, &self.reference.linear, &self.reference.shown, timer)
    }

    /// Records the measurement of `test` (linear RGB, `rgba32float`) against the reference.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        test: &Texture,
        timer: &mut Timer,
        readback: &mut Readback,
    ) -> Result<Recorded, GpuMetricError> {
        check_sizes(&[], self.extent, test.extent())?;
        self.show(gpu, encoder, test, &self.test_shown, timer)?;
        self.squared_error
            .bind("reference_linear", &self.reference.linear)
            .bind("test_linear", test)
            .bind("reference_shown", &self.reference.shown)
            .bind("test_shown", &self.test_shown)
            .bind("partial_sums", &self.error_sums)
            .over(gpu, strips(self.extent))?
            .record(encoder, timer.time());
        let errors = readback.copy_buffer(gpu, encoder, &self.error_sums, self.error_sums.size());
        let mut slots = Vec::with_capacity(self.ssim.len());
        for SsimPass { domain, pass, sums } in &self.ssim {
            pass.bind("reference_shown", &self.reference.shown)
                .bind("test_shown", &self.test_shown)
                .bind("partial_sums", sums)
                .over(gpu, ssim::valid_extent(self.extent))?
                .record(encoder, timer.time());
            slots.push((*domain, readback.copy_buffer(gpu, encoder, sums, sums.size())));
        }
        Ok(Recorded {
            metrics: self.metrics.clone(),
            extent: self.extent,
            errors,
            ssim: slots,
        })
    }

    /// How many passes [`GpuMetrics::set_reference`] and [`GpuMetrics::record`] time.
    pub fn n_passes(&self) -> [u32; 2] {
        [1, 2 + self.ssim.len() as u32]
    }

    fn show(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        linear: &Texture,
        shown: &Texture,
        timer: &mut Timer,
    ) -> Result<(), GpuMetricError> {
        self.display
            .bind("linear", linear)
            .bind("shown", shown)
            .over(gpu, self.extent)?
            .record(encoder, timer.time());
        Ok(())
    }
}

impl SsimPass {
    fn new(gpu: &Gpu, extent: Extent, domain: Domain) -> Result<Self, GpuError> {
        let values = match domain {
            Domain::Linear => unreachable!("no metric compares the structure of linear values"),
            Domain::Display => 0.0,
            Domain::Luma => 1.0,
            Domain::U8 => 2.0,
        };
        let [w0, w1, w2, w3, w4, w5] = *ssim::WEIGHTS;
        let [c1, c2] = ssim::stabilisers(domain.peak());
        let overrides = [
            ("values", values),
            ("w0", w0),
            ("w1", w1),
            ("w2", w2),
            ("w3", w3),
            ("w4", w4),
            ("w5", w5),
            ("c1", c1),
            ("c2", c2),
        ];
        let valid = ssim::valid_extent(extent);
        let n_groups = valid.width.div_ceil(SSIM_GROUP) as usize * valid.height.div_ceil(SSIM_GROUP) as usize;
        Ok(Self {
            domain,
            pass: Pass::new(gpu, "metrics: ssim", &[SSIM, COLOR], &overrides)?,
            sums: sums_buffer(gpu, n_groups * domain.n_channels() * size_of::<f32>())?,
        })
    }
}

impl Recorded {
    /// The scores, from a read-back whose submission is done.
    pub fn scores(&self, readback: &Readback) -> Result<FrameScores, GpuError> {
        let mut total = [0.0; 6];
        for strip in bytemuck::pod_collect_to_vec::<u8, ErrorSums>(&readback.bytes(self.errors)?) {
            for (sum, partial) in total.iter_mut().zip(strip) {
                *sum += f64::from(partial);
            }
        }
        let [linear, display, luma, u8, reference, n_non_finite] = total;
        let mut measured = BTreeMap::new();
        for (domain, total, reference) in [
            (Domain::Linear, linear, 0.0),
            (Domain::Display, display, reference),
            (Domain::Luma, luma, 0.0),
            (Domain::U8, u8, 0.0),
        ] {
            let n = self.extent.n_pixels() * domain.n_channels();
            measured.insert(Quantity::SquaredError(domain), sums(n, [total, reference]));
        }
        for &(domain, slot) in &self.ssim {
            let partials = bytemuck::pod_collect_to_vec::<u8, f32>(&readback.bytes(slot)?);
            let n = ssim::valid_extent(self.extent).n_pixels() * domain.n_channels();
            let total = partials.into_iter().map(f64::from).sum();
            measured.insert(Quantity::Ssim(domain), sums(n, [total, 0.0]));
        }
        if n_non_finite > 0.0 {
            // Drivers may compute anything but NaN from a NaN, so it is told from the count. Every metric saw it.
            measured.values_mut().for_each(|sums| *sums = Sums::unknown());
        }
        Ok(FrameScores {
            values: values(&self.metrics, &measured, false),
            non_finite_pixels: n_non_finite as u64,
        })
    }
}

/// Over all pixels.
fn sums(n: usize, [total, reference]: [f64; 2]) -> ByMask<Sums> {
    let sums = Sums::new(n as f64, [total, reference]);
    by_mask(&[sums, Sums::default(), Sums::default(), Sums::default()])
}

/// `Sums` of `squared_error.wgsl`, in its order.
type ErrorSums = [f32; 6];

/// One invocation a column and strip.
fn strips(extent: Extent) -> Extent {
    Extent::new(extent.width, extent.height.div_ceil(STRIP))
}

fn sums_buffer(gpu: &Gpu, size: usize) -> Result<wgpu::Buffer, GpuError> {
    gpu.scope("making room for partial sums", || {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("partial sums"),
            size: size as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    })
}
