//! Motion vectors, depths and whatever else comes with colour, as no engine should write it, and at the edges of what it may.

use super::super::scenario::{Asks, Built, Hazard, NotRun, Setup, halton_px, middle, moving, noise};
use crate::{
    image::{Extent, Image},
    sequence::Frame,
};

const EXTENT: Extent = Extent::new(24, 18);

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        id: "motion.nan",
        about: "one motion vector is NaN for one frame",
        quick: true,
        build: |setup| one_vector(setup, [f32::NAN; 2]),
    },
    Hazard {
        id: "motion.inf",
        about: "one motion vector is infinite for one frame",
        quick: false,
        build: |setup| one_vector(setup, [f32::INFINITY, f32::NEG_INFINITY]),
    },
    Hazard {
        id: "motion.1e6",
        about: "one motion vector is a million pixels long for one frame",
        quick: false,
        build: |setup| one_vector(setup, [1e6, -1e6]),
    },
    Hazard {
        id: "motion.1e30",
        about: "one motion vector is so long that its square overflows, for one frame",
        quick: false,
        build: |setup| one_vector(setup, [1e30, 1e30]),
    },
    Hazard {
        id: "motion.every_frame",
        about: "a fifth of the motion vectors is bad in every frame, others each time",
        quick: false,
        build: |setup| {
            changed(setup, |frame, seed| {
                const BAD: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e6, -1e30, 1e-40];
                let index = frame.index as u32;
                frame.motion_px = frame.motion_px.take().map(|motion| {
                    Image::from_fn(motion.extent(), |x, y| {
                        match (noise(x, y, seed ^ index) * 30.0) as usize {
                            i @ 0..6 => [BAD[i], BAD[(i + x as usize) % 6]],
                            _ => motion.at(x, y),
                        }
                    })
                });
            })
        },
    },
    Hazard {
        id: "motion.texel_edge",
        about: "everything moves by exactly one and by exactly half a pixel, so that positions lie on texel centres and edges",
        quick: true,
        build: |setup| shifts(setup, &[[1.0, 0.0], [0.5, 0.0], [0.0, -0.5], [-1.0, 1.0], [-0.5, -0.5]]),
    },
    Hazard {
        id: "motion.half_way",
        about: "everything moves by a quarter, and by a bit more or less than half a pixel",
        quick: false,
        build: |setup| {
            shifts(
                setup,
                &[[0.25, 0.25], [0.500_000_1, 0.0], [-0.75, 0.499_999_97], [0.0, -0.25]],
            )
        },
    },
    Hazard {
        id: "depth.zero",
        about: "depth is 0 everywhere",
        quick: false,
        build: |setup| depth(setup, |_, _| 0.0),
    },
    Hazard {
        id: "depth.nan",
        about: "depth is NaN in every other texel",
        quick: false,
        build: |setup| depth(setup, |i, z| if i % 2 == 0 { f32::NAN } else { z }),
    },
    Hazard {
        id: "depth.hostile",
        about: "depth is infinite, negative, denormal or as large as f32 can be",
        quick: true,
        build: |setup| {
            depth(setup, |i, z| match i % 5 {
                0 => f32::INFINITY,
                1 => -z,
                2 => 1e-40,
                3 => f32::MAX,
                _ => z,
            })
        },
    },
    Hazard {
        id: "depth.reversed",
        about: "depth is reversed: what is near looks far",
        quick: false,
        build: |setup| depth(setup, |_, z| 1.0 / z),
    },
    Hazard {
        id: "depth.equal",
        about: "depth is equal everywhere, so that every choice of the closest is a tie",
        quick: false,
        build: |setup| depth(setup, |_, _| 5.0),
    },
    Hazard {
        id: "id.all_different",
        about: "every texel is another object, in every frame",
        quick: false,
        build: |setup| {
            changed(setup, |frame, seed| {
                let base = seed.wrapping_add(frame.index as u32 * 100_003);
                frame.object_id = frame
                    .object_id
                    .take()
                    .map(|ids| Image::from_fn(ids.extent(), |x, y| base.wrapping_add(y * 4096 + x)));
            })
        },
    },
    Hazard {
        id: "jitter.edge",
        about: "jitter at the ends of what it may be, ±½ pixel, another corner each frame",
        quick: false,
        build: |setup| {
            changed(setup, |frame, _| {
                const CORNERS: [[f64; 2]; 5] = [[0.5, 0.5], [-0.5, 0.5], [0.0, 0.0], [-0.5, -0.5], [0.5, -0.5]];
                frame.jitter_px = CORNERS[frame.index % CORNERS.len()];
            })
        },
    },
    Hazard {
        id: "albedo.hostile",
        about: "a third of the unlit colour is bad in every frame, others each time",
        quick: false,
        build: |setup| {
            if !setup.recipe.optional_channels().albedo {
                return Err(NotRun("the recipe reads no unlit colour".to_owned()));
            }
            changed(setup, |frame, seed| {
                const BAD: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 1e30, 65504.0];
                let index = frame.index as u32;
                frame.albedo = frame.albedo.take().map(|albedo| {
                    Image::from_fn(albedo.extent(), |x, y| {
                        let pick = |c: usize| BAD.get((noise(x, y, seed ^ (index * 3 + c as u32)) * 54.0) as usize);
                        let own = albedo.at(x, y);
                        [0, 1, 2].map(|c| pick(c).copied().unwrap_or(own[c]))
                    })
                });
            })
        },
    },
    Hazard {
        id: "reactive.hostile",
        about: "a reactive mask that is NaN, infinite, negative or above 1",
        quick: false,
        build: |setup| {
            if !setup.recipe.required_channels().reactive {
                return Err(NotRun(
                    "the recipe reads no reactive mask (`reactive` is off)".to_owned(),
                ));
            }
            changed(setup, |frame, seed| {
                const BAD: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 2.0, 1e-40];
                let index = frame.index as u32;
                frame.reactive = frame.reactive.take().map(|mask| {
                    Image::from_fn(mask.extent(), |x, y| {
                        BAD.get((noise(x, y, seed ^ index) * 12.0) as usize)
                            .copied()
                            .unwrap_or(0.25)
                    })
                });
            })
        },
    },
];

