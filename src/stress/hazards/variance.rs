//! Boxes: variances that cancel, boxes without extent, rays along their faces, history on their surface.

use super::super::scenario::{Asks, Built, Hazard, Setup, blank, noise};
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};

const EXTENT: Extent = Extent::new(20, 16);

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "variance.cancellation",
        about: "colours of 1e4 that differ by a thousandth: m2/N - μ² loses every digit",
        quick: true,
        build: |setup| {
            painted(setup, |x, y, index, seed| {
                // The nearest f32 neighbours of 1e4 are 0.001 apart.
                let d = ((noise(x, y, seed + index) * 3.0) as i32 - 1) as f32 * 1e-3;
                [1e4 + d, 5e3 + d, 1e4 - d]
            })
        },
    },
    Hazard {
        id: "variance.narrow_box",
        about: "flat but for the last bit of f32, after another flat colour: history goes to the face of a box of no width",
        quick: true,
        build: |setup| {
            let mut scenario = painted(setup, |x, y, index, seed| {
                let last_bit = |value: f32| f32::from_bits(value.to_bits() + (noise(x, y, seed + index) * 2.0) as u32);
                match index % 8 {
                    0..2 => [0.2, 0.4, 0.1],
                    _ => [0.7, 0.5, 0.9].map(last_bit),
                }
            })?;
            scenario.asks = Asks::Digits { ulps: 512.0 };
            Ok(scenario)
        },
    },
    Hazard {
        id: "variance.zero",
        about: "everything flat, another colour every few frames",
        quick: true,
        build: |setup| painted(setup, |_, _, index, _| FLAT[index as usize / 4 % FLAT.len()]),
    },
    Hazard {
        id: "variance.flat_channel",
        about: "red and green are flat but for a rounding of history, blue is noise: a box without extent in two channels",
        quick: true,
        build: |setup| {
            painted(setup, |x, y, index, seed| {
                // The largest channel is flat, so that the tone map leaves green flat, too.
                [0.9, 0.333_3, 0.2 + 0.6 * noise(x, y, seed + index)]
            })
        },
    },
    Hazard {
        id: "variance.outlier",
        about: "one texel in nine is far brighter than the others, another each frame",
        quick: false,
        build: |setup| {
            painted(setup, |x, y, index, _| {
                match (x + index) % 3 == 0 && (y + index / 3) % 3 == 0 {
                    true => [20.0, 0.1, 5.0],
                    false => [0.2, 0.3, 0.25],
                }
            })
        },
    },
    Hazard {
        id: "variance.checker",
        about: "two colours in a checker that swap places every frame",
        quick: false,
        build: |setup| {
            painted(setup, |x, y, index, _| match (x + y + index) % 2 {
                0 => [0.9, 0.1, 0.5],
                _ => [0.1, 0.6, 0.5],
            })
        },
    },
    Hazard {
        id: "variance.box_zero",
        about: "black: luma, box and every divisor that comes of them are 0",
        quick: true,
        build: |setup| {
            painted(setup, |x, _, index, _| match index % 6 == 0 && x == 3 {
                true => [1e-3, 0.0, 0.0],
                false => [0.0; 3],
            })
        },
    },
    Hazard {
        id: "variance.parallel_ray",
        about: "history differs from the current colour in one channel only: the ray of a clip is parallel to four faces",
        quick: false,
        build: |setup| {
            painted(setup, |x, _, index, _| {
                [0.4, 0.2 + 0.1 * (x % 3) as f32 + 0.3 * (index % 2) as f32, 0.4]
            })
        },
    },
    Hazard {
        id: "variance.on_the_box",
        about: "history lies exactly on the box: extremes alternate between neighbours",
        quick: false,
        build: |setup| {
            painted(setup, |x, y, index, _| match (x / 2 + y / 2 + index) % 2 {
                0 => [0.25; 3],
                _ => [0.75; 3],
            })
        },
    },
];

const FLAT: [Rgb; 4] = [[0.25, 0.5, 2.0], [0.0; 3], [65504.0, 0.0, 1.0], [0.1, 0.100_1, 0.099_9]];

fn painted(setup: &Setup<'_>, paint: fn(u32, u32, u32, u32) -> Rgb) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(32, 16), Asks::Agreement, move |index| {
            let mut frame = blank(sizes, index, [0.0; 3]);
            frame.color = Image::from_fn(sizes.render, |x, y| paint(x, y, index as u32, seed));
            frame.albedo = Some(frame.color.clone());
            frame
        }),
    )
}
