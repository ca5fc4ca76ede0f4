//! Validation of an adapter: a clean one passes, and a fault in any pass is found by the pass's name and first frame.

use crate::{
    gpu_vs_reference::{SIZES, scene},
    support::{frame, gpu},
};
use afterimage::{
    gpu::{Bound, Dispatch, Gpu, GpuError, Timer},
    image::Extent,
    sequence::{Channels, Frame},
    taa::{
        Fault, Inputs, PRESETS, Precision, Preset, Recipe, Recorder, Repeat, Resolver, Watch,
        reference::Twin,
        validation::{Validation, Validator, shown},
    },
};
use std::collections::BTreeSet;

fn channels(recipe: &Recipe) -> Channels {
    let optional = Channels {
        unjittered_color: false,
        ..recipe.optional_channels()
    };
    recipe.required_channels().union(optional)
}

/// A recipe over frames on both sides, with one pass swapped for its twin and a fault in one, if any.
pub fn validated(
    recipe: &Recipe,
    precision: Precision,
    frames: impl Iterator<Item = Frame>,
    swapped: Option<&str>,
    fault: Option<Fault<'_>>,
) -> Validation {
    let mut frames = frames.peekable();
    let first = frames.peek().unwrap();
    let channels = Channels {
        several: first.several(),
        ..channels(recipe)
    };
    let mut validator = Validator::new(gpu(), recipe, precision, (first.sizes(), channels), swapped, fault).unwrap();
    let frames = frames.map(|frame| validator.frame(&frame).unwrap()).collect();
    Validation::new(validator.bounds(), frames)
}

fn recipe(preset: &str, overrides: &str) -> Recipe {
    let overrides = serde_json::from_str(overrides).unwrap();
    Preset::find(preset).unwrap().recipe.with(&overrides).unwrap()
}

/// A fault as `validated` takes it, and how it is to be found.
struct Planted {
    recipe: Recipe,
    pass: &'static str,
    text: &'static str,
    instead: String,
    first_frame: usize,
}

fn planted(recipe: Recipe, pass: &'static str, text: &'static str, instead: &str, first_frame: usize) -> Planted {
    Planted {
        recipe,
        pass,
        text,
        instead: instead.to_owned(),
        first_frame,
    }
}

/// A factor that is wrong in the frame with this jitter, and 1 in all others before it.
fn only_in(index: usize) -> String {
    let jitter = frame(Extent::new(1, 1), index).jitter_px[0];
    format!("select(1.0, 0.97, abs(frame.jitter_px.x - ({jitter:?})) < 1e-6)")
}

