//! One cell: a scenario on the adapter and in the twin, and what is to be said of both.

use super::{
    device::{CellError, Device, Left},
    difference::{self, Bias, Difference, Measure, Rounding, SHARE, smallest_weight, tolerance},
    endurance::endure,
    findings::Findings,
    growth::{self, Trend},
    pictures::{Picture, Pictures},
    probes,
    report::{Bound, Verdict},
    scenario::{Asks, Scenario, Segment},
};
use crate::{
    hex::hex,
    image::Image,
    sequence::Frame,
    taa::{
        Precision, Recipe,
        recipe::{Algorithm, Domain, Guards, HistoryFilter, Rectify, Sharpen, Space},
        reference::Twin,
    },
};

/// Runs a scenario.
pub fn run(
    device: Device<'_>,
    scenario: &Scenario,
    every_frame: bool,
) -> Result<(Findings, Option<Pictures>), CellError> {
    match &scenario.asks {
        Asks::Endurance { period } => endurance(device, scenario, *period, every_frame),
        _ => frame_by_frame(device, scenario),
    }
}

/// Error of one frame is negligible below this: a step of f32 in the middle of the display's range.
const NEGLIGIBLE: f64 = 1e-6;

fn frame_by_frame(device: Device<'_>, scenario: &Scenario) -> Result<(Findings, Option<Pictures>), CellError> {
    let mut findings = Findings::default();
    let mut pictures = None;
    let mut totals = Totals::default();
    let mut first_of_segment = 0;
    for segment in &scenario.segments {
        let all = device.resolve(segment, |index| (segment.frames)(index))?;
        let mut truth = Truth::new(device, segment);
        let mut expected = Vec::with_capacity(all.len());
        let mut worst = None;
        for (index, left) in all.iter().enumerate() {
            device.go_on()?;
            let Followed { twin, shown: of_twin } = truth.at(index, &mut totals);
            let frame = first_of_segment + index;
            let blown = || difference::blown(&left.shown, of_twin, device.recipe.domain);
            if let Some(message) = difference::disorder(left).or_else(blown) {
                findings.add(Verdict::Fails, Some(frame), message);
            }
            let of_frame = totals.add(device, left, of_twin, twin);
            if findings.note_error(frame, &of_frame) {
                worst = Some((index, of_frame.worst));
            }
            expected.push(of_twin.map(|c| c.map(|c| c as f32)));
        }
        if let Some((index, pixel)) = worst {
            let picture = |index: usize| Picture {
                frame: first_of_segment + index,
                found: all[index].shown.clone(),
                expected: expected[index].clone(),
            };
            let disturbed = match scenario.asks {
                Asks::Recovery { frame, .. } => Some(frame),
                _ => None,
            };
            pictures = Some(Pictures::around(pixel, index, disturbed, all.len(), picture));
        }
        probes::ask(device, scenario, segment, &all, &mut findings)?;
        if let Some(last) = all.last() {
            findings.digest = digest(last);
        }
        first_of_segment += segment.n_frames;
    }
    findings.n_frames = first_of_segment;
    totals.judge(device, scenario, &mut findings)?;
    findings.growth = growth::fit(&findings.errors, NEGLIGIBLE);
    if let Some(growth) = findings.growth.filter(|growth| growth.trend == Trend::Exponential)
        && findings.max > 10.0 * tolerance(device.recipe, device.precision)
    {
        let words = format!("the error grows by a factor of e^{:.2e} a frame", growth.rate);
        let (verdict, why) = match rounding_decides(device, scenario, totals.n_beyond as f64 / totals.n_pixels as f64)?
        {
            true => (Verdict::Degrades, ROUNDING_DECIDES),
            false => (Verdict::Fails, ""),
        };
        findings.add(verdict, None, words + why);
    }
    Ok((findings, pictures))
}

/// The twin's images, frame by frame.
struct Truth<'a> {
    device: Device<'a>,
    segment: &'a Segment,
    twin: Twin<f64>,
    /// After the last even and the last odd frame.
    last_two: [Option<Followed>; 2],
    has_settled: bool,
}

/// The twin after a frame, and what it showed.
struct Followed {
    twin: Twin<f64>,
    shown: Image<[f64; 3]>,
}

impl<'a> Truth<'a> {
    fn new(device: Device<'a>, segment: &'a Segment) -> Self {
        Self {
            device,
            segment,
            twin: Twin::new(device.recipe.clone(), device.precision),
            last_two: [None, None],
            has_settled: false,
        }
    }

    /// The twin after the next frame, `index`. Once it has settled it is not asked again.
    fn at(&mut self, index: usize, totals: &mut Totals) -> &Followed {
        let last = &mut self.last_two[index % 2];
        if !self.has_settled {
            let input = self.segment.frame(index, self.device.recipe);
            totals.note_brightest(&input);
            let shown = self.twin.resolve(&input).shown;
            let is_as_before = |before: &Followed| before.twin.is_in_the_state_of(&self.twin);
            self.has_settled = self
                .segment
                .has_settled(index + 1, |_, _| last.as_ref().is_some_and(is_as_before));
            *last = Some(Followed {
                twin: self.twin.clone(),
                shown,
            });
        }
        last.as_ref().expect("a settled twin has seen both")
    }
}

