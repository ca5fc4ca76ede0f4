//! Which reading of the motion vectors explains how the images change: each warps the frame before onto the frame, and the
//! one declared must do it about as well as the best.

mod pair;
mod readings;

pub use pair::Pair;

use super::{
    Belief,
    fit::{Errors, Gain},
    jitter::{self, MAX_SIGMA, Measured},
    observe::{Guide, motion_decoder, pairs},
    report::{Finding, Report},
};
use crate::{
    sequence::{Manifest, SequenceError, manifest::MotionSource},
    statistics::median,
};
use rayon::prelude::*;
use readings::{Reading, change, readings, with};
use serde_json::json;

/// Pairs of frames that are compared.
const MAX_PAIRS: usize = 8;
/// As many, with a frame before and after, are enough without the others.
const MIN_INNER: usize = 3;
/// Of what two readings predict differently, at least so much more must speak for the better one than against it. The right reading
/// has 0.25 to 1 over any wrong one, in sequences that are right and in those with a mistake.
pub const MIN_VERDICT: f64 = 0.1;
/// And it must be this many standard errors better.
const MIN_Z: f64 = 3.5;
/// Share of the error that vectors of another frame must take away: where motion is steady, they differ by little, and chance
/// decides.
const MIN_LAG_SHARE: f64 = 0.15;
/// A displacement that all vectors share and that is a mistake, in pixels.
const BIAS: f64 = 0.2;

/// Names what fits the images best, and believes it.
pub fn examine(belief: &mut Belief, report: &mut Report) -> Result<(), SequenceError> {
    if belief.manifest().motion.is_none() {
        return Ok(());
    }
    if belief.guide == Guide::Color && belief.sequence.is_checkerboard() {
        report.cannot_tell(
            "motion",
            "frames that shade every other pixel, and no reference, do not tell",
        );
        return Ok(());
    }
    let mut frames = pairs(&belief.sequence, MAX_PAIRS);
    // Readings by another frame's vectors are as well off as all others only where both neighbours have vectors of the shot.
    let is_inner = |index: usize| {
        let resets = |index: usize| belief.manifest().frames.get(index).is_none_or(|frame| frame.reset);
        index > 1 && !resets(index - 1) && !resets(index + 1)
    };
    if frames.iter().filter(|&&index| is_inner(index)).count() >= MIN_INNER {
        frames.retain(|&index| is_inner(index));
    }
    if frames.is_empty() {
        report.cannot_tell("motion", "no frame has a predecessor without a reset");
        return Ok(());
    }
    let mut readings = readings(belief);
    readings.extend(unbiased(belief, &readings[0], &frames)?);
    let measured = frames
        .par_iter()
        .map(|&index| Ok(Pair::with_neighbours(belief, index)?.errors(&readings)))
        .collect::<Result<Vec<Errors>, SequenceError>>()?;
    let mut errors = Errors::default();
    measured.into_iter().for_each(|pair| errors.extend(pair));
    choose(belief, report, &readings, &errors);
    if belief.guide == Guide::Color {
        let measured = measure(belief, &frames)?;
        without_guide(belief, report, &measured);
    }
    Ok(())
}

/// The fewest changes that explain the images as well as the best reading.
fn plainest(readings: &[Reading], errors: &Errors) -> usize {
    let best = (0..readings.len())
        .min_by(|&a, &b| errors.mean(a).total_cmp(&errors.mean(b)))
        .unwrap_or(0);
    (0..readings.len())
        .filter(|&index| {
            let Gain { share, z } = errors.gain(index, best);
            share < 0.01 || z < 2.0
        })
        .min_by(|&a, &b| {
            let n_changes = |index: usize| readings[index].changes.len();
            n_changes(a)
                .cmp(&n_changes(b))
                .then(errors.mean(a).total_cmp(&errors.mean(b)))
        })
        .unwrap_or(best)
}

fn choose(belief: &mut Belief, report: &mut Report, readings: &[Reading], errors: &Errors) {
    let chosen = plainest(readings, errors);
    let gain = errors.gain(0, chosen);
    let still = readings.len();
    let (declared_error, chosen_error, still_error) = (errors.mean(0), errors.mean(chosen), errors.mean(still));
    let against = belief.guide.name();
    let min_share = match readings.get(chosen) {
        Some(reading) if reading.lag != 0 => MIN_LAG_SHARE,
        _ => 0.0,
    };
    if chosen != 0 && gain.share >= min_share && errors.verdict(chosen) >= MIN_VERDICT && gain.z >= MIN_Z {
        let reading = &readings[chosen];
        for change in &reading.changes {
            let message = format!(
                "motion {}: error against the {against} {declared_error:.4} declared, {chosen_error:.4} corrected{}",
                change.says,
                if reading.changes.len() > 1 {
                    ", with the other changes of motion"
                } else {
                    ""
                }
            );
            report.findings.push(
                Finding::warning(change.id, message)
                    .with("error_declared", declared_error)
                    .with("error_corrected", chosen_error)
                    .with("error_without_motion", still_error)
                    .with("verdict", errors.verdict(chosen))
                    .with("z", gain.z)
                    .suggest(change.field, change.value.clone()),
            );
        }
        let (source, swapped) = (reading.source.clone(), reading.swapped);
        belief.motion_lag = reading.lag;
        belief.change(|manifest| {
            manifest.motion = Some(source);
            if let Some(motion) = manifest.motion.as_mut().filter(|_| swapped) {
                motion.channels.swap(0, 1);
            }
        });
        return;
    }
    let (still, verdict) = (errors.gain(0, still), errors.verdict(still));
    if verdict >= MIN_VERDICT && still.z >= MIN_Z {
        report.findings.push(
            Finding::warning(
                "motion.unexplained",
                format!(
                    "motion explains the images worse than no motion at all, in every sign and unit: error against the \
                     {against} {declared_error:.4}, {still_error:.4} without"
                ),
            )
            .with("error_declared", declared_error)
            .with("error_without_motion", still_error)
            .with("z", still.z),
        );
        return;
    }
    confirm(report, readings, errors);
}

