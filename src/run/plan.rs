//! From what was asked to what will be done: everything about a run that can be known, or refused, before it starts.

use super::{PresetSpec, RunError, RunSpec, Until, Validate};
use crate::{
    gpu::Timer,
    metrics::Metric,
    sequence::{Channels, Sequence},
    taa::{Preparation, Preset, Recipe, RecipeError, SizesError, Skip, Source, UnknownPreset, recipe::Dilation},
};
use std::collections::BTreeSet;

/// A checked run.
#[derive(Debug)]
pub struct Plan {
    pub systems: Vec<System>,
    /// Empty where the sequence has no reference.
    pub metrics: Vec<Metric>,
    pub channels: Channels,
    /// The colours to prepare, in order.
    pub prepared: BTreeSet<Preparation>,
    pub n_frames: usize,
    pub repeat: u32,
    pub skip: Skip,
    pub until: Option<Until>,
    /// Frame × preset pairs that are validated after the run.
    pub n_validated: usize,
}

/// A preset with its overrides applied.
#[derive(Debug)]
pub struct System {
    pub preset: String,
    pub recipe: Recipe,
    /// The names of its passes, in the order recorded.
    pub passes: Vec<&'static str>,
    /// What it reads of the sequence.
    pub channels: Channels,
    pub notes: Vec<String>,
}

/// The most often a pass is timed.
pub const MAX_REPEAT: u32 = 100;

