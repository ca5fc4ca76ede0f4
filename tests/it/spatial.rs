//! FXAA and SMAA on drawings whose edges are known: against the twin, against what their publications say, and against the
//! true coverage of a pixel. The domain of the display.

use crate::support::{
    agreement::{difference, difference_from},
    frame, resolve_on_gpu,
};
use afterimage::{
    image::{Extent, Image},
    metrics::{Display, Tonemap},
    sequence::{Frame, frame::Rgb},
    taa::{Precision, Preset, Recipe, reference::Twin},
};

const EXTENT: Extent = Extent::new(97, 61);

fn recipe(preset: &str, overrides: &str) -> Recipe {
    let preset = &Preset::find(preset).unwrap().recipe;
    preset.with(&serde_json::from_str(overrides).unwrap()).unwrap()
}

/// A wheel of spokes that grows thinner outwards, a hair, a grid finer than pixels: flat colours, turned a little with every
/// frame.
fn drawing(x: f64, y: f64, turn: f64) -> Rgb {
    let (dx, dy) = (x - 40.0, y - 30.0);
    let radius = libm::sqrt(dx * dx + dy * dy);
    let angle = libm::atan2(dy, dx) + turn;
    if radius < 26.0 && libm::sin(11.0 * angle) > 0.2 + 0.02 * radius {
        return [0.7, 0.1, 0.05];
    }
    if (dy - (0.13 + turn) * dx - 31.0).abs() < 0.6 || (dx - 42.0 - 0.2 * dy).abs() < 0.4 {
        return [0.02; 3];
    }
    if x > 86.0 && (libm::fmod(x + 10.0 * turn, 3.1) < 1.3) != (libm::fmod(y, 2.3) < 1.1) {
        return [0.1, 0.6, 0.2];
    }
    [0.35, 0.45, 0.9]
}

fn drawn(index: usize) -> Frame {
    let turn = 0.037 * index as f64;
    let color = Image::from_fn(EXTENT, |x, y| drawing(f64::from(x) + 0.5, f64::from(y) + 0.5, turn));
    Frame {
        color,
        ..frame(EXTENT, index)
    }
}

/// The mean of 64 samples a pixel.
fn covered(index: usize) -> Image<Rgb> {
    let turn = 0.037 * index as f64;
    Image::from_fn(EXTENT, |x, y| {
        let mut sum = [0.0; 3];
        for i in 0..64 {
            let at = |corner: u32, i: u32| f64::from(corner) + (f64::from(i) + 0.5) / 8.0;
            let sample = drawing(at(x, i % 8), at(y, i / 8), turn);
            sum = std::array::from_fn(|c| sum[c] + sample[c] / 64.0);
        }
        sum
    })
}

const DISPLAY: Display = Display {
    exposure: 0.75,
    tonemap: Tonemap::ReinhardMax,
};

