//! Frames in time: cuts without a reset, resets without a cut, references of another frame.

use super::{
    Belief, depth,
    fit::{Apart, Errors},
    motion::{MIN_VERDICT, Pair},
    observe::{Grid, Guide, N_TILES, View, spread},
    report::{Finding, Report},
};
use crate::{sequence::SequenceError, statistics::median};
use rayon::prelude::*;
use serde_json::json;

/// Pairs of frames that are looked at; of a longer sequence an even choice.
const MAX_PAIRS: usize = 64;
const MAX_SAMPLES: usize = 10_000;
/// Frames whose depths are compared with those of the frame before, to know what is usual.
const MAX_DEPTHS: usize = 8;
/// Share of the difference between unrelated images, and depths, that a cut leaves.
const CUT: f64 = 0.2;

/// How much of what differs between unrelated places differs between a frame and the frame before it, warped.
fn unexplained(belief: &Belief, index: usize) -> Result<Option<f64>, SequenceError> {
    let pair = Pair::load(belief, index)?;
    let grid = pair.grid(MAX_SAMPLES);
    let motion = pair.motion()?;
    if motion.is_none() && belief.manifest().motion.is_some() {
        // Its vectors are in a file beyond the sequence.
        return Ok(None);
    }
    let (width, height) = (grid.width, grid.height);
    let (mut error, mut unrelated) = (0.0, 0.0);
    for [x, y] in grid.pixels() {
        let shown = pair.shown([x, y]);
        let own = motion.as_ref().map_or([0.0; 2], |motion| motion[y * width + x]);
        let far = [(x + width / 3) % width, (y + height / 3) % height];
        let now = pair.before().value(pair.place([x, y], own));
        let elsewhere = pair.before().value(pair.place(far, [0.0; 2]));
        if shown.is_finite() && now.is_finite() && elsewhere.is_finite() {
            error += (shown - now).abs();
            unrelated += (shown - elsewhere).abs();
        }
    }
    Ok((unrelated > 1e-6).then(|| error / unrelated))
}

/// Cuts without a reset, and resets without a cut.
pub fn cuts(belief: &Belief, report: &mut Report) -> Result<(), SequenceError> {
    let n_pairs = belief.sequence.n_frames().saturating_sub(1);
    if n_pairs == 0 || (belief.guide == Guide::Color && belief.sequence.is_checkerboard()) {
        return Ok(());
    }
    let chosen = spread(n_pairs, MAX_PAIRS);
    if chosen.len() < n_pairs {
        report.cannot_tell(
            "frames[].reset",
            format!("only {} of {n_pairs} changes of frame were looked at", chosen.len()),
        );
    }
    report.frames = (0..=n_pairs)
        .filter(|index| chosen.contains(index) || index.checked_sub(1).is_some_and(|i| chosen.contains(&i)))
        .collect();
    let found = chosen
        .par_iter()
        .map(|&i| Ok((i + 1, unexplained(belief, i + 1)?)))
        .collect::<Result<Vec<_>, SequenceError>>()?;
    let resets = |index: usize| belief.manifest().frames[index].reset;
    let known: Vec<(usize, f64)> = found
        .into_iter()
        .filter_map(|(index, share)| Some((index, share?)))
        .collect();
    let usual = median(
        &known
            .iter()
            .filter(|(index, _)| !resets(*index))
            .map(|(_, share)| *share)
            .collect::<Vec<_>>(),
    );
    if usual.is_nan() {
        return Ok(());
    }
    let scatter = median(&known.iter().map(|(_, share)| (share - usual).abs()).collect::<Vec<_>>()).max(0.01);
    let jumps = |share: f64| share > CUT.max(2.0 * usual) && share > usual + 9.0 * scatter;
    let going_on = known.iter().filter(|(index, _)| !resets(*index));
    let (changed, others): (Vec<_>, Vec<_>) = going_on.partition(|(_, share)| jumps(*share));
    let relit = relit(belief, &changed, &others)?;
    for (index, share) in known {
        let finding = if !resets(index) && jumps(share) && !relit.contains(&index) {
            Finding::warning(
                "frames.reset",
                format!(
                    "frame {index} shows something else than frame {}: {share:.2} of the difference between unrelated images is \
                     left after its motion, {usual:.2} elsewhere; a cut without a reset, or frames out of order",
                    index - 1
                ),
            )
            .suggest(format!("frames[{index}].reset"), json!(true))
        } else if resets(index) && share < CUT && share < usual + 3.0 * scatter {
            Finding::note(
                "frames.reset",
                format!(
                    "frame {index} is declared a reset, but goes on from frame {}",
                    index - 1
                ),
            )
            .suggest(format!("frames[{index}].reset"), json!(false))
        } else {
            continue;
        };
        report.findings.push(
            finding
                .with("frame", index as f64)
                .with("unexplained", share)
                .with("unexplained_usually", usual),
        );
    }
    Ok(())
}

