//! `docs/algorithms.md` says what the code does: its tables are made here, from the recipes and from what their passes bind,
//! and compared with the page. `BLESS=1` writes them into it.

use crate::support::{frame, gpu};
use afterimage::{
    gpu::{Access, Dispatch, Gpu, GpuError, Timer},
    image::Extent,
    sequence::Channels,
    taa::{
        Inputs, PRESETS, Precision, Preset, Recipe, Recorder, Repeat, Resolver, Source, Watch,
        recipe::{
            Algorithm, Dilation, Domain, HdrWeight, HistoryFilter, InputFilter, Kind, Neighbourhood, Rectify, Sharpen,
            Spatial, Weight, parameters,
        },
    },
};
use std::{collections::BTreeSet, fmt::Write as _, fs, path::Path};

/// Bytes that a pass must move: each image bound for reading once, and each for writing. Of one pixel.
#[derive(Debug)]
struct Traffic {
    pass: String,
    read: f64,
    written: f64,
}

#[derive(Debug, Default)]
struct Count(Vec<Traffic>);

const EXTENT: Extent = Extent::new(64, 48);

impl Watch for Count {
    fn recorded(
        &mut self,
        _: &Gpu,
        _: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        _: &[&wgpu::Buffer],
    ) -> Result<(), GpuError> {
        let sum = |wanted: fn(Access) -> bool| {
            let bound = dispatch.bound().filter(|&(.., access)| wanted(access));
            // What is one texel, or one number, is not moved for each pixel.
            bound
                .map(|(_, bound, _)| (bound.n_bytes() as f64 / EXTENT.n_pixels() as f64).floor())
                .sum()
        };
        self.0.push(Traffic {
            pass: dispatch.label().to_owned(),
            read: sum(|access| access.reads),
            written: sum(|access| access.writes),
        });
        Ok(())
    }
}

fn traffic(recipe: &Recipe) -> Vec<Traffic> {
    let gpu = gpu();
    let sample = frame(EXTENT, 0);
    let channels = recipe.required_channels().union(Channels {
        unjittered_color: false,
        ..recipe.optional_channels()
    });
    let wanted = BTreeSet::from([recipe.preparation()]);
    let mut inputs = Inputs::new(gpu, sample.sizes(), channels, &wanted).unwrap();
    let mut resolver = Resolver::new(gpu, recipe.clone(), Precision::F16, sample.sizes()).unwrap();
    inputs.upload(gpu, &sample).unwrap();
    let mut count = Count::default();
    let mut recorder = Recorder {
        gpu,
        encoder: &mut gpu.device.create_command_encoder(&Default::default()),
        timer: &mut Timer::new(gpu, 0),
        repeat: Repeat::Timed(1),
        watch: Some(&mut count),
    };
    inputs.record(&mut recorder).unwrap();
    resolver.record(&mut recorder, &inputs).unwrap();
    count.0
}

fn names(channels: Channels) -> Vec<&'static str> {
    let all = [
        ("depth", channels.depth),
        ("motion", channels.motion),
        ("object ids", channels.object_id),
        ("albedo", channels.albedo),
        ("reactive mask", channels.reactive),
        ("un-jittered colour", channels.unjittered_color),
    ];
    all.into_iter().filter_map(|(name, has)| has.then_some(name)).collect()
}

fn inputs(recipe: &Recipe) -> String {
    let required = [vec!["colour"], names(recipe.required_channels())].concat().join(", ");
    let optional = names(recipe.optional_channels()).join(", ");
    match optional.is_empty() {
        true => required,
        false => format!("{required}; where there: {optional}"),
    }
}

