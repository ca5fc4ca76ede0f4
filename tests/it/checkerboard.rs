//! Frames that shade every other pixel: what is made of them, and which runs are refused.

use crate::{
    gpu_vs_reference::{SIZES, scene, still},
    run::{execute, spec},
    sequence::{copy_of, edit, fixture, reader},
    support::{
        agreement::{difference, difference_from},
        resolve_on_gpu,
    },
};
use afterimage::{
    image::{Extent, Image},
    run,
    sequence::{Frame, Sequence},
    taa::{Precision, Preset, Recipe, reference::Twin},
};
use serde_json::{Value, json};
use std::path::Path;

fn checkerboard() -> &'static Recipe {
    &Preset::find("checkerboard").unwrap().recipe
}

/// The frame with all that it did not shade changed.
fn vandalised(frame: Frame) -> Frame {
    let parity = frame.parity.unwrap();
    let is_shaded = |x: u32, y: u32| (x + y) % 2 == parity;
    let extent = frame.extent();
    let (depth, motion) = (frame.depth.as_ref().unwrap(), frame.motion_px.as_ref().unwrap());
    Frame {
        color: Image::from_fn(extent, |x, y| match is_shaded(x, y) {
            true => frame.color.at(x, y),
            false => [7.0, 0.0, 1e4],
        }),
        depth: Some(Image::from_fn(extent, |x, y| match is_shaded(x, y) {
            true => depth.at(x, y),
            false => 1e-3,
        })),
        motion_px: Some(Image::from_fn(extent, |x, y| match is_shaded(x, y) {
            true => motion.at(x, y),
            false => [f32::NAN, 3.0],
        })),
        ..frame
    }
}

#[test]
fn pixels_that_were_not_shaded_are_never_read() {
    for extent in SIZES {
        let frames = || scene(extent).take(24);
        let shown = resolve_on_gpu(checkerboard(), Precision::F32, frames());
        let vandalised = resolve_on_gpu(checkerboard(), Precision::F32, frames().map(vandalised));
        for (index, (a, b)) in shown.iter().zip(&vandalised).enumerate() {
            assert_eq!(a.0, b.0, "{extent}, frame {index}");
        }
    }
}

/// The comparison can fail: a twin that takes the other half, or another recipe's blocks.
#[test]
fn a_twin_that_fills_slightly_otherwise_disagrees() {
    let frames = || scene(SIZES[0]).take(8);
    let told_apart = |recipe: Recipe, altered: fn(Frame) -> Frame| {
        let twin = Twin::new(recipe, Precision::F32);
        !difference_from(twin, checkerboard(), Precision::F32, frames(), altered).agrees()
    };
    let with = |text: &str| checkerboard().with(&serde_json::from_str(text).unwrap()).unwrap();
    assert!(!told_apart(checkerboard().clone(), |frame| frame));
    assert!(told_apart(checkerboard().clone(), |frame| Frame {
        parity: frame.parity.map(|parity| 1 - parity),
        ..frame
    }));
    assert!(told_apart(with(r#"{"dilation": "longest"}"#), |frame| frame));
    assert!(told_apart(with(r#"{"rectify": "clamp"}"#), |frame| frame));
    assert!(told_apart(with(r#"{"history_filter": "bilinear"}"#), |frame| frame));
}

#[test]
fn its_blocks_agree() {
    for block in [
        r#"{"dilation": "longest", "rectify": "clip_current", "domain": "linear"}"#,
        r#"{"space": "rgb", "rectify": "clamp", "history_filter": "catmull_rom", "deringing": true}"#,
        r#"{"rectify": "none", "history_filter": "texel"}"#,
    ] {
        let recipe = checkerboard().with(&serde_json::from_str(block).unwrap()).unwrap();
        let found = difference(&recipe, Precision::F32, scene(SIZES[0]).take(24));
        println!("{block}: {found:?}");
        assert!(found.agrees(), "{block}: {found:?}");
    }
}

/// Where nothing moves, two frames are the whole image, as long as a pixel lies between its neighbours.
#[test]
fn a_still_ramp_is_whole_after_two_frames() {
    let extent = Extent::new(16, 12);
    let ramp = |x: u32, y: u32| [0.03 * x as f32, 0.5, 0.02 * y as f32 + 0.1];
    let frames = (0..4).map(|index| still(extent, index, ramp));
    let shown = resolve_on_gpu(checkerboard(), Precision::F32, frames);
    for (x, y) in (1..15).flat_map(|x| (1..11).map(move |y| (x, y))) {
        let (found, truth) = (shown[3].0.at(x, y), ramp(x, y));
        assert!(
            (0..3).all(|i| (found[i] - truth[i]).abs() < 2e-3),
            "({x}, {y}): {found:?}"
        );
    }
}

fn open(path: &Path) -> Sequence {
    Sequence::open(path, &reader()).unwrap()
}

#[test]
fn a_checkerboard_is_filled_and_what_it_leaves_out_is_no_hostile_texel() {
    let sequence = open(&fixture("checkerboard"));
    let report = execute(&spec(&["checkerboard"]), &sequence);
    assert!(report.is_finite());
    assert!(report.reports[0].frames.iter().all(|frame| frame.repaired_texels == 0));
    let psnr = report.reports[0].summary["psnr"].mean.0;
    println!("{psnr} dB");
    assert!(psnr > 15.0, "{psnr} dB");
}

#[test]
fn only_what_fits_a_checkerboard_runs_on_one() {
    let refused = |preset: &str, sequence: &Sequence| match run::validate(&spec(&[preset]), sequence) {
        Ok(()) => String::new(),
        Err(error) => error.to_string(),
    };
    let sequence = open(&fixture("checkerboard"));
    assert_eq!(refused("checkerboard", &sequence), "");
    assert_eq!(
        refused("inside", &sequence),
        "presets[0]: `inside` reads every pixel, and the frames are checkerboards"
    );
    assert_eq!(
        refused("checkerboard", &open(&fixture("pan"))),
        "presets[0]: `checkerboard` fills the gaps of checkerboards, and the frames have none"
    );
    assert!(refused("checkerboard", &open(&fixture("upscale"))).contains("have none"));
    let (admitted, _) = run::admitted(&sequence);
    assert_eq!(
        admitted.iter().map(|preset| preset.id).collect::<Vec<_>>(),
        ["checkerboard"]
    );
}

#[test]
fn parities_are_numbers_of_frames_over_and_over() {
    let with = |parity: Value| {
        let folder = copy_of("checkerboard");
        edit(&folder, |manifest| manifest["checkerboard"] = json!({"parity": parity}));
        Sequence::open(folder.path(), &reader()).map(|sequence| {
            let frames = (0..5).map(|index| sequence.load(index, Default::default()).unwrap());
            frames.map(|frame| frame.parity.unwrap()).collect::<Vec<_>>()
        })
    };
    assert_eq!(with(json!([0, 1])).unwrap(), [0, 1, 0, 1, 0]);
    assert_eq!(with(json!([1, 1, 0])).unwrap(), [1, 1, 0, 1, 1]);
    for bad in [json!([]), json!([0, 2])] {
        let error = with(bad).unwrap_err().to_string();
        assert!(
            error.contains("checkerboard.parity: must be a list of 0 and 1"),
            "{error}"
        );
    }
}