/// Those of some changed frames whose surfaces go on as in the others: a lamp was switched, say, and nothing was cut.
fn relit(belief: &Belief, changed: &[(usize, f64)], others: &[(usize, f64)]) -> Result<Vec<usize>, SequenceError> {
    let mut relit = Vec::new();
    if changed.is_empty() {
        return Ok(relit);
    }
    let shares = spread(others.len(), MAX_DEPTHS)
        .into_iter()
        .map(|i| depth::misled(belief, others[i].0))
        .collect::<Result<Vec<_>, _>>()?;
    let usual = median(&shares.into_iter().flatten().collect::<Vec<_>>());
    for &(index, _) in changed {
        // NaN, of no others, is below nothing.
        if depth::misled(belief, index)?.is_some_and(|share| share < CUT || share < 2.0 * usual) {
            relit.push(index);
        }
    }
    Ok(relit)
}

/// Share of the error that another frame's reference must take away. Thin wires that hardly move take a few hundredths of it away by
/// chance; the right reference takes a fifth and more where the scene moves.
const MIN_SHARE: f64 = 0.1;

/// Whether another frame's reference fits better.
pub fn reference_frame(belief: &Belief, report: &mut Report) -> Result<(), SequenceError> {
    let n_frames = belief.sequence.n_frames();
    let frames = &belief.manifest().frames;
    if belief.guide == Guide::Color || n_frames < 4 {
        return Ok(());
    }
    let inner: Vec<usize> = (1..n_frames - 1)
        .filter(|&index| !frames[index].reset && !frames[index + 1].reset)
        .collect();
    let chosen: Vec<usize> = spread(inner.len(), 6).into_iter().map(|i| inner[i]).collect();
    let measured = chosen
        .par_iter()
        .map(|&index| {
            let view = |index| View::load(&belief.sequence, index, belief.guide, belief.tone);
            let views = [view(index)?, view(index - 1)?, view(index + 1)?];
            Ok(against_others(belief, index, &views))
        })
        .collect::<Result<Vec<Errors>, SequenceError>>()?;
    let mut errors = Errors::default();
    measured.into_iter().for_each(|frame| errors.extend(frame));
    let best = errors.best();
    let gain = errors.gain(0, best);
    let what = belief.guide.name();
    if best != 0 && gain.share >= MIN_SHARE && errors.verdict(best) >= MIN_VERDICT && gain.z > 4.0 {
        let (whose, by) = if best == 1 {
            ("the frame before", -1)
        } else {
            ("the frame after", 1)
        };
        report.findings.push(
            Finding::warning(
                "reference.frame",
                format!(
                    "colour fits the {what} of {whose} better than its own: error {:.4} declared, {:.4} corrected",
                    errors.mean(0),
                    errors.mean(best)
                ),
            )
            .with("error_declared", errors.mean(0))
            .with("error_corrected", errors.mean(best))
            .with("z", gain.z)
            .suggest("reference.path", json!(format!("files of index {by:+}"))),
        );
    }
    Ok(())
}

fn against_others(belief: &Belief, index: usize, views: &[View; 3]) -> Errors {
    let grid = Grid::limited(&belief.sequence, index, 40_000);
    let [jx, jy] = belief.sequence.jitter_px[index];
    let [sx, sy] = views[0].scale;
    let mut tiles = vec![([0.0; 3], [Apart::default(); 3], 0); N_TILES];
    for [x, y] in grid.pixels() {
        let position = [(x as f64 + 0.5 + jx) * sx, (y as f64 + 0.5 + jy) * sy];
        let shown = views[0].input.at(x, y);
        let others = views
            .each_ref()
            .map(|view| view.guide.as_ref().map_or(f64::NAN, |guide| guide.value(position)));
        if shown.is_finite() && others.iter().all(|other| other.is_finite()) {
            let (sums, aparts, n) = &mut tiles[grid.tile_of([x, y])];
            for (i, other) in others.iter().enumerate() {
                sums[i] += (shown - other).abs();
                aparts[i].add((other - others[0]).abs());
            }
            *n += 1;
        }
    }
    let mut errors = Errors::default();
    tiles
        .into_iter()
        .filter(|(.., n)| *n > 0)
        .for_each(|(sums, aparts, n)| errors.push_apart(sums.into(), &aparts, n));
    errors
}
