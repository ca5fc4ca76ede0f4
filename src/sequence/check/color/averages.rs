//! In which space the reference is the mean of the colour's samples.

use super::{TRANSFERS, name};
use crate::sequence::{
    Channels, Section, SequenceError,
    check::{
        Belief,
        fit::Errors,
        observe::{Grid, N_TILES},
        report::{Finding, Report},
        stored::StoredColor,
    },
    convention::ColorDecoder,
    manifest::{AveragedIn, Transfer},
};
use rayon::prelude::*;

/// Reference pixels with more are left out of means.
const MAX_STORED: f32 = 4.0;

/// A space in which the reference may have been averaged.
#[derive(Clone, Copy)]
struct Space {
    transfer: Transfer,
    karis: bool,
}

/// Whether the reference is the mean of samples in the space declared.
pub fn examine(belief: &mut Belief, report: &mut Report, frames: &[usize]) -> Result<(), SequenceError> {
    let manifest = belief.manifest();
    let Some(reference) = &manifest.reference else {
        return Ok(());
    };
    // Two images that are read differently, or that are brighter than 1, are surely not encoded both.
    if manifest.color.transfer != reference.transfer {
        return Ok(());
    }
    let declared = Space {
        transfer: reference.transfer,
        karis: reference.averaged_in == Some(AveragedIn::Karis),
    };
    let mut spaces = vec![declared];
    spaces.push(Space {
        karis: !declared.karis,
        ..declared
    });
    spaces.extend(
        TRANSFERS
            .iter()
            .filter(|(transfer, _)| *transfer != declared.transfer)
            .map(|(transfer, _)| Space {
                transfer: *transfer,
                karis: false,
            }),
    );
    let sums = frames
        .par_iter()
        .map(|&index| biases(belief, index, &spaces))
        .collect::<Result<Vec<_>, SequenceError>>()?;
    let (mut bias, mut size) = (Errors::default(), Errors::default());
    for (frame_bias, frame_size) in sums {
        bias.extend(frame_bias);
        size.extend(frame_size);
    }
    // The last explanation is no bias.
    let effect = |space: usize| {
        let gain = bias.gain(space, spaces.len());
        (bias.mean(space) / size.mean(space), gain.z)
    };
    let effects: Vec<(f64, f64)> = (0..spaces.len()).map(effect).collect();
    let biased = |(effect, z): (f64, f64)| effect.abs() > 0.06 && z.abs() > 5.0;
    let unbiased = |(effect, _): (f64, f64)| effect.abs() < 0.05 && effect.abs() < 0.35 * effects[0].0.abs();
    if !biased(effects[0]) {
        if effects[1..].iter().all(|other| biased(*other)) {
            report.confirm("color.transfer");
            report.confirm("reference.averaged_in");
        } else {
            report.cannot_tell(
                "color.transfer",
                "too little contrast to tell in which space the reference was averaged",
            );
        }
        return Ok(());
    }
    let Some(other) = (1..spaces.len()).find(|&space| unbiased(effects[space])) else {
        report.cannot_tell(
            "reference.averaged_in",
            "the reference is the mean of the colour's samples in no known space",
        );
        return Ok(());
    };
    let space = spaces[other];
    let numbers = format!(
        "colour is off by {:+.3} of the contrast declared, {:+.3} corrected",
        effects[0].0, effects[other].0
    );
    let finding = if space.transfer == declared.transfer {
        let value = if space.karis { "karis" } else { "linear" };
        let message = format!("the reference looks averaged in {value} space: on average over edges {numbers}");
        Finding::warning("reference.averaged_in", message).suggest("reference.averaged_in", value)
    } else {
        let (is, was) = (name(space.transfer), name(declared.transfer));
        let message = format!("color and reference both look {is}, not {was}: on average over edges {numbers}");
        Finding::warning("color.transfer", message)
            .suggest("color.transfer", is)
            .suggest("reference.transfer", is)
    };
    report.findings.push(
        finding
            .with("bias_declared", effects[0].0)
            .with("bias_corrected", effects[other].0)
            .with("z", effects[0].1),
    );
    if space.transfer != declared.transfer {
        belief.change_color(|manifest| {
            manifest.color.transfer = space.transfer;
            if let Some(reference) = manifest.reference.as_mut() {
                reference.transfer = space.transfer;
            }
        })?;
    }
    Ok(())
}

/// By tile and space: sums of colour minus reference, and of its size, over pixels with detail.
fn biases(belief: &Belief, index: usize, spaces: &[Space]) -> Result<(Errors, Errors), SequenceError> {
    let sequence = &belief.sequence;
    let channels = Channels {
        reference: true,
        ..Channels::default()
    };
    let (mut bias, mut size) = (Errors::default(), Errors::default());
    let files = sequence.frame_files(index, channels)?;
    let Some(reference) = files.stored(Section::Reference, 0) else {
        return Ok((bias, size));
    };
    let color = StoredColor::new(&files, sequence);
    let grid = Grid::new(sequence, index);
    let output = sequence.output_size();
    let scale = sequence.sizes().scale();
    let [jx, jy] = sequence.jitter_px[index];
    let mut tiles = vec![(vec![0.0; spaces.len() + 1], vec![0.0; spaces.len() + 1], 0); N_TILES];
    for [x, y] in grid.pixels() {
        let at = |value: f64, limit: u32| value.clamp(0.0, f64::from(limit - 1)) as usize;
        let rx = at((x as f64 + 0.5 + jx) * scale[0], output.width);
        let ry = at((y as f64 + 0.5 + jy) * scale[1], output.height);
        let i = ry * output.width as usize + rx;
        let truth = [0, 1, 2].map(|channel| reference[channel][i]);
        // Chosen by the reference alone, which leaves the mean of the samples unbiased; a lamp would drown all else.
        if truth.iter().any(|value| *value > MAX_STORED) {
            continue;
        }
        let stored = [color.at(y * grid.width + x), vec![(truth, 1.0)]];
        let (biases, sizes, n) = &mut tiles[grid.tile_of([x, y])];
        for (i, space) in spaces.iter().enumerate() {
            let [a, b] = stored.each_ref().map(|stored| {
                let decoder = ColorDecoder {
                    transfer: space.transfer,
                    nits_per_unit: 100.0,
                    exposure: 1.0,
                };
                let light = super::light(decoder, stored).max(0.0);
                if space.karis { light / (1.0 + light) } else { light }
            });
            if (a - b).is_finite() {
                biases[i] += a - b;
                sizes[i] += (a - b).abs();
            }
        }
        *n += 1;
    }
    for (biases, sizes, n) in tiles {
        bias.push(biases, n);
        size.push(sizes, n);
    }
    Ok((bias, size))
}