fn one_vector(setup: &Setup<'_>, vector: [f32; 2]) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let area = middle(sizes.render);
    let [x, y] = area[0];
    let at = (y * sizes.render.width + x) as usize;
    Ok(setup.recovery(sizes, area, move |frame| {
        if let Some(motion) = &mut frame.motion_px {
            motion.pixels_mut()[at] = vector;
        }
    }))
}

/// A jittered scene that drifts a little, changed in every frame.
fn changed(setup: &Setup<'_>, change: impl Fn(&mut Frame, u32) + Send + Sync + 'static) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(24, 12), Asks::Agreement, move |index| {
            let mut frame = moving(sizes, index, seed, [0.3 * index as f64, 0.0]);
            frame.jitter_px = halton_px(index);
            // Not alike, so that it matters which vector is chosen.
            frame.motion_px = Some(Image::from_fn(sizes.render, |x, y| {
                [0.3 + (x % 3) as f32, 0.5 * (y % 4) as f32 - 0.75]
            }));
            change(&mut frame, seed);
            frame
        }),
    )
}

fn depth(setup: &Setup<'_>, change: impl Fn(usize, f32) -> f32 + Send + Sync + 'static) -> Built {
    changed(setup, move |frame, _| {
        if let Some(depth) = &mut frame.depth {
            for (i, z) in depth.pixels_mut().iter_mut().enumerate() {
                *z = change(i, *z);
            }
        }
    })
}

/// A scene that moves by each of `steps` in turn.
fn shifts(setup: &Setup<'_>, steps: &'static [[f32; 2]]) -> Built {
    let sizes = setup.sizes(EXTENT)?;
    let seed = setup.seed;
    Ok(
        setup.scenario(sizes, setup.frames(24, 12), Asks::Agreement, move |index| {
            let step = |i: usize| steps[i % steps.len()];
            let mut at = [0.0; 2];
            for i in 1..=index {
                at = [at[0] + f64::from(step(i)[0]), at[1] + f64::from(step(i)[1])];
            }
            let mut frame = moving(sizes, index, seed, at);
            frame.motion_px = frame.motion_px.map(|motion| motion.map(|_| step(index)));
            frame
        }),
    )
}
