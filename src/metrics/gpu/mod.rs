//! The same metrics on the device, for adapters that are faster at it than the host: the image under test never leaves
//! the device, only partial sums do. f32, within the bounds of `docs/metrics.md` of the CPU's values.
//!
//! [`GpuMetrics`] records the passes of a frame: what follows from its reference once (`reference`), then for each preset
//! the display transform and one file a family of metrics. What it records comes back as [`Recorded`], from which a
//! [`DeviceTrack`] makes the preset's scores.

mod flip;
mod histogram;
mod multiscale;
mod recorded;
mod reference;
mod similarity;
mod sums;
mod temporal;
mod track;

use super::{
    Display, Metric, MetricError, Picture,
    flip::Exposures,
    quantity::{Quantity, quantities},
    reference::check_sizes,
    relative_error::{REL_MSE_FLOOR, SMAPE_FLOOR},
};
use crate::{
    gpu::{Gpu, GpuError, Invocation, Readback, Texture, Timer},
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use flip::Flip;
use multiscale::MultiScale;
pub use recorded::Recorded;
use reference::{References, Show};
use similarity::Ssim;
use std::{collections::BTreeSet, sync::Arc};
use sums::SumPass;
use temporal::{Past, Temporal};
pub use track::DeviceTrack;
use wgpu::TextureFormat;

const COLOR: &str = include_str!("../../../shaders/common/color.wgsl");
const SQUARED_ERROR: &str = include_str!("../../../shaders/metrics/squared_error.wgsl");

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

/// The passes for a set of metrics, and what presets leave from frame to frame. Frames must be finite below 1e18 in linear
/// colour, whose squares are summed in f32.
#[derive(Debug)]
pub struct GpuMetrics {
    display: Display,
    extent: Extent,
    has_masks: bool,
    show: Show,
    references: References,
    test_shown: Texture,
    /// What is measured pixel by pixel; tells bad pixels as well, so every run has it.
    pixels: SumPass<9>,
    ssim: Vec<Ssim>,
    multi_scale: Option<MultiScale>,
    flip: Option<Flip>,
    temporal: Temporal,
    /// Of each preset.
    pasts: Vec<Past>,
    has_previous: bool,
}

/// A frame of the sequence, the same for every preset.
#[derive(Clone, Copy, Debug)]
pub struct ScoredFrame<'a> {
    /// Linear RGB.
    pub reference: &'a Arc<Image<Rgb>>,
    /// Where each pixel's surface was one frame ago, minus where it is now, in pixels; metrics that need it have no value
    /// without.
    pub motion_px: Option<&'a Image<[f32; 2]>>,
    /// Whether it continues the frame recorded before it; false after a reset.
    pub follows: bool,
    /// Whether it is past warm-up, and counts in what is gathered over the sequence.
    pub settled: bool,
}

/// Where passes and copies are recorded.
#[derive(Debug)]
pub struct Recording<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// What records.
    pub encoder: &'a mut wgpu::CommandEncoder,
    /// Where sums go.
    pub readback: &'a mut Readback,
}

/// What passes are made for.
struct Setup<'a> {
    gpu: &'a Gpu,
    extent: Extent,
    metrics: &'a [Metric],
    quantities: BTreeSet<Quantity>,
    has_masks: bool,
}

/// What is known of a frame besides its reference.
#[derive(Clone, Copy, Debug)]
struct KnownFrame {
    follows: bool,
    /// Whether it follows, and its motion is known.
    follows_motion: bool,
    settled: bool,
    /// Whether there are masks, and the frame's pixels have been told apart.
    knows_classes: bool,
}

impl GpuMetrics {
    /// Compiles the passes for `metrics` on frames of `extent` from `n_presets` presets.
    pub fn new(
        gpu: &Gpu,
        extent: Extent,
        display: Display,
        metrics: &[Metric],
        n_presets: usize,
    ) -> Result<Self, GpuMetricError> {
        check_sizes(metrics, extent, extent)?;
        let setup = Setup {
            gpu,
            extent,
            metrics,
            quantities: quantities(metrics),
            has_masks: metrics.iter().any(|metric| metric.mask().is_some()),
        };
        let floors = [("rel_mse_floor", REL_MSE_FLOOR), ("smape_floor", SMAPE_FLOOR)];
        let ssim = setup.quantities.iter().filter_map(|quantity| match quantity {
            Quantity::Ssim(domain) => Some(Ssim::new(&setup, *domain)),
            _ => None,
        });
        let wants = |quantities: &[Quantity]| quantities.iter().any(|quantity| setup.wants(*quantity));
        let flip = || Flip::new(&setup, n_presets);
        let has_flip = wants(&[Quantity::Flip, Quantity::FlipPercentile, Quantity::HdrFlip]);
        let multi_scale = wants(&[Quantity::MsSsim]).then(|| MultiScale::new(&setup));
        let temporal = Temporal::new(&setup)?;
        Ok(Self {
            display,
            extent,
            has_masks: setup.has_masks,
            show: Show::new(&setup, display)?,
            references: References::new(&setup)?,
            test_shown: setup.texture("shown test", TextureFormat::Rgba32Float)?,
            pixels: SumPass::new(&setup, "metrics: squared error", SQUARED_ERROR, &[COLOR], &floors)?,
            ssim: ssim.collect::<Result<_, _>>()?,
            multi_scale: multi_scale.transpose()?,
            flip: has_flip.then(flip).transpose()?,
            pasts: (0..n_presets)
                .map(|_| temporal.past(&setup))
                .collect::<Result<_, _>>()?,
            temporal,
            has_previous: false,
        })
    }

