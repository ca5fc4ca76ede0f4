//! Depth against cameras: how a resting surface moves in the image follows from both.

use super::{Depths, decoder};
use crate::sequence::{
    SequenceError,
    check::{
        Belief,
        report::{Finding, Report},
    },
    convention::Projector,
    frame::SKY_DEPTH,
    manifest::{Camera, DepthKind, DepthSource, FarPlane},
};
use glam::DVec2;
use serde_json::{Value, json};

const MIN_PARALLAX_PIXELS: usize = 150;

/// Another reading of depth.
pub struct Reading {
    pub source: DepthSource,
    pub says: String,
    pub suggestions: Vec<(&'static str, Value)>,
}

/// Vectors and the camera's own motion, of pixels whose motion tells their depth.
struct Parallax {
    pair: usize,
    i: usize,
    motion: DVec2,
}

/// Holds depth and cameras against the vectors, or against the images where vectors are made of them.
pub fn examine(
    belief: &mut Belief,
    report: &mut Report,
    declared: &DepthSource,
    depths: &[Depths],
) -> Result<(), SequenceError> {
    let motion = belief.manifest().motion.as_ref();
    if motion.is_some_and(|motion| motion.invalid_value.is_some()) {
        return super::derived::examine(belief, report, declared, depths);
    }
    if belief.sequence.projectors.is_empty() || motion.is_none() {
        report.cannot_tell("depth.kind", "there are no cameras and vectors to hold it against");
        return Ok(());
    }
    let parallax = parallax(belief, &belief.sequence.projectors, declared, depths);
    if parallax.len() < MIN_PARALLAX_PIXELS {
        report.cannot_tell(
            "depth.kind",
            "the camera does not move enough for depth to be seen in the motion",
        );
        return Ok(());
    }
    against_vectors(belief, report, declared, depths, &parallax);
    Ok(())
}

fn against_vectors(
    belief: &mut Belief,
    report: &mut Report,
    declared: &DepthSource,
    depths: &[Depths],
    parallax: &[Parallax],
) {
    let readings = readings(belief, declared);
    let share = |source: &DepthSource| agreement(belief, &belief.sequence.projectors, source, depths, parallax);
    let shares: Vec<f64> = readings.iter().map(|reading| share(&reading.source)).collect();
    let best = (0..shares.len())
        .max_by(|&a, &b| shares[a].total_cmp(&shares[b]).then(b.cmp(&a)))
        .unwrap_or(0);
    if shares[0] >= 0.5 || shares[0] >= 0.8 * shares[best] && shares[0] > 0.3 {
        if shares[1..].iter().all(|other| *other < 0.7 * shares[0]) {
            report.confirm("depth.kind");
        } else {
            report.cannot_tell("depth.kind", "another reading fits the cameras' motion as well");
        }
        return;
    }
    if shares[best] < 0.4 || shares[best] <= 2.0 * shares[0] {
        wrong_camera(belief, report, declared, depths, shares[0]);
        return;
    }
    let reading = &readings[best];
    let message = format!(
        "depth {}: the cameras' motion explains {:.0} % of the moving pixels declared, {:.0} % corrected",
        reading.says,
        100.0 * shares[0],
        100.0 * shares[best]
    );
    let id = reading.suggestions.first().map_or("depth.kind", |(field, _)| field);
    let mut finding = Finding::warning(id, message)
        .with("explained_declared", shares[0])
        .with("explained_corrected", shares[best]);
    for (field, value) in &reading.suggestions {
        finding = finding.suggest(*field, value.clone());
    }
    report.findings.push(finding);
    let source = reading.source.clone();
    belief.change(|manifest| manifest.depth = Some(source));
}

/// Pixels that the vectors move otherwise than the camera moves what is infinitely far.
fn parallax(belief: &Belief, projectors: &[Projector], source: &DepthSource, depths: &[Depths]) -> Vec<Parallax> {
    let mut found = Vec::new();
    for (pair, depth) in depths.iter().enumerate() {
        let Some(motion) = &depth.motion else { continue };
        let (current, previous) = (&projectors[depth.index], &projectors[depth.index - 1]);
        let decoder = decoder(belief, source, depth.index);
        for i in (0..motion.len()).step_by(3) {
            let vector = DVec2::from_array(motion[i]);
            let far = current.motion_px(previous, depth.sample(i), f64::from(SKY_DEPTH));
            let is_sky = decoder.decode(depth.stored[i], depth.sample(i)) >= SKY_DEPTH;
            if !is_sky && (vector - far).length() > 0.4 {
                found.push(Parallax {
                    pair,
                    i,
                    motion: vector,
                });
            }
        }
    }
    found
}

/// Share of these pixels whose vector is the camera's motion at the depth read.
fn agreement(
    belief: &Belief,
    projectors: &[Projector],
    source: &DepthSource,
    depths: &[Depths],
    parallax: &[Parallax],
) -> f64 {
    let agreeing = parallax.iter().filter(|pixel| {
        let depth = &depths[pixel.pair];
        let z = decoder(belief, source, depth.index).decode(depth.stored[pixel.i], depth.sample(pixel.i));
        let (current, previous) = (&projectors[depth.index], &projectors[depth.index - 1]);
        let derived = current.motion_px(previous, depth.sample(pixel.i), f64::from(z));
        (derived - pixel.motion).length() < 0.04 + 0.01 * pixel.motion.length()
    });
    agreeing.count() as f64 / parallax.len().max(1) as f64
}

pub fn readings(belief: &Belief, declared: &DepthSource) -> Vec<Reading> {
    let mut all = vec![Reading {
        source: declared.clone(),
        says: String::new(),
        suggestions: Vec::new(),
    }];
    let mut add = |says: String, suggestions: Vec<(&'static str, Value)>, edit: &dyn Fn(&mut DepthSource)| {
        let mut source = declared.clone();
        edit(&mut source);
        all.push(Reading {
            source,
            says,
            suggestions,
        });
    };
    for (kind, name) in [
        (DepthKind::LinearViewZ, "linear_view_z"),
        (DepthKind::RayDistance, "ray_distance"),
    ] {
        if declared.kind != kind {
            add(
                format!("looks like {name}"),
                vec![("depth.kind", json!(name))],
                &|source| {
                    (source.kind, source.reversed) = (kind, false);
                },
            );
        }
    }
    let far = belief.manifest().frames[0].far(Some(declared));
    let far_name = |far: FarPlane| match far {
        FarPlane::At(far) => json!(far),
        _ => json!("inf"),
    };
    for reversed in [false, true] {
        for plane in [far, FarPlane::Infinite] {
            let is_declared = declared.kind == DepthKind::Device && declared.reversed == reversed && plane == far;
            if is_declared
                || (plane == FarPlane::Infinite
                    && far != FarPlane::At(0.0)
                    && far == FarPlane::Infinite
                    && plane != far)
            {
                continue;
            }
            let mut suggestions = Vec::new();
            if declared.kind != DepthKind::Device {
                suggestions.push(("depth.kind", json!("device")));
            }
            if declared.reversed != reversed {
                suggestions.push(("depth.reversed", json!(reversed)));
            }
            if plane != far {
                suggestions.push(("depth.far", far_name(plane)));
            }
            let says = format!(
                "looks like {}device depth{}",
                if reversed { "reversed " } else { "" },
                if plane == far { "" } else { " without a far plane" }
            );
            add(says, suggestions, &|source| {
                (source.kind, source.reversed, source.far) = (DepthKind::Device, reversed, plane);
            });
        }
    }
    // A wrong unit or near plane scales what comes out.
    for step in -40..=40 {
        let factor = libm::pow(10.0, f64::from(step) / 20.0);
        if step == 0 {
            continue;
        }
        if declared.kind == DepthKind::Device {
            let Some(near) = belief.manifest().frames[0].near(declared) else {
                continue;
            };
            add(
                format!("looks {factor:.2} times as far"),
                vec![("depth.near", json!(near * factor))],
                &|source| {
                    source.near = Some(near * factor);
                },
            );
        } else {
            add(
                format!("looks {factor:.2} times as far"),
                vec![("depth.scale", json!(declared.scale * factor))],
                &|source| {
                    source.scale *= factor;
                    source.bias *= factor;
                },
            );
        }
    }
    all
}

/// A mistake in a camera's matrices: which matrix, what it is, what it should be, and the change that makes it so.
pub type CameraMistake = (&'static str, &'static str, &'static str, fn(&mut Camera));

pub fn camera_mistakes() -> [CameraMistake; 5] {
    fn transposed(m: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
        std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
    }
    fn inverted(m: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
        glam::DMat4::from_cols_array_2d(&m).inverse().to_cols_array_2d()
    }
    [
        ("view", "is transposed", "its transpose", |camera| {
            camera.view = transposed(camera.view)
        }),
        ("view", "is view to world", "its inverse", |camera| {
            camera.view = inverted(camera.view)
        }),
        (
            "view",
            "is view to world, transposed",
            "the inverse of its transpose",
            |camera| {
                camera.view = inverted(transposed(camera.view));
            },
        ),
        ("projection", "has y flipped", "with its second row negated", |camera| {
            camera.projection[1] = camera.projection[1].map(|value| -value);
        }),
        ("projection", "is transposed", "its transpose", |camera| {
            camera.projection = transposed(camera.projection)
        }),
    ]
}

/// Every frame's camera, changed; none where that is no camera.
pub fn changed_cameras(belief: &Belief, edit: fn(&mut Camera)) -> Option<Vec<Projector>> {
    let manifest = belief.manifest();
    let changed = manifest.frames.iter().map(|entry| {
        let mut camera = entry.camera.clone()?;
        edit(&mut camera);
        Projector::new(&camera, manifest.render_size)
    });
    changed.collect()
}

/// Which other camera would explain the motion, if any does.
fn wrong_camera(belief: &Belief, report: &mut Report, declared: &DepthSource, depths: &[Depths], declared_share: f64) {
    let best = camera_mistakes()
        .into_iter()
        .filter_map(|(matrix, says, value, edit)| {
            let projectors = changed_cameras(belief, edit)?;
            let parallax = parallax(belief, &projectors, declared, depths);
            (parallax.len() >= MIN_PARALLAX_PIXELS).then(|| {
                (
                    agreement(belief, &projectors, declared, depths, &parallax),
                    matrix,
                    says,
                    value,
                )
            })
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((share, matrix, says, value)) if share > 0.5 && share > 2.0 * declared_share => {
            let message = format!(
                "the cameras' {matrix} {says}: it explains {:.0} % of the moving pixels declared, {:.0} % corrected",
                100.0 * declared_share,
                100.0 * share
            );
            report.findings.push(
                Finding::warning("camera", message)
                    .with("explained_declared", declared_share)
                    .with("explained_corrected", share)
                    .suggest(format!("frames[].camera.{matrix}"), value),
            );
        }
        _ => report.cannot_tell(
            "depth.kind",
            format!("depth and cameras explain the vectors of {:.0} % of the moving pixels, and no other reading explains more", 100.0 * declared_share),
        ),
    }
}
