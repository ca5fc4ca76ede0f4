//! Texels that no colour should have, alone, in rows and tiles, everywhere and all the time.

use super::super::scenario::{Asks, Built, Hazard, Setup, blank, middle, still};
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};

const EXTENT: Extent = Extent::new(24, 18);

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "texel.nan",
        about: "one texel is NaN for one frame",
        quick: true,
        build: |setup| one(setup, [f32::NAN; 3]),
    },
    Hazard {
        id: "texel.inf",
        about: "one texel is +Inf for one frame",
        quick: true,
        build: |setup| one(setup, [f32::INFINITY, 1.0, f32::INFINITY]),
    },
    Hazard {
        id: "texel.negative_inf",
        about: "one texel is -Inf for one frame",
        quick: false,
        build: |setup| one(setup, [f32::NEG_INFINITY; 3]),
    },
    Hazard {
        id: "texel.f16_max",
        about: "one texel is 65504, the largest f16, for one frame",
        quick: true,
        build: |setup| one(setup, [65504.0; 3]),
    },
    Hazard {
        id: "texel.1e30",
        about: "one texel is 1e30 for one frame",
        quick: false,
        build: |setup| one(setup, [1e30, 0.5, 1e30]),
    },
    Hazard {
        id: "texel.denormal",
        about: "one texel is denormal, in f32 and in f16, for one frame",
        quick: false,
        build: |setup| one(setup, [1e-40, 3e-8, 6e-5]),
    },
    Hazard {
        id: "texel.negative_zero",
        about: "one texel is -0 for one frame",
        quick: false,
        build: |setup| one(setup, [-0.0; 3]),
    },
    Hazard {
        id: "texel.negative",
        about: "one texel is negative for one frame",
        quick: false,
        build: |setup| one(setup, [-1.0, 0.5, -1e5]),
    },
    Hazard {
        id: "texel.mixed",
        about: "one texel is NaN in red, +Inf in green and fine in blue for one frame",
        quick: false,
        build: |setup| one(setup, [f32::NAN, f32::INFINITY, 0.3]),
    },
    Hazard {
        id: "texel.row",
        about: "a row is NaN for one frame",
        quick: false,
        build: |setup| {
            let extent = setup.size.unwrap_or(EXTENT);
            let y = extent.height / 2;
            area(setup, [[0, y], [extent.width, y + 1]], |_| [f32::NAN; 3])
        },
    },
    Hazard {
        id: "texel.tile",
        about: "a tile of 8×8 is +Inf for one frame",
        quick: false,
        build: |setup| {
            let extent = setup.size.unwrap_or(EXTENT);
            let first = [extent.width / 2, extent.height / 2].map(|at| at.saturating_sub(4));
            let last = [(first[0] + 8).min(extent.width), (first[1] + 8).min(extent.height)];
            area(setup, [first, last], |_| [f32::INFINITY; 3])
        },
    },
    Hazard {
        id: "texel.every",
        about: "every texel is bad for one frame, each in another way",
        quick: true,
        build: |setup| {
            let extent = setup.size.unwrap_or(EXTENT);
            area(setup, [[0, 0], [extent.width, extent.height]], palette)
        },
    },
    Hazard {
        id: "texel.every_frame",
        about: "a tenth of the texels is bad in every frame, others each time",
        quick: true,
        build: |setup| every_frame(setup, 10),
    },
    Hazard {
        id: "texel.moving_edge",
        about: "a border between black and 65504 moves by half a pixel a frame",
        quick: true,
        build: moving_edge,
    },
    Hazard {
        id: "texel.all_the_time",
        about: "every texel is bad in every frame",
        quick: false,
        build: |setup| every_frame(setup, 1),
    },
];

/// A border between black and 65504 that moves by half a pixel a frame: filters with negative lobes leave the range at both sides.
fn moving_edge(setup: &Setup<'_>) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    Ok(
        setup.scenario(sizes, setup.frames(24, 12), Asks::Agreement, move |index| {
            let mut frame = blank(sizes, index, [0.0; 3]);
            let edge = 4.0 + 0.5 * index as f32;
            frame.color = Image::from_fn(sizes.render, |x, _| match (x as f32) < edge {
                true => [65504.0, 65504.0, 60000.0],
                false => [0.0; 3],
            });
            frame.motion_px = Some(Image::filled(sizes.render, [-0.5, 0.0]));
            frame
        }),
    )
}

/// Something bad, by number.
fn palette(n: u32) -> Rgb {
    const BAD: [f32; 8] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -1.0,
        1e30,
        65504.0,
        -0.0,
        1e-40,
    ];
    [0, 3, 5].map(|step| BAD[(n.wrapping_mul(2654435761) >> 16).wrapping_add(step * (n % 3)) as usize % BAD.len()])
}

fn one(setup: &Setup<'_>, color: Rgb) -> Built {
    area(setup, middle(setup.size.unwrap_or(EXTENT)), move |_| color)
}

/// A scene at rest in which the texels of `area` are bad for one frame.
fn area(setup: &Setup<'_>, area: [[u32; 2]; 2], color: impl Fn(u32) -> Rgb + Send + Sync + 'static) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    Ok(setup.recovery(sizes, area, move |frame| {
        for y in area[0][1]..area[1][1] {
            for x in area[0][0]..area[1][0] {
                let i = y * sizes.render.width + x;
                frame.color.pixels_mut()[i as usize] = color(i);
            }
        }
    }))
}

fn every_frame(setup: &Setup<'_>, one_in: u32) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(24, 12), Asks::Agreement, move |index| {
            let mut frame = still(sizes, index, seed);
            for (i, color) in frame.color.pixels_mut().iter_mut().enumerate() {
                let n = (i as u32).wrapping_mul(747_796_405) ^ (index as u32).wrapping_mul(2_891_336_453) ^ seed;
                if (n >> 8).is_multiple_of(one_in) {
                    *color = palette(n >> 4);
                }
            }
            frame
        }),
    )
}
