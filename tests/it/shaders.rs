//! Every WGSL file is valid beside the shared ones, the numbers that Rust passes for an enum's variants are those that
//! WGSL's constants have, and binding by name refuses what does not fit.

use crate::support::gpu;
use afterimage::{
    gpu::{GpuError, Pass, Texture},
    image::Extent,
    taa::{
        Recipe,
        recipe::{
            Dilation, Domain, HdrWeight, HistoryFilter, InputFilter, Neighbourhood, Rectify, Sharpen, Space, Weight,
        },
    },
};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};
use wgpu::naga;

fn wgsl_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            wgsl_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "wgsl") {
            found.push(path);
        }
    }
}

fn parse(source: &str) -> Result<naga::Module, String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::all())
        .validate(&module)
        .map_err(|error| error.emit_to_string(source))?;
    Ok(module)
}

/// A pass together with the files it is compiled with.
fn module_of(pass: &Path, files: &[PathBuf]) -> String {
    // A recipe's passes share what lies beside them; of two files that stand in for each other one is enough.
    let runs_over_lists_alone = pass.ends_with("settle.wgsl");
    let stands_in = [
        "history_f32.wgsl",
        if runs_over_lists_alone {
            "every_pixel.wgsl"
        } else {
            "listed.wgsl"
        },
        "near_shared.wgsl",
        "near_rows.wgsl",
        "classes.wgsl",
        "shares.wgsl",
        "strips_together.wgsl",
    ];
    let of_recipe = pass.iter().any(|part| part == "taa")
        && !["prepare.wgsl", "merge.wgsl", "classify.wgsl"]
            .iter()
            .any(|name| pass.ends_with(name));
    let mut module = fs::read_to_string(pass).unwrap();
    let shared = files.iter().filter(|path| {
        let text = fs::read_to_string(path).unwrap();
        !text.contains("@compute") && !stands_in.iter().any(|name| path.ends_with(name))
    });
    let (metrics, others): (Vec<_>, Vec<_>) = shared.partition(|path| path.iter().any(|part| part == "metrics"));
    let needed = others.into_iter().filter(|path| {
        let folder = path.parent().unwrap();
        let is_grid = path.ends_with("every_pixel.wgsl") && pass.ends_with("prepare.wgsl");
        folder.ends_with("common") || is_grid || of_recipe && folder.parent().unwrap().ends_with("taa")
    });
    module.extend(needed.map(|path| format!("\n{}", fs::read_to_string(path).unwrap())));
    if module.contains("ROWS") {
        module += "const ROWS: u32 = 2u;";
    }
    // A metric's pass is compiled with the files that it, or one of these, calls.
    let mut metrics: Vec<_> = metrics.iter().map(|path| fs::read_to_string(path).unwrap()).collect();
    while let Some(i) = metrics
        .iter()
        .position(|text| functions(text).any(|name| module.contains(&format!("{name}("))))
    {
        module = [module, metrics.swap_remove(i)].join("\n");
    }
    module
}

/// The names of the functions that a text defines.
fn functions(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("fn "));
    lines.filter_map(|line| line.split('(').next())
}

fn all_files() -> Vec<PathBuf> {
    let mut files = Vec::new();
    wgsl_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders"), &mut files);
    files.sort();
    files
}

