//! Where the samples of each frame really lie: the shift between a frame and its guide, against the jitter declared.
//!
//! A point sample of an edge and the box filter's ramp agree best, on average over all edges, where both mean the same
//! position; so the shift of least squares is the jitter, in sign and size.

mod readings;

pub use readings::Reading;

use super::{
    Belief,
    fit::{self, Shift},
    observe::{Grid, Guide, N_TILES, View, spread},
    report::{Finding, Report},
};
use crate::{
    sequence::{Manifest, SequenceError},
    statistics::median,
};
use rayon::prelude::*;
use readings::{CANONICAL, readings, rescaled};
use serde_json::json;

/// Frames that are measured.
const MAX_FRAMES: usize = 16;
/// Shifts that are found worse than this, in pixels, tell nothing.
pub const MAX_SIGMA: f64 = 0.12;
/// A misfit that is no mistake.
const FITS: f64 = 0.07;
/// An offset between input and reference that is one. Bright things much thinner than a pixel, lit from one side, are found
/// up to 0.2 px beside their mean in images that are right.
const OFFSET: f64 = 0.22;

/// A misfit of every reading that is a mistake, in pixels.
const UNEXPLAINED: f64 = 0.15;
/// A mean jitter, in pixels, that is a mistake.
const MEAN: f64 = 0.15;

/// The shift of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Position in the sequence.
    pub index: usize,
    /// Where the samples lie, or between two frames by how much they moved.
    pub shift: Shift,
}

/// Measures each frame against its guide.
pub fn measure(belief: &Belief, frames: &[usize]) -> Result<Vec<Measured>, SequenceError> {
    let found = frames
        .par_iter()
        .map(|&index| {
            let view = View::load(&belief.sequence, index, belief.guide, belief.tone)?;
            Ok(against_guide(belief, &view, index).map(|shift| Measured { index, shift }))
        })
        .collect::<Result<Vec<_>, SequenceError>>()?;
    Ok(found.into_iter().flatten().collect())
}

fn against_guide(belief: &Belief, view: &View, index: usize) -> Option<Shift> {
    let guide = view.guide.as_ref()?;
    let grid = Grid::new(&belief.sequence, index);
    let pixels = grid.pixels();
    let [sx, sy] = view.scale;
    let residual = |i: usize, d: [f64; 2]| {
        let [x, y] = pixels[i];
        let position = [(x as f64 + 0.5 + d[0]) * sx, (y as f64 + 0.5 + d[1]) * sy];
        let (value, slope) = guide.spline(position)?;
        let error = view.input.at(x, y) - value;
        error.is_finite().then_some((error, [slope[0] * sx, slope[1] * sy]))
    };
    fit::shift(pixels.len(), N_TILES, |i| grid.tile_of(pixels[i]), residual, [0.0; 2])
}

/// How far a reading is from what was measured, with the constant offset that fits best.
#[derive(Clone, Copy, Debug)]
pub struct Misfit {
    pub rms: f64,
    /// What three of four frames stay within.
    pub most: f64,
    pub offset: [f64; 2],
}

pub fn misfit(measured: &[Measured], expected: impl Fn(usize) -> Option<[f64; 2]>, free_offset: bool) -> Misfit {
    let residuals: Vec<[f64; 2]> = measured
        .iter()
        .filter_map(|frame| {
            let expected = expected(frame.index)?;
            Some([frame.shift.by[0] - expected[0], frame.shift.by[1] - expected[1]])
        })
        .collect();
    let mut offset = [0.0; 2];
    if free_offset {
        for (axis, offset) in offset.iter_mut().enumerate() {
            *offset = median(&residuals.iter().map(|r| r[axis]).collect::<Vec<_>>());
        }
    }
    // The median of squares: a frame that is a mistake of its own must not decide about all.
    let mut squares: Vec<f64> = residuals
        .iter()
        .map(|r| (r[0] - offset[0]).powi(2) + (r[1] - offset[1]).powi(2))
        .collect();
    squares.sort_by(f64::total_cmp);
    let most = squares.get((3 * squares.len()).div_ceil(4).saturating_sub(1));
    Misfit {
        rms: median(&squares).sqrt(),
        most: most.map_or(f64::NAN, |square| square.sqrt()),
        offset,
    }
}

