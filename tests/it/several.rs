//! Frames with several samples or layers of each pixel: the pass that makes one of them against its twin, against frames that
//! have one to begin with, and by hand; and how a manifest declares them.

use crate::{
    gpu_vs_reference::{SIZES, scene},
    run::{execute, spec},
    support::{frame, noise, resolve_on_gpu},
    validation::validated,
};
use afterimage::{
    image::{
        Extent, Image,
        files::{Backend, FileReader, Limits},
    },
    metrics::Metric,
    run::RunSpec,
    sequence::{Channels, Frame, Manifest, Merging, Others, Sequence},
    taa::{Fault, PRESETS, Precision, Preset, Recipe, reference::Twin},
};
use std::{fs, path::Path};

const LAYERS: Merging = Merging::Layers { premultiplied: false };

/// Frame `index` of the scene with `n` samples or layers, which differ in everything; some of it hostile.
fn several(extent: Extent, index: usize, merging: Merging, n: usize) -> Frame {
    let first = frame(extent, index);
    let of = |item: usize| {
        let other = frame(extent, index + 3 * item);
        let hostile = move |x: u32, y: u32| index % 5 == 2 && noise(x, y, 60 + item as u32) < 0.01;
        let color = other.color.clone();
        Frame {
            color: Image::from_fn(extent, |x, y| match hostile(x, y) {
                true => [f32::INFINITY, 0.5, -1.0],
                false => color.at(x, y).map(|c| 0.8 * c),
            }),
            ..other
        }
    };
    let others: Vec<_> = (1..n).map(of).collect();
    let opacity = |item: usize| {
        Image::from_fn(extent, |x, y| match noise(x, y, (90 + 10 * index + item) as u32) {
            _ if item + 1 == n => 1.0,
            bad if bad < 0.003 => f32::NAN,
            bad if bad < 0.006 => 1.5,
            value => 0.9 * value,
        })
    };
    let is_layered = merging != Merging::Samples;
    Frame {
        others: Some(Others {
            merging,
            opacity: (0..n).filter(|_| is_layered).map(opacity).collect(),
            color: others.iter().map(|other| other.color.clone()).collect(),
            motion_px: others.iter().filter_map(|other| other.motion_px.clone()).collect(),
            depth: others.iter().filter_map(|other| other.depth.clone()).collect(),
        }),
        ..first
    }
}

fn recipe(preset: &str) -> &'static Recipe {
    &Preset::find(preset).unwrap().recipe
}

/// All but the checkerboard, whose frames have one colour a pixel.
fn presets() -> impl Iterator<Item = &'static Preset> {
    const ALL: &[Preset] = &PRESETS;
    ALL.iter().filter(|preset| !preset.recipe.fills_checkerboard())
}

#[test]
fn every_preset_agrees_on_samples_and_on_layers() {
    for (merging, n) in [(Merging::Samples, 3), (LAYERS, 2)] {
        for preset in presets() {
            let frames = (0..6).map(|index| several(SIZES[0], index, merging, n));
            let found = validated(&preset.recipe, Precision::F32, frames, None, None);
            assert!(found.agrees, "{} {merging:?}: {found:?}", preset.id);
            assert_eq!(found.passes[0].name, "merge");
        }
    }
}

#[test]
fn premultiplied_layers_agree() {
    let merging = Merging::Layers { premultiplied: true };
    for preset in ["inside", "sobel2018", "phlm2016"] {
        let frames = (0..24).map(|index| several(SIZES[0], index, merging, 4));
        let found = validated(recipe(preset), Precision::F32, frames, None, None);
        assert!(found.agrees, "{preset}: {found:?}");
    }
}

#[test]
fn odd_sizes_agree() {
    for extent in &SIZES[1..] {
        for merging in [Merging::Samples, LAYERS] {
            let frames = (0..8).map(|index| several(*extent, index, merging, 2));
            let found = validated(recipe("inside"), Precision::F32, frames, None, None);
            assert!(found.agrees, "{extent} {merging:?}: {found:?}");
        }
    }
}

/// The comparison can fail: at the first frame that shows it.
#[test]
fn faults_of_merging_are_found() {
    let cases = [
        (Merging::Samples, "sum /= f32(n)", "sum /= f32(n) + 0.05", 0),
        (Merging::Samples, "score > best", "score < best", 0),
        (Merging::Samples, "depth_of(kept, p)", "depth_of(0, p)", 0),
        (LAYERS, "transmittance *= 1.0 -", "transmittance *= 0.9 -", 0),
        (
            LAYERS,
            "hostile = hostile || is_hostile_opacity",
            "hostile = hostile && is_hostile_opacity",
            0,
        ),
    ];
    for (merging, text, instead, first_frame) in cases {
        let fault = Fault {
            pass: "merge",
            text,
            instead,
        };
        let frames = (0..4).map(|index| several(SIZES[0], index, merging, 3));
        let found = validated(recipe("inside"), Precision::F32, frames, None, Some(fault));
        assert_eq!(found.first_fault(), Some((first_frame, "merge")), "{text}: {found:?}");
    }
}

