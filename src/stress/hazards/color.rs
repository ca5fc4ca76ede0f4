//! Colours at the ends of what domains, spaces and weights can hold.

use super::super::scenario::{Asks, Built, Hazard, Setup, blank};
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "color.tonemap",
        about: "the tone map and its inverse at 0, just below 1, at 2047 and at 65504",
        quick: true,
        build: |setup| {
            const VALUES: [f32; 8] = [0.0, 1e-7, 0.999_999_94, 1.0, 2046.0, 2047.0, 2048.0, 65504.0];
            patches(setup, |n| {
                let v = VALUES[n as usize % 8];
                [[v; 3], [v, 0.0, 0.0], [v, v * 0.5, 0.0]][n as usize / 8 % 3]
            })
        },
    },
    Hazard {
        id: "color.ycocg_grid",
        about: "values of f16 from 0 to 65504 in order: YCoCg forth and back at every magnitude",
        quick: false,
        build: |setup| {
            let sizes = setup.sizes(Extent::new(62, 32))?;
            let n = sizes.render.n_pixels() as u32;
            Ok(
                setup.scenario(sizes, setup.frames(6, 4), Asks::Agreement, move |index| {
                    let mut frame = blank(sizes, index, [0.0; 3]);
                    let width = sizes.render.width;
                    frame.color = Image::from_fn(sizes.render, |x, y| {
                        // Along rows by turns, so that neighbours are alike.
                        let x = if y % 2 == 0 { x } else { width - 1 - x };
                        // Bits of positive finite f16: 0 to 0x7bff.
                        let bits = (u64::from(y * width + x) * 0x7bff / u64::from(n.max(2) - 1)) as u16;
                        let v = half::f16::from_bits(bits).to_f32();
                        [v, v * 0.5, v * 0.25]
                    });
                    frame
                }),
            )
        },
    },
    Hazard {
        id: "color.luma_zero",
        about: "black beside saturated blue: luma weights and luma differences at 0",
        quick: true,
        build: |setup| {
            patches(setup, |n| match n % 4 {
                0 => [0.0; 3],
                1 => [0.0, 0.0, 1e-3],
                2 => [0.0, 0.0, 1.0],
                _ => [1e-6, 0.0, 0.0],
            })
        },
    },
    Hazard {
        id: "color.srgb_knee",
        about: "linear values on both sides of the knee of sRGB, 0.0031308",
        quick: false,
        build: |setup| {
            patches(setup, |n| {
                let knee = 0.003_130_8_f32;
                let bits = knee.to_bits() - 8 + n % 17;
                [f32::from_bits(bits), knee * (0.5 + n as f32 * 0.02), knee]
            })
        },
    },
];

/// Patches of 3×3 texels, each of a colour of its own, that move to the next place every fourth frame.
fn patches(setup: &Setup<'_>, color: fn(u32) -> Rgb) -> Built {
    let sizes = setup.sizes(Extent::new(24, 18))?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(24, 12), Asks::Agreement, move |index| {
            let mut frame = blank(sizes, index, [0.0; 3]);
            let turn = seed % 8 + index as u32 / 4;
            frame.color = Image::from_fn(sizes.render, |x, y| color(x / 3 + y / 3 * 8 + turn));
            frame.albedo = Some(frame.color.clone());
            frame
        }),
    )
}
