//! `ssim`, `ssim.y` and `ssim.u8`.

use super::{
    super::{
        quantity::Domain,
        ssim::{self, Part},
    },
    Recording, Setup,
    reference::References,
    sums::{Copied, PartialSums},
};
use crate::{
    gpu::{GpuError, Pass, Texture},
    image::Extent,
};

const COLOR: &str = include_str!("../../../shaders/common/color.wgsl");
const SSIM: &str = include_str!("../../../shaders/metrics/ssim.wgsl");

/// Side in windows of a workgroup of `ssim.wgsl`.
const GROUP: u32 = 16;

/// SSIM of one domain.
#[derive(Debug)]
pub struct Ssim {
    pub domain: Domain,
    pass: Pass,
    sums: WindowSums,
}

/// For each class the sum of an index times a window's share of it, and the sum of these shares.
#[derive(Debug)]
pub struct WindowSums {
    sums: PartialSums<2>,
    windows: Extent,
}

impl Ssim {
    pub fn new(setup: &Setup, domain: Domain) -> Result<Self, GpuError> {
        Ok(Self {
            domain,
            pass: window_pass(setup, domain, Part::Whole, setup.classes_wgsl())?,
            sums: WindowSums::new(setup, setup.extent)?,
        })
    }

    pub fn record(
        &self,
        recording: &mut Recording,
        references: &References,
        test_shown: &Texture,
    ) -> Result<Copied<2>, GpuError> {
        let images = [references.shown(), test_shown];
        self.sums.record(
            recording,
            &self.pass,
            images,
            references.classes.as_ref().map(|classes| ("classes", classes)),
        )
    }
}

/// The pass over all windows of a domain. `classes_wgsl` says what share of a window is of each class.
pub fn window_pass(setup: &Setup, domain: Domain, part: Part, classes_wgsl: &'static str) -> Result<Pass, GpuError> {
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
        ("part", f64::from(part as u32)),
        ("w0", w0),
        ("w1", w1),
        ("w2", w2),
        ("w3", w3),
        ("w4", w4),
        ("w5", w5),
        ("c1", c1),
        ("c2", c2),
    ];
    Pass::new(setup.gpu, "metrics: ssim", &[SSIM, COLOR, classes_wgsl], &overrides)
}

impl WindowSums {
    /// Of images of `extent`.
    pub fn new(setup: &Setup, extent: Extent) -> Result<Self, GpuError> {
        let windows = ssim::valid_extent(extent);
        let n_groups = windows.width.div_ceil(GROUP) as usize * windows.height.div_ceil(GROUP) as usize;
        Ok(Self {
            sums: PartialSums::new(setup, n_groups)?,
            windows,
        })
    }

    /// Records `pass` over reference and test, with what tells classes apart.
    pub fn record(
        &self,
        recording: &mut Recording,
        pass: &Pass,
        [reference, test]: [&Texture; 2],
        classes: Option<(&'static str, &Texture)>,
    ) -> Result<Copied<2>, GpuError> {
        let mut invocation = pass
            .bind("reference_shown", reference)
            .bind("test_shown", test)
            .bind("partial_sums", self.sums.buffer());
        if let Some((name, texture)) = classes {
            invocation = invocation.bind(name, texture);
        }
        recording.dispatch(invocation, self.windows)?;
        Ok(self.sums.copy(recording))
    }
}
