//! History that is resampled a thousand times. What moves comes back, so that a small image is enough: each motion is undone
//! by the next.

use super::super::scenario::{Asks, Built, Hazard, NotRun, Setup, blank};
use crate::image::{Extent, Image};

const EXTENT: Extent = Extent::new(14, 14);
const N_FRAMES: usize = 1000;
const N_IF_QUICK: usize = 64;
/// Standard deviation of the dot, input pixels.
const RADIUS: f64 = 1.4;

/// Where the dot lies, input pixels from the middle: off it, so that rotation and zoom move it.
const PLACE: [f64; 2] = [2.0, -1.0];
const GROUND: f64 = 0.05;

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "resampling.half_pixel",
        about: "1 000 shifts by half a pixel, forth and back",
        quick: true,
        build: |setup| {
            dot(
                setup,
                Motion {
                    shift: [0.5, 0.5],
                    ..REST
                },
            )
        },
    },
    Hazard {
        id: "resampling.irrational",
        about: "1 000 shifts by irrational parts of a pixel, forth and back",
        quick: false,
        build: |setup| {
            let shift = [std::f64::consts::FRAC_1_SQRT_2 * 0.5, 0.618_033_988_749_894_9];
            dot(setup, Motion { shift, ..REST })
        },
    },
    Hazard {
        id: "resampling.rotation",
        about: "1 000 rotations by a tenth of a radian, forth and back",
        quick: false,
        build: |setup| {
            dot(
                setup,
                Motion {
                    turn: [0.0, 0.1],
                    ..REST
                },
            )
        },
    },
    Hazard {
        id: "resampling.zoom",
        about: "1 000 zooms by 5 %, in and out",
        quick: false,
        build: |setup| {
            dot(
                setup,
                Motion {
                    turn: [0.05, 0.0],
                    ..REST
                },
            )
        },
    },
];

/// How everything moves, forth and back by turns: from (1 - c/2) u - s/2 to (1 + c/2) u + s/2, places as complex numbers.
#[derive(Clone, Copy)]
struct Motion {
    shift: [f64; 2],
    turn: [f64; 2],
}

const REST: Motion = Motion {
    shift: [0.0; 2],
    turn: [0.0; 2],
};

fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn over(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let square = b[0] * b[0] + b[1] * b[1];
    times(a, [b[0] / square, -b[1] / square])
}

impl Motion {
    /// Which point of the scene is seen at `p`, on a side: -½ or ½.
    fn scene_at(self, p: [f64; 2], side: f64) -> [f64; 2] {
        let moved = [0, 1].map(|axis| p[axis] - side * self.shift[axis]);
        over(moved, [1.0 + side * self.turn[0], side * self.turn[1]])
    }

    /// Where a point of the scene is seen.
    fn seen_at(self, u: [f64; 2], side: f64) -> [f64; 2] {
        let turned = times(u, [1.0 + side * self.turn[0], side * self.turn[1]]);
        [0, 1].map(|axis| turned[axis] + side * self.shift[axis])
    }
}

/// A dot on a dim ground that everything moves with.
fn dot(setup: &Setup<'_>, motion: Motion) -> Built {
    if !setup.recipe.reproject {
        return Err(NotRun("the recipe does not follow motion".to_owned()));
    }
    let sizes = setup.sizes(EXTENT)?;
    let n_frames = setup.frames(N_FRAMES, N_IF_QUICK);
    let middle = [sizes.render.width, sizes.render.height].map(|side| f64::from(side) * 0.5);
    let asks = Asks::Dot { ground: GROUND };
    let mut scenario = setup.scenario(sizes, n_frames, asks, move |index| {
        let mut frame = blank(sizes, index, [0.0; 3]);
        let from_middle = |x: u32, y: u32| [f64::from(x) + 0.5 - middle[0], f64::from(y) + 0.5 - middle[1]];
        let side = if index % 2 == 0 { 0.5 } else { -0.5 };
        frame.color = Image::from_fn(sizes.render, |x, y| {
            let u = motion.scene_at(from_middle(x, y), side);
            let [dx, dy] = [u[0] - PLACE[0], u[1] - PLACE[1]];
            let value = libm::exp(-(dx * dx + dy * dy) / (2.0 * RADIUS * RADIUS));
            [0.8, 0.4, 0.2].map(|c| (GROUND + c * value) as f32)
        });
        frame.motion_px = Some(Image::from_fn(sizes.render, |x, y| {
            let p = from_middle(x, y);
            let before = motion.seen_at(motion.scene_at(p, side), -side);
            [0, 1].map(|axis| (before[axis] - p[axis]) as f32)
        }));
        frame
    });
    scenario.segments[0].alternates_from = Some(0);
    Ok(scenario)
}