/// Four times the same is the same, to the last bit; and layers behind one that hides them are as if they were not there.
#[test]
fn equal_samples_are_one() {
    let doubled = |frame: Frame, merging: Merging| {
        let (color, motion, depth) = (frame.color.clone(), frame.motion_px.clone(), frame.depth.clone());
        let others = match merging {
            Merging::Samples => Others {
                merging,
                opacity: Vec::new(),
                color: vec![color; 3],
                motion_px: motion.into_iter().cycle().take(3).collect(),
                depth: Vec::new(),
            },
            Merging::Layers { .. } => Others {
                merging,
                opacity: [1.0, 0.75]
                    .map(|opacity| Image::filled(frame.extent(), opacity))
                    .to_vec(),
                color: vec![color.map(|[r, g, b]| [b, r, g])],
                motion_px: motion.iter().map(|motion| motion.map(|[x, y]| [y, 2.0 * x])).collect(),
                depth: depth.iter().map(|depth| depth.map(|z| 0.5 * z)).collect(),
            },
        };
        Frame {
            others: Some(others),
            ..frame
        }
    };
    for preset in ["inside", "salvi2016", "sobel2018", "none"] {
        let alone = resolve_on_gpu(recipe(preset), Precision::F16, scene(SIZES[0]).take(8));
        for merging in [Merging::Samples, LAYERS] {
            let frames = scene(SIZES[0]).take(8).map(|frame| doubled(frame, merging));
            let merged = resolve_on_gpu(recipe(preset), Precision::F16, frames);
            for (index, (a, b)) in alone.iter().zip(&merged).enumerate() {
                assert_eq!(a.0.pixels(), b.0.pixels(), "{preset} {merging:?}: frame {index}");
                if merging == Merging::Samples {
                    assert_eq!(a.1, b.1, "{preset}: texels repaired in frame {index}");
                }
            }
        }
    }
}

/// (0.25 + 0.5 + 1.5) / 3 = 0.75; over each other with 0.25, 0.5 and 1: 0.0625 + 0.1875 + 0.5625 = 0.8125.
#[test]
fn a_pixel_by_hand() {
    let extent = Extent::new(2, 1);
    let merged = |merging, opacity: &[f32]| {
        let gray = |value: f32| Image::filled(extent, [value, 2.0 * value, 0.0]);
        let frame = Frame {
            color: gray(0.25),
            others: Some(Others {
                merging,
                opacity: opacity.iter().map(|&opacity| Image::filled(extent, opacity)).collect(),
                color: vec![gray(0.5), gray(1.5)],
                motion_px: Vec::new(),
                depth: Vec::new(),
            }),
            ..frame(extent, 0)
        };
        let expected = Twin::<f64>::new(recipe("none").clone(), Precision::F32)
            .resolve(&frame)
            .shown;
        let (shown, repaired) = resolve_on_gpu(recipe("none"), Precision::F32, [frame].into_iter()).remove(0);
        assert_eq!(repaired, 0);
        assert_eq!(expected.at(1, 0).map(|c| c as f32), shown.at(1, 0));
        shown.at(1, 0)
    };
    assert_eq!(merged(Merging::Samples, &[]), [0.75, 1.5, 0.0]);
    assert_eq!(merged(LAYERS, &[0.25, 0.5, 1.0]), [0.8125, 1.625, 0.0]);
}

