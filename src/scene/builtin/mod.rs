//! The scenes that come with the harness, each for a weakness of temporal anti-aliasing.

mod atrium;
mod detail;
mod edges;
mod foliage;
mod font;
mod hair;
mod light;
mod parts;
mod simple;
mod spaceship;

use super::{BakeError, model::Scene};
use glam::DVec3;
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

/// Every scene.
pub const SCENES: &[BuiltIn] = &[
    BuiltIn {
        id: "pipe",
        purpose: "white pipes down to a fraction of a pixel before a dark wall, upright: long edges that creep sideways",
        known: "motion; every edge is a straight column",
        build: edges::pipe,
    },
    BuiltIn {
        id: "pipe_tilted",
        purpose: "the same pipes leaning by 5 degrees: stairs of eleven pixels that must become a line",
        known: "motion; every edge is a straight line",
        build: edges::pipe_tilted,
    },
    BuiltIn {
        id: "blinds",
        purpose: "a window with blinds against a bright sky: parallel edges closer than two pixels",
        known: "motion",
        build: edges::blinds,
    },
    BuiltIn {
        id: "arched_window",
        purpose: "an arched window with leads and rings: edges of every slope, bright outside and dark within",
        known: "motion",
        build: edges::arched_window,
    },
    BuiltIn {
        id: "text",
        purpose: "a wall of text from large to illegible: sharpness, and letters that blur while the camera slides",
        known: "motion",
        build: detail::text,
    },
    BuiltIn {
        id: "atrium",
        purpose: "a hall of columns and railings in sun and shadow: what games look like",
        known: "motion",
        build: atrium::atrium,
    },
    BuiltIn {
        id: "flowers",
        purpose: "a meadow of alpha-cut flowers that sway: holes whose rims no vector follows",
        known: "motion",
        build: detail::flowers,
    },
    BuiltIn {
        id: "far_edges",
        purpose: "a town at the horizon: every edge is far away, depth tells little, and parallax is below a pixel",
        known: "motion",
        build: edges::far_edges,
    },
    BuiltIn {
        id: "sphere",
        purpose: "a ball passes a detailed wall: ghosts behind it, and a crescent without history",
        known: "motion; what the ball uncovers, in closed form",
        build: simple::sphere,
    },
    BuiltIn {
        id: "hairball",
        purpose: "a ball of hair, lit: neighbourhoods in which no two texels agree",
        known: "motion is 0",
        build: hair::still,
    },
    BuiltIn {
        id: "hairball_rotating",
        purpose: "the same, turning: no texel keeps its strand",
        known: "motion",
        build: hair::rotating,
    },
    BuiltIn {
        id: "hairball_silhouette",
        purpose: "black hair before a white sky: coverage is all there is",
        known: "motion is 0; colour is coverage",
        build: hair::silhouette,
    },
    BuiltIn {
        id: "hairball_silhouette_rotating",
        purpose: "the same, turning",
        known: "motion; colour is coverage",
        build: hair::silhouette_rotating,
    },
    BuiltIn {
        id: "foliage",
        purpose: "dense alpha-cut leaves in the wind: motion and depth change from pixel to pixel",
        known: "motion",
        build: foliage::foliage,
    },
    BuiltIn {
        id: "spaceship",
        purpose: "panels and antennae finer than a pixel, a moving lamp, reflections: shading slides over the surface",
        known: "motion",
        build: spaceship::spaceship,
    },
    BuiltIn {
        id: "balcony",
        purpose: "balconies with railings, chairs of slats, stripes and herringbone: high frequencies in shape and texture",
        known: "motion",
        build: edges::balcony,
    },
    BuiltIn {
        id: "fence",
        purpose: "chain-link, wires and a spoked wheel that turns: sub-pixel lines over a moving background",
        known: "motion",
        build: edges::fence,
    },
    BuiltIn {
        id: "checker",
        purpose: "an unfiltered checkerboard to the horizon: moiré that the average must turn to grey",
        known: "motion; colour and reference of every pixel, in closed form",
        build: edges::checker,
    },
    BuiltIn {
        id: "stochastic_alpha",
        purpose: "coverage by chance: noise that must be averaged and not kept",
        known: "motion; the mean is the blend",
        build: simple::stochastic_alpha,
    },
    BuiltIn {
        id: "particles",
        purpose: "smoke, sparks and a pane that leave no motion vectors: only the reactive mask knows them",
        known: "motion of what lies behind",
        build: light::particles,
    },
    BuiltIn {
        id: "flicker",
        purpose: "a bad tube and a candle: shading changes while nothing moves",
        known: "motion is 0",
        build: light::flicker,
    },
    BuiltIn {
        id: "zoom",
        purpose: "the lens closes by 3 % a frame on fine print: history is magnified again and again",
        known: "motion",
        build: detail::zoom,
    },
    BuiltIn {
        id: "cut",
        purpose: "the camera cuts at frame 8: nothing of the hall before may be seen in the one after",
        known: "motion; history is void at frame 8",
        build: atrium::cut,
    },
    BuiltIn {
        id: "pan",
        purpose: "the camera turns by 50 pixels a frame: vectors longer than any neighbourhood",
        known: "motion",
        build: atrium::pan,
    },
    BuiltIn {
        id: "fireflies",
        purpose: "specks smaller than a pixel and up to 3000 times as bright as white, tubes, a mirror ball",
        known: "motion",
        build: light::fireflies,
    },
    BuiltIn {
        id: "static",
        purpose: "nothing moves and nothing changes: what is not sharp and still here never will be",
        known: "motion is 0; the reference is the same in every frame but for its noise",
        build: simple::still,
    },
];

/// Middle of the ball of `sphere` by time.
pub fn sphere_center(time: f64) -> DVec3 {
    simple::sphere_center(time)
}

/// Its radius.
pub fn sphere_radius() -> f64 {
    simple::SPHERE_RADIUS
}

/// Colour of the floor of `checker` at a point on it: each channel's.
pub fn checker_color(on_floor: DVec3) -> f32 {
    edges::checker_color(on_floor)
}

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
