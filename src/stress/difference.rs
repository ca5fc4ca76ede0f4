//! How far the adapter is from the twin, and whether what it left is in order.

use super::{device::Left, scenario::DISPLAY};
use crate::{
    image::Image,
    sequence::frame::Rgb,
    taa::{
        Precision, Recipe,
        recipe::{Domain, InputFilter, Weight},
        reference::color::Color,
    },
};
use std::collections::HashSet;

/// Contract, section 5: the largest difference in f32, display units.
pub const TOLERANCE: f64 = 2e-3;
/// The same where moments are prefiltered.
const TOLERANCE_PREFILTERED: f64 = 4e-3;
/// The share of pixels in which a decision may fall otherwise.
pub const SHARE: f64 = 5e-4;

/// Linear colour on a display: the range is 1.
pub fn display(linear: f64) -> f64 {
    if linear == f64::INFINITY {
        1.0
    } else {
        linear / (1.0 + linear.abs())
    }
}

/// The distance of neighbouring numbers at `value`.
pub fn ulp(value: f64, precision: Precision) -> f64 {
    let (digits, smallest) = match precision {
        Precision::F16 => (10, -14),
        Precision::F32 => (23, -126),
    };
    let (_, exponent) = libm::frexp(value.abs());
    libm::ldexp(1.0, (exponent - 1).max(smallest) - digits)
}

/// The smallest weight that a recipe gives the current colour, where it has one.
pub fn smallest_weight(recipe: &Recipe) -> Option<f64> {
    match recipe.weight {
        Weight::Fixed if recipe.input_filter == InputFilter::Upsample => Some(recipe.current_weight * 0.3),
        Weight::Fixed => Some(recipe.current_weight),
        Weight::LumaFeedback => Some(1.0 - recipe.luma_feedback_hi),
        Weight::Antiflicker => Some(0.04),
        Weight::Count | Weight::Amortized => None,
    }
}

/// How far adapter and twin may be apart: in f16 they may round to neighbouring steps, whose sum over frames is 2⁻¹¹ / weight.
pub fn tolerance(recipe: &Recipe, precision: Precision) -> f64 {
    let of_f32 = if recipe.prefilter_moments {
        TOLERANCE_PREFILTERED
    } else {
        TOLERANCE
    };
    match recipe.precision(precision) {
        Precision::F32 => of_f32,
        Precision::F16 => of_f32.max(libm::ldexp(1.0, -11) / smallest_weight(recipe).unwrap_or(0.025)),
    }
}

/// One frame against the twin's.
#[derive(Clone, Debug, Default)]
pub struct Difference {
    /// The largest of all pixels, display units.
    pub max: f64,
    /// In steps of the precision.
    pub max_ulps: f64,
    /// The pixel of `max`.
    pub worst: [u32; 2],
    /// Pixels beyond the tolerance.
    pub n_beyond: usize,
    pub n_pixels: usize,
}

/// How a display shows a linear colour: through x / (1 + x). Where that is the recipe's own domain, its divisor is that of the
/// largest channel: the other two are known to no more digits than it is.
pub fn displayed(linear: [f64; 3], domain: Domain) -> [f64; 3] {
    match domain {
        Domain::Tonemapped if linear.iter().all(|c| *c >= 0.0 && c.is_finite()) => {
            let largest = linear[0].max(linear[1]).max(linear[2]);
            linear.map(|c| c / (1.0 + largest))
        }
        _ => linear.map(display),
    }
}

/// How frames are compared.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    pub domain: Domain,
    pub precision: Precision,
    /// Display units.
    pub tolerance: f64,
}

impl Measure {
    pub fn of(recipe: &Recipe, precision: Precision) -> Self {
        Self {
            domain: recipe.domain,
            precision: recipe.precision(precision),
            tolerance: tolerance(recipe, precision),
        }
    }
}

/// Compares what is shown.
pub fn shown(found: &Image<Rgb>, expected: &Image<[f64; 3]>, measure: Measure) -> Difference {
    let Measure {
        domain,
        precision,
        tolerance,
    } = measure;
    let width = found.extent().width as usize;
    let mut difference = Difference {
        n_pixels: found.pixels().len(),
        ..Difference::default()
    };
    for (i, (a, b)) in found.pixels().iter().zip(expected.pixels()).enumerate() {
        let (mut of_pixel, mut ulps) = (0.0_f64, 0.0_f64);
        let a = a.map(f64::from);
        let shown = [displayed(a, domain), displayed(*b, domain)];
        for channel in 0..3 {
            let (a, b) = (a[channel], b[channel]);
            if a == b {
                continue;
            }
            let d = (shown[0][channel] - shown[1][channel]).abs();
            let distance = (a - b).abs() / ulp(b, precision);
            of_pixel = of_pixel.max(if d.is_nan() { f64::INFINITY } else { d });
            ulps = ulps.max(if distance.is_nan() { f64::INFINITY } else { distance });
        }
        difference.max_ulps = difference.max_ulps.max(ulps);
        difference.n_beyond += usize::from(of_pixel > tolerance);
        if of_pixel > difference.max {
            difference.max = of_pixel;
            difference.worst = [(i % width) as u32, (i / width) as u32];
        }
    }
    difference
}

/// Distinct values in a frame from which on their roundings cancel.
const MANY_COLORS: usize = 100;

/// Signed differences of stored history from the twin's, in steps of f16: what truncates lies below on average.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bias {
    sum: f64,
    n: usize,
}

