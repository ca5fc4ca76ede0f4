//! Temporal upsampling: the GPU against the f64 twin at many scales, and what sequences with two sizes ask of a run.

use crate::{
    gpu_vs_reference::{SIZES, scene, still},
    run::{execute, spec},
    sequence::{copy_of, edit, fixture, reader},
    support::{
        agreement::{BEYOND, difference, difference_from},
        resolve_on_gpu,
    },
};
use afterimage::{
    image::Extent,
    metrics::Metric,
    run,
    sequence::{Frame, Sequence},
    taa::{Precision, Preset, Recipe, reference::Twin},
};
use serde_json::{Value, json};

const SCALES: [f64; 5] = [1.0, 1.5, 2.0, 3.7, 4.0];

/// Sides that no scale leaves whole are rounded up, so that the axes differ.
fn scaled(extent: Extent, scale: f64) -> Extent {
    let side = |side: u32| (f64::from(side) * scale).ceil() as u32;
    Extent::new(side(extent.width), side(extent.height))
}

fn upscaled(render: Extent, output_size: Extent) -> impl Iterator<Item = Frame> + Clone {
    scene(render).map(move |frame| Frame { output_size, ..frame })
}

fn taau() -> &'static Recipe {
    &Preset::find("taau").unwrap().recipe
}

#[test]
fn taau_agrees_at_every_size_and_scale() {
    // The last two make scales exact, so that many samples lie on the limits of box and texels.
    for extent in SIZES.into_iter().chain([Extent::new(18, 10), Extent::new(30, 20)]) {
        for scale in SCALES {
            let output = scaled(extent, scale);
            let found = difference(taau(), Precision::F32, upscaled(extent, output));
            println!("{extent} to {output}: {found:?}");
            assert!(found.agrees(), "{extent} to {output}: {found:?}");
        }
    }
}

#[test]
fn taau_agrees_with_f16_history() {
    for scale in SCALES {
        let found = difference(taau(), Precision::F16, upscaled(SIZES[0], scaled(SIZES[0], scale)));
        println!("{scale}: {found:?}");
        assert!(found.beyond <= BEYOND, "{scale}: {found:?}");
    }
}

#[test]
fn every_block_agrees_while_upsampling() {
    let output = Extent::new(100, 50);
    for block in [
        r#"{"dilation": "longest", "history_filter": "texel", "neighbourhood": "rounded", "rectify": "clamp"}"#,
        r#"{"history_filter": "bfecc", "neighbourhood": "variance", "rectify": "clip_current", "domain": "linear"}"#,
        r#"{"neighbourhood": "variance", "prefilter_moments": true, "variance_window": 5, "weight": "luma_feedback"}"#,
        r#"{"reject_depth": true, "reject_depth_tolerance": 0.01, "reject_id": true, "weight": "count"}"#,
        r#"{"reactive": true, "motion_weight": true, "hdr_weight": "karis", "rectify": "clip_current"}"#,
        r#"{"sharpen": "rcas", "motion_blur": true, "weight": "antiflicker", "deringing": true}"#,
        r#"{"history_filter": "none", "motion_blur": true}"#,
        r#"{"reproject": false, "chroma_from_luma": true, "unjitter_neighbourhood": true, "neighbourhood": "cross"}"#,
    ] {
        let recipe = taau().with(&serde_json::from_str(block).unwrap()).unwrap();
        let found = difference(&recipe, Precision::F32, upscaled(SIZES[0], output).take(24));
        println!("{block}: {found:?}");
        assert!(found.agrees(), "{block}: {found:?}");
    }
}

