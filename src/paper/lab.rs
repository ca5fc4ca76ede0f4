//! Where experiments are made: bakes scenes, runs systems on them, keeps the frames that are to be shown.

use super::{
    PaperError,
    stage::Stage,
    subject::{Outcome, Subject},
};
use crate::{
    gpu::Gpu,
    image::{
        Extent, Image,
        files::{Backend, FileReader, Limits},
    },
    metrics::{Display, Metric, Picture, Reference, Values},
    run::{self, MetricsOn, Observer, RunError, RunSpec, Validate},
    scene::{BakeSettings, Baker, Cache},
    sequence::{Channels, Sequence, frame::Rgb, jitter::JitterSequence},
    taa::{Precision, Skip},
};
use std::sync::Mutex;

/// How much work the experiments are worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Size of every frame but those below.
    pub extent: Extent,
    /// Size of the thesis's static tests.
    pub still_extent: Extent,
    /// Renders a reference is the mean of.
    pub reference_samples: u32,
    /// Frames of scenes that move.
    pub n_frames: usize,
    /// Sizes at which the cost is measured.
    pub cost_extents: [Extent; 3],
}

impl Effort {
    /// What `docs/reproduction.md` is made with.
    pub const FULL: Self = Self {
        extent: Extent::new(320, 180),
        still_extent: Extent::new(960, 540),
        reference_samples: 32,
        n_frames: 24,
        cost_extents: [
            Extent::new(1920, 1080),
            Extent::new(2560, 1440),
            Extent::new(3840, 2160),
        ],
    };

    /// A look in a minute or two. Orderings may differ.
    pub const QUICK: Self = Self {
        extent: Extent::new(160, 90),
        still_extent: Extent::new(320, 180),
        reference_samples: 16,
        n_frames: 16,
        cost_extents: [Extent::new(240, 135), Extent::new(320, 180), Extent::new(480, 270)],
    };
}

/// Makes experiments.
pub struct Lab<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) effort: Effort,
    scenes: Cache,
}

/// Keeps one frame of each subject.
struct Camera {
    frame_index: Option<usize>,
    pictures: Mutex<Vec<Option<Image<Rgb>>>>,
}

impl Observer for Camera {
    fn wants_output(&self) -> bool {
        self.frame_index.is_some()
    }

    fn output(&self, preset_index: usize, frame_index: usize, image: &Image<Rgb>) -> Result<(), std::io::Error> {
        if self.frame_index == Some(frame_index) {
            let mut pictures = self.pictures.lock().expect("no panic while it is held");
            pictures[preset_index] = Some(image.clone());
        }
        Ok(())
    }
}

impl Lab<'_> {
    /// Runs `subjects` on `sequence` and keeps frame `pictured` of each.
    pub fn run(
        &self,
        sequence: &Sequence,
        subjects: &[Subject],
        metrics: &[Metric],
        pictured: Option<usize>,
    ) -> Result<Vec<Outcome>, PaperError> {
        let spec = RunSpec {
            presets: subjects.iter().map(|subject| subject.spec.clone()).collect(),
            metrics: metrics.to_vec(),
            history: Precision::F16,
            n_frames: None,
            repeat: 1,
            metrics_on: MetricsOn::Auto,
            validate: Validate::No,
            skip: Skip::Off,
            until: None,
        };
        let camera = Camera {
            frame_index: pictured,
            pictures: Mutex::new(vec![None; subjects.len()]),
        };
        let report = run::execute(&spec, sequence, self.gpu, &camera)?;
        let pictures = camera.pictures.into_inner().expect("no panic while it was held");
        let outcomes = subjects.iter().zip(report.reports).zip(pictures);
        Ok(outcomes
            .map(|((subject, report), picture)| Outcome {
                label: subject.label.clone(),
                report,
                picture,
            })
            .collect())
    }
}

/// The last frame of a scene at rest.
pub struct Settled {
    pub reference: Image<Rgb>,
    pub display: Display,
    /// One a subject.
    pub stills: Vec<Still>,
}

/// What a subject showed in it.
pub struct Still {
    pub label: String,
    pub image: Image<Rgb>,
    values: Values,
}

impl Still {
    /// A metric of it.
    pub fn value(&self, metric: Metric) -> f64 {
        self.values.get(metric.id()).map_or(f64::NAN, |value| value.0)
    }
}

