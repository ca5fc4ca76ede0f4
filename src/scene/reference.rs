//! The reference: many renders of one frame, summed on the device in f32, in two halves that know nothing of each
//! other, so that their difference tells how much noise is left. A CPU adapter renders the halves at once, each on a device
//! of its own.

use super::{
    pattern::Pattern,
    renderer::{ColorTarget, PreparedFrame, Renderer, View},
};
use crate::{
    gpu::{Gpu, GpuError, Pass, ReadbackPool},
    image::{Extent, Image},
    metrics::Display,
    sequence::{frame::Rgb, manifest::NoiseFloor},
};

/// Renders that are submitted at once. The device is waited for after each lot, so that memory stays bounded.
const LOT: usize = 16;

/// Sums of renders of one size.
pub(super) struct Accumulator {
    gpu: Gpu,
    pass: Pass,
    extent: Extent,
    target: ColorTarget,
    sum: wgpu::Buffer,
    tonemapped_sum: wgpu::Buffer,
    tonemapped: bool,
    pool: ReadbackPool,
}

/// Means of the renders of one lot of views.
pub(super) struct Mean {
    /// In linear light.
    pub linear: Image<Rgb>,
    /// After Karis's weighting and back, where asked for.
    pub karis: Option<Image<Rgb>>,
}

const SOURCE: &str = include_str!("../../shaders/scene/accumulate.wgsl");

impl Accumulator {
    /// Sums of `extent`, of renders so many times as fine along each axis.
    pub fn new(gpu: &Gpu, extent: Extent, fineness: u32, tonemapped: bool) -> Result<Self, GpuError> {
        let overrides = [
            ("FINENESS", f64::from(fineness)),
            ("TONEMAPPED", f64::from(u8::from(tonemapped))),
        ];
        let pass = Pass::new(gpu, "accumulate", &[SOURCE], &overrides)?;
        gpu.scope("making room for a reference", || {
            let buffer = |n_pixels: usize| {
                gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("sum"),
                    size: n_pixels as u64 * 16,
                    usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                })
            };
            Self {
                gpu: gpu.clone(),
                extent,
                target: ColorTarget::new(gpu, Extent::new(extent.width * fineness, extent.height * fineness)),
                sum: buffer(extent.n_pixels()),
                tonemapped_sum: buffer(if tonemapped { extent.n_pixels() } else { 1 }),
                tonemapped,
                pool: ReadbackPool::default(),
                pass,
            }
        })
    }

    /// Renders every view and leaves the sums on the device.
    pub fn accumulate(&self, renderer: &Renderer, frame: &PreparedFrame, views: &[View]) -> Result<(), GpuError> {
        let add = self
            .pass
            .bind("render", &self.target.color)
            .bind("sum", &self.sum)
            .offer("tonemapped_sum", &self.tonemapped_sum)
            .over(&self.gpu, self.extent)?;
        let mut first = true;
        for lot in views.chunks(LOT) {
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            if std::mem::take(&mut first) {
                encoder.clear_buffer(&self.sum, 0, None);
                encoder.clear_buffer(&self.tonemapped_sum, 0, None);
            }
            for view in lot {
                renderer.draw_color(&mut encoder, frame, *view, &self.target)?;
                add.record(&mut encoder, None);
            }
            let submission = self.gpu.queue.submit([encoder.finish()]);
            self.gpu.wait(submission)?;
        }
        Ok(())
    }

    /// Reads the sums back as means.
    pub fn read(&self) -> Result<Mean, GpuError> {
        let mut readback = self.pool.begin();
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut copy = |buffer: &wgpu::Buffer| readback.copy_buffer(&self.gpu, &mut encoder, buffer, buffer.size());
        let slot = copy(&self.sum);
        let tonemapped_slot = self.tonemapped.then(|| copy(&self.tonemapped_sum));
        let submission = self.gpu.queue.submit([encoder.finish()]);
        readback.map();
        self.gpu.wait(submission)?;
        let mean = |slot| -> Result<Image<Rgb>, GpuError> {
            let bytes = readback.bytes(slot)?;
            let sums: &[[f32; 4]] = bytemuck::cast_slice(&bytes);
            let pixels = sums.iter().map(|[r, g, b, n]| [r / n, g / n, b / n]).collect();
            Ok(Image::from_pixels(self.extent, pixels))
        };
        Ok(Mean {
            linear: mean(slot)?,
            karis: tonemapped_slot
                .map(|slot| Ok::<_, GpuError>(unweighted(&mean(slot)?)))
                .transpose()?,
        })
    }
}

/// The colour whose c / (1 + luma) this is.
fn unweighted(image: &Image<Rgb>) -> Image<Rgb> {
    Image::from_fn(image.extent(), |x, y| {
        let t = image.at(x, y);
        let luma = 0.2126 * t[0] + 0.7152 * t[1] + 0.0722 * t[2];
        t.map(|c| c / (1.0 - luma).max(f32::EPSILON))
    })
}

/// The views of one half of a reference: so many renders, each `fineness` times as fine along each axis.
pub(super) fn half_views(pattern: Pattern, n_samples: u32, fineness: u32, seed: u64) -> Vec<View> {
    let offsets = pattern.offsets_px(n_samples / 2 / (fineness * fineness), seed);
    let view = |(i, jitter_px): (usize, [f64; 2])| View {
        jitter_px,
        seed: (seed as u32).wrapping_add(i as u32),
        fineness,
    };
    offsets.into_iter().enumerate().map(view).collect()
}

/// What is left of the noise: half of the difference of two halves, squared and summed.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct NoiseSums {
    linear: f64,
    shown: f64,
    n_values: f64,
}

impl NoiseSums {
    /// Adds a frame's two halves. They are independent, so the error of their mean has the variance of half of their
    /// difference.
    pub fn add(&mut self, halves: [&Image<Rgb>; 2], display: Display) {
        let [a, b] = halves.map(Image::pixels);
        for (a, b) in a.iter().zip(b) {
            let (shown_a, shown_b) = (display.apply(*a), display.apply(*b));
            for i in 0..3 {
                let linear = 0.5 * (f64::from(a[i]) - f64::from(b[i]));
                let shown = 0.5 * (shown_a[i] - shown_b[i]);
                self.linear += linear * linear;
                self.shown += shown * shown;
            }
        }
        self.n_values += 3.0 * a.len() as f64;
    }

    pub fn floor(&self) -> NoiseFloor {
        let shown = self.shown / self.n_values;
        NoiseFloor {
            rms_linear: libm::sqrt(self.linear / self.n_values),
            psnr_db: (shown > 0.0).then(|| -10.0 * libm::log10(shown)),
        }
    }
}