/// The comparison can fail: jitter a hundredth of a pixel off, jitter of the other sign, another box, a confidence that
/// is none.
#[test]
fn a_twin_that_upsamples_slightly_otherwise_disagrees() {
    let output = Extent::new(122, 74);
    let frames = || upscaled(SIZES[0], output).take(8);
    let told_apart = |recipe: Recipe, altered: fn(Frame) -> Frame| {
        let twin = Twin::new(recipe, Precision::F32);
        !difference_from(twin, taau(), Precision::F32, frames(), altered).agrees()
    };
    let with = |text: &str| taau().with(&serde_json::from_str(text).unwrap()).unwrap();
    assert!(!told_apart(taau().clone(), |frame| frame));
    assert!(told_apart(taau().clone(), |frame| Frame {
        jitter_px: [frame.jitter_px[0] + 0.01, frame.jitter_px[1]],
        ..frame
    }));
    assert!(told_apart(taau().clone(), |frame| Frame {
        jitter_px: frame.jitter_px.map(|offset| -offset),
        ..frame
    }));
    assert!(told_apart(with(r#"{"neighbourhood": "box3"}"#), |frame| frame));
    assert!(told_apart(with(r#"{"current_weight": 0.11}"#), |frame| frame));
}

#[test]
fn a_flat_colour_stays_what_it_is_at_every_scale() {
    let extent = Extent::new(9, 7);
    for scale in SCALES {
        let frames = (0..40).map(|index| Frame {
            output_size: scaled(extent, scale),
            jitter_px: [0.3, -0.4],
            ..still(extent, index, |_, _| [0.25, 0.5, 2.0])
        });
        let (shown, _) = resolve_on_gpu(taau(), Precision::F16, frames).pop().unwrap();
        assert_eq!(shown.extent(), scaled(extent, scale));
        for c in shown.pixels() {
            assert!(
                (c[0] - 0.25).abs() < 1e-3 && (c[1] - 0.5).abs() < 1e-3 && (c[2] - 2.0).abs() < 8e-3,
                "{c:?}"
            );
        }
    }
}

fn open(path: &std::path::Path) -> Sequence {
    Sequence::open(path, &reader()).unwrap()
}

/// Everything after the resolver has the output's size, metrics along the motion included; and history is worth more than
/// a spatial filter.
#[test]
fn a_sequence_is_upscaled_and_scored_at_its_output_size() {
    let sequence = open(&fixture("upscale"));
    let mut wanted = spec(&["taau", "taau"]);
    wanted.presets[1].parameters = serde_json::from_value(json!({"history_filter": "none"})).unwrap();
    wanted.metrics = vec![Metric::PSNR, Metric::SSIM, Metric::WARPED_TPSNR];
    let report = execute(&wanted, &sequence);
    assert_eq!(report.sequence.render_size, Extent::new(32, 24));
    assert_eq!(report.sequence.output_size, Extent::new(64, 48));
    let gains_db = ["psnr", "warped_tpsnr"].map(|id| {
        let mean = |index: usize| report.reports[index].summary[id].mean.0;
        println!("{id}: {} with history, {} without", mean(0), mean(1));
        mean(0) - mean(1)
    });
    assert!(gains_db.iter().all(|gain_db| *gain_db > 0.5), "{gains_db:?}");
}

#[test]
fn presets_that_cannot_upscale_are_named() {
    let refused = |presets: &[&str], sequence: &Sequence| match run::validate(&spec(presets), sequence) {
        Ok(()) => String::new(),
        Err(error) => error.to_string(),
    };
    let sequence = open(&fixture("upscale"));
    assert_eq!(refused(&["taau"], &sequence), "");
    assert_eq!(
        refused(&["taau", "ema"], &sequence),
        "presets[1]: `ema` does not upscale, as from 32×24 to 64×48 asks; the input filter `upsample` does"
    );
    let (admitted, left_out) = run::admitted(&sequence);
    assert_eq!(admitted.iter().map(|preset| preset.id).collect::<Vec<_>>(), ["taau"]);
    assert!(left_out.iter().any(|(preset, _)| preset.id == "karis2014"));

    // With the input filter that can, another system goes, too.
    let mut ema = spec(&["ema"]);
    ema.presets[0].parameters = serde_json::from_value(json!({"input_filter": "upsample"})).unwrap();
    assert!(run::validate(&ema, &sequence).is_ok());

    let with_output = |size: Value| {
        let folder = copy_of("upscale");
        edit(&folder, |manifest| manifest["output_size"] = size);
        refused(&["taau"], &open(folder.path()))
    };
    assert_eq!(with_output(json!([128, 96])), "");
    assert_eq!(
        with_output(json!([64, 97])),
        "presets[0]: `taau` upscales by 1 to 4 along each axis, which from 32×24 to 64×97 is not"
    );
    assert!(with_output(json!([31, 48])).contains("1 to 4"));
}