/// Frames of the guide case: measures, names what fits, and believes it.
pub fn examine(belief: &mut Belief, report: &mut Report) -> Result<(), SequenceError> {
    pattern(belief, report);
    if belief.guide == Guide::Color {
        return Ok(());
    }
    let frames = spread(belief.sequence.n_frames(), MAX_FRAMES);
    let mut measured = measure(belief, &frames)?;
    measured.retain(|frame| frame.shift.sigma.iter().all(|sigma| *sigma < MAX_SIGMA));
    let guide = belief.guide.name();
    if measured.len() < 2 {
        report.cannot_tell(
            "jitter",
            format!("too little detail to measure the shift between colour and {guide}"),
        );
        return Ok(());
    }
    if let Some(left_over) = judge(
        belief,
        report,
        &measured,
        |reading, manifest, index| reading.jitter_px(manifest, index),
        true,
    ) {
        offset_finding(belief, report, left_over, &measured);
    }
    Ok(())
}

/// All readings, and how far each is from what was measured.
struct Judged {
    readings: Vec<Reading>,
    misfits: Vec<Misfit>,
    best: usize,
    /// That of no jitter at all.
    none: Misfit,
    /// A misfit that the measurement itself may have.
    fits: f64,
    first: Measured,
    n_measured: usize,
}

impl Judged {
    fn new(
        manifest: &Manifest,
        measured: &[Measured],
        expected: impl Fn(&Reading, &Manifest, usize) -> Option<[f64; 2]>,
        free_offset: bool,
    ) -> Self {
        let mut readings = readings(manifest);
        let pairs: Vec<[[f64; 2]; 2]> = measured
            .iter()
            .filter_map(|frame| Some([frame.shift.by, expected(&readings[0], manifest, frame.index)?]))
            .collect();
        readings.extend(rescaled(manifest, &pairs));
        let misfits: Vec<Misfit> = readings
            .iter()
            .map(|reading| misfit(measured, |index| expected(reading, manifest, index), free_offset))
            .collect();
        let fits = FITS.max(3.0 * sigma(measured));
        Self {
            best: likeliest(&misfits, fits),
            none: misfit(measured, |_| Some([0.0; 2]), free_offset),
            fits,
            first: measured[0],
            n_measured: measured.len(),
            readings,
            misfits,
        }
    }

    fn declared(&self) -> Misfit {
        self.misfits[0]
    }

    /// Aliasing shifts an image by itself; what matters is that nothing fits better.
    fn declared_fits(&self) -> bool {
        let (declared, best) = (self.declared().rms, self.misfits[self.best].rms);
        declared <= self.fits || (declared <= 1.1 * best && declared <= 0.5 * self.none.rms)
    }

    fn another_fits(&self) -> bool {
        let best = self.misfits[self.best].rms;
        // What is fitted to the measurements fits them a little better in any case.
        let share = if self.readings[self.best].is_fitted() { 0.5 } else { 0.6 };
        // Of many readings of few frames, one has half of them near by chance.
        let holds = self.misfits[self.best].most <= self.fits.max(0.6 * self.none.most);
        holds && best <= share * self.declared().rms && best <= self.fits.max(0.5 * self.none.rms)
    }

    fn warning(&self, id: &str, message: String) -> Finding {
        Finding::warning(id, message)
            .with("misfit_declared_px", self.declared().rms)
            .with("misfit_without_jitter_px", self.none.rms)
            .with("frames", self.n_measured as f64)
    }

    fn absent(&self) -> Finding {
        let message = format!(
            "frames declare jitter, but their samples lie at the pixel centres: misfit {:.3} px declared, {:.3} px without",
            self.declared().rms,
            self.none.rms
        );
        self.warning("jitter.absent", message)
            .suggest("frames[].jitter", json!([0, 0]))
    }

    fn missing(&self, is_jittered: bool) -> Finding {
        let [x, y] = self.first.shift.by;
        let declare = match is_jittered {
            true => "all frames declare the same",
            false => "no frame declares",
        };
        let message = format!(
            "{declare} jitter, but samples move by {:.2} px from frame to frame; frame {} lies at ({x:.2}, {y:.2})",
            self.none.rms, self.first.index
        );
        self.warning("jitter.missing", message)
            .suggest("frames[].jitter", json!("what the engine moved the projection by"))
    }