fn mean_square(a: &Image<Rgb>, b: &Image<Rgb>) -> f64 {
    let pairs = a.pixels().iter().zip(b.pixels());
    let squares = pairs.map(|(&a, &b)| {
        let [a, b] = [a, b].map(|c| DISPLAY.apply(c));
        (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>()
    });
    squares.sum::<f64>() / a.pixels().len() as f64
}

#[test]
fn edges_at_every_angle_agree() {
    for preset in ["fxaa", "smaa", "smaa_t2x"] {
        let recipe = recipe(preset, "{}");
        for precision in [Precision::F32, Precision::F16] {
            let found = difference(&recipe, precision, (0..24).map(drawn));
            println!("{preset} {precision:?}: {found:?}");
            assert!(
                found.agrees() || precision == Precision::F16 && found.beyond <= 5e-4,
                "{preset}: {found:?}"
            );
        }
    }
}

/// The comparison can fail: another filter, no filter, one that mixes encoded values, a display a hundredth brighter.
#[test]
fn a_twin_that_filters_otherwise_disagrees() {
    let frames = || (0..2).map(drawn);
    let told_apart = |twin: Recipe, altered: fn(Frame) -> Frame| {
        let twin = Twin::new(twin, Precision::F32);
        let smaa = recipe("smaa", "{}");
        !difference_from(twin, &smaa, Precision::F32, frames(), altered).agrees()
    };
    assert!(!told_apart(recipe("smaa", "{}"), |frame| frame));
    assert!(told_apart(recipe("fxaa", "{}"), |frame| frame));
    assert!(told_apart(recipe("smaa", r#"{"spatial": "none"}"#), |frame| frame));
    assert!(told_apart(recipe("smaa", r#"{"spatial_decodes": false}"#), |frame| {
        frame
    }));
    let brighter = |frame: Frame| Frame {
        display: Display {
            exposure: 2.0 * frame.display.exposure,
            ..frame.display
        },
        ..frame
    };
    assert!(told_apart(recipe("smaa", "{}"), brighter));
}

/// Coverage adds up in light: there both come nearer to it, by more than a mixture of encoded values does.
#[test]
fn both_come_nearer_to_the_true_coverage() {
    let error = |preset: &str, overrides: &str| {
        let shown = resolve_on_gpu(&recipe(preset, overrides), Precision::F32, (0..4).map(drawn));
        let errors = shown
            .iter()
            .enumerate()
            .map(|(index, (shown, _))| mean_square(shown, &covered(index)));
        errors.sum::<f64>() / 4.0
    };
    let none = error("none", "{}");
    for preset in ["fxaa", "smaa"] {
        let (light, encoded) = (error(preset, "{}"), error(preset, r#"{"spatial_decodes": false}"#));
        println!("{preset}: {light} and {encoded} of {none}");
        assert!(
            light < encoded && encoded < none && light < 0.6 * none,
            "{preset}: {light} {encoded} {none}"
        );
    }
}

/// A black half above a white one, the border a pixel lower from x = 8 on. FXAA: at (8, 4), next to the step, the edge ends
/// 1 texel to the left and is lost 26.5 to the right: white counts ½ - 1/27.5. SMAA: the line falls from ½ above the edge to 0
/// in the middle of its 65 pixels, so the first of them takes ½ (1 - ½/32.5) of white.
#[test]
fn a_step_is_blended_as_the_publications_say() {
    let extent = Extent::new(100, 12);
    let step = Frame {
        color: Image::from_fn(extent, |x, y| [f32::from(y >= if x < 8 { 4 } else { 5 }); 3]),
        display: Display::default(),
        ..frame(extent, 0)
    };
    for (preset, expected) in [("fxaa", 0.5 - 1.0 / 27.5), ("smaa", 0.5 * (1.0 - 0.5 / 32.5))] {
        let (shown, _) = resolve_on_gpu(&recipe(preset, "{}"), Precision::F32, [step.clone()].into_iter()).remove(0);
        let found = f64::from(shown.at(8, 4)[0]);
        assert!(
            (found - expected).abs() < 2e-5,
            "{preset}: {found} instead of {expected}"
        );
        // Away from edges nothing changes, but that the display's transform there and back rounds.
        assert_eq!(shown.at(8, 1), [0.0; 3], "{preset}");
        assert!((shown.at(8, 8)[0] - 1.0).abs() < 1e-6, "{preset}");
    }
}

#[test]
fn the_un_jittered_colour_is_read_where_there_is_one_but_not_by_t2x() {
    let reads = |preset: &str| recipe(preset, "{}").optional_channels().unjittered_color;
    assert_eq!(
        ["none", "fxaa", "smaa", "smaa_t2x"].map(reads),
        [true, true, true, false]
    );
    let mut twin = Twin::<f64>::new(recipe("fxaa", "{}"), Precision::F32);
    let flat = Frame {
        unjittered_color: Some(Image::filled(EXTENT, [0.25; 3])),
        ..drawn(0)
    };
    let shown = twin.resolve(&flat).shown;
    assert!(shown.pixels().iter().flatten().all(|v| (v - 0.25).abs() < 1e-9));
}

/// There and back through every display transform, with history in between.
#[test]
fn the_display_domain_agrees_for_every_tone_map() {
    for tonemap in Tonemap::ALL {
        let display = Display { exposure: 0.4, tonemap };
        let frames = (0..12).map(move |index| Frame {
            display,
            ..frame(EXTENT, index)
        });
        for preset in ["smaa_t2x", "inside"] {
            let recipe = recipe(preset, r#"{"domain": "display"}"#);
            let found = difference(&recipe, Precision::F32, frames.clone());
            assert!(found.agrees(), "{preset} {tonemap:?}: {found:?}");
        }
    }
}
