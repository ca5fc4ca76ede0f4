//! The same work done otherwise must give the same bits.

use super::super::scenario::{Asks, Built, Hazard, Order, Setup, halton_px, moving, noise};
use crate::image::Extent;

const EXTENT: Extent = Extent::new(37, 23);

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "order.repeat",
        about: "the same job twice, bit for bit",
        quick: true,
        build: |setup| ordered(setup, Order::Repeat),
    },
    Hazard {
        id: "order.threads",
        about: "with one thread of the host and with several, bit for bit, on the adapter and in the twin",
        quick: false,
        build: |setup| ordered(setup, Order::Threads),
    },
    Hazard {
        id: "order.tiles",
        about: "with tiles of other shapes, and so in another order, bit for bit",
        quick: false,
        build: |setup| ordered(setup, Order::Tiles),
    },
    Hazard {
        id: "order.skip",
        about: "with what repeats computed and left out, bit for bit: a scene that stands still, moves and stands still again",
        quick: true,
        build: settling,
    },
];

/// A flat sky above a scene. All rests for eight frames; the sky then has another colour and the camera moves and jitters for
/// four; and all rests again.
fn settling(setup: &Setup<'_>) -> Built {
    let sizes = setup.sizes(Extent::new(70, 77))?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(20, 13), Asks::Order(Order::Skip), move |index| {
            let moves = (8..12).contains(&index);
            let at = [0.7, 0.2].map(|step| step * (index.clamp(7, 11) - 7) as f64);
            let mut frame = moving(sizes, index, seed, at);
            if moves {
                frame.jitter_px = halton_px(index);
                frame.motion_px = frame.motion_px.map(|motion| motion.map(|_| [0.7, 0.2]));
            } else {
                frame.jitter_px = [0.0; 2];
            }
            let width = sizes.render.width as usize;
            let sky = width * (sizes.render.height as usize * 2 / 3);
            let of_sky = if index < 8 { [0.35, 0.5, 0.8] } else { [0.8, 0.4, 0.1] };
            frame.color.pixels_mut()[..sky].fill(of_sky);
            frame
        }),
    )
}

fn ordered(setup: &Setup<'_>, order: Order) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(6, 4), Asks::Order(order), move |index| {
            let mut frame = moving(sizes, index, seed, [0.7 * index as f64, 0.2 * index as f64]);
            frame.jitter_px = halton_px(index);
            frame.motion_px = frame.motion_px.map(|motion| motion.map(|_| [0.7, 0.2]));
            for (i, color) in frame.color.pixels_mut().iter_mut().enumerate() {
                if noise(i as u32, index as u32, seed) < 0.02 {
                    *color = [f32::NAN, f32::INFINITY, 1e5];
                }
            }
            frame
        }),
    )
}
