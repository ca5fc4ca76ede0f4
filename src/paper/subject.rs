//! A system as an experiment runs it, and what came of it.

use crate::{
    image::Image,
    metrics::Metric,
    run::{
        PresetSpec, RunError,
        report::{FrameReport, PresetReport},
    },
    sequence::frame::Rgb,
    taa::{Preset, Recipe},
};

/// A preset, its overridden parameters, and the name that tables give it.
#[derive(Clone, Debug)]
pub struct Subject {
    pub label: String,
    pub spec: PresetSpec,
    /// Whether what it shows depends on earlier frames.
    pub has_history: bool,
}

impl Subject {
    /// A preset as published, under `label`.
    pub fn new(label: &str, preset: &str) -> Self {
        Self {
            label: label.to_owned(),
            spec: PresetSpec {
                preset: preset.to_owned(),
                parameters: serde_json::Map::new(),
            },
            has_history: true,
        }
    }

    /// With a parameter replaced.
    pub fn with(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.spec.parameters.insert(name.to_owned(), value.into());
        self
    }

    /// Under another name.
    pub fn labelled(self, label: &str) -> Self {
        Self {
            label: label.to_owned(),
            ..self
        }
    }

    /// Which shows each frame by itself.
    pub fn without_history(self) -> Self {
        Self {
            has_history: false,
            ..self
        }
    }

    /// Its parameters in full.
    pub fn recipe(&self) -> Result<Recipe, RunError> {
        let refused = |cause: String| RunError::Input(format!("{}: {cause}", self.spec.preset));
        let preset = Preset::find(&self.spec.preset).map_err(|cause| refused(cause.to_string()))?;
        let recipe = preset.recipe.with(&self.spec.parameters);
        recipe.map_err(|cause| refused(cause.to_string()))
    }
}

/// What a subject made of a sequence.
#[derive(Clone, Debug)]
pub struct Outcome {
    pub label: String,
    pub report: PresetReport,
    /// The frame that was asked for.
    pub picture: Option<Image<Rgb>>,
}

impl Outcome {
    /// A metric in the last frame.
    pub fn last(&self, metric: Metric) -> f64 {
        self.report.frames.last().map_or(f64::NAN, |frame| value(frame, metric))
    }

    /// The mean of a metric's finite frames after warm-up.
    pub fn mean(&self, metric: Metric) -> f64 {
        self.report
            .summary
            .get(metric.id())
            .map_or(f64::NAN, |summary| summary.mean.0)
    }

    /// A metric in each frame after warm-up, with the frame's index.
    pub fn each(&self, metric: Metric) -> Vec<(usize, f64)> {
        let settled = self.report.frames.iter().filter(|frame| !frame.warmup);
        settled.map(|frame| (frame.index, value(frame, metric))).collect()
    }

    /// The median time of a frame's passes after warm-up, milliseconds.
    pub fn time_ms(&self) -> f64 {
        self.report.times_ms.values().map(|time| time.median).sum()
    }
}

fn value(frame: &FrameReport, metric: Metric) -> f64 {
    frame.metrics.get(metric.id()).map_or(f64::NAN, |value| value.0)
}