impl Bias {
    /// Adds a frame. `kept` is RGBA, of which `pixel` chooses. A frame of few colours says nothing: each is rounded to one side.
    pub fn add(&mut self, kept: &[f32], expected: &Image<Color<f64>>, pixel: impl Fn(usize) -> bool) {
        let distinct: HashSet<u32> = kept.iter().map(|v| v.to_bits()).take(4096).collect();
        if distinct.len() < MANY_COLORS {
            return;
        }
        for (i, (rgba, b)) in kept.chunks_exact(4).zip(expected.pixels()).enumerate() {
            for (a, b) in rgba.iter().zip(b.0) {
                // Denormals have no digits to lose.
                if b > 6.2e-5 && pixel(i) {
                    // A decision that fell otherwise must not count as rounding.
                    let steps = ((f64::from(*a) - b) / ulp(b, Precision::F16)).clamp(-4.0, 4.0);
                    self.sum += if steps.is_nan() { 0.0 } else { steps };
                    self.n += 1;
                }
            }
        }
    }

    /// Steps; 0 of nothing.
    pub fn mean(self) -> f64 {
        self.sum / (self.n as f64).max(1.0)
    }
}

/// Whether stored history is the nearest f16 to what was shown: exactly in linear, and but for the tone map's own rounding there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rounding {
    n_wrong: usize,
    n: usize,
}

impl Rounding {
    /// Adds a frame of a recipe that shows what it stores.
    pub fn add(&mut self, kept: &[f32], shown: &Image<Rgb>, domain: Domain) {
        for (rgba, linear) in kept.chunks_exact(4).zip(shown.pixels()) {
            let computed = Color(linear.map(f64::from)).to_domain(domain, &DISPLAY);
            // Brighter colours than the tone map's inverse can show are not known, and near its end few digits of them are.
            let (known, allowed) = match domain {
                Domain::Linear => (f64::INFINITY, 0.501),
                Domain::Tonemapped => (0.99, 0.501),
                Domain::Display => (0.95, 0.51),
            };
            if computed.max3() > known {
                continue;
            }
            for (a, b) in rgba.iter().zip(computed.0) {
                if b > 6.2e-5 && b < 65504.0 {
                    self.n += 1;
                    let steps = (f64::from(*a) - b).abs() / ulp(b, Precision::F16);
                    self.n_wrong += usize::from(steps > allowed);
                }
            }
        }
    }

    /// The share of values that are not the nearest.
    pub fn wrong(self) -> f64 {
        self.n_wrong as f64 / (self.n as f64).max(1.0)
    }
}

/// The largest difference of stored history from the twin's, in steps of f32 at the pixel's brightest channel.
pub fn lost_digits(kept: &[f32], expected: &Image<Color<f64>>) -> f64 {
    let pixels = kept.chunks_exact(4).zip(expected.pixels());
    let steps = pixels.map(|(rgba, b)| {
        let step = ulp(b.max3(), Precision::F32);
        let of_channel = rgba.iter().zip(b.0).map(|(a, b)| (f64::from(*a) - b).abs() / step);
        of_channel.fold(0.0, f64::max)
    });
    steps.fold(0.0, f64::max)
}

/// What is wrong with what a frame left, if anything.
pub fn disorder(left: &Left) -> Option<String> {
    let is_finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
    if let Some((name, _)) = left.kept.iter().find(|(_, values)| !is_finite(values)) {
        return Some(format!("stores a value in `{name}` that is not finite"));
    }
    if !left.shown.pixels().iter().all(|pixel| is_finite(pixel)) {
        return Some("shows a value that is not finite".to_owned());
    }
    for (name, values) in &left.kept {
        let limit = match *name {
            // Its trace is bounded by 4·1000, and no element of what is positive is larger than that.
            "covariances" => 4.0 * 1000.0 * 1.001,
            "samples" => f32::MAX,
            _ => 65504.0,
        };
        // Beside a running mean stands of how many samples it is: as many as there were frames.
        let is_count = |i: usize| *name == "mean" && i % 4 == 3;
        let too_large = |&(i, v): &(usize, &f32)| v.abs() > limit && !is_count(i);
        if let Some((_, large)) = values.iter().enumerate().find(too_large) {
            return Some(format!("stores {large:e} in `{name}`, beyond its limit of {limit}"));
        }
    }
    None
}

/// Whether the inverse of the tone map ends where it should. For colours of the domain up to 1 that is 2047; a box in YCoCg,
/// or a mean with a deviation, may hold some that are larger, which the twin then shows, too. No display tells them apart.
pub fn blown(found: &Image<Rgb>, expected: &Image<[f64; 3]>, domain: Domain) -> Option<String> {
    let brightest = |largest: f64, v: f64| largest.max(v.abs());
    let found = found
        .pixels()
        .iter()
        .flatten()
        .fold(0.0, |largest, v| brightest(largest, f64::from(*v)));
    let expected = expected.pixels().iter().flatten().copied().fold(2048.0, brightest);
    let is_blown = domain == Domain::Tonemapped && found > 1.01 * expected;
    is_blown.then(|| format!("shows {found:.0}, where the tone map's inverse should end at {expected:.0}"))
}

/// A value of history as a display shows it.
pub fn display_of_history(value: f32, domain: Domain) -> f64 {
    match domain {
        Domain::Linear => display(f64::from(value)),
        _ => f64::from(value),
    }
}