/// A scene as an experiment wants it rendered.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    pub scene: &'static str,
    /// None: as many as the effort is worth.
    pub n_frames: Option<usize>,
    /// Whether time stands still.
    pub at_rest: bool,
    pub jitter: JitterSequence,
    /// Factor on every jitter.
    pub jitter_scale: f64,
    /// Samples a pixel of the frames.
    pub n_samples: u32,
    pub mipmaps: bool,
    /// None: as many as the effort is worth.
    pub reference_samples: Option<u32>,
}

impl Shot {
    pub fn of(scene: &'static str) -> Self {
        Self {
            scene,
            n_frames: None,
            at_rest: false,
            jitter: JitterSequence::Halton23(16),
            jitter_scale: 1.0,
            n_samples: 1,
            mipmaps: true,
            reference_samples: None,
        }
    }

    /// What PHLM's references have, and enough where images are tens of decibels away from them.
    pub const FEW: u32 = 16;

    /// The same with a cheap reference, for scenes of many triangles.
    pub fn with_few_reference_samples(self) -> Self {
        Self {
            reference_samples: Some(Self::FEW),
            ..self
        }
    }

    /// The same without motion.
    pub fn at_rest(self) -> Self {
        Self { at_rest: true, ..self }
    }
}

impl<'a> Lab<'a> {
    /// A lab on `gpu`, which keeps its scenes where `afterimage bake` does.
    pub fn new(gpu: &'a Gpu, effort: Effort) -> Self {
        let scenes = Cache::new(Cache::default_folder());
        Self { gpu, effort, scenes }
    }

    fn settings(&self, shot: Shot, extent: Extent) -> BakeSettings {
        BakeSettings {
            n_frames: shot.n_frames.unwrap_or(self.effort.n_frames),
            render_size: extent,
            output_size: extent,
            at_rest: shot.at_rest,
            jitter: shot.jitter,
            jitter_scale: shot.jitter_scale,
            samples: shot.n_samples,
            reference_samples: shot.reference_samples.unwrap_or(self.effort.reference_samples),
            mipmaps: shot.mipmaps,
            ..BakeSettings::new(shot.scene)
        }
    }

    /// Lets history fill on a scene that stands still, and scores the last frame by metrics that need no other. Systems without
    /// history see that frame only. Nothing is written.
    pub fn settle(
        &self,
        shot: Shot,
        extent: Extent,
        subjects: &[Subject],
        metrics: &[Metric],
    ) -> Result<Settled, PaperError> {
        let settings = self.settings(shot.at_rest(), extent);
        let mut baker = Baker::new(self.gpu, &settings)?;
        let mut stage = None;
        let mut reference = None;
        for index in 0..settings.n_frames {
            let mut frame = baker.frame(index)?.into_frame();
            reference = frame.reference.take();
            let stage = match &mut stage {
                Some(stage) => stage,
                None => stage.insert(Stage::new(self.gpu, subjects, Precision::F16, &frame)?),
            };
            let is_last = index + 1 == settings.n_frames;
            let systems = (0..subjects.len()).filter(|&system| is_last || subjects[system].has_history);
            stage.resolve(&frame, systems)?;
        }
        let missing = || RunError::Internal(format!("scene `{}` gave no reference", settings.scene));
        let (reference, stage) = reference.zip(stage).ok_or_else(missing)?;
        let display = baker.display();
        let scored = Reference::new(Picture::linear(reference.clone(), display), metrics);
        let mut stills = Vec::with_capacity(subjects.len());
        for (system, subject) in subjects.iter().enumerate() {
            let image = stage.shown(system)?;
            let scores = scored.evaluate(&Picture::linear(image.clone(), display));
            let scores = scores.map_err(|cause| RunError::Input(format!("scene `{}`: {cause}", settings.scene)))?;
            stills.push(Still {
                label: subject.label.clone(),
                image,
                values: scores.values,
            });
        }
        Ok(Settled {
            reference,
            display,
            stills,
        })
    }

    /// The sequence of a shot, rendered where it was not yet.
    pub fn bake(&self, shot: Shot) -> Result<Sequence, PaperError> {
        let settings = self.settings(shot, self.effort.extent);
        let baked = self.scenes.get(self.gpu, &settings, false, &())?;
        let reader = FileReader::new(Backend::Auto, Limits::default());
        Ok(Sequence::open(&baked.path, &reader)?)
    }
}

/// The reference of one frame.
pub fn reference(sequence: &Sequence, index: usize) -> Result<Image<Rgb>, PaperError> {
    let channels = Channels {
        reference: true,
        ..Channels::default()
    };
    let frame = sequence.load(index, channels)?;
    frame
        .reference
        .ok_or_else(|| RunError::Internal(format!("{} has no reference", sequence.name())).into())
}