fn fixture(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn open(path: &Path) -> Sequence {
    Sequence::open(path, &FileReader::new(Backend::Auto, Limits::default())).unwrap()
}

/// Colour, depth and motion of each sample are read from where the manifest says.
#[test]
fn the_fixtures_load() {
    let channels = Channels {
        depth: true,
        motion: true,
        ..Channels::default()
    };
    let samples = open(&fixture("samples")).load(2, channels).unwrap();
    let others = samples.others.as_ref().unwrap();
    assert_eq!(
        (others.color.len(), others.motion_px.len(), others.depth.len()),
        (3, 3, 3)
    );
    assert_ne!(others.color[0], samples.color);
    assert_ne!(others.motion_px[1], others.motion_px[0]);
    let layers = open(&fixture("layers")).load(2, channels).unwrap();
    let others = layers.others.as_ref().unwrap();
    assert_eq!((others.color.len(), others.opacity.len()), (1, 2));
    // The pane covers x from 9 to 23 in this frame, and moves on its own; beside it there is what lies behind.
    let motion = layers.merged_motion_px().unwrap();
    assert_eq!(motion.at(15, 12), [-1.5, 0.0]);
    assert_eq!(layers.kept_item(15, 12), 0);
    assert_eq!(motion.at(40, 12), others.motion_px[0].at(40, 12));
    assert_eq!(layers.kept_item(40, 12), 1);
}

/// More samples are nearer to the reference, and the pane's own motion beats that of what lies behind it.
#[test]
fn merging_pays() {
    let psnr = |path: &Path, preset: &str| {
        let wanted = RunSpec {
            metrics: vec![Metric::PSNR],
            ..spec(&[preset])
        };
        let report = execute(&wanted, &open(path));
        assert!(report.reports[0].times_ms.contains_key("merge") || report.reports[0].times_ms.is_empty());
        report.reports[0].summary["psnr"].mean.0
    };
    let altered = |name: &str, alter: &dyn Fn(&mut serde_json::Value)| {
        let folder = tempfile::tempdir().unwrap();
        for entry in ["input", "reference", "layer0", "layer1"] {
            let from = fixture(name).join(entry);
            if from.is_dir() {
                fs::create_dir_all(folder.path().join(entry)).unwrap();
                for file in fs::read_dir(from).unwrap() {
                    let file = file.unwrap();
                    fs::copy(file.path(), folder.path().join(entry).join(file.file_name())).unwrap();
                }
            }
        }
        let manifest = fs::read_to_string(fixture(name).join("manifest.json")).unwrap();
        let mut manifest = serde_json::from_str(&manifest).unwrap();
        alter(&mut manifest);
        fs::write(folder.path().join("manifest.json"), manifest.to_string()).unwrap();
        folder
    };
    let two = altered("samples", &|manifest| manifest["samples"]["count"] = 2.into());
    let (four, two) = (psnr(&fixture("samples"), "none"), psnr(two.path(), "none"));
    assert!(four > two + 0.5, "{four} dB of four samples, {two} dB of two");
    let wrong = altered("layers", &|manifest| {
        manifest["layers"]["alpha"]["meaning"] = "transmittance".into();
    });
    let (right, wrong) = (psnr(&fixture("layers"), "inside"), psnr(wrong.path(), "inside"));
    assert!(
        right > wrong + 3.0,
        "{right} dB, {wrong} dB where opacity is taken for transmittance"
    );
}

/// Makes a mistake in a manifest.
type Alter = dyn Fn(&mut serde_json::Value);

#[test]
fn manifests_that_make_no_sense_are_refused() {
    let refused = |name: &str, alter: &Alter| {
        let manifest = fs::read_to_string(fixture(name).join("manifest.json")).unwrap();
        let mut manifest = serde_json::from_str(&manifest).unwrap();
        alter(&mut manifest);
        Manifest::from_value(manifest).unwrap_err().to_string()
    };
    let cases: [(&str, &Alter, &str); 8] = [
        (
            "samples",
            &|m| m["samples"]["count"] = 17.into(),
            "samples.count: 17 must be 2 to 16",
        ),
        (
            "samples",
            &|m| m["samples"] = serde_json::Value::Null,
            "holds {sample}, and the manifest has no `samples`",
        ),
        (
            "samples",
            &|m| m["checkerboard"] = serde_json::json!({"parity": [0, 1]}),
            "samples: frames of a checkerboard",
        ),
        (
            "samples",
            &|m| m["reference"]["path"] = "r{sample}.exr".into(),
            "reference: cannot differ by {sample}",
        ),
        (
            "layers",
            &|m| m["motion"] = serde_json::Value::Null,
            "motion: missing, and every layer has",
        ),
        (
            "layers",
            &|m| m["motion"]["path"] = "layer1/{index:02}.exr".into(),
            "motion: is the same for every layer",
        ),
        (
            "layers",
            &|m| m["layers"]["alpha"]["path"] = "a.exr".into(),
            "layers.alpha: is the same for every layer",
        ),
        (
            "layers",
            &|m| m["samples"] = serde_json::json!({"count": 2}),
            "layers: a sequence has `samples` or `layers`",
        ),
    ];
    for (name, alter, expected) in cases {
        let message = refused(name, alter);
        assert!(message.contains(expected), "{message}");
    }
    // A sample that a file does not have is named when files are checked.
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join("input")).unwrap();
    for entry in fs::read_dir(fixture("samples").join("input")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), folder.path().join("input").join(entry.file_name())).unwrap();
    }
    let manifest = fs::read_to_string(fixture("samples").join("manifest.json")).unwrap();
    let manifest = manifest.replace("\"count\": 4", "\"count\": 5");
    let mut manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    manifest["reference"] = serde_json::Value::Null;
    fs::write(folder.path().join("manifest.json"), manifest.to_string()).unwrap();
    let missing = open(folder.path()).verify_files().unwrap_err().to_string();
    assert!(missing.contains("S4.R"), "{missing}");
}
