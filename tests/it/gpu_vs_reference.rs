//! The GPU against the f64 twin: every preset, every block, odd sizes, a reset and hostile input on the way.

use crate::support::{
    agreement::{BEYOND, difference, difference_from},
    frame, gpu, noise, resolve_on_gpu,
};
use afterimage::{
    image::{Extent, Image},
    sequence::{Frame, Sizes},
    taa::{PRESETS, Precision, Preset, Resolver, reference::Twin},
};

/// Sixty-four frames of a scene.
pub fn scene(extent: Extent) -> impl Iterator<Item = Frame> + Clone {
    (0..64).map(move |index| frame(extent, index))
}

pub const SIZES: [Extent; 4] = [
    Extent::new(61, 37),
    Extent::new(1, 1),
    Extent::new(3, 5),
    Extent::new(17, 1),
];

#[test]
fn every_preset_agrees_at_every_size() {
    for preset in &PRESETS {
        for extent in SIZES {
            let found = difference(&preset.recipe, Precision::F32, scene(extent));
            println!("{} {extent}: {found:?}", preset.id);
            assert!(found.agrees(), "{} {extent}: {found:?}", preset.id);
        }
    }
}

/// A rounded history makes more decisions fall differently: within the f16 step that the two may round apart.
#[test]
fn every_preset_agrees_with_f16_history() {
    for preset in &PRESETS {
        let found = difference(&preset.recipe, Precision::F16, scene(SIZES[0]));
        println!("{}: {found:?}", preset.id);
        assert!(found.beyond <= BEYOND, "{}: {found:?}", preset.id);
    }
}

#[test]
fn every_block_agrees() {
    let blocks = [
        r#"{"dilation": "longest", "history_filter": "texel"}"#,
        r#"{"history_filter": "catmull_rom", "deringing": true}"#,
        r#"{"history_filter": "catmull_rom_5", "deringing": true, "input_filter": "unjitter"}"#,
        r#"{"history_filter": "bfecc", "dilation": "closest"}"#,
        r#"{"history_filter": "bfecc", "deringing": true, "weight": "amortized", "domain": "tonemapped"}"#,
        r#"{"history_filter": "quasi_cubic"}"#,
        r#"{"history_filter": "quasi_cubic", "deringing": true, "weight": "amortized", "domain": "display"}"#,
        r#"{"spatial": "fxaa", "domain": "tonemapped", "input_filter": "unjitter", "neighbourhood": "sobel", "rectify": "clamp"}"#,
        r#"{"spatial": "smaa", "domain": "display", "spatial_decodes": false, "motion_blur": true}"#,
        r#"{"spatial": "smaa", "domain": "tonemapped", "algorithm": "phlm2016"}"#,
        r#"{"domain": "display", "sharpen": "rcas", "neighbourhood": "rounded", "rectify": "clip_centre"}"#,
        r#"{"domain": "display", "sharpen": "xu", "motion_blur": true}"#,
        r#"{"neighbourhood": "cross", "rectify": "clamp"}"#,
        r#"{"neighbourhood": "box3", "rectify": "clip_centre", "space": "ycocg", "domain": "tonemapped"}"#,
        r#"{"neighbourhood": "rounded", "rectify": "clip_current", "unjitter_neighbourhood": true}"#,
        r#"{"neighbourhood": "variance", "variance_window": 5, "variance_gamma": 1.25, "rectify": "clip_centre"}"#,
        r#"{"neighbourhood": "variance", "intersect_minmax": false, "rectify": "clip_current", "space": "ycocg"}"#,
        r#"{"neighbourhood": "box3", "rectify": "none", "weight": "antiflicker"}"#,
        r#"{"neighbourhood": "variance", "prefilter_moments": true, "variance_window": 31, "rectify": "clip_centre"}"#,
        r#"{"neighbourhood": "variance", "prefilter_moments": true, "rectify": "clip_current", "domain": "tonemapped"}"#,
        r#"{"neighbourhood": "sobel", "rectify": "clamp", "space": "ycocg"}"#,
        r#"{"algorithm": "phlm2016", "phlm_printed": true, "domain": "tonemapped"}"#,
        r#"{"neighbourhood": "shrunk", "rectify": "clip_current", "input_filter": "blackman_harris"}"#,
        r#"{"sharpen": "xu", "sharpen_strength": 0.5, "motion_blur": true}"#,
        r#"{"sharpen": "rcas", "sharpen_strength": 0.8, "domain": "tonemapped"}"#,
        r#"{"neighbourhood": "cross", "rectify": "clamp", "space": "ycocg", "chroma_from_luma": true}"#,
        r#"{"reject_depth": true, "reject_depth_tolerance": 0.01, "dilation": "closest"}"#,
        r#"{"reject_id": true, "weight": "count", "count_weight_min": 0.05}"#,
        r#"{"reactive": true, "motion_weight": true}"#,
        r#"{"weight": "amortized", "dilation": "longest", "reject_id": true, "domain": "tonemapped"}"#,
        r#"{"motion_weight": true, "hdr_weight": "karis", "motion_blur": true, "weight": "luma_feedback"}"#,
    ];
    for block in blocks {
        let overrides = serde_json::from_str(block).unwrap();
        let recipe = Preset::find("ema").unwrap().recipe.with(&overrides).unwrap();
        let found = difference(&recipe, Precision::F32, scene(SIZES[0]).take(24));
        println!("{block}: {found:?}");
        assert!(found.agrees(), "{block}: {found:?}");
    }
}

