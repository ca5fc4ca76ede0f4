//! Whether colour and reference mean the same light: their encodings, exposures and brightness.
//!
//! Where both images are flat they must agree, so flat pixels tell of any encoding that only one of them got wrong. What
//! both got wrong shows at edges: point samples are on average the reference's mean in the space where it was averaged,
//! and in no other.

mod averages;

use super::{
    Belief,
    observe::{Grid, Guide, spread},
    plane::luma,
    report::{Finding, Report},
    stored::StoredColor,
};
use crate::{
    image::Image,
    sequence::{
        Channels, Section, SequenceError,
        convention::ColorDecoder,
        frame::Rgb,
        manifest::{ColorSource, Manifest, Transfer},
    },
    statistics::median,
};
use rayon::prelude::*;
use serde_json::json;

const MAX_FRAMES: usize = 8;
/// Flat pixels of a frame.
const MAX_FLAT: usize = 3000;
/// Difference of logarithms that is noise, as the median over flat pixels.
const AGREES: f64 = 0.1;

const TRANSFERS: [(Transfer, &str); 3] = [
    (Transfer::Linear, "linear"),
    (Transfer::Srgb, "srgb"),
    (Transfer::Pq, "pq"),
];

fn name(transfer: Transfer) -> &'static str {
    TRANSFERS
        .iter()
        .find(|(known, _)| *known == transfer)
        .map_or("", |(_, name)| name)
}

/// Stored colours of one pixel in both images.
struct Flat {
    /// Of each sample or layer, with its weight.
    color: Vec<(Rgb, f64)>,
    reference: Rgb,
    exposure: f64,
}

/// The encoding of what colour is compared with.
fn other(manifest: &Manifest) -> Option<ColorSource> {
    let reference = manifest.reference.as_ref().map(|reference| reference.color());
    reference.or_else(|| manifest.unjittered_color.clone())
}

/// How both images are read.
#[derive(Clone, Copy, PartialEq)]
struct Reading {
    transfers: [Transfer; 2],
    pre_exposed: [bool; 2],
}

impl Reading {
    fn declared(manifest: &Manifest) -> Option<Self> {
        let other = other(manifest)?;
        Some(Self {
            transfers: [manifest.color.transfer, other.transfer],
            pre_exposed: [manifest.color.pre_exposed, other.pre_exposed],
        })
    }

    fn n_changes(self, declared: Self) -> usize {
        let transfers = (0..2).filter(|&i| self.transfers[i] != declared.transfers[i]).count();
        transfers
            + (0..2)
                .filter(|&i| self.pre_exposed[i] != declared.pre_exposed[i])
                .count()
    }

    /// Logarithm of colour's over reference's light.
    fn ratio(self, flat: &Flat, nits_per_unit: [f64; 2]) -> Option<f64> {
        let decoder = |i: usize| ColorDecoder {
            transfer: self.transfers[i],
            nits_per_unit: nits_per_unit[i],
            exposure: if self.pre_exposed[i] { flat.exposure } else { 1.0 },
        };
        let color = light(decoder(0), &flat.color);
        let reference = light(decoder(1), &[(flat.reference, 1.0)]);
        let usable = color > 1e-5 && reference > 1e-5 && color < 1e5 && reference < 1e5;
        usable.then(|| libm::log(color / reference))
    }
}

/// Luminance of stored colours that count by their weights.
fn light(decoder: ColorDecoder, stored: &[(Rgb, f64)]) -> f64 {
    stored
        .iter()
        .map(|(stored, weight)| weight * luma(decoder.decode(*stored)))
        .sum()
}

pub fn examine(belief: &mut Belief, report: &mut Report) -> Result<(), SequenceError> {
    if belief.guide == Guide::Color {
        report.cannot_tell("color.transfer", "there is no reference to compare with");
        return Ok(());
    }
    let frames = spread(belief.sequence.n_frames(), MAX_FRAMES);
    let flats = frames
        .par_iter()
        .map(|&index| flat_pixels(belief, index))
        .collect::<Result<Vec<_>, SequenceError>>()?;
    agreement(belief, report, &flats)?;
    if belief.guide != Guide::Reference {
        return Ok(());
    }
    parity(belief, report)?;
    averages::examine(belief, report, &frames)
}