#[test]
fn every_pass_is_valid() {
    let files = all_files();
    let passes: Vec<_> = files
        .iter()
        .filter(|path| fs::read_to_string(path).unwrap().contains("@compute"))
        .collect();
    assert!(passes.len() >= 2, "{passes:?}");
    let near = "const GROUP_WIDTH: u32 = 8u; const GROUP_HEIGHT: u32 = 4u;\n".to_owned()
        + include_str!("../../shaders/taa/temporal/near_shared.wgsl");
    let swaps = [
        (
            include_str!("../../shaders/taa/tiles/listed.wgsl"),
            include_str!("../../shaders/taa/tiles/every_pixel.wgsl"),
        ),
        (&*near, include_str!("../../shaders/taa/temporal/near_cached.wgsl")),
        (
            include_str!("../../shaders/taa/temporal/near_rows.wgsl"),
            include_str!("../../shaders/taa/temporal/near_cached.wgsl"),
        ),
        (
            include_str!("../../shaders/metrics/strips_together.wgsl"),
            include_str!("../../shaders/metrics/strips_apart.wgsl"),
        ),
    ];
    let mut n_swapped = [0; 4];
    for pass in passes {
        let module = module_of(pass, &files);
        if let Err(error) = parse(&module) {
            panic!("{}: {error}", pass.display());
        }
        for ((instead, of), n) in swaps.iter().zip(&mut n_swapped) {
            if !module.contains(of) {
                continue;
            }
            *n += 1;
            if let Err(error) = parse(&module.replace(of, instead)) {
                panic!("{} with {}: {error}", pass.display(), instead.lines().next().unwrap());
            }
        }
    }
    assert!(
        n_swapped.iter().all(|n| *n > 0),
        "a file that no pass has was never tried: {n_swapped:?}"
    );
}

/// The rasteriser's two files are one text.
#[test]
fn the_scene_is_valid() {
    let files = all_files();
    let text = |name: &str| {
        let path = files.iter().find(|path| path.ends_with(name)).unwrap();
        fs::read_to_string(path).unwrap()
    };
    let module = parse(&[text("scene/surface.wgsl"), text("scene/frame.wgsl")].join("\n"));
    let module = module.unwrap_or_else(|error| panic!("{error}"));
    assert!(
        module
            .entry_points
            .iter()
            .any(|entry| entry.stage == naga::ShaderStage::Fragment)
    );
}

#[test]
fn variants_have_the_numbers_that_the_shaders_know() {
    let files = all_files();
    let resolve = files
        .iter()
        .find(|path| path.ends_with("temporal/sharpen.wgsl"))
        .unwrap();
    let module = parse(&module_of(resolve, &files)).unwrap();
    let constants: BTreeMap<_, _> = module
        .constants
        .iter()
        .filter_map(|(_, constant)| match module.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::U32(value)) => Some((constant.name.clone()?, value)),
            _ => None,
        })
        .collect();
    fn check<T: Serialize + Copy>(constants: &BTreeMap<String, u32>, prefix: &str, variants: &[(T, u32)]) {
        for (variant, number) in variants {
            let id = serde_json::to_value(variant).unwrap();
            let name = format!("{prefix}_{}", id.as_str().unwrap().to_uppercase());
            // A variant that the shader never names is what its `default` does.
            if let Some(found) = constants.get(&name) {
                assert_eq!(found, number, "{name}");
            } else {
                assert!(*number == 0, "{name} is no constant of the shader");
            }
        }
    }
    macro_rules! check {
        ($prefix:literal, $type:ident: $($variant:ident),*) => {
            check(&constants, $prefix, &[$(($type::$variant, $type::$variant as u32)),*])
        };
    }
    check!("DOMAIN", Domain: Linear, Tonemapped, Display);
    check!("SPACE", Space: Rgb, Ycocg);
    check!("DILATION", Dilation: None, Closest, Longest);
    check!("INPUT", InputFilter: Texel, Unjitter, BlackmanHarris, Upsample);
    check!("HISTORY", HistoryFilter: None, Texel, Bilinear, CatmullRom, CatmullRom5, Bfecc, QuasiCubic);
    check!("NEIGHBOURHOOD", Neighbourhood: None, Cross, Box3, Rounded, Variance, Sobel, Shrunk);
    check!("RECTIFY", Rectify: None, Clamp, ClipCentre, ClipCurrent);
    check!("WEIGHT", Weight: Fixed, LumaFeedback, Antiflicker, Count, Amortized);
    check!("SHARPEN", Sharpen: None, Xu, Normalised, Rcas);
    check!("HDR_WEIGHT", HdrWeight: None, Karis);
}