/// What of Yang, Liu and Salvi 2020 it is built from, by their sections.
fn survey(recipe: &Recipe) -> String {
    let mut blocks = Vec::new();
    let uses_history = recipe.history_filter != HistoryFilter::None;
    let is_temporal = recipe.algorithm == Algorithm::Temporal;
    blocks.push(match (recipe.source, recipe.input_filter) {
        (Source::UnjitteredIfPresent, _) => "3.1 no jitter where there is a choice",
        (_, InputFilter::Texel) => "3.1 the sample as it fell",
        (_, InputFilter::Unjitter) => "3.1 samples resampled to pixel centres",
        (_, InputFilter::BlackmanHarris) => "3.1 samples filtered by their distance",
        (_, InputFilter::Upsample) => "5.1 samples by their distance on the output's grid",
    });
    if recipe.spatial != Spatial::None {
        blocks.push("6.4 each frame anti-aliased by itself");
    }
    if uses_history {
        blocks.push(match (recipe.reproject, recipe.dilation) {
            (false, _) => "3.2 no reprojection",
            (_, Dilation::None) => "3.2 each pixel's own vector",
            (_, Dilation::Closest) => "3.2 vector of the nearest surface",
            (_, Dilation::Longest) => "3.2 longest vector",
        });
        blocks.extend(match recipe.history_filter {
            HistoryFilter::None | HistoryFilter::Texel => None,
            HistoryFilter::Bilinear => Some("6.1.1 bilinear resampling"),
            HistoryFilter::CatmullRom => Some("6.1.1 Catmull-Rom, 16 texels"),
            HistoryFilter::CatmullRom5 => Some("6.1.1 Catmull-Rom, 5 taps"),
            HistoryFilter::Bfecc => Some("6.1.1 error compensation"),
            HistoryFilter::QuasiCubic => Some("6.1.1 cubic quasi-interpolation"),
        });
    }
    if uses_history && is_temporal {
        blocks.push(match recipe.weight {
            Weight::Fixed => "3.3 fixed weight",
            Weight::Count => "3.3 mean of all samples",
            Weight::LumaFeedback => "4.1 weight by difference of luma",
            Weight::Antiflicker => "6.3 less weight near the box's ends",
            Weight::Amortized => "3.3 mean, 4.1 weight bounded by difference and by resampling",
        });
        blocks.extend(recipe.motion_weight.then_some("3.3 weight raised by motion"));
        blocks.extend((recipe.reject_depth || recipe.reject_id).then_some("4.1 rejection by geometry"));
        blocks.extend(box_of(recipe));
    }
    match recipe.algorithm {
        Algorithm::Temporal => {}
        Algorithm::Phlm2016 => blocks.push("4.2 linear models of each pixel's history"),
        Algorithm::Checkerboard => blocks.push("5.3 checkerboard"),
    }
    if recipe.algorithm == Algorithm::Checkerboard {
        blocks.extend(box_of(recipe));
    }
    if recipe.domain == Domain::Tonemapped {
        blocks.push("3.3.1 tone-mapped");
    }
    if recipe.hdr_weight == HdrWeight::Karis {
        blocks.push("3.3.1 weight by luma");
    }
    if recipe.sharpen != Sharpen::None {
        blocks.push("6.1.2 sharpening");
    }
    if recipe.motion_blur {
        blocks.push("6.2 fast pixels blurred along their motion");
    }
    blocks.join("; ")
}

fn box_of(recipe: &Recipe) -> Option<&'static str> {
    Some(match (recipe.rectify, recipe.neighbourhood) {
        (Rectify::None, _) => return None,
        (_, Neighbourhood::Sobel) => "4.2 clip to a box as wide as edges say",
        (_, Neighbourhood::Variance) => "4.2 variance clipping",
        (_, Neighbourhood::Shrunk) => "5.2 clip to the box of near samples",
        (Rectify::Clamp, _) => "4.2 clamp",
        (Rectify::ClipCentre | Rectify::ClipCurrent, _) => "4.2 clip",
        (Rectify::Hull, _) => "4.2 clip to the hull",
    })
}

/// The parameters in which a preset differs from the defaults.
fn set(preset: &Preset) -> String {
    let fields = preset.recipe.to_json();
    let set = parameters()
        .iter()
        .filter(|parameter| fields[&parameter.name] != parameter.default);
    let text = set.map(|parameter| {
        let value = fields[&parameter.name].to_string();
        format!("`{}` {}", parameter.name, value.trim_matches('"'))
    });
    text.collect::<Vec<_>>().join(", ")
}

fn systems() -> String {
    let mut table = "| system | inputs | passes | bytes a pixel | of the survey |\n|---|---|---|---|---|\n".to_owned();
    for preset in &PRESETS {
        let traffic = traffic(&preset.recipe);
        let passes = traffic
            .iter()
            .map(|pass| format!("`{}` {} + {}", pass.pass, pass.read, pass.written));
        let passes = passes.collect::<Vec<_>>().join("<br>");
        let total: f64 = traffic.iter().map(|pass| pass.read + pass.written).sum();
        let (id, inputs, survey) = (preset.id, inputs(&preset.recipe), survey(&preset.recipe));
        let _ = writeln!(table, "| `{id}` | {inputs} | {passes} | {total} | {survey} |");
    }
    table
}

