//! Temporal resolve: recipes, presets, the GPU resolver, and under `reference` its plain CPU twin.
//!
//! A [`Recipe`] names every block of the pipeline; a [`Preset`] is a published system's recipe. [`Inputs`] holds a
//! frame on the device, shared by all recipes of a run; a [`Resolver`] holds one recipe's passes and history.
//! Knows images, frames and the GPU; nothing of metrics, reports or the service.

mod carried;
mod changes;
mod checkerboard;
mod fault;
mod inputs;
mod merge;
mod phlm2016;
mod preset;
pub mod recipe;
mod recorder;
pub mod reference;
mod resolver;
mod skip;
mod smaa_area;
mod sobel2018;
mod spatial;
mod temporal;
mod tiles;
pub mod validation;

pub use changes::TILE;
pub use fault::Fault;
pub use inputs::Inputs;
pub use preset::{PRESETS, Preset, UnknownPreset};
pub use recipe::{Recipe, RecipeError, SizesError};
pub use recorder::{Recorder, Repeat, Step, Watch};
pub use resolver::Resolver;
pub use skip::Skip;
pub use sobel2018::EDGES_PASS;
pub use tiles::{Kept, SETTLE_PASS, Shares};

use crate::sequence::Channels;
use carried::Carried;
use recipe::{Algorithm, Dilation, Domain, Guards, HistoryFilter, Neighbourhood, Weight};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How history is stored between frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 16-bit float, as engines do.
    #[default]
    F16,
    /// 32-bit float.
    F32,
}

/// How a recipe is run, apart from what it computes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// How history is stored.
    pub precision: Precision,
    /// Which work may be left out.
    pub skip: Skip,
}

impl From<Precision> for Options {
    fn from(precision: Precision) -> Self {
        Self {
            precision,
            ..Self::default()
        }
    }
}

impl Precision {
    /// Its name in JSON.
    pub const fn id(self) -> &'static str {
        match self {
            Self::F16 => "f16",
            Self::F32 => "f32",
        }
    }
}

/// Which colour a recipe resolves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The frame's colour.
    Color,
    /// The un-jittered colour where the sequence has one, else the frame's colour.
    UnjitteredIfPresent,
}

/// A colour as recipes resolve it: repaired, in their working domain. Recipes that agree share it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Preparation {
    /// Which colour.
    pub source: Source,
    /// In which domain.
    pub domain: Domain,
    /// With the albedo, where the sequence has one.
    pub albedo: bool,
    /// Hostile texels repaired, or left as they are.
    pub guards: Guards,
}

impl Recipe {
    /// The colour it resolves.
    pub fn preparation(&self) -> Preparation {
        Preparation {
            source: self.source,
            domain: self.domain,
            albedo: self.optional_channels().albedo,
            guards: self.guards,
        }
    }

    /// The images a frame must have for this recipe.
    pub fn required_channels(&self) -> Channels {
        let uses_history = self.uses_history();
        let uses_motion = uses_history && self.reproject || self.motion_blur;
        Channels {
            motion: uses_motion,
            depth: uses_motion && (self.dilation == Dilation::Closest || self.reject_depth) || self.finds_edges(),
            object_id: uses_history && self.reject_id,
            reactive: uses_history && self.reactive,
            ..Channels::default()
        }
    }

    /// Whether it makes whole images of frames that shade every other pixel; other recipes need every pixel.
    pub fn fills_checkerboard(&self) -> bool {
        self.algorithm == Algorithm::Checkerboard
    }

    /// Whether what it shows is a blend of history and the current colour by a weight, so that a pixel has a share of history.
    pub fn blends_history(&self) -> bool {
        self.algorithm == Algorithm::Temporal && self.uses_history()
    }

    fn uses_history(&self) -> bool {
        self.history_filter != HistoryFilter::None
    }

    /// Whether its box depends on the frame's edges.
    fn finds_edges(&self) -> bool {
        self.blends_history() && self.neighbourhood == Neighbourhood::Sobel
    }

    /// Whether its weight depends on how far history is from the current colour around a pixel.
    fn finds_differences(&self) -> bool {
        self.uses_history() && self.weight == Weight::Amortized
    }

    /// Whether the depth of the frame before tells it anything.
    fn reads_previous_depth(&self) -> bool {
        self.uses_history() && self.reject_depth || self.finds_edges()
    }

    /// How its history is stored where the job asks for `precision`.
    pub fn precision(&self, precision: Precision) -> Precision {
        if self.history_always_f32 {
            Precision::F32
        } else {
            precision
        }
    }

    /// The images it makes use of where a sequence has them.
    pub fn optional_channels(&self) -> Channels {
        Channels {
            albedo: self.finds_edges(),
            object_id: self.finds_edges(),
            unjittered_color: self.source == Source::UnjitteredIfPresent,
            ..Channels::default()
        }
    }
}
