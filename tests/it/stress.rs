//! The stress suite: it passes what is sound, and turns red where a fault is planted in a shader.

use crate::support::{gpu, service::TestService};
use afterimage::{
    gpu::Gpu,
    image::Extent,
    run::PresetSpec,
    stress::{
        self, Observer, Pictures, StressSpec, Trend,
        report::{Cell, StressReport, Verdict},
    },
    taa::{Fault, PRESETS, Precision, recipe::Guards},
};
use serde_json::json;
use std::{fs, path::Path, sync::Mutex};

struct Quiet;

impl Observer for Quiet {
    fn cell(&self, _index: usize, _cell: &Cell, _pictures: Option<&Pictures>, _n_done: usize, _n_total: usize) {}

    fn cancelled(&self) -> bool {
        false
    }
}

fn preset(id: &str, parameters: serde_json::Value) -> PresetSpec {
    PresetSpec {
        preset: id.to_owned(),
        parameters: parameters.as_object().unwrap().clone(),
    }
}

/// One hazard on one preset.
fn spec(hazard: &str, id: &str, precision: Precision) -> StressSpec {
    StressSpec {
        presets: vec![preset(id, json!({}))],
        hazards: vec![hazard.to_owned()],
        precisions: vec![precision],
        ..StressSpec::default()
    }
}

fn run(spec: &StressSpec, gpu: &Gpu) -> StressReport {
    stress::execute(spec, gpu, &Quiet).unwrap()
}

fn only_cell(spec: &StressSpec, gpu: &Gpu) -> Cell {
    let mut cells = run(spec, gpu).cells;
    assert_eq!(cells.len(), 1);
    cells.remove(0)
}

/// What a long run finds does not depend on whether it stops where the state repeats: of the adapter, which `--every-frame` keeps
/// running, and of the twin, whose last digits of `inside` take several periods to come back.
#[test]
fn long_runs_stop_where_the_state_repeats() {
    let gpu = gpu();
    for (hazard, id) in [("feedback.static", "inside"), ("feedback.no_excitation", "phlm2016")] {
        let cell = |every_frame| {
            let spec = StressSpec {
                n_frames: Some(3000),
                every_frame,
                ..spec(hazard, id, Precision::F32)
            };
            only_cell(&spec, gpu)
        };
        let (short, long) = (cell(false), cell(true));
        assert!(
            short.reason.contains("the state repeats from frame"),
            "{}",
            short.reason
        );
        assert_eq!(
            (short.verdict, short.max_error.0, &short.reason),
            (long.verdict, long.max_error.0, &long.reason)
        );
    }
    let forever = StressSpec {
        n_frames: Some(10_000_000),
        ..spec("feedback.static", "inside", Precision::F32)
    };
    assert_eq!(only_cell(&forever, gpu).n_frames, 10_000_000);
}

/// Over a thousand resampled frames PHLM's decisions turn on rounding: its twins in f32 and f64 part too, so nobody blames the
/// adapter. A shader that is wrong is blamed all the same.
#[test]
fn what_rounding_decides_is_no_fault() {
    let gpu = gpu();
    let chaotic = spec("resampling.zoom", "phlm2016", Precision::F32);
    let cell = only_cell(&chaotic, gpu);
    assert_eq!(cell.verdict, Verdict::Degrades, "{}", cell.reason);
    assert!(cell.reason.contains("so does a twin in f32"), "{}", cell.reason);
    let fault = Fault {
        pass: "model",
        text: "const FORGETTING: f32 = 0.998;",
        instead: "const FORGETTING: f32 = 0.9;",
    };
    let soon = StressSpec {
        n_frames: Some(100),
        ..chaotic
    };
    let early = only_cell(&soon, gpu);
    assert_ne!(early.verdict, Verdict::Fails, "{}", early.reason);
    assert!(!early.reason.contains("differ from the twin"), "{}", early.reason);
    let report = stress::execute_with_fault(&soon, gpu, &Quiet, Some(fault)).unwrap();
    assert_eq!(report.cells[0].verdict, Verdict::Fails, "{}", report.cells[0].reason);
}

