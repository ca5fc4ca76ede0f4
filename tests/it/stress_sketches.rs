//! Whole frames drawn at random (the same ones each time; `fuzz/` draws others), hostile ones too: twins and GPU stand them. What one does not is shrunk, and written as a
//! sequence into the folder that the failure names.

use crate::support::{gpu, service::reader};
use afterimage::{
    sequence::Sequence,
    stress::{Sketch, SketchedFrame},
    taa::{PRESETS, Precision, Preset, Recipe},
};
use proptest::{
    collection::vec,
    prelude::*,
    test_runner::{RngSeed, TestRunner},
};

prop_compose! {
    fn frame()(
        reset in prop::bool::weighted(0.1),
        jitter in [-128..=127_i8, -128..=127_i8],
        colors in vec(0..=255_u8, 0..24),
        motion in vec(0..16_u8, 0..12),
        depth in vec(0..8_u8, 0..8),
        ids in vec(0..4_u8, 0..4),
    ) -> SketchedFrame {
        SketchedFrame { reset, jitter, colors, motion, depth, ids }
    }
}

prop_compose! {
    fn sketch()(width in 1..=Sketch::MAX_SIDE, height in 1..=Sketch::MAX_SIDE, frames in vec(frame(), 1..6)) -> Sketch {
        Sketch { width, height, frames }
    }
}

/// Fails with where the sketch was written.
fn stands(
    sketch: &Sketch,
    preset: &Preset,
    precision: Precision,
    gpu: Option<&afterimage::gpu::Gpu>,
) -> Result<(), TestCaseError> {
    sketch.check(&preset.recipe, precision, gpu).map_err(|weakness| {
        let folder = std::env::temp_dir().join(format!("afterimage-{}", preset.id));
        sketch.write(&folder, preset.id, &preset.recipe).unwrap();
        TestCaseError::fail(format!(
            "{} {precision:?}: {weakness}; see {}",
            preset.id,
            folder.display()
        ))
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn twins_stand_any_frames(sketch in sketch(), which in 0..PRESETS.len(), half in any::<bool>()) {
        let precision = if half { Precision::F16 } else { Precision::F32 };
        stands(&sketch, &PRESETS[which], precision, None)?;
    }
}

#[test]
fn the_gpu_stands_any_frames() {
    // Passes are compiled once a recipe.
    let gpu = gpu().caching();
    let mut runner = TestRunner::new(ProptestConfig {
        cases: 48,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::default()
    });
    let strategy = (sketch(), 0..PRESETS.len(), any::<bool>());
    runner
        .run(&strategy, |(sketch, which, half)| {
            let precision = if half { Precision::F16 } else { Precision::F32 };
            stands(&sketch, &PRESETS[which], precision, Some(&gpu))
        })
        .unwrap();
}

/// The check can fail, and what it fails on is a sequence that can be read.
#[test]
fn a_weakness_is_written_as_a_sequence() {
    let bad = Sketch {
        width: 5,
        height: 4,
        frames: vec![
            SketchedFrame::default(),
            SketchedFrame {
                colors: vec![9, 0, 0, 10],
                ..SketchedFrame::default()
            },
        ],
    };
    let ema = &Preset::find("ema").unwrap().recipe;
    let unguarded: Recipe = ema
        .with(&serde_json::from_str(r#"{"guards": "off"}"#).unwrap())
        .unwrap();
    let weakness = bad.check(&unguarded, Precision::F32, None).unwrap_err();
    assert!(
        weakness.to_string().contains("frame 1") && weakness.to_string().contains("not finite"),
        "{weakness}"
    );
    bad.check(ema, Precision::F32, Some(gpu())).unwrap();
    let folder = tempfile::tempdir().unwrap();
    bad.write(folder.path(), "bad", ema).unwrap();
    let sequence = Sequence::open(folder.path(), &reader()).unwrap();
    let read = sequence.load(1, sequence.available()).unwrap();
    let made = bad.frame(1, ema, None);
    let bits = |image: &afterimage::image::Image<[f32; 3]>| {
        image.pixels().iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(bits(&read.color), bits(&made.color));
    assert_eq!(read.motion_px, made.motion_px);
    assert_eq!(read.object_id, made.object_id);
}

/// Bytes of any length make a sketch.
#[test]
fn any_bytes_are_a_sketch() {
    for n in [0, 1, 2, 3, 40, 400] {
        let sketch = Sketch::from_bytes(&vec![0xa7; n]);
        assert!(!sketch.frames.is_empty() && sketch.width <= Sketch::MAX_SIDE);
    }
    let plain = Sketch::from_bytes(&[]);
    assert_eq!(plain.frames, [SketchedFrame::default()]);
}