    fn corrected(&self) -> Finding {
        let reading = &self.readings[self.best];
        let corrected = self.misfits[self.best].rms;
        let message = format!(
            "the jitter {}: misfit {:.3} px declared, {corrected:.3} px corrected",
            reading.says,
            self.declared().rms
        );
        let finding = self.warning(reading.id, message).with("misfit_corrected_px", corrected);
        reading.suggestions.iter().fold(finding, |finding, (field, value)| {
            finding.suggest(*field, value.clone())
        })
    }

    fn unexplained(&self, declared_px: [f64; 2]) -> Finding {
        let ([x, y], [dx, dy]) = (self.first.shift.by, declared_px);
        let message = format!(
            "the declared jitter does not fit the images in any sign, unit or order: misfit {:.3} px; frame {} is declared at \
             ({dx:.2}, {dy:.2}) and lies at ({x:.2}, {y:.2})",
            self.declared().rms,
            self.first.index
        );
        self.warning("jitter.unexplained", message)
            .with("misfit_best_px", self.misfits[self.best].rms)
    }
}

/// Of the readings that fit, the one whose samples lie least beside the declared grid: an offset is a mistake of its own. Else
/// the one with the least misfit.
fn likeliest(misfits: &[Misfit], fits: f64) -> usize {
    let beside = |misfit: &Misfit| misfit.rms.hypot(misfit.offset[0]).hypot(misfit.offset[1]);
    let fitting = (0..misfits.len()).filter(|&i| misfits[i].rms <= fits);
    fitting
        .min_by(|&a, &b| beside(&misfits[a]).total_cmp(&beside(&misfits[b])))
        .or_else(|| (0..misfits.len()).min_by(|&a, &b| misfits[a].rms.total_cmp(&misfits[b].rms)))
        .unwrap_or(0)
}

fn sigma(measured: &[Measured]) -> f64 {
    let sigmas = measured.iter().map(|m| m.shift.sigma[0].max(m.shift.sigma[1]));
    median(&sigmas.collect::<Vec<_>>())
}

/// Chooses among the readings by what was measured in at least one frame. Gives what is left by the one believed.
pub fn judge(
    belief: &mut Belief,
    report: &mut Report,
    measured: &[Measured],
    expected: impl Fn(&Reading, &Manifest, usize) -> Option<[f64; 2]>,
    free_offset: bool,
) -> Option<Misfit> {
    let judged = Judged::new(belief.manifest(), measured, expected, free_offset);
    let (declared, is_jittered) = (judged.declared(), belief.sequence.is_jittered());
    if judged.declared_fits() {
        if is_jittered {
            confirm(report, &judged.readings, &judged.misfits, judged.fits);
        } else {
            report.confirm("jitter");
        }
        return Some(declared);
    }
    if measured.len() < 3 {
        report.cannot_tell("jitter", "fewer than three frames could be measured");
        return None;
    }
    if belief.sequence.jitter_px.windows(2).all(|pair| pair[0] == pair[1]) {
        report.findings.retain(|finding| finding.id != "jitter.constant");
        report.findings.push(judged.missing(is_jittered));
        return None;
    }
    if judged.none.rms <= judged.fits && judged.misfits[judged.best].rms > 0.5 * judged.none.rms {
        report.findings.push(judged.absent());
        belief.change(|manifest| manifest.frames.iter_mut().for_each(|frame| frame.jitter = [0.0; 2]));
        return Some(judged.none);
    }
    if judged.another_fits() {
        report.findings.push(judged.corrected());
        believe(belief, &judged.readings[judged.best]);
        return Some(judged.misfits[judged.best]);
    }
    // A jitter that has nothing to do with the samples is further off than none at all.
    if declared.rms < UNEXPLAINED || declared.rms < 0.8 * judged.none.rms {
        let reason = format!(
            "samples lie {:.2} px from where the jitter says, and no other reading fits better",
            declared.rms
        );
        report.cannot_tell("jitter", reason);
        return Some(declared);
    }
    let declared_px = belief.sequence.jitter_px[judged.first.index];
    report.findings.push(judged.unexplained(declared_px));
    None
}

/// Fields of which every other reading fits worse are confirmed.
fn confirm(report: &mut Report, readings: &[Reading], misfits: &[Misfit], fits: f64) {
    for id in ["jitter.units", "jitter.meaning", "jitter.y"] {
        let mut others = readings
            .iter()
            .zip(misfits)
            .filter(|(reading, _)| reading.id == id)
            .peekable();
        if others.peek().is_none()
            || others.all(|(_, misfit)| misfit.rms > 1.5 * fits && misfit.rms > 1.5 * misfits[0].rms)
        {
            report.confirm(id);
        } else {
            report.cannot_tell(
                id,
                "the jitter is too small, or the images have too little detail, to tell",
            );
        }
    }
}