#[test]
fn the_hull_is_for_the_twin_alone() {
    let overrides = serde_json::from_str(r#"{"rectify": "hull", "domain": "tonemapped"}"#).unwrap();
    let recipe = Preset::find("salvi2016").unwrap().recipe.with(&overrides).unwrap();
    let refused = Resolver::new(gpu(), recipe.clone(), Precision::F32, Sizes::native(SIZES[0])).unwrap_err();
    assert!(refused.to_string().contains("`hull`"), "{refused}");
    let boxed = serde_json::from_str(r#"{"neighbourhood": "box3", "rectify": "clip_current"}"#).unwrap();
    let boxed = recipe.with(&boxed).unwrap();
    let [mut hull, mut boxed] = [recipe, boxed].map(|recipe| Twin::<f64>::new(recipe, Precision::F32));
    let mut differs = false;
    for frame in (0..4).map(|index| frame(Extent::new(17, 9), index)) {
        let (hull, boxed) = (hull.resolve(&frame).shown, boxed.resolve(&frame).shown);
        assert!(hull.pixels().iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
        differs |= hull.pixels() != boxed.pixels();
    }
    assert!(differs, "the hull is tighter than the box");
}

/// The comparison can fail: a twin with one parameter slightly off must be told apart.
#[test]
fn a_slightly_wrong_twin_disagrees() {
    let recipe = &Preset::find("ema").unwrap().recipe;
    let mut off = recipe.clone();
    off.current_weight = 0.101;
    let twin = Twin::new(off, Precision::F32);
    let found = difference_from(twin, recipe, Precision::F32, scene(SIZES[0]).take(8), |frame| frame);
    assert!(!found.agrees(), "{found:?}");
}

/// Once motion stops, what is shown is the mean of the last image in motion and every colour since.
#[test]
fn linear_models_show_a_mean_where_all_is_still() {
    let recipe = &Preset::find("phlm2016").unwrap().recipe;
    let extent = SIZES[0];
    let frames = || {
        (0..12).map(|index| match index {
            0..4 => frame(extent, index),
            _ => still(extent, index, |x, y| [noise(x, y, index as u32); 3]),
        })
    };
    let shown = resolve_on_gpu(recipe, Precision::F32, frames());
    let mut twin = Twin::<f64>::new(recipe.clone(), Precision::F32);
    let last = frames().map(|frame| twin.resolve(&frame).shown).last().unwrap();
    let tonemapped = |[r, g, b]: [f32; 3]| f64::from(r) / (1.0 + f64::from(r.max(g).max(b)));
    for [x, y] in [[30, 20], [0, 0], [60, 36]] {
        let since: f64 = (4..12).map(|index| tonemapped([noise(x, y, index); 3])).sum();
        let mean = (tonemapped(shown[3].0.at(x, y)) + since) / 9.0;
        let of_twin = tonemapped(last.at(x, y).map(|c| c as f32));
        for found in [tonemapped(shown[11].0.at(x, y)), of_twin] {
            assert!((found - mean).abs() < 1e-4, "at {x}, {y}: {found} instead of {mean}");
        }
    }
}

pub fn still(extent: Extent, index: usize, color: impl Fn(u32, u32) -> [f32; 3] + Sync) -> Frame {
    Frame {
        reset: false,
        jitter_px: [0.0; 2],
        color: Image::from_fn(extent, color),
        depth: Some(Image::filled(extent, 1.0)),
        motion_px: Some(Image::filled(extent, [0.0; 2])),
        ..frame(extent, index)
    }
}

#[test]
fn a_constant_image_is_a_fixed_point_of_every_preset() {
    let extent = Extent::new(9, 7);
    for preset in &PRESETS {
        for precision in [Precision::F16, Precision::F32] {
            let frames = (0..40).map(|index| still(extent, index, |_, _| [0.25, 0.5, 2.0]));
            let (shown, _) = resolve_on_gpu(&preset.recipe, precision, frames).pop().unwrap();
            let worst = shown.pixels().iter().fold(0.0_f32, |worst, c| {
                worst
                    .max((c[0] - 0.25).abs())
                    .max((c[1] - 0.5).abs())
                    .max((c[2] - 2.0).abs() / 4.0)
            });
            assert!(worst <= 2e-3, "{} {precision:?}: off by {worst}", preset.id);
        }
    }
}

/// White noise through `mix(h, c, w)` settles at variance w / (2 - w).
#[test]
fn static_noise_settles_at_the_variance_that_theory_gives() {
    let extent = Extent::new(64, 64);
    let frames = (0..80).map(|index| still(extent, index, |x, y| [noise(x, y, index as u32 + 100); 3]));
    let recipe = Preset::find("ema").unwrap().recipe.clone();
    let (shown, _) = resolve_on_gpu(&recipe, Precision::F32, frames).pop().unwrap();
    let n = extent.n_pixels() as f64;
    let mean = shown.pixels().iter().map(|c| f64::from(c[0])).sum::<f64>() / n;
    let variance = shown
        .pixels()
        .iter()
        .map(|c| (f64::from(c[0]) - mean).powi(2))
        .sum::<f64>()
        / n;
    let ratio = variance / (1.0 / 12.0) / (0.1 / 1.9);
    assert!((0.9..1.1).contains(&ratio), "variance is {ratio} of theory's");
}

#[test]
fn a_reset_shows_the_current_frame() {
    let extent = Extent::new(16, 16);
    let recipe = Preset::find("ema").unwrap().recipe.clone();
    let frames = (0..3).map(|index| Frame {
        reset: index == 2,
        ..still(extent, index, |x, y| [noise(x, y, index as u32); 3])
    });
    let shown = resolve_on_gpu(&recipe, Precision::F16, frames);
    assert_eq!(shown[2].0.at(3, 4), [noise(3, 4, 2); 3]);
    assert_ne!(shown[1].0.at(3, 4), [noise(3, 4, 1); 3]);
}

/// One bad texel may spoil only what reads it, and nothing one frame later.
#[test]
fn a_hostile_texel_does_not_spread() {
    let extent = Extent::new(16, 16);
    for preset in &PRESETS {
        let frames = (0..4).map(|index| {
            still(extent, index, |x, y| {
                if (x, y, index) == (8, 8, 1) {
                    [f32::NAN; 3]
                } else {
                    [0.5; 3]
                }
            })
        });
        let shown = resolve_on_gpu(&preset.recipe, Precision::F16, frames);
        assert_eq!(shown[1].1, 1, "one texel was repaired");
        assert!(
            shown
                .iter()
                .all(|(image, _)| image.pixels().iter().flatten().all(|v| v.is_finite()))
        );
        let far = shown[3].0.at(2, 2);
        assert!((far[0] - 0.5).abs() < 1e-3, "{}: {far:?}", preset.id);
    }
}

#[test]
fn the_adapter_has_a_name_and_a_driver() {
    let info = gpu().info();
    assert!(!info.name.is_empty() && !info.driver.is_empty(), "{info:?}");
}
