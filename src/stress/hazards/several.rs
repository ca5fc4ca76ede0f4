//! Pixels of several samples or layers, some of them bad: what makes them one must let nothing bad through.

use super::super::scenario::{Asks, Built, Hazard, NotRun, Setup, halton_px, moving, noise};
use crate::{
    image::{Extent, Image},
    sequence::{Frame, Merging, Others, frame::Rgb},
};

const EXTENT: Extent = Extent::new(24, 18);
const BAD: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 1e30, 65504.0];

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "several.samples",
        about: "three samples of each pixel, a tenth of them bad in colour, motion or depth, others each frame",
        quick: false,
        build: |setup| merged(setup, Merging::Samples),
    },
    Hazard {
        id: "several.layers",
        about: "three layers of each pixel, a tenth of them bad in colour, opacity, motion or depth, others each frame",
        quick: false,
        build: |setup| merged(setup, Merging::Layers { premultiplied: false }),
    },
];

/// Something bad for one in ten, otherwise `good`.
fn perhaps(good: f32, x: u32, y: u32, seed: u32) -> f32 {
    BAD.get((noise(x, y, seed) * 60.0) as usize).copied().unwrap_or(good)
}

fn merged(setup: &Setup<'_>, merging: Merging) -> Built {
    if setup.recipe.fills_checkerboard() {
        return Err(NotRun(
            "a checkerboard's frames have one colour a pixel, or none".to_owned(),
        ));
    }
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(16, 8), Asks::Agreement, move |index| {
            let mut frame = moving(sizes, index, seed, [0.3 * index as f64, 0.0]);
            frame.jitter_px = halton_px(index);
            frame.motion_px = frame.motion_px.map(|motion| motion.map(|_| [0.3, 0.0]));
            frame.others = Some(others(&frame, merging, seed ^ (index as u32 * 977 + 1)));
            frame
        }),
    )
}

fn others(frame: &Frame, merging: Merging, seed: u32) -> Others {
    let extent = frame.extent();
    let behind = [1, 2];
    let color = |item: u32| {
        Image::from_fn(extent, |x, y| -> Rgb {
            let own = frame.color.at(x, y).map(|c| c * (1.0 - 0.25 * item as f32));
            [0, 1, 2].map(|c| perhaps(own[c], x, y, seed ^ (item * 131 + c as u32)))
        })
    };
    let opacity = |item: u32| {
        Image::from_fn(extent, |x, y| match noise(x, y, seed ^ (item * 137 + 7)) {
            // More than all, less than nothing, and no number.
            n if n < 0.03 => [f32::NAN, -0.5, 1.5][(n * 100.0) as usize % 3],
            n => 0.2 + 0.6 * n,
        })
    };
    let motion = |item: u32| {
        Image::from_fn(extent, |x, y| {
            let own = [0.3 + 0.25 * item as f32, -0.125 * item as f32];
            [0, 1].map(|axis| perhaps(own[axis], x, y, seed ^ (item * 139 + axis as u32 + 11)))
        })
    };
    let depth = |item: u32| {
        Image::from_fn(extent, |x, y| {
            perhaps(5.0 + item as f32, x, y, seed ^ (item * 149 + 17))
        })
    };
    Others {
        merging,
        color: behind.map(color).into(),
        opacity: match merging {
            Merging::Samples => Vec::new(),
            Merging::Layers { .. } => [0, 1, 2].map(opacity).into(),
        },
        motion_px: behind.map(motion).into(),
        depth: behind.map(depth).into(),
    }
}
