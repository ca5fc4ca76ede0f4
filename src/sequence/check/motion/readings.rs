//! Every way to read motion vectors.

use crate::sequence::{
    check::Belief,
    manifest::{MotionDirection, MotionSource, MotionUnits, YAxis},
};
use serde_json::{Value, json};

/// Another reading of the vectors.
#[derive(Clone)]
pub struct Reading {
    pub source: MotionSource,
    /// x and y change places.
    pub swapped: bool,
    /// Vectors of another frame.
    pub lag: isize,
    /// What is wrong, to go after "motion"; one for each change.
    pub changes: Vec<Change>,
}

#[derive(Clone)]
pub struct Change {
    pub id: &'static str,
    pub says: String,
    pub field: &'static str,
    pub value: Value,
}

pub fn change(id: &'static str, says: impl Into<String>, value: impl Into<Value>) -> Change {
    Change {
        id,
        says: says.into(),
        field: if id == "motion.x" { "motion.scale" } else { id },
        value: value.into(),
    }
}

const UNITS: [(MotionUnits, &str); 4] = [
    (MotionUnits::PixelsRender, "pixels_render"),
    (MotionUnits::PixelsOutput, "pixels_output"),
    (MotionUnits::Uv, "uv"),
    (MotionUnits::Ndc, "ndc"),
];

/// Every reading; the first is the one declared.
pub fn readings(belief: &Belief) -> Vec<Reading> {
    let manifest = belief.manifest();
    let Some(declared) = &manifest.motion else {
        return Vec::new();
    };
    let mut all = vec![Reading {
        source: declared.clone(),
        swapped: false,
        lag: 0,
        changes: Vec::new(),
    }];
    let units = |units: MotionUnits| {
        UNITS
            .iter()
            .find(|(known, _)| *known == units)
            .map_or("", |(_, name)| name)
    };
    let upscales = manifest.render_size != manifest.output_size;
    let other_units: Vec<MotionUnits> = UNITS
        .iter()
        .map(|(units, _)| *units)
        .filter(|other| {
            *other != declared.units
                && (upscales || *other != MotionUnits::PixelsOutput || declared.units == MotionUnits::PixelsOutput)
        })
        .filter(|other| {
            upscales || !(declared.units == MotionUnits::PixelsOutput && *other == MotionUnits::PixelsRender)
        })
        .collect();
    each(&mut all, |reading| {
        other_units
            .iter()
            .map(|other| {
                let says = format!("looks like {}, not {}", units(*other), units(declared.units));
                with(reading, change("motion.units", says, units(*other)), |source| {
                    source.units = *other
                })
            })
            .collect()
    });
    each(&mut all, |reading| signs(reading, declared));
    let channels = json!([declared.channels[1], declared.channels[0]]);
    each(&mut all, |reading| {
        let swap = change("motion.channels", "x and y look swapped", channels.clone());
        vec![Reading {
            swapped: true,
            ..with(reading, swap, |_| ())
        }]
    });
    if belief.sequence.is_jittered() {
        each(&mut all, |reading| {
            let says = if declared.jittered {
                "does not contain the jitter"
            } else {
                "contains the change of jitter"
            };
            vec![with(
                reading,
                change("motion.jittered", says, !declared.jittered),
                |source| {
                    source.jittered = !declared.jittered;
                },
            )]
        });
    }
    let one = all[0].clone();
    for factor in [0.25, 0.5, 2.0, 4.0] {
        let [x, y] = declared.scale.map(|scale| scale * factor);
        let says = format!("looks {} times as long as it should be", 1.0 / factor);
        all.push(with(&one, change("motion.scale", says, json!([x, y])), |source| {
            source.scale = [x, y];
            source.bias = source.bias.map(|bias| bias * factor);
        }));
    }
    for (lag, says) in [(-1, "belongs to the frame after"), (1, "belongs to the frame before")] {
        let shift = change(
            "motion.path",
            format!("is a frame off: each file {says}"),
            json!(format!("files of index {lag:+}")),
        );
        all.push(Reading {
            lag,
            ..with(&one, shift, |_| ())
        });
    }
    all
}

/// Adds to all that are there what `more` makes of them.
fn each(all: &mut Vec<Reading>, more: impl Fn(&Reading) -> Vec<Reading>) {
    let added: Vec<Reading> = all.iter().flat_map(more).collect();
    all.extend(added);
}

pub fn with(reading: &Reading, change: Change, edit: impl FnOnce(&mut MotionSource)) -> Reading {
    let mut reading = reading.clone();
    edit(&mut reading.source);
    reading.changes.push(change);
    reading
}

fn signs(reading: &Reading, declared: &MotionSource) -> Vec<Reading> {
    let (direction, direction_name) = match declared.direction {
        MotionDirection::CurrentToPrevious => (MotionDirection::PreviousToCurrent, "previous_to_current"),
        MotionDirection::PreviousToCurrent => (MotionDirection::CurrentToPrevious, "current_to_previous"),
    };
    let (y, y_name) = match declared.y {
        YAxis::Down => (YAxis::Up, "up"),
        YAxis::Up => (YAxis::Down, "down"),
    };
    let [sx, sy] = declared.scale;
    vec![
        with(
            reading,
            change("motion.direction", "points the other way", direction_name),
            |source| {
                source.direction = direction;
            },
        ),
        with(reading, change("motion.y", "y looks flipped", y_name), |source| {
            source.y = y
        }),
        with(
            reading,
            change("motion.x", "x looks flipped", json!([-sx, sy])),
            |source| {
                source.scale[0] *= -1.0;
                source.bias[0] *= -1.0;
            },
        ),
    ]
}