const ROUNDING_DECIDES: &str = " (so does a twin in f32: what the system decides, rounding turns the other way)";

/// Whether a good part of the `share` of pixels beyond the tolerance is so without the adapter: between twins in f32 and f64, which
/// share all code. No excuse for a literal formula, whose lost digits are what is to be shown.
fn rounding_decides(device: Device<'_>, scenario: &Scenario, share: f64) -> Result<bool, CellError> {
    if device.recipe.guards == Guards::Off {
        return Ok(false);
    }
    let measure = Measure::of(device.recipe, device.precision);
    let (mut n_beyond, mut n_pixels) = (0, 0);
    for segment in &scenario.segments {
        let mut exact = Twin::<f64>::new(device.recipe.clone(), device.precision);
        let mut rounded = Twin::<f32>::new(device.recipe.clone(), device.precision);
        for index in 0..segment.n_frames {
            device.go_on()?;
            let input = segment.frame(index, device.recipe);
            let expected = exact.resolve(&input).shown;
            let of_frame = difference::shown(&rounded.resolve(&input).shown, &expected, measure);
            n_beyond += of_frame.n_beyond;
            n_pixels += of_frame.n_pixels;
        }
    }
    Ok(n_beyond as f64 > (0.25 * share).max(SHARE) * n_pixels as f64)
}

/// SHA-256 of the bits shown.
fn digest(left: &Left) -> String {
    use sha2::Digest;
    let mut hash = sha2::Sha256::new();
    hash.update(bytemuck::cast_slice::<_, u8>(left.shown.pixels()));
    hex(&hash.finalize())
}

/// Sums over all frames of a cell.
#[derive(Default)]
struct Totals {
    n_beyond: usize,
    n_pixels: usize,
    bias: Bias,
    rounding: Rounding,
    /// Steps of f32, of history that is not rounded.
    lost_digits: f64,
    /// The largest colour of all input, repaired.
    brightest: f64,
}

/// Whether nothing happens to a colour between history and the image shown.
fn shows_what_it_stores(recipe: &Recipe) -> bool {
    let is_shown = matches!(recipe.algorithm, Algorithm::Temporal | Algorithm::Checkerboard);
    is_shown && recipe.sharpen == Sharpen::None && !recipe.motion_blur
}

impl Totals {
    fn note_brightest(&mut self, input: &Frame) {
        let colors = input.color.pixels().iter().flatten();
        // As `max` has it, NaN is nothing.
        self.brightest = colors.fold(self.brightest, |largest, c| largest.max(f64::from(c.min(65504.0))));
    }

    fn add(&mut self, device: Device<'_>, left: &Left, expected: &Image<[f64; 3]>, twin: &Twin<f64>) -> Difference {
        let measure = Measure::of(device.recipe, device.precision);
        let of_frame = difference::shown(&left.shown, expected, measure);
        self.n_beyond += of_frame.n_beyond;
        self.n_pixels += of_frame.n_pixels;
        match (measure.precision, left.kept.first(), twin.history()) {
            (Precision::F16, Some((_, kept)), Some(history)) => {
                self.bias.add(kept, history, |_| true);
                if shows_what_it_stores(device.recipe) {
                    self.rounding.add(kept, &left.shown, measure.domain);
                }
            }
            (Precision::F32, Some((_, kept)), Some(history)) => {
                self.lost_digits = self.lost_digits.max(difference::lost_digits(kept, history));
            }
            _ => {}
        }
        of_frame
    }

    fn judge(&self, device: Device<'_>, scenario: &Scenario, findings: &mut Findings) -> Result<(), CellError> {
        judge_bias(self.bias, findings);
        let wrong = self.rounding.wrong();
        if wrong > 0.01 {
            let message = format!(
                "{:.0} % of stored history is not the nearest f16 to what was computed: the store does not round to nearest",
                100.0 * wrong
            );
            findings.add(Verdict::Fails, None, message);
        }
        if let Asks::Digits { ulps } = scenario.asks
            && self.lost_digits > ulps
        {
            let message = format!(
                "history is {:.0} steps of f32 from the twin's, more than {ulps}",
                self.lost_digits
            );
            findings.add(Verdict::Fails, None, message);
        }
        // Order is a question of bits, not of digits.
        if matches!(scenario.asks, Asks::Order(_)) {
            return Ok(());
        }
        // Of a disturbance only what it touches can go wrong.
        let n_pixels = match scenario.asks {
            Asks::Recovery {
                area: [first, last], ..
            } => {
                let reach = 2 * probes::reach(device.recipe);
                let n_texels = (last[0] - first[0] + reach) * (last[1] - first[1] + reach);
                let segment = &scenario.segments[0];
                let scale = segment.sizes.output.width / segment.sizes.render.width;
                self.n_pixels
                    .min((n_texels * scale * scale) as usize * segment.n_frames)
            }
            _ => self.n_pixels,
        };
        // What spreads is more than what was touched.
        let share = (self.n_beyond as f64 / (n_pixels as f64).max(1.0)).min(1.0);
        let limit = tolerance(device.recipe, device.precision);
        let words = format!(
            "{:.2} % of the pixels differ from the twin by more than {limit:.1e}",
            100.0 * share
        );
        // A single pixel is no share.
        if self.n_beyond > 1 && share > SHARE {
            // A channel of YCoCg holds the brightest and the darkest around a pixel, in linear to a few steps of the brightest.
            let in_linear_ycocg = device.recipe.domain == Domain::Linear && device.recipe.space == Space::Ycocg;
            let is_lost_digits = in_linear_ycocg && findings.max <= 8.0 * libm::ldexp(self.brightest, -23);
            let (verdict, why) = match share > 0.02 {
                _ if is_lost_digits => (
                    Verdict::Degrades,
                    " (the system boxes linear colours in YCoCg: beside the brightest, f32 loses the digits of the dark)",
                ),
                true if rounding_decides(device, scenario, share)? => (Verdict::Degrades, ROUNDING_DECIDES),
                true => (Verdict::Fails, ""),
                false => (Verdict::Degrades, ""),
            };
            findings.add(verdict, None, words + why);
        }
        Ok(())
    }
}

