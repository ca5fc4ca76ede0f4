//! Every way to read the jitter.

use crate::sequence::{
    convention::jitter_px,
    manifest::{JitterConvention, JitterMeaning, JitterUnits, Manifest, YAxis},
};
use serde_json::{Value, json};

/// As frames have it once they are loaded.
pub const CANONICAL: JitterConvention = JitterConvention {
    units: JitterUnits::PixelsRender,
    meaning: JitterMeaning::SampleOffset,
    y: YAxis::Down,
};

/// Another reading of the jitter.
pub struct Reading {
    /// Id of the finding.
    pub id: &'static str,
    /// What is wrong, to go after "the jitter".
    pub says: String,
    convention: JitterConvention,
    swapped: bool,
    factor: f64,
    /// Added in pixels, and what leaves the pixel comes in at its other side.
    wrapped_px: [f64; 2],
    lag: isize,
    pub suggestions: Vec<(&'static str, Value)>,
}

impl Reading {
    pub fn declared(convention: JitterConvention) -> Self {
        Self {
            id: "",
            says: String::new(),
            convention,
            swapped: false,
            factor: 1.0,
            wrapped_px: [0.0; 2],
            lag: 0,
            suggestions: Vec::new(),
        }
    }

    /// The jitter of a frame in pixels by this reading; none beyond the sequence.
    pub fn jitter_px(&self, manifest: &Manifest, index: usize) -> Option<[f64; 2]> {
        let entry = manifest.frames.get(index.checked_add_signed(self.lag)?)?;
        let [x, y] = entry.jitter;
        let stored = if self.swapped { [y, x] } else { [x, y] };
        let jitter = jitter_px(self.convention, stored, manifest.render_size);
        Some([0, 1].map(|axis| match self.wrapped_px[axis] {
            0.0 => jitter[axis] * self.factor,
            moved => {
                let at = jitter[axis] * self.factor + moved;
                at - at.round()
            }
        }))
    }

    /// Whether its size was fitted to what was measured, and is not one that people choose.
    pub fn is_fitted(&self) -> bool {
        libm::log2(self.factor).fract() != 0.0
    }

    fn is_possible(&self, manifest: &Manifest) -> bool {
        (0..manifest.frames.len()).all(|index| {
            let jitter = self.jitter_px(manifest, index);
            jitter.is_none_or(|jitter| jitter.iter().all(|axis| axis.abs() <= 0.51))
        })
    }
}

/// Every reading that is looked at; the first is the one declared.
pub fn readings(manifest: &Manifest) -> Vec<Reading> {
    let declared = manifest.jitter.unwrap_or(CANONICAL);
    let (meaning, meaning_name) = match declared.meaning {
        JitterMeaning::SampleOffset => (JitterMeaning::ProjectionOffset, "projection_offset"),
        JitterMeaning::ProjectionOffset => (JitterMeaning::SampleOffset, "sample_offset"),
    };
    let (y, y_name) = match declared.y {
        YAxis::Down => (YAxis::Up, "up"),
        YAxis::Up => (YAxis::Down, "down"),
    };
    let signs = [
        ("", "", declared, Vec::new()),
        (
            "jitter.meaning",
            "has the wrong sign",
            JitterConvention { meaning, ..declared },
            vec![("jitter.meaning", json!(meaning_name))],
        ),
        (
            "jitter.y",
            "has y flipped",
            JitterConvention { y, ..declared },
            vec![("jitter.y", json!(y_name))],
        ),
        (
            "jitter.x",
            "has x flipped",
            JitterConvention { meaning, y, ..declared },
            vec![("jitter.meaning", json!(meaning_name)), ("jitter.y", json!(y_name))],
        ),
    ];
    let mut all = Vec::new();
    for swapped in [false, true] {
        for (id, says, convention, suggestions) in &signs {
            let mut reading = Reading {
                id,
                says: (*says).to_owned(),
                swapped,
                suggestions: suggestions.clone(),
                ..Reading::declared(*convention)
            };
            if swapped {
                (reading.id, reading.says) = ("jitter.axes", "has x and y swapped".to_owned());
                reading.suggestions.push(("frames[].jitter", json!("[y, x]")));
            }
            all.push(reading);
        }
    }
    all.extend(other_units(declared));
    for (wrapped_px, axes) in [([0.5, 0.0], "x"), ([0.0, 0.5], "y"), ([0.5, 0.5], "x and y")] {
        all.push(Reading {
            id: "jitter.offset",
            says: format!("is half a pixel off along {axes}, wrapped around"),
            wrapped_px,
            suggestions: vec![(
                "frames[].jitter",
                json!(format!("half a pixel more or less along {axes}, within half a pixel")),
            )],
            ..Reading::declared(declared)
        });
    }
    for (lag, says) in [(-1, "is that of the frame before"), (1, "is that of the frame after")] {
        all.push(Reading {
            id: "jitter.frame",
            says: says.to_owned(),
            lag,
            suggestions: vec![("frames[].jitter", json!(format!("of frame index{lag:+}")))],
            ..Reading::declared(declared)
        });
    }
    // The one declared stays, so that it can be judged.
    let mut first = true;
    all.retain(|reading| std::mem::take(&mut first) || reading.is_possible(manifest));
    all
}

/// The size that fits what was measured, beside its mean; none where the jitter has about that size.
pub fn rescaled(manifest: &Manifest, pairs: &[[[f64; 2]; 2]]) -> Option<Reading> {
    let declared = Reading::declared(manifest.jitter?);
    let n = pairs.len() as f64;
    let mean = |which: usize, axis: usize| pairs.iter().map(|pair| pair[which][axis]).sum::<f64>() / n;
    let (mut both, mut own) = (0.0, 0.0);
    for axis in 0..2 {
        let means = [mean(0, axis), mean(1, axis)];
        for [measured, expected] in pairs.iter().map(|pair| pair.map(|of| of[axis])) {
            both += (measured - means[0]) * (expected - means[1]);
            own += (expected - means[1]).powi(2);
        }
    }
    let fitted = both / own;
    if !(0.05..=20.0).contains(&fitted) || (0.8..=1.25).contains(&fitted) {
        return None;
    }
    // Powers of two are likelier than what is beside them, and a few frames tell a size to a tenth or two.
    let octaves = libm::log2(fitted);
    let factor = if (octaves - octaves.round()).abs() < 0.25 {
        libm::exp2(octaves.round())
    } else {
        (fitted * 100.0).round() / 100.0
    };
    let reading = Reading {
        id: "jitter.scale",
        says: format!("is {:.2} times what it should be", 1.0 / factor),
        factor,
        suggestions: vec![("frames[].jitter", json!(format!("times {factor}")))],
        ..declared
    };
    reading.is_possible(manifest).then_some(reading)
}

/// Other units.
fn other_units(declared: JitterConvention) -> Vec<Reading> {
    let mut all = Vec::new();
    for (units, name) in [
        (JitterUnits::PixelsRender, "pixels_render"),
        (JitterUnits::Uv, "uv"),
        (JitterUnits::Ndc, "ndc"),
    ] {
        if units == declared.units {
            continue;
        }
        all.push(Reading {
            id: "jitter.units",
            says: "has other units".to_owned(),
            suggestions: vec![("jitter.units", json!(name))],
            ..Reading::declared(JitterConvention { units, ..declared })
        });
    }
    all
}
