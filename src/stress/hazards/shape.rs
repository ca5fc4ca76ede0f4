//! Images of odd shapes, and sequences of odd lengths.

use super::super::scenario::{Asks, Built, Hazard, Scenario, Segment, Setup, halton_px, moving};
use crate::{image::Extent, sequence::Sizes};
use std::sync::Arc;

macro_rules! shape {
    ($id:literal, $width:literal by $height:literal, $frames:literal, $quick:literal, $about:literal) => {
        Hazard {
            id: $id,
            about: $about,
            quick: $quick,
            build: |setup| shaped(setup, Extent::new($width, $height), $frames),
        }
    };
}

pub const HAZARDS: &[Hazard] = &[
    shape!("shape.1x1", 1 by 1, 24, true, "one pixel"),
    shape!("shape.1xn", 1 by 67, 24, false, "one column"),
    shape!("shape.nx1", 67 by 1, 24, true, "one row"),
    shape!("shape.2x2", 2 by 2, 24, false, "four pixels"),
    shape!("shape.3x5", 3 by 5, 24, false, "smaller than any window"),
    shape!("shape.61x37", 61 by 37, 6, false, "no multiple of any tile"),
    shape!("shape.64x48", 64 by 48, 6, false, "whole tiles"),
    shape!("shape.8191x3", 8191 by 3, 3, false, "a prime width, three rows"),
    shape!("shape.16384x16", 16384 by 16, 2, false, "as wide as textures get"),
    Hazard {
        id: "shape.resize",
        about: "the size changes in the middle, twice",
        quick: true,
        build: |setup| {
            let (seed, n) = (setup.seed, setup.frames(8, 4));
            let extents = [Extent::new(17, 11), Extent::new(24, 9), Extent::new(17, 11)];
            let segments = extents
                .into_iter()
                .map(|extent| Ok(segment(setup.exactly(extent)?, n, seed)))
                .collect::<Result<_, _>>()?;
            Ok(Scenario {
                segments,
                asks: Asks::Agreement,
            })
        },
    },
    Hazard {
        id: "shape.one_frame",
        about: "a sequence of one frame",
        quick: true,
        build: |setup| shaped(setup, Extent::new(19, 13), 1),
    },
    Hazard {
        id: "shape.always_reset",
        about: "history is dropped before every frame",
        quick: false,
        build: |setup| {
            let mut scenario = shaped(setup, Extent::new(19, 13), 16)?;
            for segment in &mut scenario.segments {
                let frames = Arc::clone(&segment.frames);
                segment.frames = Arc::new(move |index| {
                    let mut frame = frames(index);
                    frame.reset = true;
                    frame
                });
            }
            Ok(scenario)
        },
    },
];

fn shaped(setup: &Setup<'_>, extent: Extent, n_frames: usize) -> Built {
    let sizes = setup.exactly(extent)?;
    let n_frames = if setup.quick { n_frames.min(8) } else { n_frames };
    Ok(Scenario {
        segments: vec![segment(sizes, n_frames, setup.seed)],
        asks: Asks::Agreement,
    })
}

/// A jittered scene that moves, some of it out of the image.
fn segment(sizes: Sizes, n_frames: usize, seed: u32) -> Segment {
    Segment {
        sizes,
        n_frames,
        frames: Arc::new(move |index| {
            let mut frame = moving(sizes, index, seed, [0.375 * index as f64, -0.25 * index as f64]);
            frame.jitter_px = halton_px(index);
            frame.motion_px = frame.motion_px.map(|motion| motion.map(|_| [0.375, -0.25]));
            frame
        }),
        alternates_from: None,
    }
}
