//! What comes of many frames: drift, decay, averages of very many samples, models without news, flicker.

use super::super::scenario::{
    Asks, Built, Frames, Hazard, NotRun, Scenario, Segment, Setup, blank, halton_px, noise, still,
};
use crate::{
    image::{Extent, Image},
    sequence::{Frame, Sizes},
    taa::recipe::Algorithm,
};
use std::sync::Arc;

/// Small, because what is asked is a matter of frames.
const EXTENT: Extent = Extent::new(8, 8);
const MANY: usize = 100_000;
/// Where what can go wrong does so sooner.
const SOME: usize = 2000;
const MANY_IF_QUICK: usize = 512;

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "feedback.static",
        about: "100 000 frames of a jittered scene at rest: does rounding add up?",
        quick: true,
        build: |setup| {
            endurance(setup, 16, MANY, |sizes, index, seed| {
                let mut frame = still(sizes, index, seed);
                frame.jitter_px = halton_px(index);
                frame
            })
        },
    },
    Hazard {
        id: "feedback.flat",
        about: "2 000 frames of one colour that f16 does not hold exactly",
        quick: false,
        build: |setup| {
            endurance(setup, 2, SOME, |sizes, index, _| {
                blank(sizes, index, [0.333_3, 0.1, 0.7])
            })
        },
    },
    Hazard {
        id: "feedback.no_excitation",
        about: "one colour while one far pixel moves, 100 000 frames: a model learns nothing and must not forget for ever (without a model 2 000)",
        quick: true,
        build: |setup| {
            let has_model = setup.recipe.algorithm == Algorithm::Phlm2016;
            endurance(setup, 2, if has_model { MANY } else { SOME }, |sizes, index, _| {
                let mut frame = blank(sizes, index, [0.5, 0.25, 0.125]);
                if let Some(motion) = &mut frame.motion_px {
                    motion.pixels_mut()[0] = [1e-3, 0.0];
                }
                frame
            })
        },
    },
    Hazard {
        id: "feedback.count_65536",
        about: "a running mean of 65 536 samples: weights of 1/N",
        quick: false,
        build: |setup| {
            if !setup.recipe.weight.counts() {
                return Err(NotRun("the recipe keeps no count of samples".to_owned()));
            }
            endurance(setup, 4, 65_537, |sizes, index, seed| {
                let mut frame = still(sizes, index, seed);
                let brightness = [0.5, 1.0, 0.25, 0.75][index % 4];
                frame.color = frame.color.map(|c| c.map(|c| c * brightness));
                frame
            })
        },
    },
    Hazard {
        id: "feedback.flicker_2",
        about: "brightness that alternates every frame, 2 000 frames",
        quick: false,
        build: |setup| {
            endurance(setup, 2, SOME, |sizes, index, seed| {
                dimmed(sizes, index, seed, index % 2)
            })
        },
    },
    Hazard {
        id: "feedback.flicker_jitter",
        about: "brightness with the period of the jitter, 16 frames, 2 000 of them",
        quick: false,
        build: |setup| {
            endurance(setup, 16, SOME, |sizes, index, seed| {
                let mut frame = dimmed(sizes, index, seed, usize::from(index % 16 < 5));
                frame.jitter_px = halton_px(index);
                frame
            })
        },
    },
    Hazard {
        id: "feedback.decay",
        about: "white, then black for hundreds of frames",
        quick: true,
        build: |setup| steps(setup, [[1.0, 0.5, 4.0], [0.0; 3]]),
    },
    Hazard {
        id: "feedback.rise",
        about: "black, then a colour for hundreds of frames",
        quick: false,
        build: |setup| steps(setup, [[0.0; 3], [0.7, 0.333_3, 9.0]]),
    },
    Hazard {
        id: "feedback.noise",
        about: "white noise: w/(2 - w) of its variance must be left",
        quick: false,
        build: |setup| {
            let sizes = setup.sizes(Extent::new(32, 32))?;
            let seed = setup.seed;
            Ok(setup.scenario(sizes, setup.frames(80, 40), Asks::Noise, move |index| {
                let mut frame = blank(sizes, index, [0.0; 3]);
                frame.color = Image::from_fn(sizes.render, |x, y| {
                    [noise(x, y, seed ^ ((index as u32 + 1) * 7919)); 3]
                });
                frame
            }))
        },
    },
];

fn dimmed(sizes: Sizes, index: usize, seed: u32, is_bright: usize) -> Frame {
    let mut frame = still(sizes, index, seed);
    let brightness = [0.2, 1.0][is_bright];
    frame.color = frame.color.map(|c| c.map(|c| c * brightness));
    frame
}

fn endurance(setup: &Setup<'_>, period: usize, n_frames: usize, paint: fn(Sizes, usize, u32) -> Frame) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    let frames: Frames = Arc::new(move |index| paint(sizes, index, seed));
    Ok(Scenario {
        segments: vec![Segment {
            sizes,
            // At least two whole periods, or nothing would be looked at.
            n_frames: setup.frames(n_frames, MANY_IF_QUICK).max(4 * period + 1),
            frames,
            alternates_from: None,
        }],
        asks: Asks::Endurance { period },
    })
}

/// One colour for four frames, then another.
fn steps(setup: &Setup<'_>, [first, then]: [[f32; 3]; 2]) -> Built {
    const THEN: usize = 4;
    let sizes = setup.sizes(EXTENT)?;
    let mut scenario = setup.scenario(sizes, setup.frames(400, 100), Asks::Agreement, move |index| {
        blank(sizes, index, if index < THEN { first } else { then })
    });
    scenario.segments[0].alternates_from = Some(THEN);
    Ok(scenario)
}
