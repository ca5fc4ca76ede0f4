//! How shown images came about: shares of history as the twin has them, and tiles that were skipped where nothing changes.

use crate::{
    run::spec,
    sequence::{copy_of, edit},
    support::{
        gpu,
        service::{fixture, reader},
    },
};
use afterimage::{
    image::Image,
    run::{self, Observer, PresetSpec, RunSpec, Trace},
    sequence::Sequence,
    taa::{Precision, Preset, Recipe, Skip, TILE, recipe::Weight, reference::Twin},
};
use serde_json::json;
use std::sync::Mutex;
use tempfile::TempDir;

/// Keeps the images of one kind, frame by frame.
struct Keep {
    wanted: Trace,
    kept: Mutex<Vec<Image<f32>>>,
}

impl Observer for Keep {
    fn wants_output(&self) -> bool {
        true
    }

    fn trace(&self, _: usize, frame: usize, trace: Trace, image: &Image<f32>) -> std::io::Result<()> {
        if trace == self.wanted {
            let mut kept = self.kept.lock().unwrap();
            assert_eq!(kept.len(), frame, "frames come in order");
            kept.push(image.clone());
        }
        Ok(())
    }
}

fn traced(spec: &RunSpec, sequence: &Sequence, wanted: Trace) -> Vec<Image<f32>> {
    let keep = Keep {
        wanted,
        kept: Mutex::default(),
    };
    run::execute(spec, sequence, gpu(), &keep).unwrap();
    keep.kept.into_inner().unwrap()
}

fn open(name: &str) -> Sequence {
    Sequence::open(&fixture(name), &reader()).unwrap()
}

/// How far shares are from those of a twin of `recipe`: on average, and how many of all pixels by more than 0.01.
fn from_twin(found: &[Image<f32>], recipe: &Recipe, sequence: &Sequence) -> [f64; 2] {
    let mut twin = Twin::<f64>::new(recipe.clone(), Precision::F32);
    let channels = recipe
        .required_channels()
        .union(recipe.optional_channels().intersection(sequence.available()));
    let (mut sum, mut n, mut n_beyond) = (0.0, 0.0, 0.0);
    for (index, found) in found.iter().enumerate() {
        let frame = sequence.load(index, channels).unwrap();
        twin.resolve(&frame);
        let expected = twin.history_share(&frame);
        for (&found, &expected) in found.pixels().iter().zip(expected.pixels()) {
            let apart = (f64::from(found) - expected).abs();
            n += 1.0;
            if apart <= 0.01 { sum += apart } else { n_beyond += 1.0 }
        }
    }
    [sum / n, n_beyond / n]
}

/// Every kind of weight. Where a decision falls differently a share may be another one: those are the pixels that may be beyond.
#[test]
fn shares_of_history_are_the_twins() {
    let sequence = open("pan");
    for preset in ["ema", "karis2014", "inside", "accumulate", "amortized", "salvi2016"] {
        let recipe = &Preset::find(preset).unwrap().recipe;
        let found = traced(&spec(&[preset]), &sequence, Trace::HistoryShare);
        assert_eq!(found.len(), sequence.n_frames());
        assert!(
            found[0].pixels().iter().all(|&share| share == 0.0),
            "{preset}: frame 0 has no history"
        );
        assert!(
            found[5].pixels().iter().any(|&share| share > 0.3),
            "{preset}: frame 5 has some"
        );
        let [mean, beyond] = from_twin(&found, recipe, &sequence);
        println!("{preset}: mean {mean:.1e}, beyond {beyond:.1e}");
        assert!(
            mean < 1e-5 && beyond < 1e-3,
            "{preset}: mean {mean:.1e}, beyond {beyond:.1e}"
        );
        // The comparison can fail: a twin with another weight is told apart.
        let mut off = recipe.clone();
        off.weight = match recipe.weight {
            Weight::Fixed => Weight::Count,
            _ => Weight::Fixed,
        };
        let [mean, beyond] = from_twin(&found, &off, &sequence);
        assert!(
            mean >= 1e-5 || beyond >= 1e-3,
            "{preset}: another twin agrees: mean {mean:.1e}, beyond {beyond:.1e}"
        );
    }
}

#[test]
fn recipes_without_a_weight_have_no_share() {
    for preset in ["none", "fxaa", "phlm2016"] {
        assert_eq!(
            traced(&spec(&[preset]), &open("pan"), Trace::HistoryShare).len(),
            0,
            "{preset}"
        );
    }
}

/// A sequence of 61×37 pixels whose frames are all the first one.
pub fn at_rest() -> TempDir {
    let folder = copy_of("static");
    edit(&folder, |manifest| {
        for section in ["color", "depth", "motion"] {
            manifest[section]["path"] = json!("input/00.exr");
        }
        for frame in manifest["frames"].as_array_mut().unwrap() {
            frame["jitter"] = json!([0, 0]);
        }
    });
    folder
}

#[test]
fn skipped_tiles_are_where_nothing_changes() {
    let folder = at_rest();
    let sequence = Sequence::open(folder.path(), &reader()).unwrap();
    let mut spec = spec(&["ema"]);
    spec.skip = Skip::Exact;
    spec.presets = vec![PresetSpec {
        preset: "ema".to_owned(),
        parameters: serde_json::from_str(r#"{"current_weight": 0.5}"#).unwrap(),
    }];
    let skipped = traced(&spec, &sequence, Trace::SkippedTiles);
    let report = run::execute(&spec, &sequence, gpu(), &()).unwrap();
    let size = sequence.output_size();
    assert_eq!(skipped.len(), sequence.n_frames());
    assert_eq!(
        (skipped[0].extent().width, skipped[0].extent().height),
        (size.width.div_ceil(TILE), size.height.div_ceil(TILE))
    );
    assert!(
        skipped[0].pixels().iter().all(|&tile| tile == 0.0),
        "the first frame is new everywhere"
    );
    let share = skipped.iter().flat_map(|frame| frame.pixels()).sum::<f32>()
        / (skipped.len() * skipped[0].pixels().len()) as f32;
    let reported = report.reports[0].skipped.as_ref().unwrap().share;
    assert!(share > 0.5, "only {share} of the tiles were skipped");
    assert!(
        (f64::from(share) - reported).abs() < 1e-6,
        "{share} is not the report's {reported}"
    );
    spec.skip = Skip::Off;
    assert_eq!(traced(&spec, &sequence, Trace::SkippedTiles).len(), 0);
}
