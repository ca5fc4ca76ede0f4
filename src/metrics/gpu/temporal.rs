//! What changes from frame to frame: the passes, and what each preset leaves on the device for its next frame.

use super::{
    super::{
        mask::{N_CLASSES, counts, place},
        quantity::Quantity,
        temporal::Change,
    },
    KnownFrame, Recording, Setup,
    reference::{REPROJECT, References, reprojection},
    sums::{Copied, SumPass, storage},
};
use crate::gpu::{GpuError, Invocation, Pass, Texture};
use wgpu::{BufferUsages, TextureFormat};

const COLOR: &str = include_str!("../../../shaders/common/color.wgsl");
const CHANGE: &str = include_str!("../../../shaders/metrics/change.wgsl");
const ALONG_MOTION: &str = include_str!("../../../shaders/metrics/change_along_motion.wgsl");
const KEEP_ERRORS: &str = include_str!("../../../shaders/metrics/keep_errors.wgsl");
const FIT: &str = include_str!("../../../shaders/metrics/fit.wgsl");
const DEVIATION: &str = include_str!("../../../shaders/metrics/deviation.wgsl");

/// `Moments` of `deviation.wgsl`: three of f32.
const MOMENTS_BYTES: usize = 12;

/// The passes that the metrics of a run need.
#[derive(Debug)]
pub struct Temporal {
    change: Option<SumPass<2>>,
    along_motion: Option<SumPass<3>>,
    keep_errors: Option<Pass>,
    fit: Option<SumPass<5>>,
    deviations: Vec<Deviation>,
}

/// The deviation over time of the pixels of one place of [`super::super::mask::ByMask`].
#[derive(Debug)]
struct Deviation {
    place: usize,
    pass: SumPass<3>,
}

/// What one preset leaves for its next frame.
#[derive(Debug)]
pub struct Past {
    /// Test minus reference, display RGB.
    errors: Option<Texture>,
    /// Of each deviation.
    moments: Vec<wgpu::Buffer>,
}

/// Sums of one preset's frame on their way back.
#[derive(Debug, Default)]
pub struct Changes {
    pub change: Option<Copied<2>>,
    pub along_motion: Option<Copied<3>>,
    pub fit: Option<Copied<5>>,
    /// With their places.
    pub deviations: Vec<(usize, Copied<3>)>,
}

impl Temporal {
    pub fn new(setup: &Setup) -> Result<Self, GpuError> {
        let wants = |changes: &[Change]| changes.iter().any(|change| setup.wants(Quantity::Change(*change)));
        let changes = wants(&[Change::Step, Change::MeanError]);
        let follows = wants(&[Change::WarpedStep, Change::WarpExcess]);
        let change = || SumPass::new(setup, "metrics: change", CHANGE, &[COLOR], &[]);
        let along_motion = || {
            let shared = [REPROJECT, COLOR];
            SumPass::new(
                setup,
                "metrics: change along the motion",
                ALONG_MOTION,
                &shared,
                &[reprojection()],
            )
        };
        let keep = || Pass::new(setup.gpu, "metrics: keep errors", &[KEEP_ERRORS], &[]);
        let fit = || SumPass::new(setup, "metrics: fit", FIT, &[COLOR], &[]);
        let deviations = setup
            .metrics
            .iter()
            .filter(|metric| metric.definition().quantity == Quantity::ErrorDeviation);
        Ok(Self {
            change: changes.then(change).transpose()?,
            along_motion: follows.then(along_motion).transpose()?,
            keep_errors: (changes || follows).then(keep).transpose()?,
            fit: wants(&[Change::Fit]).then(fit).transpose()?,
            deviations: deviations
                .map(|metric| Deviation::new(setup, place(metric.mask())))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Of a preset that has not seen a frame.
    pub fn past(&self, setup: &Setup) -> Result<Past, GpuError> {
        let size = setup.extent.n_pixels() * MOMENTS_BYTES;
        let moments = || storage(setup.gpu, "deviations over time", size, BufferUsages::empty());
        let errors = || setup.texture("errors", TextureFormat::Rgba32Float);
        Ok(Past {
            errors: self.keep_errors.as_ref().map(|_| errors()).transpose()?,
            moments: self.deviations.iter().map(|_| moments()).collect::<Result<_, _>>()?,
        })
    }

    /// Records the changes from the preset's previous frame, which `past` is of, and makes it this one's.
    pub fn record(
        &self,
        recording: &mut Recording,
        references: &References,
        test_shown: &Texture,
        past: &Past,
        frame: &KnownFrame,
    ) -> Result<Changes, GpuError> {
        let classes = references.classes.as_ref();
        let bind = |invocation| bind_images(invocation, references, test_shown);
        let mut changes = Changes::default();
        if let (Some(pass), Some(errors), true) = (&self.change, &past.errors, frame.follows) {
            let invocation = bind(pass.start(classes)).bind("previous_errors", errors);
            changes.change = Some(pass.record(recording, invocation)?);
        }
        if let (Some(pass), Some(errors), true) = (&self.along_motion, &past.errors, frame.follows_motion)
            && let (Some(motion), Some(change)) = (&references.motion, &references.change)
        {
            let invocation = bind(pass.start(classes)).bind("previous_errors", errors);
            let invocation = invocation.bind("motion", motion).bind("change", change);
            changes.along_motion = Some(pass.record(recording, invocation)?);
        }
        if let (Some(pass), Some(patterns), true) = (&self.fit, &references.patterns, frame.follows) {
            let invocation = bind(pass.start(classes)).bind("patterns", patterns);
            changes.fit = Some(pass.record(recording, invocation)?);
        }
        if let (Some(pass), Some(errors)) = (&self.keep_errors, &past.errors) {
            recording.dispatch(bind(pass.start()).bind("errors", errors), errors.extent())?;
        }
        for (Deviation { place, pass }, moments) in self.deviations.iter().zip(&past.moments) {
            // After a reset nobody knows what moves.
            if frame.settled && (*place == 0 || frame.knows_classes) {
                let invocation = bind(pass.start(classes)).bind("moments", moments);
                changes.deviations.push((*place, pass.record(recording, invocation)?));
            }
        }
        Ok(changes)
    }
}

fn bind_images<'a>(invocation: Invocation<'a>, references: &'a References, test_shown: &'a Texture) -> Invocation<'a> {
    invocation
        .bind("reference_shown", references.shown())
        .bind("test_shown", test_shown)
}

impl Deviation {
    fn new(setup: &Setup, place: usize) -> Result<Self, GpuError> {
        let bits = (0..N_CLASSES)
            .filter(|class| counts(place, *class))
            .map(|class| 1 << class);
        let overrides = [("counted_classes", f64::from(bits.sum::<u32>()))];
        Ok(Self {
            place,
            pass: SumPass::new(setup, "metrics: deviation", DEVIATION, &[COLOR], &overrides)?,
        })
    }
}