/// The flattest pixels of a frame.
fn flat_pixels(belief: &Belief, index: usize) -> Result<Vec<Flat>, SequenceError> {
    let sequence = &belief.sequence;
    let files = sequence.frame_files(index, belief.guide.channels())?;
    let section = match belief.guide {
        Guide::Reference => Section::Reference,
        _ => Section::UnjitteredColor,
    };
    let Some(reference) = files.stored(section, 0) else {
        return Ok(Vec::new());
    };
    let color = StoredColor::new(&files, sequence);
    let color_planes = color.planes();
    let reference_planes: Vec<&[f32]> = reference.iter().map(|plane| &**plane).collect();
    let exposure = sequence.manifest().frames[index].exposure.unwrap_or(1.0);
    let grid = Grid::new(sequence, index);
    let (output, scale) = match belief.guide {
        Guide::Reference => (sequence.output_size(), sequence.sizes().scale()),
        _ => (sequence.render_size(), [1.0; 2]),
    };
    let (output_width, output_height) = (output.width as usize, output.height as usize);
    let mut ranked = Vec::new();
    for [x, y] in grid.pixels() {
        let at =
            |coordinate: usize, scale: f64, limit: usize| (((coordinate as f64 + 0.5) * scale) as usize).min(limit - 1);
        let [rx, ry] = [at(x, scale[0], output_width), at(y, scale[1], output_height)];
        // Of a checkerboard only pixels of the same parity are anything.
        let step = if sequence.is_checkerboard() { 2 } else { 1 };
        let (Some(a), Some(b)) = (
            variation(&color_planes, [grid.width, grid.height], [x, y], step),
            variation(&reference_planes, [output_width, output_height], [rx, ry], 1),
        ) else {
            continue;
        };
        let i = ry * output_width + rx;
        ranked.push((
            a + b,
            Flat {
                color: color.at(y * grid.width + x),
                reference: [0, 1, 2].map(|channel| reference[channel][i]),
                exposure,
            },
        ));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = (ranked.len() / 5).min(MAX_FLAT);
    ranked.truncate(n);
    Ok(ranked.into_iter().map(|(_, flat)| flat).collect())
}

/// Range over level of the pixels around one.
fn variation(planes: &[&[f32]], [width, height]: [usize; 2], [x, y]: [usize; 2], step: usize) -> Option<f64> {
    if x < step || y < step || x + step >= width || y + step >= height {
        return None;
    }
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    let offsets: &[[isize; 2]] = if step == 2 {
        &[[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]
    } else {
        &[
            [0, 0],
            [1, 0],
            [-1, 0],
            [0, 1],
            [0, -1],
            [1, 1],
            [1, -1],
            [-1, 1],
            [-1, -1],
        ]
    };
    for [dx, dy] in offsets {
        let i = y.wrapping_add_signed(*dy) * width + x.wrapping_add_signed(*dx);
        let value: f64 = planes.iter().map(|plane| f64::from(plane[i])).sum();
        if !value.is_finite() {
            return None;
        }
        (low, high) = (low.min(value), high.max(value));
    }
    (high > 1e-4).then(|| (high - low) / high)
}

/// How far both images are apart by a reading, in natural logarithms.
#[derive(Clone, Copy)]
struct Apart {
    /// Median distance; infinite where few pixels come out usable.
    error: f64,
    /// Median of colour over reference.
    gain: f64,
    /// Median distance from that.
    spread: f64,
}

impl Apart {
    fn by(reading: Reading, flats: &[&Flat], nits_per_unit: [f64; 2]) -> Self {
        let ratios: Vec<f64> = flats
            .iter()
            .filter_map(|flat| reading.ratio(flat, nits_per_unit))
            .collect();
        let gain = median(&ratios.clone());
        let from = |centre: f64| median(&ratios.iter().map(|ratio| (ratio - centre).abs()).collect::<Vec<_>>());
        let usable = ratios.len() * 2 >= flats.len() && !gain.is_nan();
        Self {
            error: if usable { from(0.0) } else { f64::INFINITY },
            gain,
            spread: from(gain),
        }
    }
}

/// Every way to read both images.
fn readings(declared: Reading, exposed: bool) -> Vec<Reading> {
    let mut all = Vec::new();
    for (color, _) in TRANSFERS {
        for (reference, _) in TRANSFERS {
            for pre_exposed in [[false, false], [false, true], [true, false], [true, true]] {
                if exposed || pre_exposed == declared.pre_exposed {
                    all.push(Reading {
                        transfers: [color, reference],
                        pre_exposed,
                    });
                }
            }
        }
    }
    // Of equals the plainest.
    all.sort_by_key(|reading| reading.n_changes(declared));
    all
}

fn agreement(belief: &mut Belief, report: &mut Report, frames: &[Vec<Flat>]) -> Result<(), SequenceError> {
    let manifest = belief.manifest();
    let (Some(declared), Some(other)) = (Reading::declared(manifest), other(manifest)) else {
        return Ok(());
    };
    let flats: Vec<&Flat> = frames.iter().flatten().collect();
    if flats.len() < 100 {
        report.cannot_tell("color.transfer", "too few flat pixels");
        return Ok(());
    }
    let nits = [manifest.color.nits_per_unit, other.nits_per_unit];
    let apart = Apart::by(declared, &flats, nits);
    if apart.error <= AGREES {
        report.confirm("brightness");
        return Ok(());
    }
    let mut exposures = manifest.frames.iter().filter_map(|frame| frame.exposure);
    let exposed = exposures.any(|exposure| exposure != 1.0);
    let mut best = (declared, apart.error);
    for reading in readings(declared, exposed) {
        let error = Apart::by(reading, &flats, nits).error;
        if error < 0.8 * best.1 {
            best = (reading, error);
        }
    }
    if best.1 <= 0.4 * apart.error {
        return believe(belief, report, declared, best, apart.error);
    }
    report.findings.push(unexplained(belief.guide.name(), apart));
    Ok(())
}

/// The finding where no reading makes both images agree.
fn unexplained(other: &str, apart: Apart) -> Finding {
    let times = libm::exp(-apart.gain);
    if apart.spread <= 0.5 * apart.error {
        let message =
            format!("the {other} is {times:.2} times as bright as the colour: one of them has another exposure");
        return Finding::warning("reference.brightness", message)
            .with("ratio", times)
            .with("spread", apart.spread)
            .suggest(
                "reference.pre_exposed",
                json!("true, with frames[].exposure, if it was multiplied by an exposure"),
            );
    }
    let message = format!(
        "colour and {other} differ where both are flat, by {:.0} % at the median, and no transfer function or exposure \
         explains it",
        100.0 * (libm::exp(apart.error) - 1.0)
    );
    Finding::warning("reference.color", message)
        .with("error", apart.error)
        .with("ratio", times)
}

fn believe(
    belief: &mut Belief,
    report: &mut Report,
    declared: Reading,
    (reading, error): (Reading, f64),
    declared_error: f64,
) -> Result<(), SequenceError> {
    let other = match belief.guide {
        Guide::Reference => "reference",
        _ => "unjittered_color",
    };
    for (i, section) in ["color", other].into_iter().enumerate() {
        let with = |finding: Finding| {
            finding
                .with("error_declared", declared_error)
                .with("error_corrected", error)
        };
        if reading.transfers[i] != declared.transfers[i] {
            let (is, was) = (name(reading.transfers[i]), name(declared.transfers[i]));
            let id = format!("{section}.transfer");
            let message = format!(
                "{section} looks {is}, not {was}: where both images are flat they differ by {declared_error:.3} (of the \
                 natural logarithm) declared, {error:.3} corrected"
            );
            report
                .findings
                .push(with(Finding::warning(&id, message)).suggest(&id, is));
        }
        if reading.pre_exposed[i] != declared.pre_exposed[i] {
            let id = format!("{section}.pre_exposed");
            let verb = if reading.pre_exposed[i] {
                "looks"
            } else {
                "does not look"
            };
            let message = format!(
                "{section} {verb} multiplied by the frames' exposure: flat pixels differ by {declared_error:.3} (of the natural \
                 logarithm) declared, {error:.3} corrected"
            );
            report
                .findings
                .push(with(Finding::warning(&id, message)).suggest(&id, reading.pre_exposed[i]));
        }
    }
    belief.change_color(|manifest| {
        manifest.color.transfer = reading.transfers[0];
        manifest.color.pre_exposed = reading.pre_exposed[0];
        if let Some(reference) = manifest.reference.as_mut() {
            reference.transfer = reading.transfers[1];
            reference.pre_exposed = reading.pre_exposed[1];
        } else if let Some(unjittered) = manifest.unjittered_color.as_mut() {
            unjittered.transfer = reading.transfers[1];
            unjittered.pre_exposed = reading.pre_exposed[1];
        }
    })
}

/// Whether the shaded pixels of a checkerboard are those declared.
fn parity(belief: &mut Belief, report: &mut Report) -> Result<(), SequenceError> {
    if !belief.sequence.is_checkerboard() {
        return Ok(());
    }
    let other = belief.sequence.redeclared(|manifest| {
        if let Some(mask) = manifest.checkerboard.as_mut() {
            mask.parity.iter_mut().for_each(|parity| *parity = 1 - *parity);
        }
    });
    let frames = spread(belief.sequence.n_frames(), 4);
    let error = |sequence: &crate::sequence::Sequence| {
        let mut sum = 0.0;
        for &index in &frames {
            let channels = Channels {
                reference: true,
                ..Channels::default()
            };
            let frame = sequence.load(index, channels)?;
            let Some(reference) = &frame.reference else { continue };
            for [x, y] in Grid::new(sequence, index).pixels() {
                let of = |image: &Image<Rgb>| f64::from(belief.tone.map(image.at(x as u32, y as u32)));
                let difference = (of(&frame.color) - of(reference)).abs();
                sum += if difference.is_nan() { 1.0 } else { difference };
            }
        }
        Ok::<f64, SequenceError>(sum)
    };
    let (declared, flipped) = (error(&belief.sequence)?, error(&other)?);
    if flipped < 0.7 * declared {
        report.findings.push(
            Finding::warning(
                "checkerboard.parity",
                format!(
                    "the pixels that are not declared shaded fit the reference better: error {:.2} of those declared",
                    flipped / declared
                ),
            )
            .with("error_ratio", flipped / declared)
            .suggest("checkerboard.parity", json!("the other of 0 and 1 for each frame")),
        );
        belief.sequence = other;
    } else if declared < 0.7 * flipped {
        report.confirm("checkerboard.parity");
    } else {
        report.cannot_tell(
            "checkerboard.parity",
            "both halves of the pixels fit the reference as well",
        );
    }
    Ok(())
}
