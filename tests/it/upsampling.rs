//! Temporal upsampling: the GPU against the f64 twin at many scales, and what sequences with two sizes ask of a run.

use crate::{
    gpu_vs_reference::{SIZES, scene, still},
    support::{
        agreement::{BEYOND, difference, difference_from},
        resolve_on_gpu,
    },
};
use afterimage::{
    image::Extent,
    sequence::Frame,
    taa::{Precision, Preset, Recipe, reference::Twin},
};

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
