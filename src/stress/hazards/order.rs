//! The same work done otherwise must give the same bits. Skipping tiles will belong here: on and off, as `Order::Tiles` does
//! with their shape.

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
];

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
