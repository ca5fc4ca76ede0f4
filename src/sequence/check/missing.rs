//! Objects that move otherwise than their vectors say, such as skinned ones whose bones were left out.

use super::{
    Belief,
    motion::Pair,
    observe::{Guide, TILES, pairs},
    report::{Finding, Report},
    stored,
};
use crate::sequence::{Channels, SequenceError, frame::SKY_DEPTH};
use rayon::prelude::*;
use std::collections::BTreeMap;

const MAX_PAIRS: usize = 8;
/// Regions that are named; more say the same.
const MAX_FINDINGS: usize = 5;
/// How far a region is looked for, in pixels.
const REACH: i32 = 8;
/// Samples of a region.
const MAX_SAMPLES: usize = 600;
const MIN_SAMPLES: usize = 60;
/// Mean difference from its mean, of tone-mapped luma, below which a region is flat.
const MIN_CONTRAST: f64 = 0.02;

/// One region in one pair of frames.
struct Found {
    region: u32,
    /// Where it is beyond what its vectors say.
    by: [f64; 2],
    error: f64,
    best: f64,
    speed: f64,
    n_pixels: usize,
    found: bool,
}

/// Looks for each object, or tile, beyond where its vectors say.
pub fn examine(belief: &mut Belief, report: &mut Report) -> Result<(), SequenceError> {
    if belief.guide == Guide::Color
        || belief.manifest().motion.is_none()
        || report
            .warnings()
            .any(|finding| finding.id.starts_with("motion.") && finding.id != "motion.sky")
    {
        return Ok(());
    }
    let frames = pairs(&belief.sequence, MAX_PAIRS);
    let found = frames
        .par_iter()
        .map(|&index| regions(belief, index))
        .collect::<Result<Vec<_>, SequenceError>>()?;
    let mut by_region: BTreeMap<u32, Vec<Found>> = BTreeMap::new();
    for region in found.into_iter().flatten() {
        by_region.entry(region.region).or_default().push(region);
    }
    let has_ids = belief.manifest().object_id.is_some();
    let wrong = by_region
        .into_iter()
        .filter_map(|(region, seen)| describe(region, has_ids, &seen, frames.len()));
    report.findings.extend(wrong.take(MAX_FINDINGS));
    Ok(())
}

/// The finding of a region that is off in most of the frames that show it.
fn describe(region: u32, has_ids: bool, seen: &[Found], n_pairs: usize) -> Option<Finding> {
    let wrong: Vec<&Found> = seen.iter().filter(|found| found.found).collect();
    if wrong.len() < n_pairs.min(2) || wrong.len() * 10 < seen.len() * 6 {
        return None;
    }
    let mean = |value: fn(&Found) -> f64| wrong.iter().map(|found| value(found)).sum::<f64>() / wrong.len() as f64;
    let off = mean(|found| found.by[0].hypot(found.by[1]));
    let (error, best) = (mean(|found| found.error), mean(|found| found.best));
    let n_pixels = mean(|found| found.n_pixels as f64);
    let place = if has_ids {
        format!("object {region}")
    } else {
        let (x, y) = (region as usize % TILES[0] + 1, region as usize / TILES[0] + 1);
        format!("the tile in column {x} of {}, row {y} of {}", TILES[0], TILES[1])
    };
    let vectors = match mean(|found| found.speed) < 0.05 {
        true => "its vectors are zero",
        false => "its vectors say otherwise",
    };
    let message = format!(
        "{place} ({n_pixels:.0} pixels) moves by {off:.1} px more than declared; {vectors}: error {error:.4} declared, \
         {best:.4} moved on"
    );
    let finding = Finding::warning("motion.object", message)
        .with("region", f64::from(region))
        .with("off_px", off)
        .with("error_declared", error)
        .with("error_moved", best);
    Some(finding)
}

fn regions(belief: &Belief, index: usize) -> Result<Vec<Found>, SequenceError> {
    let pair = Pair::load(belief, index)?;
    let grid = pair.grid(200_000);
    let Some(motion) = pair.motion()? else {
        return Ok(Vec::new());
    };
    let channels = Channels {
        object_id: true,
        depth: true,
        ..Channels::default()
    };
    let frame = belief.sequence.load(index, channels)?;
    let ids = &frame.object_id;
    // Where there are cameras, the sky is held against them.
    let has_cameras = !belief.sequence.projectors.is_empty();
    let is_sky = |[x, y]: [usize; 2]| {
        let (x, y) = (x as u32, y as u32);
        let depth = frame.depth_of(stored::speaker(&frame, x, y)).filter(|_| has_cameras);
        depth.is_some_and(|depth| depth.at(x, y) >= SKY_DEPTH)
    };
    let mut regions: BTreeMap<u32, Vec<[usize; 2]>> = BTreeMap::new();
    for pixel in grid.pixels().into_iter().filter(|pixel| !is_sky(*pixel)) {
        let region = match ids {
            Some(ids) => ids.at(pixel[0] as u32, pixel[1] as u32),
            None => grid.tile_of(pixel) as u32,
        };
        regions.entry(region).or_default().push(pixel);
    }
    // Thousands of ids are hashes of something else than objects.
    if regions.len() > 200 {
        return Ok(Vec::new());
    }
    Ok(regions
        .into_iter()
        .filter_map(|(region, pixels)| look(&pair, &motion, grid.width, region, &pixels))
        .collect())
}

fn look(pair: &Pair, motion: &[[f64; 2]], width: usize, region: u32, pixels: &[[usize; 2]]) -> Option<Found> {
    let step = pixels.len().div_ceil(MAX_SAMPLES).max(1);
    let samples: Vec<(f64, [usize; 2], [f64; 2])> = pixels
        .iter()
        .step_by(step)
        .map(|&pixel| (pair.shown(pixel), pixel, motion[pixel[1] * width + pixel[0]]))
        .filter(|(shown, _, [x, y])| shown.is_finite() && x.is_finite() && y.is_finite())
        .collect();
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let n = samples.len() as f64;
    let mean = samples.iter().map(|(shown, ..)| shown).sum::<f64>() / n;
    let contrast = samples.iter().map(|(shown, ..)| (shown - mean).abs()).sum::<f64>() / n;
    // A flat region is told apart only by what stands before it.
    if contrast < MIN_CONTRAST {
        return None;
    }
    let error = |dx: f64, dy: f64| {
        let errors = samples.iter().map(|(shown, pixel, [x, y])| {
            let error = (shown - pair.before().bilinear(pair.place(*pixel, [x + dx, y + dy]))).abs();
            if error.is_nan() { 0.5 } else { error }
        });
        errors.sum::<f64>() / n
    };
    let own = error(0.0, 0.0);
    // Below this nothing is seen to differ.
    let mut best = ([0.0; 2], own);
    if own > 0.02 {
        for dy in -REACH..=REACH {
            for dx in -REACH..=REACH {
                let (dx, dy) = (f64::from(dx), f64::from(dy));
                let error = error(dx, dy);
                if error < best.1 {
                    best = ([dx, dy], error);
                }
            }
        }
    }
    Some(Found {
        region,
        by: best.0,
        error: own,
        best: best.1,
        speed: samples.iter().map(|(_, _, [x, y])| x.hypot(*y)).sum::<f64>() / n,
        n_pixels: pixels.len(),
        found: best.1 < 0.5 * own && best.0 != [0.0; 2],
    })
}