    /// Records the measurement of every preset's image (linear RGB, `rgba32float`) of the next frame; timed as one.
    pub fn record(
        &mut self,
        recording: &mut Recording,
        timer: &mut Timer,
        frame: ScoredFrame,
        tests: &[&Texture],
    ) -> Result<Vec<Recorded>, GpuMetricError> {
        let motion = frame.motion_px.map(Image::extent);
        let images = [frame.reference.extent()].into_iter().chain(motion);
        for extent in tests.iter().map(|test| test.extent()).chain(images) {
            check_sizes(&[], self.extent, extent)?;
        }
        let follows = frame.follows && self.has_previous;
        let follows_motion = follows && frame.motion_px.is_some();
        self.has_previous = true;
        let known = KnownFrame {
            follows,
            follows_motion,
            settled: frame.settled,
            knows_classes: self.has_masks && follows_motion,
        };
        timer.begin(recording.encoder);
        self.prepare(recording, &known, &frame)?;
        let presets = tests.iter().zip(&self.pasts);
        let presets = presets.map(|(test, past)| self.record_preset(recording, &known, test, past));
        let mut recorded: Vec<Recorded> = presets.collect::<Result<_, GpuError>>()?;
        if let Some(flip) = &self.flip {
            let reference = || Picture::linear(Arc::clone(frame.reference), self.display);
            let exposures = || Exposures::of(&reference());
            let hdr = flip.record_hdr(recording, &self.references, tests, exposures)?;
            for (recorded, hdr) in recorded.iter_mut().zip(hdr) {
                recorded.hdr_flip = Some(hdr);
            }
        }
        timer.end(recording.encoder);
        Ok(recorded)
    }

    /// What follows from the frame's reference, for all presets.
    fn prepare(&mut self, recording: &mut Recording, known: &KnownFrame, frame: &ScoredFrame) -> Result<(), GpuError> {
        self.references.advance(recording, &self.show, frame.reference)?;
        if known.follows {
            self.references.follow(recording, frame.motion_px)?;
        }
        if let Some(multi_scale) = &self.multi_scale {
            multi_scale.prepare(recording, &self.references)?;
        }
        if let Some(flip) = &self.flip {
            flip.prepare(recording, &self.references)?;
        }
        Ok(())
    }

    fn record_preset(
        &self,
        recording: &mut Recording,
        frame: &KnownFrame,
        test: &Texture,
        past: &Past,
    ) -> Result<Recorded, GpuError> {
        let (references, shown) = (&self.references, &self.test_shown);
        self.show.record(recording, test, shown)?;
        let pixels = self.pixels.start(references.classes.as_ref());
        let pixels = pixels
            .bind("reference_linear", &references.linear)
            .bind("test_linear", test)
            .bind("reference_shown", references.shown())
            .bind("test_shown", shown);
        let pixels = self.pixels.record(recording, pixels)?;
        let ssim = self.ssim.iter();
        let ssim = ssim.map(|ssim| Ok((ssim.domain, ssim.record(recording, references, shown)?)));
        let ssim = ssim.collect::<Result<_, GpuError>>()?;
        let multi_scale = self.multi_scale.as_ref();
        let multi_scale = multi_scale.map(|scales| scales.record(recording, references, shown));
        let flip = self.flip.as_ref().map(|flip| flip.record(recording, references, shown));
        Ok(Recorded {
            follows: frame.follows,
            knows_classes: frame.knows_classes,
            pixels,
            ssim,
            multi_scale: multi_scale.transpose()?,
            flip: flip.transpose()?.unwrap_or_default(),
            hdr_flip: None,
            changes: self.temporal.record(recording, references, shown, past, frame)?,
        })
    }
}

impl Setup<'_> {
    fn wants(&self, quantity: Quantity) -> bool {
        self.quantities.contains(&quantity)
    }

    fn texture(&self, label: &str, format: TextureFormat) -> Result<Texture, GpuError> {
        self.gpu.scope(&format!("making room for {label}"), || {
            Texture::new(self.gpu, label, self.extent, format)
        })
    }
}

impl Recording<'_> {
    fn dispatch(&mut self, invocation: Invocation, extent: Extent) -> Result<(), GpuError> {
        invocation.over(self.gpu, extent)?.record(self.encoder, None);
        Ok(())
    }

    fn copy(&mut self, buffer: &wgpu::Buffer) -> usize {
        self.readback.copy_buffer(self.gpu, self.encoder, buffer, buffer.size())
    }
}
