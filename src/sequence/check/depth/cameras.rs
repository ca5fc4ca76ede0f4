//! Depth against cameras: how a resting surface moves in the image follows from both.

use super::{
    Depths, decoder,
    mistakes::{believe, mistakes},
    readings::{Seen, fitted, kinds},
};
use crate::sequence::{
    SequenceError,
    check::{
        Belief,
        report::{Finding, Report},
    },
    convention::Projector,
    frame::SKY_DEPTH,
    manifest::{DepthKind, DepthSource},
};
use glam::DVec2;

/// Pixels that must speak before anything is said.
const MIN_PIXELS: usize = 150;
/// A difference of motion, in pixels, that is one.
const MOVES: f64 = 0.4;
/// What the camera explains the vectors of, where it is right: the rest moves by itself.
const EXPLAINS: f64 = 0.5;

/// A pixel that moves, by its vector.
#[derive(Clone, Copy)]
struct Moving {
    pair: usize,
    i: usize,
    motion: DVec2,
    /// Whether the camera moves otherwise what is infinitely far, so that the vector tells a depth.
    has_parallax: bool,
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
    let moving = moving(belief, declared, depths);
    let parallax: Vec<Moving> = moving.iter().copied().filter(|pixel| pixel.has_parallax).collect();
    let share = agreement(belief, &belief.sequence.projectors, declared, depths, &moving);
    if moving.len() >= MIN_PIXELS && share >= EXPLAINS {
        report.confirm("camera");
    }
    if parallax.len() >= MIN_PIXELS && against_vectors(belief, report, declared, depths, &parallax) {
        return Ok(());
    }
    if moving.len() >= MIN_PIXELS && share < EXPLAINS {
        wrong_camera(belief, report, declared, depths, &moving, share);
    } else {
        report.cannot_tell(
            "depth.kind",
            "the camera does not move enough for depth to be seen in the motion",
        );
    }
    Ok(())
}

/// Which reading of depth explains the vectors. Gives whether one does.
fn against_vectors(
    belief: &mut Belief,
    report: &mut Report,
    declared: &DepthSource,
    depths: &[Depths],
    parallax: &[Moving],
) -> bool {
    let mut readings = kinds(belief, declared);
    readings.extend(fitted(declared, &seen(belief, declared, depths, parallax)));
    let share = |source: &DepthSource| agreement(belief, &belief.sequence.projectors, source, depths, parallax);
    let shares: Vec<f64> = readings.iter().map(|reading| share(&reading.source)).collect();
    let most = shares.iter().copied().fold(0.0, f64::max);
    if shares[0] >= EXPLAINS || shares[0] >= 0.8 * most && shares[0] > 0.3 {
        // What is fitted to the vectors comes close to the declared wherever that is right.
        let others = readings
            .iter()
            .zip(&shares)
            .skip(1)
            .filter(|(reading, _)| !reading.is_fitted);
        if others.map(|(_, share)| *share).all(|other| other < 0.7 * shares[0]) {
            report.confirm("depth.kind");
        } else {
            report.cannot_tell("depth.kind", "another reading fits the cameras' motion as well");
        }
        return true;
    }
    if most < 0.4 || most <= 2.0 * shares[0] {
        return false;
    }
    // Of those that explain as much, the one with the fewest changes; what comes first in the list is likelier.
    let best = (0..shares.len())
        .filter(|&index| shares[index] >= most - 0.02)
        .min_by_key(|&index| readings[index].suggestions.len())
        .unwrap_or(0);
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
    true
}

/// Pixels that are no sky and move, by their vectors.
fn moving(belief: &Belief, source: &DepthSource, depths: &[Depths]) -> Vec<Moving> {
    let projectors = &belief.sequence.projectors;
    let mut found = Vec::new();
    for (pair, depth) in depths.iter().enumerate() {
        let Some(motion) = &depth.motion else { continue };
        let (current, previous) = (&projectors[depth.index], &projectors[depth.index - 1]);
        let decoder = decoder(belief, source, depth.index);
        for i in (0..motion.len()).step_by(3) {
            let vector = DVec2::from_array(motion[i]);
            let is_sky = decoder.decode(depth.stored[i], depth.sample(i)) >= SKY_DEPTH;
            let far = current.motion_px(previous, depth.sample(i), f64::from(SKY_DEPTH));
            let has_parallax = (vector - far).length() > MOVES;
            if !is_sky && (vector.length() > MOVES || has_parallax) {
                found.push(Moving {
                    pair,
                    i,
                    motion: vector,
                    has_parallax,
                });
            }
        }
    }
    found
}

/// What the vectors say of the depths of these pixels.
fn seen(belief: &Belief, declared: &DepthSource, depths: &[Depths], pixels: &[Moving]) -> Vec<Seen> {
    let projectors = &belief.sequence.projectors;
    let see = |pixel: &Moving| {
        let depth = &depths[pixel.pair];
        let (current, previous) = (&projectors[depth.index], &projectors[depth.index - 1]);
        let (decoder, sample) = (decoder(belief, declared, depth.index), depth.sample(pixel.i));
        let stored = depth.stored[pixel.i];
        Seen {
            read: match declared.kind {
                DepthKind::Device => f64::from(stored) * declared.scale + declared.bias,
                _ => f64::from(decoder.decode(stored, sample)),
            },
            inverse_depth: current.inverse_depth(previous, sample, pixel.motion),
            near: decoder.near,
            far: decoder.far,
        }
    };
    pixels.iter().map(see).collect()
}

/// Share of these pixels whose vector is the camera's motion at the depth read.
fn agreement(
    belief: &Belief,
    projectors: &[Projector],
    source: &DepthSource,
    depths: &[Depths],
    pixels: &[Moving],
) -> f64 {
    let agreeing = pixels.iter().filter(|pixel| {
        let depth = &depths[pixel.pair];
        let z = decoder(belief, source, depth.index).decode(depth.stored[pixel.i], depth.sample(pixel.i));
        let (current, previous) = (&projectors[depth.index], &projectors[depth.index - 1]);
        let derived = current.motion_px(previous, depth.sample(pixel.i), f64::from(z));
        (derived - pixel.motion).length() < 0.04 + 0.01 * pixel.motion.length()
    });
    agreeing.count() as f64 / pixels.len().max(1) as f64
}

/// Which other cameras would explain the motion, if any do.
fn wrong_camera(
    belief: &mut Belief,
    report: &mut Report,
    declared: &DepthSource,
    depths: &[Depths],
    moving: &[Moving],
    declared_share: f64,
) {
    let explained = mistakes().into_iter().filter_map(|mistake| {
        let cameras = mistake.mended(belief.manifest())?;
        let size = belief.manifest().render_size;
        let projectors: Vec<Projector> = cameras
            .iter()
            .map(|camera| Projector::new(camera, size))
            .collect::<Option<_>>()?;
        Some((
            agreement(belief, &projectors, declared, depths, moving),
            mistake,
            cameras,
        ))
    });
    match explained.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((share, mistake, cameras)) if share > EXPLAINS && share > 2.0 * declared_share => {
            let numbers = format!(
                "they explain {:.0} % of the moving pixels declared, {:.0} % corrected",
                100.0 * declared_share,
                100.0 * share
            );
            report.findings.push(
                mistake
                    .finding(&numbers)
                    .with("explained_declared", declared_share)
                    .with("explained_corrected", share),
            );
            believe(belief, cameras);
        }
        _ => report.cannot_tell(
            "depth.kind",
            format!(
                "depth and cameras explain the vectors of {:.0} % of the moving pixels, and no other reading explains more",
                100.0 * declared_share
            ),
        ),
    }
}