/// One for every pass there is.
fn faults() -> Vec<Planted> {
    let bfecc = || recipe("ema", r#"{"history_filter": "bfecc"}"#);
    let quasi_cubic = || recipe("ema", r#"{"history_filter": "quasi_cubic"}"#);
    let plain = |preset| recipe(preset, "{}");
    let late = only_in(5);
    vec![
        planted(
            plain("fxaa"),
            "fxaa",
            "vec4f(rgb, c.a)",
            &format!("vec4f({late} * rgb, c.a)"),
            5,
        ),
        planted(
            plain("smaa"),
            "smaa_edges",
            ">= vec2f(THRESHOLD)",
            ">= vec2f(2.0 * THRESHOLD)",
            0,
        ),
        planted(plain("smaa"), "smaa_weights", "return area *", "return 0.9 * area *", 0),
        planted(
            plain("smaa"),
            "smaa_blend",
            "vec4f(rgb, c.a)",
            &format!("vec4f({late} * rgb, c.a)"),
            5,
        ),
        planted(
            quasi_cubic(),
            "prefilter_rows",
            "GAIN * GAIN * y",
            "0.9 * GAIN * GAIN * y",
            1,
        ),
        planted(
            quasi_cubic(),
            "prefilter_columns",
            "GAIN * GAIN * y",
            "0.9 * GAIN * GAIN * y",
            1,
        ),
        planted(plain("ema"), "prepare", "F16_MAX, too_large", "100.0, too_large", 4),
        planted(bfecc(), "advect", "+ 0.5 + usable", "+ 0.25 + usable", 1),
        planted(bfecc(), "compensate", "0.5 * (h - back)", "0.3 * (h - back)", 1),
        planted(
            plain("amortized"),
            "difference",
            "- fetch(color, p)",
            "- 0.9 * fetch(color, p)",
            1,
        ),
        planted(plain("amortized"), "difference_rows", "sum / 7.0", "sum / 7.5", 1),
        planted(
            plain("salvi2016_wide"),
            "moments_rows",
            "shift + offset",
            "shift + 0.9 * offset",
            0,
        ),
        planted(
            plain("salvi2016_wide"),
            "moments_columns",
            "shift + offset",
            "shift + 0.9 * offset",
            0,
        ),
        planted(
            plain("sobel2018"),
            "edges",
            "vec3f(0.7, 0.3, 1.0)",
            "vec3f(0.7, 0.2, 1.0)",
            0,
        ),
        planted(plain("sobel2018"), "stabilise", "0.5 * (cross + square)", "cross", 1),
        planted(
            plain("inside"),
            "resolve",
            "saturated(resolved)",
            &format!("saturated({late} * resolved)"),
            5,
        ),
        planted(
            plain("uncharted4"),
            "sharpen",
            "c + sharpen_strength",
            &format!("{late} * c + sharpen_strength"),
            5,
        ),
        planted(
            plain("phlm2016"),
            "still",
            "atomicStore(&moves, 1u)",
            "atomicStore(&moves, 0u)",
            0,
        ),
        planted(
            plain("phlm2016"),
            "model",
            "let y = current_color",
            &format!("let y = {late} * current_color"),
            5,
        ),
        planted(
            plain("checkerboard"),
            "resolve",
            "resolved = filled",
            &format!("resolved = {late} * filled"),
            5,
        ),
    ]
}

#[test]
fn a_fault_is_found_by_pass_and_first_frame() {
    for planted in faults() {
        let Planted {
            recipe,
            pass,
            text,
            instead,
            first_frame,
        } = &planted;
        let fault = Fault { pass, text, instead };
        let found = validated(recipe, Precision::F32, scene(SIZES[0]).take(8), None, Some(fault));
        assert!(!found.agrees, "{pass}");
        assert_eq!(found.first_fault(), Some((*first_frame, *pass)));
        // Errors of this pass do not count against those after it.
        let wrong: Vec<_> = found.passes.iter().filter(|pass| !pass.agrees).collect();
        assert_eq!(wrong.len(), 1, "{pass}: {wrong:?}");
        assert_eq!(wrong[0].first_disagreeing_frame, Some(*first_frame));
    }
}

#[test]
fn every_pass_has_its_fault() {
    let faults: BTreeSet<_> = faults().iter().map(|planted| planted.pass).collect();
    let recipes = PRESETS.iter().map(|preset| preset.recipe.clone());
    let filters = ["bfecc", "quasi_cubic"].map(|filter| recipe("ema", &format!(r#"{{"history_filter": "{filter}"}}"#)));
    for recipe in recipes.chain(filters) {
        for pass in recipe.passes() {
            assert!(faults.contains(pass), "no fault is planted in `{pass}`");
        }
    }
}

/// With the twin's images in the place of the faulty pass's, what is shown agrees, and with any other pass's it does not.
#[test]
fn swapping_the_faulty_pass_heals_the_frames() {
    let late = only_in(5);
    let cases = [
        (
            "uncharted4",
            "sharpen",
            "c + sharpen_strength",
            format!("{late} * c + sharpen_strength"),
        ),
        (
            "sobel2018",
            "stabilise",
            "0.5 * (cross + square)",
            "vec2f(0.0, 0.1)".to_owned(),
        ),
        (
            "salvi2016_wide",
            "moments_columns",
            "shift + offset",
            "shift + 0.5 * offset".to_owned(),
        ),
        (
            "phlm2016",
            "model",
            "let y = current_color",
            format!("let y = {late} * current_color"),
        ),
        ("ema", "prepare", "F16_MAX, too_large", "100.0, too_large".to_owned()),
    ];
    for (preset, faulty, text, instead) in cases {
        let recipe = recipe(preset, "{}");
        let fault = Fault {
            pass: faulty,
            text,
            instead: &instead,
        };
        let passes: Vec<_> = [&["prepare"], &*recipe.passes()].concat();
        for pass in passes {
            let found = validated(
                &recipe,
                Precision::F32,
                scene(SIZES[0]).take(8),
                Some(pass),
                Some(fault),
            );
            let heals = shown(pass, &found.frames).agrees;
            assert_eq!(
                heals,
                pass == faulty,
                "{preset}: the twin's `{pass}` for a wrong `{faulty}`"
            );
        }
    }
}

/// Every pass's twin says all that the pass writes, so that nothing is left unseen.
#[test]
fn twins_know_everything_that_passes_write() {
    let bfecc = recipe("ema", r#"{"history_filter": "bfecc"}"#);
    let counted = recipe(
        "ema",
        r#"{"weight": "count", "history_filter": "bfecc", "sharpen": "xu"}"#,
    );
    let recipes = PRESETS.iter().map(|preset| preset.recipe.clone());
    for recipe in recipes.chain([bfecc, counted]) {
        let (gpu, extent) = (gpu(), Extent::new(5, 4));
        let frames = [0, 1].map(|index| frame(extent, index));
        let sizes = frames[0].sizes();
        let wanted = BTreeSet::from([recipe.preparation()]);
        let mut inputs = Inputs::new(gpu, sizes, channels(&recipe), &wanted).unwrap();
        let mut resolver = Resolver::new(gpu, recipe.clone(), Precision::F16, sizes).unwrap();
        let mut timer = Timer::new(gpu, 0);
        let mut twin = Twin::new(recipe, Precision::F16);
        for frame in &frames {
            inputs.upload(gpu, frame).unwrap();
            twin.begin(frame);
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let mut covered = Covered { twin: &mut twin, frame };
            let mut recorder = Recorder {
                gpu,
                encoder: &mut encoder,
                timer: &mut timer,
                repeat: Repeat::Timed(1),
                watch: Some(&mut covered),
            };
            inputs.record(&mut recorder).unwrap();
            resolver.record(&mut recorder, &inputs).unwrap();
        }
    }
}

#[derive(Debug)]
struct Covered<'a> {
    twin: &'a mut Twin<f32>,
    frame: &'a Frame,
}

impl Watch for Covered<'_> {
    fn recorded(
        &mut self,
        _: &Gpu,
        _: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        _: &[&wgpu::Buffer],
    ) -> Result<(), GpuError> {
        let planes = self.twin.compute(dispatch.label(), self.frame);
        for plane in &planes {
            self.twin.keep(dispatch.label(), plane);
        }
        // What a recipe has no use for is a texture of one texel.
        let is_real = |bound: &Bound<'_>| match bound {
            Bound::Texture(texture) => texture.extent() != Extent::new(1, 1),
            Bound::Buffer(_) => true,
        };
        let written = dispatch
            .bound()
            .filter(|(_, bound, access)| access.writes && is_real(bound));
        let written: BTreeSet<_> = written.map(|(name, ..)| name).collect();
        let known: BTreeSet<_> = planes.iter().map(|plane| plane.name).collect();
        // Before there is history, nobody reads what is made of it.
        if self.frame.index > 0 || !known.is_empty() {
            assert_eq!(known, written, "{}", dispatch.label());
        }
        Ok(())
    }
}

#[test]
fn a_clean_adapter_agrees_for_64_frames_with_a_reset() {
    for preset in &PRESETS {
        let found = validated(&preset.recipe, Precision::F32, scene(SIZES[0]), None, None);
        assert!(
            found.agrees && found.first_fault().is_none(),
            "{}: {found:?}",
            preset.id
        );
        assert_eq!(found.frames.len(), 64);
    }
}

/// What is promised then is that each pass agrees, and plain blends.
#[test]
fn a_clean_adapter_agrees_with_f16_history() {
    for preset in &PRESETS {
        let found = validated(&preset.recipe, Precision::F16, scene(SIZES[0]).take(32), None, None);
        assert!(found.agrees, "{}: {found:?}", preset.id);
    }
}

#[test]
fn a_clean_adapter_agrees_at_odd_sizes() {
    for preset in &PRESETS {
        for extent in &SIZES[1..] {
            let found = validated(&preset.recipe, Precision::F32, scene(*extent).take(24), None, None);
            assert!(found.agrees, "{} {extent}: {found:?}", preset.id);
        }
    }
}

#[test]
fn a_clean_adapter_agrees_where_it_upscales() {
    let upscaled = scene(Extent::new(31, 19)).take(12).map(|frame| Frame {
        output_size: Extent::new(61, 37),
        ..frame
    });
    let found = validated(&recipe("taau", "{}"), Precision::F32, upscaled, None, None);
    assert!(found.agrees, "{found:?}");
}