fn settings() -> String {
    let mut table = "| system | published | sets |\n|---|---|---|\n".to_owned();
    for preset in &PRESETS {
        let _ = writeln!(table, "| `{}` | {} | {} |", preset.id, preset.publication, set(preset));
    }
    table
}

fn parameter_table() -> String {
    let mut table = "| parameter | values | unit | default | meaning |\n|---|---|---|---|---|\n".to_owned();
    for parameter in parameters() {
        let values = match &parameter.kind {
            Kind::Flag => "`true`, `false`".to_owned(),
            Kind::Choice { .. } => "see below".to_owned(),
            Kind::Integer(range) | Kind::Number(range) => range.to_string(),
        };
        let unit = parameter.unit.as_deref().unwrap_or_default();
        let default = parameter.default.to_string();
        let (default, name, meaning) = (default.trim_matches('"'), &parameter.name, &parameter.description);
        let _ = writeln!(table, "| `{name}` | {values} | {unit} | `{default}` | {meaning} |");
    }
    table
}

fn choices() -> String {
    let mut table = "| parameter | value | meaning |\n|---|---|---|\n".to_owned();
    for parameter in parameters() {
        if let Kind::Choice { values } = &parameter.kind {
            for value in values {
                let _ = writeln!(
                    table,
                    "| `{}` | `{}` | {} |",
                    parameter.name, value.name, value.description
                );
            }
        }
    }
    table
}

/// The page with `table` between the marks of `name`.
fn with_table(page: &str, name: &str, table: &str) -> String {
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- end of {name} -->"));
    let (before, rest) = page.split_once(&begin).unwrap_or_else(|| panic!("no `{begin}`"));
    let (_, after) = rest.split_once(&end).unwrap_or_else(|| panic!("no `{end}`"));
    format!("{before}{begin}{table}{end}{after}")
}

#[test]
fn the_page_of_algorithms_says_what_the_code_does() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/algorithms.md");
    let page = fs::read_to_string(&path).unwrap();
    let tables = [
        ("systems", systems()),
        ("settings", settings()),
        ("parameters", parameter_table()),
        ("choices", choices()),
    ];
    let made = tables
        .iter()
        .fold(page.clone(), |page, (name, table)| with_table(&page, name, table));
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, &made).unwrap();
    }
    for (found, expected) in page.lines().zip(made.lines()) {
        assert_eq!(
            found, expected,
            "docs/algorithms.md; `BLESS=1` writes what the code says"
        );
    }
    assert_eq!(page.lines().count(), made.lines().count());
}

/// Counted by hand from the formats: colour is rgba32float, history rgba16float, motion rg32float, depth r32float.
#[test]
fn traffic_is_what_the_formats_say() {
    let of = |preset: &str| {
        let traffic = traffic(&Preset::find(preset).unwrap().recipe);
        let passes = traffic.into_iter().map(|pass| (pass.pass, pass.read, pass.written));
        passes.collect::<Vec<_>>()
    };
    let pass = |name: &str, read: f64, written: f64| (name.to_owned(), read, written);
    // Nothing is kept of a system without history.
    assert_eq!(of("none"), [pass("prepare", 16.0, 16.0), pass("resolve", 16.0, 16.0)]);
    let expected = [
        pass("prepare", 16.0, 16.0),
        pass("resolve", 16.0 + 8.0 + 8.0, 8.0 + 16.0),
    ];
    assert_eq!(of("ema"), expected);
    let expected = [
        pass("prepare", 16.0, 16.0),
        pass("resolve", 16.0 + 4.0 + 8.0 + 8.0, 8.0 + 16.0),
        pass("sharpen", 16.0, 16.0),
    ];
    assert_eq!(of("uncharted4"), expected);
    let model = (16.0 + 8.0 + 8.0 + 48.0 + 48.0 + 16.0, 8.0 + 48.0 + 48.0 + 16.0 + 16.0);
    assert_eq!(
        of("phlm2016")[1..],
        [pass("still", 8.0, 0.0), pass("model", model.0, model.1)]
    );
}
