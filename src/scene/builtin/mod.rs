//! The scenes that come with the harness, each for a weakness of temporal anti-aliasing.

mod atrium;
mod foliage;
mod parts;
mod simple;
mod spaceship;

use super::{BakeError, model::Scene};
use serde::Serialize;

/// A scene by its id.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BuiltIn {
    /// Stored id; never changes.
    pub id: &'static str,
    /// What it hurts.
    pub purpose: &'static str,
    /// What can be told of its frames without looking at them.
    pub known: &'static str,
    /// Builds it from a seed.
    #[serde(skip)]
    pub build: fn(seed: u64) -> Scene,
}

const MOTION: &str = "motion";

/// Every scene.
pub const SCENES: &[BuiltIn] = &[
    BuiltIn {
        id: "atrium",
        purpose: "a hall of columns and railings in sun and shadow: what games look like",
        known: MOTION,
        build: atrium::atrium,
    },
    BuiltIn {
        id: "foliage",
        purpose: "dense alpha-cut leaves in the wind: motion and depth change from pixel to pixel",
        known: MOTION,
        build: foliage::foliage,
    },
    BuiltIn {
        id: "spaceship",
        purpose: "panels and antennae finer than a pixel, a moving lamp, reflections: shading slides over the surface",
        known: MOTION,
        build: spaceship::spaceship,
    },
    BuiltIn {
        id: "sphere",
        purpose: "a ball passes a detailed wall: ghosts behind it, and a crescent without history",
        known: "motion; what the ball uncovers, in closed form",
        build: simple::sphere,
    },
    BuiltIn {
        id: "stochastic_alpha",
        purpose: "coverage by chance: noise that must be averaged and not kept",
        known: MOTION,
        build: simple::stochastic_alpha,
    },
    BuiltIn {
        id: "static",
        purpose: "nothing moves and nothing changes: what is not sharp and still here never will be",
        known: "motion is 0; the reference is the same in every frame but for its noise",
        build: simple::still,
    },
];

/// The scene with this id.
pub fn find(id: &str) -> Result<&'static BuiltIn, BakeError> {
    SCENES
        .iter()
        .find(|scene| scene.id == id)
        .ok_or_else(|| BakeError::UnknownScene {
            wanted: id.to_owned(),
            nearest: SCENES
                .iter()
                .map(|scene| scene.id)
                .max_by(|a, b| strsim::jaro_winkler(id, a).total_cmp(&strsim::jaro_winkler(id, b)))
                .unwrap_or_default(),
        })
}