/// A field is confirmed where each single change of it is clearly worse.
fn confirm(report: &mut Report, readings: &[Reading], errors: &Errors) {
    for field in [
        "motion.units",
        "motion.direction",
        "motion.y",
        "motion.x",
        "motion.channels",
        "motion.jittered",
        "motion.scale",
    ] {
        let mut others = (0..readings.len())
            .filter(|&index| matches!(readings[index].changes.as_slice(), [only] if only.id == field))
            .peekable();
        if others.peek().is_none() {
            continue;
        }
        let worse = |index: usize| -errors.verdict(index) >= MIN_VERDICT && errors.gain(index, 0).z >= MIN_Z;
        if others.all(worse) {
            report.confirm(field);
        } else {
            report.cannot_tell(
                field,
                "another reading explains the images as well: too little moves that way",
            );
        }
    }
}

/// The shift that frames still need after the motion, where it can be measured.
fn measure(belief: &Belief, frames: &[usize]) -> Result<Vec<Measured>, SequenceError> {
    let measured = frames
        .par_iter()
        .map(|&index| Ok(Pair::load(belief, index)?.left_over()))
        .collect::<Result<Vec<_>, SequenceError>>()?;
    let mut measured: Vec<Measured> = measured.into_iter().flatten().collect();
    measured.retain(|frame| frame.shift.sigma.iter().all(|sigma| *sigma < MAX_SIGMA));
    Ok(measured)
}

/// The reading with another bias, where all pixels still need the same shift.
fn unbiased(belief: &Belief, declared: &Reading, frames: &[usize]) -> Result<Option<Reading>, SequenceError> {
    if belief.guide != Guide::Reference {
        return Ok(None);
    }
    let measured = measure(belief, frames)?;
    if measured.len() < 2 {
        return Ok(None);
    }
    let mean = |axis: usize| median(&measured.iter().map(|m| m.shift.by[axis]).collect::<Vec<_>>());
    let shift = [mean(0), mean(1)];
    if shift[0].hypot(shift[1]) < BIAS {
        return Ok(None);
    }
    // What a stored 1 is worth in pixels, and its sign, from the decoder itself.
    let decode =
        |source: &MotionSource, stored: [f32; 2]| motion_decoder(&belief.sequence, source, frames[0]).decode(stored);
    let mut plain = declared.source.clone();
    plain.invalid_value = None;
    let mut moved = plain.clone();
    moved.bias = [plain.bias[0] + 1.0, plain.bias[1] + 1.0];
    let (Some(zero), Some(one)) = (decode(&plain, [0.0; 2]), decode(&moved, [0.0; 2])) else {
        return Ok(None);
    };
    let bias = [0, 1].map(|axis| declared.source.bias[axis] + shift[axis] / f64::from(one[axis] - zero[axis]));
    let says = format!("is ({:.2}, {:.2}) px off everywhere", -shift[0], -shift[1]);
    Ok(Some(with(
        declared,
        change("motion.bias", says, json!(bias)),
        |source| source.bias = bias,
    )))
}

/// Without a guide the shift left over is the change of jitter by the true reading, minus that by the reading believed.
fn without_guide(belief: &mut Belief, report: &mut Report, measured: &[Measured]) {
    if measured.len() < 2 || belief.manifest().motion.as_ref().is_some_and(|motion| motion.jittered) {
        // Jittered vectors join what images show, whatever the jitter is.
        report.cannot_tell("jitter", "there is no reference, and frames alone do not tell");
        return;
    }
    let change = |at: &dyn Fn(usize) -> Option<[f64; 2]>, index: usize| {
        let (now, then) = (at(index)?, at(index - 1)?);
        Some([now[0] - then[0], now[1] - then[1]])
    };
    let believed = belief.sequence.jitter_px.clone();
    let mut total = measured.to_vec();
    for frame in &mut total {
        let own = change(&|index| believed.get(index).copied(), frame.index).unwrap_or_default();
        frame.shift.by = [frame.shift.by[0] + own[0], frame.shift.by[1] + own[1]];
    }
    let expected = |reading: &jitter::Reading, manifest: &Manifest, index: usize| {
        change(&|index| reading.jitter_px(manifest, index), index)
    };
    jitter::judge(belief, report, &total, expected, false);
}