impl Plan {
    pub fn new(spec: &RunSpec, sequence: &Sequence) -> Result<Self, RunError> {
        if spec.presets.is_empty() {
            return Err(RunError::Input("presets: name at least one".to_owned()));
        }
        if !(1..=MAX_REPEAT).contains(&spec.repeat) {
            return Err(RunError::Input(format!(
                "repeat: must be 1 to {MAX_REPEAT}, not {}",
                spec.repeat
            )));
        }
        if spec.n_frames == Some(0) {
            return Err(RunError::Input("frames: must be at least 1".to_owned()));
        }
        let available = sequence.available();
        let n_frames = spec.n_frames.unwrap_or(usize::MAX).min(sequence.n_frames());
        let systems = spec
            .presets
            .iter()
            .enumerate()
            .map(|(index, wanted)| {
                System::new(wanted, sequence, n_frames, spec.skip)
                    .map_err(|cause| RunError::Input(format!("presets[{index}]: {cause}")))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let prepared: BTreeSet<_> = systems.iter().map(|system| system.recipe.preparation()).collect();
        let metrics = if available.reference {
            spec.metrics.clone()
        } else {
            Vec::new()
        };
        check_metrics(&metrics, sequence)?;
        if let Some(until) = spec.until.filter(|until| !metrics.contains(&until.metric)) {
            let message = format!("until: `{}` is not among the metrics computed", until.metric);
            return Err(RunError::Input(message));
        }
        let plan = Self {
            channels: channels(&systems, &metrics),
            systems,
            metrics,
            prepared,
            n_validated: match spec.validate {
                Validate::No => 0,
                Validate::Yes | Validate::Bisect => spec.presets.len() * n_frames,
            },
            n_frames,
            repeat: spec.repeat,
            skip: spec.skip,
            until: spec.until,
        };
        // Leaves room for the passes of GPU metrics.
        if plan.n_timed_passes() > Timer::MAX_PASSES / 2 {
            let limit = Timer::MAX_PASSES / 2;
            let n_passes = plan.n_timed_passes();
            let message = format!(
                "repeat: {n_passes} timed passes a frame are more than {limit}; ask for fewer presets or repeats"
            );
            return Err(RunError::Input(message));
        }
        Ok(plan)
    }

    /// How many passes of a frame are timed, metrics aside.
    pub fn n_timed_passes(&self) -> u32 {
        let n_passes: usize = self.systems.iter().map(|system| system.passes.len()).sum();
        (self.n_merges() + self.prepared.len() + n_passes) as u32 * self.repeat
    }

    /// The passes that merge samples or layers, before all others.
    pub fn n_merges(&self) -> usize {
        usize::from(self.channels.several.is_some())
    }
}

/// Whether the sequence has what the metrics need beside the reference.
pub fn check_metrics(metrics: &[Metric], sequence: &Sequence) -> Result<(), RunError> {
    for metric in metrics {
        metric
            .check_size(sequence.output_size())
            .map_err(|cause| RunError::Input(format!("metrics: {cause}")))?;
        if metric.needs_motion() && !sequence.available().motion {
            let message = format!("metrics: `{metric}` needs motion, which the sequence does not have");
            return Err(RunError::Input(message));
        }
    }
    Ok(())
}

impl System {
    fn new(wanted: &PresetSpec, sequence: &Sequence, n_frames: usize, skip: Skip) -> Result<Self, SystemError> {
        let recipe = Preset::find(&wanted.preset)?.recipe.with(&wanted.parameters)?;
        recipe.check_gpu()?;
        admits(sequence, &recipe).map_err(|reason| SystemError::Sequence {
            preset: wanted.preset.clone(),
            reason,
        })?;
        Ok(Self {
            preset: wanted.preset.clone(),
            notes: notes(&recipe, sequence, n_frames),
            passes: recipe.passes_skipping(skip, sequence.sizes()),
            channels: recipe
                .required_channels()
                .union(recipe.optional_channels().intersection(sequence.available()))
                .union(Channels {
                    several: sequence.available().several,
                    ..Channels::default()
                }),
            recipe,
        })
    }
}

/// What is wrong with one preset of a run.
#[derive(Debug, thiserror::Error)]
enum SystemError {
    #[error(transparent)]
    Preset(#[from] UnknownPreset),
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    #[error("`{preset}` {reason}")]
    Sequence { preset: String, reason: Unfit },
}

/// Why a recipe cannot run on a sequence: words that follow a preset's name.
#[derive(Debug, thiserror::Error)]
pub enum Unfit {
    /// The sizes do not go together with it.
    #[error(transparent)]
    Sizes(#[from] SizesError),
    /// It would read pixels that are not there.
    #[error("reads every pixel, and the frames are checkerboards")]
    Checkerboard,
    /// It would ignore half of the pixels.
    #[error("fills the gaps of checkerboards, and the frames have none")]
    NoCheckerboard,
    /// An image that it reads is not there.
    #[error("needs {}, which the sequence does not have", .0.join(" and "))]
    Missing(Vec<&'static str>),
}

/// Whether `sequence` has what `recipe` needs.
pub fn admits(sequence: &Sequence, recipe: &Recipe) -> Result<(), Unfit> {
    match (sequence.is_checkerboard(), recipe.fills_checkerboard()) {
        (true, false) => return Err(Unfit::Checkerboard),
        (false, true) => return Err(Unfit::NoCheckerboard),
        _ => recipe.check_sizes(sequence.sizes())?,
    }
    let missing = missing(recipe.required_channels(), sequence.available());
    match missing.is_empty() {
        true => Ok(()),
        false => Err(Unfit::Missing(missing)),
    }
}

fn channels(systems: &[System], metrics: &[Metric]) -> Channels {
    let scored = Channels {
        reference: !metrics.is_empty(),
        motion: metrics.iter().any(|metric| metric.needs_motion()),
        ..Channels::default()
    };
    systems.iter().fold(scored, |all, system| all.union(system.channels))
}

fn missing(required: Channels, available: Channels) -> Vec<&'static str> {
    [
        ("depth", required.depth && !available.depth),
        ("motion", required.motion && !available.motion),
        ("object ids", required.object_id && !available.object_id),
        ("a reactive mask", required.reactive && !available.reactive),
    ]
    .into_iter()
    .filter_map(|(name, is_missing)| is_missing.then_some(name))
    .collect()
}

/// What a reader must know to trust a system's numbers.
fn notes(recipe: &Recipe, sequence: &Sequence, n_frames: usize) -> Vec<String> {
    let mut notes = Vec::new();
    if recipe.source == Source::UnjitteredIfPresent && !sequence.available().unjittered_color && sequence.is_jittered()
    {
        notes.push("the input is jittered: the sequence has no un-jittered colour".to_owned());
    }
    if sequence.manifest().motion.as_ref().is_some_and(|motion| motion.dilated) && recipe.dilation != Dilation::None {
        notes.push("the sequence's motion vectors are dilated already; the recipe dilates them again".to_owned());
    }
    if n_frames <= sequence.warmup_frames() {
        notes.push("nothing is summarised: every frame is warm-up".to_owned());
    }
    if !sequence.available().reference {
        notes.push("no metrics: the sequence has no reference".to_owned());
    }
    notes
}