fn believe(belief: &mut Belief, reading: &Reading) {
    let manifest = belief.manifest();
    let by_reading = (0..manifest.frames.len()).map(|index| reading.jitter_px(manifest, index).unwrap_or_default());
    believe_px(belief, by_reading.collect());
}

fn believe_px(belief: &mut Belief, jitters_px: Vec<[f64; 2]>) {
    belief.change(|manifest| {
        manifest.jitter = Some(CANONICAL);
        for (frame, jitter) in manifest.frames.iter_mut().zip(jitters_px) {
            frame.jitter = jitter;
        }
    });
}

fn offset_finding(belief: &mut Belief, report: &mut Report, left_over: Misfit, measured: &[Measured]) {
    let offset = left_over.offset;
    let length = offset[0].hypot(offset[1]);
    // What thin things do to one frame is alike in all its tiles, and shows only between frames.
    let sigma = sigma(measured).max(left_over.rms) / (measured.len() as f64).sqrt();
    if length < OFFSET || length < 5.0 * sigma {
        report.confirm("grid");
        return;
    }
    let mean = mean(&belief.sequence.jitter_px);
    if (mean[0] + offset[0]).hypot(mean[1] + offset[1]) < 0.3 * length {
        leaning(belief, report, offset, sigma);
        return;
    }
    let what = belief.guide.name();
    let half = offset.iter().any(|axis| (axis.abs() - 0.5).abs() < 0.1);
    let hint = if half {
        ": half a pixel, as between pixel centres and corners; render both on the same grid"
    } else {
        "; render both with the same camera and grid"
    };
    let message = format!(
        "colour lies ({:.2}, {:.2}) px beside the {what}, jitter taken out{hint}",
        offset[0], offset[1]
    );
    report.findings.push(
        Finding::warning("grid.offset", message)
            .with("offset_x_px", offset[0])
            .with("offset_y_px", offset[1])
            .with("sigma_px", sigma),
    );
}

/// The finding of a jitter whose own mean is what lies between colour and reference.
fn leaning(belief: &mut Belief, report: &mut Report, offset: [f64; 2], sigma: f64) {
    let [x, y] = offset.map(|axis| -axis);
    report.findings.retain(|finding| finding.id != "jitter.mean");
    report.findings.push(
        Finding::warning(
            "jitter.offset",
            format!("every jitter declared is ({x:.2}, {y:.2}) px more than where samples lie, as where 0 to 1 was not made -0.5 to 0.5"),
        )
        .with("offset_x_px", x)
        .with("offset_y_px", y)
        .with("sigma_px", sigma)
        .suggest("frames[].jitter", json!(format!("minus ({x:.2}, {y:.2}) px"))),
    );
    let moved: Vec<[f64; 2]> = belief
        .sequence
        .jitter_px
        .iter()
        .map(|[jx, jy]| [jx - x, jy - y])
        .collect();
    believe_px(belief, moved);
}

fn mean(jitters: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|axis| jitters.iter().map(|jitter| jitter[axis]).sum::<f64>() / jitters.len() as f64)
}

/// What the numbers alone say: a jitter that never changes, or that leans to one side.
fn pattern(belief: &Belief, report: &mut Report) {
    let jitters = &belief.sequence.jitter_px;
    let mean = mean(jitters);
    if jitters.len() < 8 || !belief.sequence.is_jittered() {
        return;
    }
    let finding = if jitters.iter().all(|jitter| *jitter == jitters[0]) {
        let [x, y] = jitters[0];
        Finding::warning(
            "jitter.constant",
            format!("every frame has the same jitter, ({x:.3}, {y:.3}) px: nothing is gained over time"),
        )
    } else if mean.iter().any(|axis| axis.abs() > MEAN) {
        let [x, y] = mean;
        Finding::warning(
            "jitter.mean",
            format!(
                "the mean jitter is ({x:.2}, {y:.2}) px and should be 0, as where 0 to 1 was not made -0.5 to 0.5: results shift by it"
            ),
        )
    } else {
        return;
    };
    report
        .findings
        .push(finding.with("mean_x_px", mean[0]).with("mean_y_px", mean[1]));
}