/// Rounding to nearest has no bias; truncating has that of half a step.
fn judge_bias(bias: Bias, findings: &mut Findings) {
    let steps = bias.mean();
    if steps.abs() > 0.25 {
        let side = if steps < 0.0 { "below" } else { "above" };
        let message = format!(
            "stored history lies {:.2} steps of f16 {side} the twin's on average: the store does not round to nearest",
            steps.abs()
        );
        findings.add(Verdict::Fails, None, message);
    }
}

fn endurance(
    device: Device<'_>,
    scenario: &Scenario,
    period: usize,
    every_frame: bool,
) -> Result<(Findings, Option<Pictures>), CellError> {
    let segment = &scenario.segments[0];
    let endured = endure(device, segment, period, every_frame)?;
    let precision = device.recipe.precision(device.precision);
    let mut findings = Findings::default();
    for (frame, error) in &endured.errors {
        findings.note_error(*frame, error);
    }
    findings.n_frames = endured.n_frames;
    if let Some((frame, message)) = &endured.disorder {
        findings.add(Verdict::Fails, Some(*frame), message.clone());
    }
    findings.growth = growth::fit(&findings.errors, NEGLIGIBLE);
    judge_bias(endured.bias, &mut findings);
    let limit = tolerance(device.recipe, device.precision);
    if endured.rounded.max > limit {
        let message = format!(
            "differs by {:.1e} from a twin that rounds alike, more than {limit:.1e}",
            endured.rounded.max
        );
        findings.add(Verdict::Fails, None, message);
    }
    findings.bound = drift_bound(device, precision, findings.max, endured.n_frames);
    match (&findings.bound, findings.growth.map(|growth| growth.trend)) {
        (Some(bound), _) if bound.measured > bound.value.max(2e-3) => {
            let message = format!(
                "drifts by {:.1e}, beyond {} = {:.1e}",
                bound.measured, bound.formula, bound.value
            );
            // What theory bounds is a plain blend; a box may decide otherwise of a rounded history than of an exact one.
            let is_plain = device.recipe.rectify == Rectify::None;
            let far = is_plain || bound.measured > 8.0 * bound.value;
            findings.add(if far { Verdict::Fails } else { Verdict::Degrades }, None, message);
        }
        (None, Some(Trend::Exponential)) => {
            findings.add(Verdict::Fails, None, "the error grows exponentially".to_owned());
        }
        (None, _) if findings.max > limit => {
            let message = format!("differs by {:.1e} from a twin that never rounds history", findings.max);
            findings.add(Verdict::Degrades, None, message);
        }
        _ => {}
    }
    if let Some(frame) = endured.repeats_from {
        findings.remark(format!("the state repeats from frame {frame} on"));
    }
    Ok((findings, endured.pictures()))
}

/// How far rounding may carry history away, by theory.
fn drift_bound(device: Device<'_>, precision: Precision, measured: f64, n_frames: usize) -> Option<Bound> {
    let recipe = device.recipe;
    if recipe.guards == Guards::Off || recipe.history_filter == HistoryFilter::None {
        return None;
    }
    let (value, formula) = match (smallest_weight(recipe), precision) {
        _ if recipe.algorithm != Algorithm::Temporal => return None,
        (Some(weight), Precision::F16) => (libm::ldexp(1.0, -11) / weight, format!("2⁻¹¹ / {weight:.3}")),
        (Some(weight), Precision::F32) => (libm::ldexp(1.0, -23) / weight, format!("2⁻²³ / {weight:.3}")),
        (None, Precision::F32) => (libm::ldexp(1.0, -24) * n_frames as f64, "2⁻²⁴ N".to_owned()),
        (None, Precision::F16) => return None,
    };
    Some(Bound {
        value,
        formula,
        measured,
    })
}