/// What each fault is, and the cell that it must turn red.
#[test]
fn planted_faults_turn_cells_red() {
    let faults = [
        (
            "NaN is tested as x != x, which drivers fold away",
            "prepare",
            "return bits > F16_MAX_BITS && bits != 0x80000000u;",
            "return x != x || x < 0.0 || x > F16_MAX;",
            spec("texel.nan", "inside", Precision::F16),
        ),
        (
            "what is above the largest f16 is left",
            "prepare",
            "let too_large = bits > F16_MAX_BITS && bits <= 0x7f800000u;",
            "let too_large = false;",
            spec("texel.inf", "ema", Precision::F32),
        ),
        (
            "the store truncates, seen in one frame",
            "resolve",
            "return quantizeToF16(c);",
            "return bitcast<vec3f>(bitcast<vec3u>(c) & vec3u(0xffffe000u));",
            spec("shape.61x37", "karis2014", Precision::F16),
        ),
        (
            "the store truncates, seen over many frames",
            "resolve",
            "return quantizeToF16(c);",
            "return bitcast<vec3f>(bitcast<vec3u>(c) & vec3u(0xffffe000u));",
            StressSpec {
                n_frames: Some(400),
                ..spec("feedback.static", "ema", Precision::F16)
            },
        ),
        (
            "boxes have no smallest extent",
            "resolve",
            "    return vec3f(0x1p-11);",
            "    return vec3f(1e-30);",
            spec("variance.flat_channel", "inside", Precision::F16),
        ),
        (
            "variance is m2/N - μ² about 0",
            "resolve",
            "let centre = select(vec3f(0.0), neighbour(p, vec2i(0)), guards);",
            "let centre = vec3f(0.0);",
            StressSpec {
                // Where the extremes of the texels bound it too, a box that is too wide does no harm.
                presets: vec![preset("salvi2016", json!({"intersect_minmax": false}))],
                ..spec("variance.narrow_box", "salvi2016", Precision::F32)
            },
        ),
        (
            "prefiltered moments are about 0",
            "moments_columns",
            "    if (!guards) {\n        shift = vec3f(0.0);",
            "    if (true) {\n        shift = vec3f(0.0);",
            spec("variance.narrow_box", "salvi2016_wide", Precision::F32),
        ),
        (
            "luma's divisor has no floor",
            "resolve",
            "max(max(l0, l1), 0.2)",
            "max(l0, l1)",
            spec("variance.box_zero", "inside", Precision::F32),
        ),
        (
            "P is not bounded",
            "model",
            "    return p * min(1.0, 4.0 * UNKNOWN / trace);",
            "    return p;",
            StressSpec {
                n_frames: Some(2000),
                ..spec("feedback.no_excitation", "phlm2016", Precision::F32)
            },
        ),
        (
            "depth that is no depth is believed",
            "resolve",
            "return select(SKY_DEPTH, z, bitcast<u32>(z) - 1u < 0x7f7fffffu);",
            "return z;",
            spec("depth.hostile", "inside", Precision::F32),
        ),
        (
            "motion that is no motion is followed",
            "resolve",
            "&& length2 <= longest * longest;",
            "|| true;",
            spec("motion.nan", "ema", Precision::F32),
        ),
        (
            "an opacity that is none is believed",
            "merge",
            "return select(clamp(a, 0.0, 1.0), 0.0, (bitcast<u32>(a) & 0x7fffffffu) > 0x7f800000u);",
            "return a;",
            spec("several.layers", "ema", Precision::F32),
        ),
        (
            "one sample of several is not repaired",
            "merge",
            "            sum += repaired(raw);",
            "            sum += raw;",
            spec("several.samples", "ema", Precision::F32),
        ),
        (
            "the unlit colour is not repaired",
            "prepare",
            "luma(select(albedo, repaired(albedo), guards))",
            "luma(albedo)",
            spec("albedo.hostile", "sobel2018", Precision::F32),
        ),
        (
            "a reactive mask that is no number is believed",
            "resolve",
            "return select(0.0, saturate(bitcast<f32>(bits)), (bits & 0x7fffffffu) < 0x7f800000u);",
            "return bitcast<f32>(bits);",
            StressSpec {
                presets: vec![preset("ema", json!({"reactive": true}))],
                ..spec("reactive.hostile", "ema", Precision::F32)
            },
        ),
        (
            "the tone map's inverse has no end",
            "resolve",
            "t / (1.0 - min(max3(t), TONEMAPPED_MAX))",
            "t / (1.0 - max3(t))",
            spec("color.tonemap", "smaa1tx", Precision::F32),
        ),
        (
            "what is stored does not saturate",
            "resolve",
            "    return min(c, vec3f(F16_MAX));",
            "    return c;",
            StressSpec {
                presets: vec![preset("ema", json!({"history_filter": "catmull_rom"}))],
                ..spec("texel.moving_edge", "ema", Precision::F32)
            },
        ),
        (
            "negative lobes go below black",
            "resolve",
            "    h = max(h, vec3f(0.0));",
            "",
            StressSpec {
                presets: vec![preset("ema", json!({"history_filter": "catmull_rom"}))],
                ..spec("texel.moving_edge", "ema", Precision::F32)
            },
        ),
        (
            "a weight is slightly off",
            "resolve",
            "var a = current_weight;",
            "var a = 1.05 * current_weight;",
            spec("color.tonemap", "ema", Precision::F32),
        ),
        (
            "tiles whose history still changes are kept",
            "classify",
            "&& (before & CHANGED) == 0u",
            "",
            spec("order.skip", "ema", Precision::F32),
        ),
        (
            "tiles of a moving surface are kept before it has settled",
            "classify",
            "const UNSETTLED: u32 = 2u;",
            "const UNSETTLED: u32 = 0u;",
            spec("order.skip", "ema", Precision::F32),
        ),
        (
            "tiles of which nothing is noted are kept",
            "classify",
            "noted |= CHANGED | UNSETTLED;",
            "",
            spec("order.skip", "ema", Precision::F32),
        ),
        (
            "it is not noted that history changes",
            "settle",
            "differ(c, fetch(history, p))",
            "differ(c, fetch(history, p)) && c.r < 0.0",
            spec("order.skip", "ema", Precision::F32),
        ),
        (
            "it is not noted that history has not settled",
            "settle",
            "differ(c, round_history(fetch(color, p)))",
            "differ(c, round_history(fetch(color, p))) && c.r < 0.0",
            spec("order.skip", "ema", Precision::F32),
        ),
    ];
    let mut missed = Vec::new();
    for (fault, pass, text, instead, spec) in faults {
        let sound = only_cell(&spec, gpu());
        assert!(sound.verdict < Verdict::Fails, "{fault}: red without it: {sound:?}");
        let mistake = Fault { pass, text, instead };
        let mut cells = stress::execute_with_fault(&spec, gpu(), &Quiet, Some(mistake))
            .unwrap()
            .cells;
        let found = cells.remove(0);
        println!("{fault}: {:?}: {}", found.verdict, found.reason);
        if found.verdict != Verdict::Fails {
            missed.push((fault, found));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

/// Every preset passes or degrades; which cells degrade is written in docs/stability.md.
#[test]
fn no_preset_fails_a_quick_look_with_f16_history() {
    no_preset_fails(Precision::F16);
}

#[test]
fn no_preset_fails_a_quick_look_with_f32_history() {
    no_preset_fails(Precision::F32);
}

fn no_preset_fails(precision: Precision) {
    let spec = StressSpec {
        quick: true,
        n_frames: Some(12),
        precisions: vec![precision],
        ..StressSpec::default()
    };
    let report = run(&spec, gpu());
    let failed: Vec<_> = report
        .cells
        .iter()
        .filter(|cell| cell.verdict == Verdict::Fails)
        .collect();
    assert!(failed.is_empty(), "{failed:#?}");
    let ran = report.cells.iter().filter(|cell| cell.verdict != Verdict::NotRun);
    let n_ran = ran.inspect(|cell| assert!(cell.n_frames > 0, "{cell:?}")).count();
    assert!(n_ran > 20 * PRESETS.len(), "{n_ran} cells ran");
    let not_run = report.cells.iter().filter(|cell| cell.verdict == Verdict::NotRun);
    not_run.for_each(|cell| assert!(!cell.reason.is_empty(), "{cell:?}"));
}

#[test]
fn guards_are_what_keeps_recipes_stable() {
    let unguarded = |hazard, id, precision| StressSpec {
        guards: vec![Guards::Off],
        ..spec(hazard, id, precision)
    };
    let nan = only_cell(&unguarded("texel.nan", "ema", Precision::F32), gpu());
    assert_eq!(nan.verdict, Verdict::Fails, "{nan:?}");
    assert!(nan.reason.contains("not finite"), "{nan:?}");
    let forgetting = StressSpec {
        n_frames: Some(2000),
        ..unguarded("feedback.no_excitation", "phlm2016", Precision::F32)
    };
    let forgetting = only_cell(&forgetting, gpu());
    assert!(forgetting.reason.contains("covariances"), "{forgetting:?}");
}

/// Many frames at once are those one by one, and what repeats is found to.
#[test]
fn long_runs_agree_with_the_twin_and_end_early() {
    for id in ["inside", "accumulate", "phlm2016", "taau", "checkerboard"] {
        let spec = StressSpec {
            n_frames: Some(1000),
            size: Some(Extent::new(18, 16)),
            ..spec("feedback.static", id, Precision::F32)
        };
        let cell = only_cell(&spec, gpu());
        assert_eq!(cell.verdict, Verdict::Pass, "{cell:?}");
        assert_eq!(
            cell.growth.map(|growth| growth.trend).unwrap_or(Trend::Bounded),
            Trend::Bounded,
            "{cell:?}"
        );
        assert!(cell.max_error.0 < 1e-4, "{cell:?}");
        assert!(cell.n_frames > 980, "{cell:?}");
    }
}

#[test]
fn the_adapter_decides_what_can_run() {
    let spec = StressSpec {
        size: Some(Extent::new(16384, 1)),
        ..spec("feedback.decay", "taau", Precision::F16)
    };
    let cell = only_cell(&spec, gpu());
    assert_eq!(cell.verdict, Verdict::NotRun);
    // Where textures may be as large as its output, its memory is too much.
    let reason = if 2 * 16384 > gpu().max_side() {
        "pixels a side"
    } else {
        "MiB at once"
    };
    assert!(cell.reason.contains(reason), "{cell:?}");
}

#[test]
fn specs_that_make_no_sense_are_refused() {
    let refused = |spec: StressSpec| stress::validate(&spec).unwrap_err().to_string();
    let unknown = StressSpec {
        hazards: vec!["texel.nun".to_owned()],
        ..StressSpec::default()
    };
    assert!(refused(unknown).contains("did you mean `texel.nan`"));
    let empty = StressSpec {
        size: Some(Extent::new(0, 4)),
        ..StressSpec::default()
    };
    assert!(refused(empty).contains("size"));
    let parameter = StressSpec {
        presets: vec![preset("ema", json!({"weigth": "fixed"}))],
        ..StressSpec::default()
    };
    assert!(refused(parameter).contains("did you mean `weight`"));
}

/// The document has every hazard and every recipe, and is the same each time.
#[test]
fn the_document_has_every_hazard() {
    let spec = StressSpec {
        presets: vec![preset("none", json!({})), preset("ema", json!({}))],
        hazards: vec![
            "color".to_owned(),
            "variance.zero".to_owned(),
            "feedback.decay".to_owned(),
        ],
        guards: vec![Guards::On, Guards::Off],
        ..StressSpec::default()
    };
    let [first, second] = [0, 1].map(|_| stress::markdown(&[run(&spec, gpu())], "afterimage stress"));
    assert_eq!(first, second);
    for hazard in stress::hazards() {
        let row = format!("| `{}` | {} |", hazard.id, hazard.about);
        assert!(first.contains(&row), "{row}");
    }
    assert!(
        first.contains("| `color.tonemap` | ✓") && first.contains("Without guards"),
        "{first}"
    );
    assert!(first.contains("Made by `afterimage stress`;"), "{first}");
    // The one in the repository knows them all, too.
    let kept = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/stability.md")).unwrap();
    for hazard in stress::hazards() {
        assert!(
            kept.contains(&format!("| `{}` |", hazard.id)),
            "docs/stability.md lacks {}",
            hazard.id
        );
    }
    for preset in &PRESETS {
        assert!(
            kept.contains(&format!("`{}`", preset.id)),
            "docs/stability.md lacks {}",
            preset.id
        );
    }
}

#[test]
fn pictures_show_where_the_worst_is() {
    #[derive(Default)]
    struct Keep(Mutex<Vec<Vec<u8>>>);
    impl Observer for Keep {
        fn cell(&self, _index: usize, _cell: &Cell, pictures: Option<&Pictures>, _n_done: usize, _n_total: usize) {
            self.0.lock().unwrap().extend(pictures.map(Pictures::png));
        }
        fn cancelled(&self) -> bool {
            false
        }
    }
    let keep = Keep::default();
    let spec = StressSpec {
        guards: vec![Guards::Off],
        ..spec("texel.nan", "ema", Precision::F32)
    };
    stress::execute(&spec, gpu(), &keep).unwrap();
    let png = keep.0.into_inner().unwrap().remove(0);
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut rgb).unwrap();
    assert!(
        rgb.chunks_exact(3).any(|pixel| pixel == [255, 0, 255]),
        "a NaN is magenta"
    );
}

#[test]
fn the_service_keeps_matrices() {
    let service = TestService::with_gpu();
    let client = service.client();
    let post = |body: &serde_json::Value| {
        client.send(
            "POST",
            "/stress",
            &[("content-type", "application/json")],
            body.to_string().as_bytes(),
        )
    };
    let unknown = json!({"stress": {"hazards": ["nothing"]}});
    post(&unknown).is_problem(
        422,
        "invalid_job",
        Some("stress.hazards"),
        "no hazard or family `nothing`",
    );
    assert_eq!(client.get("/stress").json()["runs"].as_array().unwrap().len(), 0);
    let body =
        json!({"stress": {"presets": [{"preset": "ema"}], "hazards": ["shape.3x5", "texel.nan"]}, "label": "first"});
    let answer = post(&body);
    assert_eq!(answer.status, 202, "{}", answer.text());
    let id = answer.json()["id"].as_i64().unwrap();
    let job = client.wait_for(id, &["done", "failed"]);
    assert_eq!((&job["status"], &job["n_done"]), (&json!("done"), &json!(4)), "{job}");
    assert_eq!(job["spec"]["stress"]["hazards"][0], "shape.3x5");
    let matrix = client.get(&format!("/stress/{id}")).json();
    assert!(!matrix["adapter"]["driver"].as_str().unwrap().is_empty());
    let cells = matrix["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 4);
    for field in [
        "hazard",
        "recipe",
        "precision",
        "adapter",
        "verdict",
        "reason",
        "max_error",
        "frame",
        "recovered_after",
    ] {
        assert!(cells[0].get(field).is_some(), "{field}");
    }
    let picture = client.get(&format!("/stress/{id}/cells/0.png"));
    assert_eq!((picture.status, &picture.body[1..4]), (200, &b"PNG"[..]));
    let pictured: Vec<u64> = cells[0]["pictured"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|n| n.as_u64())
        .collect();
    let worst = cells[0]["frame"].as_u64().unwrap();
    let last = cells[0]["n_frames"].as_u64().unwrap() - 1;
    assert!(pictured.is_sorted() && pictured.contains(&worst), "{pictured:?}");
    // The bad frame, and the one that must be free of it.
    assert!([5, 6, 7].iter().all(|frame| pictured.contains(frame)), "{pictured:?}");
    assert_eq!((pictured.first(), pictured.last()), (Some(&0), Some(&last)));
    // Rows of equal height, four pixels between them: texels of 24×18 four times enlarged.
    let height = u32::from_be_bytes(picture.body[20..24].try_into().unwrap());
    assert_eq!(height, 76 * pictured.len() as u32 - 4);
    client
        .get(&format!("/stress/{id}/cells/9.png"))
        .is_problem(404, "not_found", None, "no picture");
    client
        .get("/stress/77")
        .is_problem(404, "not_found", None, "no stress report");
    let page = |path: &str| {
        ureq::get(service.url(path))
            .call()
            .unwrap()
            .body_mut()
            .read_to_string()
            .unwrap()
    };
    let overview = page("/stress");
    for text in ["shape.3x5", "texel.nan", "ema", &format!("/stress/{id}/cells/0")] {
        assert!(overview.contains(text), "{text} is not on the page");
    }
    assert!(page(&format!("/stress/{id}/cells/1")).contains("cells/1.png"));
    assert!(page("/jobs").contains("/stress?job="));
    assert!(page(&format!("/jobs/{id}")).contains("stress"));
}