/// Every override of the resolve but the workgroup's is a parameter of the recipe, under the same name.
#[test]
fn overrides_are_parameters() {
    let files = all_files();
    let resolve = files
        .iter()
        .find(|path| path.ends_with("temporal/sharpen.wgsl"))
        .unwrap();
    let module = parse(&module_of(resolve, &files)).unwrap();
    let recipe: &Recipe = &afterimage::taa::PRESETS[0].recipe;
    let parameters = recipe.to_json();
    for (_, item) in module.overrides.iter() {
        let name = item.name.as_deref().unwrap();
        assert!(
            name.starts_with("WORKGROUP_") || parameters.get(name).is_some(),
            "override `{name}` is no parameter"
        );
    }
}

const COPY: &str = "
    override scale: f32;
    struct Parameters { offset: vec2f, gain: f32 }
    @group(0) @binding(0) var source: texture_2d<f32>;
    @group(0) @binding(1) var copy: texture_storage_2d<rgba32float, write>;
    @group(0) @binding(2) var<uniform> parameters: Parameters;
    @compute @workgroup_size(8, 8)
    fn main(@builtin(global_invocation_id) id: vec3u) {
        textureStore(copy, id.xy, parameters.gain * scale * textureLoad(source, vec2i(parameters.offset) + vec2i(id.xy), 0));
    }";

fn message(error: GpuError) -> String {
    error.to_string()
}

#[test]
fn binding_by_name_refuses_what_does_not_fit() {
    let gpu = gpu();
    let extent = Extent::new(4, 4);
    let texture = || Texture::new(gpu, "test", extent, wgpu::TextureFormat::Rgba32Float);
    let (source, copy) = (texture(), texture());
    let pass = Pass::new(gpu, "copy", &[COPY], &[("scale", 1.0)]).unwrap();
    let fields: [(&'static str, afterimage::gpu::UniformValue); 2] =
        [("offset", [0.0, 0.0].into()), ("gain", 1.0_f32.into())];
    let bound = || pass.bind("source", &source).bind("copy", &copy);
    assert!(bound().uniform("parameters", &fields).over(gpu, extent).is_ok());

    let missing = message(bound().over(gpu, extent).unwrap_err());
    assert!(
        missing.contains("copy") && missing.contains("`parameters` is not bound"),
        "{missing}"
    );
    let twice = bound().bind("copy", &source).uniform("parameters", &fields);
    assert!(message(twice.over(gpu, extent).unwrap_err()).contains("`copy` is bound twice"));
    let unknown = bound().bind("sauce", &source).uniform("parameters", &fields);
    assert!(message(unknown.over(gpu, extent).unwrap_err()).contains("no binding `sauce`"));
    let field = bound().uniform("parameters", &fields[..1]);
    assert!(message(field.over(gpu, extent).unwrap_err()).contains("`parameters.gain` is not set"));
    let mistyped = bound().uniform("parameters", &[fields[0], ("gain", [1.0, 1.0].into())]);
    assert!(message(mistyped.over(gpu, extent).unwrap_err()).contains("`parameters.gain`"));
}

#[test]
fn a_shader_that_does_not_fit_is_refused() {
    let error = |sources: &[&str], overrides: &[(&str, f64)]| {
        message(Pass::new(gpu(), "copy", sources, overrides).unwrap_err())
    };
    assert!(error(&[COPY], &[]).contains("override `scale` is not set"));
    assert!(error(&[COPY], &[("scale", 1.0), ("skale", 1.0)]).contains("no override `skale`"));
    let broken = error(&["@compute @workgroup_size(1) fn main() { let x = nothing; }"], &[]);
    assert!(broken.contains("nothing") && broken.contains("copy"), "{broken}");
}
