//! `ms_ssim.y`: both images halved four times, and the windows of each scale.

use super::{
    super::{ms_ssim::N_SCALES, quantity::Domain, ssim::Part},
    Recording, Setup,
    reference::References,
    similarity::{WindowSums, window_pass},
    sums::Copied,
};
use crate::{
    gpu::{GpuError, Pass, Texture},
    image::Extent,
};
use wgpu::TextureFormat;

const HALVE: &str = include_str!("../../../shaders/metrics/halve.wgsl");
const CLASS_SHARES: &str = include_str!("../../../shaders/metrics/class_shares.wgsl");
const SHARES: &str = include_str!("../../../shaders/metrics/shares.wgsl");

/// MS-SSIM of luma. Images are halved in colour: luma of a mean is the mean of lumas.
#[derive(Debug)]
pub struct MultiScale {
    halve: Pass,
    contrast: Pass,
    whole: Pass,
    /// Of each scale.
    sums: Vec<WindowSums>,
    reference: Pyramid,
    test: Pyramid,
    shares: Option<Shares>,
}

/// An image at every scale but the finest.
#[derive(Debug)]
struct Pyramid(Vec<Texture>);

/// What share of each pixel is of each class, where there are masks.
#[derive(Debug)]
struct Shares {
    pass: Pass,
    finest: Texture,
    coarser: Pyramid,
}

impl MultiScale {
    pub fn new(setup: &Setup) -> Result<Self, GpuError> {
        let classes_wgsl = if setup.has_masks { SHARES } else { setup.classes_wgsl() };
        let windows = |part| window_pass(setup, Domain::Luma, part, classes_wgsl);
        let sums = extents(setup.extent).map(|extent| WindowSums::new(setup, extent));
        Ok(Self {
            halve: Pass::new(setup.gpu, "metrics: halve", &[HALVE], &[])?,
            contrast: windows(Part::Contrast)?,
            whole: windows(Part::Whole)?,
            sums: sums.collect::<Result<_, _>>()?,
            reference: Pyramid::new(setup)?,
            test: Pyramid::new(setup)?,
            shares: setup.has_masks.then(|| Shares::new(setup)).transpose()?,
        })
    }

    /// Records the scales of the frame's reference and of its classes.
    pub fn prepare(&self, recording: &mut Recording, references: &References) -> Result<(), GpuError> {
        self.reference.record(recording, &self.halve, references.shown())?;
        if let (Some(shares), Some(classes)) = (&self.shares, &references.classes) {
            let invocation = shares
                .pass
                .bind("classes", classes)
                .bind("class_shares", &shares.finest);
            recording.dispatch(invocation, shares.finest.extent())?;
            shares.coarser.record(recording, &self.halve, &shares.finest)?;
        }
        Ok(())
    }

    /// Sums of each scale, from the finest on.
    pub fn record(
        &self,
        recording: &mut Recording,
        references: &References,
        test_shown: &Texture,
    ) -> Result<Vec<Copied<2>>, GpuError> {
        self.test.record(recording, &self.halve, test_shown)?;
        let scale = |(i, sums): (usize, &WindowSums)| {
            let pass = if i + 1 == N_SCALES { &self.whole } else { &self.contrast };
            let images = [self.reference.at(references.shown(), i), self.test.at(test_shown, i)];
            let shares = self.shares.as_ref();
            let shares = shares.map(|shares| ("shares", shares.coarser.at(&shares.finest, i)));
            sums.record(recording, pass, images, shares)
        };
        self.sums.iter().enumerate().map(scale).collect()
    }
}

impl Pyramid {
    fn new(setup: &Setup) -> Result<Self, GpuError> {
        let texture = |extent| Texture::new(setup.gpu, "halved image", extent, TextureFormat::Rgba32Float);
        let scales = || extents(setup.extent).skip(1).map(texture).collect();
        setup.gpu.scope("making room for halved images", scales).map(Self)
    }

    fn record(&self, recording: &mut Recording, halve: &Pass, finest: &Texture) -> Result<(), GpuError> {
        for (i, coarser) in self.0.iter().enumerate() {
            let invocation = halve.bind("finer", self.at(finest, i)).bind("coarser", coarser);
            recording.dispatch(invocation, coarser.extent())?;
        }
        Ok(())
    }

    fn at<'a>(&'a self, finest: &'a Texture, scale: usize) -> &'a Texture {
        scale.checked_sub(1).map_or(finest, |coarser| &self.0[coarser])
    }
}

impl Shares {
    fn new(setup: &Setup) -> Result<Self, GpuError> {
        let sources = [CLASS_SHARES, setup.classes_wgsl()];
        Ok(Self {
            pass: Pass::new(setup.gpu, "metrics: shares of classes", &sources, &[])?,
            finest: setup.texture("shares of classes", TextureFormat::Rgba32Float)?,
            coarser: Pyramid::new(setup)?,
        })
    }
}

/// Of every scale.
fn extents(finest: Extent) -> impl Iterator<Item = Extent> {
    let halved = |extent: &Extent| Some(Extent::new(extent.width.div_ceil(2), extent.height.div_ceil(2)));
    std::iter::successors(Some(finest), halved).take(N_SCALES)
}
