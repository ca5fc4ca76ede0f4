//! What is made of the reference of a frame, once for every preset that is compared with it.

use super::{
    super::{
        Display,
        mask::{DISOCCLUDED, MOVING},
        quantity::Quantity,
        temporal::{Change, MOVES_FROM_PX, REPROJECTS_WITHIN},
    },
    Recording, Setup,
};
use crate::{
    gpu::{GpuError, Invocation, Pass, Texture},
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use wgpu::TextureFormat;

const COLOR: &str = include_str!("../../../shaders/common/color.wgsl");
const DISPLAY: &str = include_str!("../../../shaders/common/display.wgsl");
const ROOTS: &str = include_str!("../../../shaders/common/roots.wgsl");
const SHOW: &str = include_str!("../../../shaders/metrics/display.wgsl");
pub const REPROJECT: &str = include_str!("../../../shaders/metrics/reproject.wgsl");
const CLASSIFY: &str = include_str!("../../../shaders/metrics/classify.wgsl");
const REFERENCE_CHANGE: &str = include_str!("../../../shaders/metrics/reference_change.wgsl");
const PATTERNS: &str = include_str!("../../../shaders/metrics/patterns.wgsl");

/// The display transform.
#[derive(Debug)]
pub struct Show(Pass);

/// The reference of the frame at hand, and what follows from it.
#[derive(Debug)]
pub struct References {
    pub linear: Texture,
    /// This frame's and the previous one's, taking turns; one where nothing reads the previous one.
    shown: Vec<Texture>,
    turn: usize,
    /// Where metrics follow it: `rg32float`, in pixels.
    pub motion: Option<Texture>,
    classify: Option<Pass>,
    /// The class of each pixel, where metrics ask for masks.
    pub classes: Option<Texture>,
    change_pass: Option<Pass>,
    /// Luma's change along the motion.
    pub change: Option<Texture>,
    patterns_pass: Option<Pass>,
    /// Of ghosting and blur.
    pub patterns: Option<Texture>,
}

/// What `reproject.wgsl` must know.
pub fn reprojection() -> (&'static str, f64) {
    ("reprojects_within", REPROJECTS_WITHIN)
}

impl Show {
    pub fn new(setup: &Setup, display: Display) -> Result<Self, GpuError> {
        let overrides = [
            ("exposure", display.exposure),
            ("tonemap", f64::from(display.tonemap as u32)),
        ];
        Pass::new(
            setup.gpu,
            "metrics: display",
            &[SHOW, DISPLAY, ROOTS, COLOR],
            &overrides,
        )
        .map(Self)
    }

    pub fn record(&self, recording: &mut Recording, linear: &Texture, shown: &Texture) -> Result<(), GpuError> {
        let invocation = self.0.bind("linear", linear).bind("shown", shown);
        recording.dispatch(invocation, shown.extent())
    }
}

impl References {
    pub fn new(setup: &Setup) -> Result<Self, GpuError> {
        let wants = |change| setup.wants(Quantity::Change(change));
        let follows_motion = wants(Change::WarpedStep) || wants(Change::WarpExcess);
        let reads_previous = setup.has_masks || follows_motion || wants(Change::Fit);
        let moving = [
            ("moving", f64::from(MOVING)),
            ("disoccluded", f64::from(DISOCCLUDED)),
            ("moves_from_px", f64::from(MOVES_FROM_PX)),
            reprojection(),
        ];
        let pass = |wanted: bool, label, sources: &[&str], overrides: &[(&str, f64)]| {
            wanted
                .then(|| Pass::new(setup.gpu, label, sources, overrides))
                .transpose()
        };
        let texture = |wanted: bool, label, format| wanted.then(|| setup.texture(label, format)).transpose();
        let shown =
            (0..1 + usize::from(reads_previous)).map(|_| setup.texture("shown reference", TextureFormat::Rgba32Float));
        Ok(Self {
            linear: setup.texture("reference", TextureFormat::Rgba32Float)?,
            shown: shown.collect::<Result<_, _>>()?,
            turn: 0,
            motion: texture(setup.has_masks || follows_motion, "motion", TextureFormat::Rg32Float)?,
            classify: pass(
                setup.has_masks,
                "metrics: classes",
                &[CLASSIFY, REPROJECT, COLOR],
                &moving,
            )?,
            classes: texture(setup.has_masks, "classes", TextureFormat::R32Uint)?,
            change_pass: pass(
                follows_motion,
                "metrics: reference change",
                &[REFERENCE_CHANGE, REPROJECT, COLOR],
                &[reprojection()],
            )?,
            change: texture(follows_motion, "reference change", TextureFormat::R32Float)?,
            patterns_pass: pass(wants(Change::Fit), "metrics: patterns", &[PATTERNS, COLOR], &[])?,
            patterns: texture(wants(Change::Fit), "patterns", TextureFormat::Rgba32Float)?,
        })
    }

    /// Uploads the next frame's reference, linear RGB, and records its display transform.
    pub fn advance(&mut self, recording: &mut Recording, show: &Show, reference: &Image<Rgb>) -> Result<(), GpuError> {
        let gpu = recording.gpu;
        gpu.scope("uploading a reference", || self.linear.write_rgb(gpu, reference))?;
        self.turn = (self.turn + 1) % self.shown.len();
        show.record(recording, &self.linear, self.shown())
    }

    /// Records what follows from this frame and the previous one; along the motion where that is known.
    pub fn follow(&self, recording: &mut Recording, motion_px: Option<&Image<[f32; 2]>>) -> Result<(), GpuError> {
        let gpu = recording.gpu;
        if let (Some(motion), Some(motion_px)) = (&self.motion, motion_px) {
            gpu.scope("uploading motion", || motion.write_vec2(gpu, motion_px))?;
        }
        let along_motion = [
            (&self.classify, "classified", &self.classes),
            (&self.change_pass, "change", &self.change),
        ];
        for (pass, name, made) in along_motion {
            if let (Some(pass), Some(made), Some(motion), Some(_)) = (pass, made, &self.motion, motion_px) {
                let invocation = self.both(pass).bind("motion", motion).bind(name, made);
                recording.dispatch(invocation, self.extent())?;
            }
        }
        if let (Some(pass), Some(patterns)) = (&self.patterns_pass, &self.patterns) {
            recording.dispatch(self.both(pass).bind("patterns", patterns), self.extent())?;
        }
        Ok(())
    }

    fn both<'a>(&'a self, pass: &'a Pass) -> Invocation<'a> {
        let previous = &self.shown[(self.turn + 1) % self.shown.len()];
        pass.bind("reference_shown", self.shown())
            .bind("previous_shown", previous)
    }

    /// Display RGB.
    pub fn shown(&self) -> &Texture {
        &self.shown[self.turn]
    }

    fn extent(&self) -> Extent {
        self.linear.extent()
    }
}
