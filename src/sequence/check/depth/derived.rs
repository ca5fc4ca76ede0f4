//! Depth and cameras against the images, where the motion is made of both.

use super::{
    Depths, decoder,
    mistakes::{CameraMistake, mistakes},
    readings::{Reading, kinds, steps},
};
use crate::sequence::{
    SequenceError,
    check::{
        Belief,
        fit::Errors,
        motion::Pair,
        observe::N_TILES,
        report::{Finding, Report},
    },
    convention::Projector,
    manifest::DepthSource,
};

/// Where motion comes from depth and cameras, the images tell whether these are right.
pub fn examine(
    belief: &Belief,
    report: &mut Report,
    declared: &DepthSource,
    depths: &[Depths],
) -> Result<(), SequenceError> {
    let readings: Vec<Reading> = kinds(belief, declared)
        .into_iter()
        .chain(steps(belief, declared))
        .enumerate()
        .filter(|(i, _)| i % 3 == 0 || *i < 8)
        .map(|(_, reading)| reading)
        .collect();
    let size = belief.manifest().render_size;
    let cameras: Vec<(CameraMistake, Vec<Projector>)> = mistakes()
        .into_iter()
        .filter_map(|mistake| {
            let cameras = mistake.mended(belief.manifest())?;
            let projectors = cameras
                .iter()
                .map(|camera| Projector::new(camera, size))
                .collect::<Option<_>>()?;
            Some((mistake, projectors))
        })
        .collect();
    let errors = errors(belief, declared, depths, &readings, &cameras)?;
    // A near plane can stand for much; what comes first in the list is likelier.
    let least = errors.best();
    let best = (0..readings.len() + cameras.len())
        .find(|&index| {
            let rest = errors.gain(index, least);
            index > 0 && (rest.share < 0.05 || rest.z < 2.0)
        })
        .unwrap_or(least);
    let gain = errors.gain(0, best);
    if best == 0 || gain.share < 0.1 || gain.z < 4.0 {
        report.cannot_tell(
            "depth.kind",
            "motion is derived from it; no other reading explains the images better",
        );
        return Ok(());
    }
    let numbers = format!(
        "error of the motion derived from it {:.4} declared, {:.4} corrected",
        errors.mean(0),
        errors.mean(best)
    );
    let finding = if let Some(reading) = readings.get(best) {
        let id = reading.suggestions.last().map_or("depth.kind", |(field, _)| field);
        let mut finding = Finding::warning(id, format!("depth {}: {numbers}", reading.says));
        for (field, value) in &reading.suggestions {
            finding = finding.suggest(*field, value.clone());
        }
        finding
    } else {
        cameras[best - readings.len()].0.finding(&numbers)
    };
    report.findings.push(
        finding
            .with("error_declared", errors.mean(0))
            .with("error_corrected", errors.mean(best))
            .with("z", gain.z),
    );
    Ok(())
}

/// Errors of the derived motion by every reading, then by every changed camera.
fn errors(
    belief: &Belief,
    declared: &DepthSource,
    depths: &[Depths],
    readings: &[Reading],
    cameras: &[(CameraMistake, Vec<Projector>)],
) -> Result<Errors, SequenceError> {
    let mut errors = Errors::default();
    for depth in depths {
        let pair = Pair::load(belief, depth.index)?;
        let grid = pair.grid(20_000);
        let n = readings.len() + cameras.len();
        let mut tiles = vec![(vec![0.0; n], 0); N_TILES];
        for pixel in grid.pixels() {
            let i = pixel[1] * grid.width + pixel[0];
            let shown = pair.shown(pixel);
            if !pair.is_derived(i) || !shown.is_finite() {
                continue;
            }
            let error = |projectors: &[Projector], source: &DepthSource| {
                let z = decoder(belief, source, depth.index).decode(depth.stored[i], depth.sample(i));
                let motion =
                    projectors[depth.index].motion_px(&projectors[depth.index - 1], depth.sample(i), f64::from(z));
                let error = (shown - pair.before().value(pair.place(pixel, motion.to_array()))).abs();
                if error.is_nan() { 0.5 } else { error }
            };
            let (sums, n) = &mut tiles[grid.tile_of(pixel)];
            *n += 1;
            for (sum, reading) in sums.iter_mut().zip(readings) {
                *sum += error(&belief.sequence.projectors, &reading.source);
            }
            for (sum, (_, projectors)) in sums[readings.len()..].iter_mut().zip(cameras) {
                *sum += error(projectors, declared);
            }
        }
        tiles
            .into_iter()
            .filter(|(_, n)| *n > 0)
            .for_each(|(sums, n)| errors.push(sums, n));
    }
    Ok(errors)
}
