//! The convention check: the fixtures are clean, and each mistake in a manifest or in a dump is found and named.
#![allow(clippy::unwrap_used, reason = "in tests a panic is the message")]

use crate::sequence::{
    copy_of, edit,
    files::{Channel, Part, write_exr},
    fixture, reader,
    scene::{FAR, NEAR, PAN, Pose, Sample, Scene, jitter_px},
};
use afterimage::sequence::{
    Sequence,
    check::{Report, Severity, check},
};
use serde_json::{Value, json};
use std::{fs, path::Path};
use tempfile::TempDir;

fn checked(path: &Path) -> Report {
    check(&Sequence::open(path, &reader()).unwrap()).unwrap()
}

fn warnings(report: &Report) -> Vec<&str> {
    report.warnings().map(|finding| finding.id.as_str()).collect()
}

#[test]
fn what_is_right_is_not_warned_of() {
    for name in [
        "pan",
        "static",
        "engine",
        "upscale",
        "checkerboard",
        "samples",
        "layers",
    ] {
        let report = checked(&fixture(name));
        assert!(report.findings.is_empty(), "{name}: {:?}", report.findings);
    }
}

#[test]
fn what_the_pixels_show_is_confirmed_and_what_they_do_not_is_said() {
    let report = checked(&fixture("pan"));
    for field in [
        "brightness",
        "color.transfer",
        "jitter.meaning",
        "jitter.y",
        "motion.direction",
        "motion.y",
        "motion.units",
        "depth.kind",
    ] {
        assert!(
            report.confirmed.iter().any(|confirmed| confirmed == field),
            "{field}: {:?}",
            report.confirmed
        );
    }
    let report = checked(&fixture("static"));
    let undecided = |field: &str| report.undecided.iter().any(|undecided| undecided.field == field);
    assert!(
        undecided("motion.y") && undecided("motion.direction"),
        "{:?}",
        report.undecided
    );
    assert!(report.confirmed.iter().any(|confirmed| confirmed == "jitter.y"));
}

/// A fixture, the place of a field, its wrong value, and the finding that must come first.
type Mistake = (&'static str, &'static str, Value, &'static str);

fn mistakes() -> Vec<Mistake> {
    vec![
        ("pan", "/color/transfer", json!("srgb"), "color.transfer"),
        ("pan", "/reference/transfer", json!("srgb"), "reference.transfer"),
        ("pan", "/reference/transfer", json!("pq"), "reference.transfer"),
        ("pan", "/reference/averaged_in", json!("karis"), "reference.averaged_in"),
        ("pan", "/motion/units", json!("ndc"), "motion.units"),
        (
            "pan",
            "/motion/direction",
            json!("previous_to_current"),
            "motion.direction",
        ),
        ("pan", "/motion/y", json!("down"), "motion.y"),
        ("pan", "/motion/scale", json!([2, 2]), "motion.scale"),
        ("pan", "/motion/scale", json!([-1, 1]), "motion.x"),
        ("pan", "/motion/bias", json!([0.5, 0]), "motion.bias"),
        ("pan", "/motion/jittered", json!(true), "motion.jittered"),
        ("pan", "/motion/dilated", json!(true), "motion.dilated"),
        (
            "pan",
            "/motion/channels",
            json!(["ViewLayer.Vector.Y", "ViewLayer.Vector.X"]),
            "motion.channels",
        ),
        (
            "pan",
            "/jitter",
            json!({"units": "pixels_render", "meaning": "projection_offset", "y": "down"}),
            "jitter.meaning",
        ),
        (
            "pan",
            "/jitter",
            json!({"units": "pixels_render", "meaning": "sample_offset", "y": "up"}),
            "jitter.y",
        ),
        ("pan", "/depth/scale", json!(2), "depth.scale"),
        ("pan", "/depth/kind", json!("ray_distance"), "depth.kind"),
        ("pan", "/depth/kind", json!("device"), "depth.kind"),
        ("pan", "/frames/6/reset", json!(false), "frames.reset"),
        ("static", "/jitter/y", json!("up"), "jitter.y"),
        ("static", "/motion/jittered", json!(true), "motion.jittered"),
        ("engine", "/color/transfer", json!("linear"), "color.transfer"),
        ("engine", "/motion/y", json!("down"), "motion.y"),
        ("engine", "/jitter/meaning", json!("sample_offset"), "jitter.meaning"),
        ("engine", "/jitter/units", json!("pixels_render"), "jitter.units"),
        ("engine", "/depth/reversed", json!(false), "depth.reversed"),
        (
            "upscale",
            "/motion/direction",
            json!("previous_to_current"),
            "motion.direction",
        ),
        ("upscale", "/jitter/y", json!("up"), "jitter.y"),
        (
            "samples",
            "/jitter/meaning",
            json!("projection_offset"),
            "jitter.meaning",
        ),
        ("samples", "/motion/y", json!("up"), "motion.y"),
        ("samples", "/color/transfer", json!("srgb"), "color.transfer"),
        (
            "layers",
            "/motion/direction",
            json!("previous_to_current"),
            "motion.direction",
        ),
        ("layers", "/jitter/y", json!("up"), "jitter.y"),
        ("layers", "/color/transfer", json!("srgb"), "color.transfer"),
        (
            "checkerboard",
            "/checkerboard/parity",
            json!([1, 0]),
            "checkerboard.parity",
        ),
    ]
}

/// Sets a field whether or not it was there.
fn set(manifest: &mut Value, pointer: &str, value: Value) {
    let (parent, field) = pointer.rsplit_once('/').unwrap();
    let parent = manifest.pointer_mut(parent).unwrap();
    match field.parse::<usize>() {
        Ok(index) => parent[index] = value,
        Err(_) => parent[field] = value,
    }
}

#[test]
fn every_mistake_of_a_manifest_is_named() {
    for (name, pointer, value, id) in mistakes() {
        let folder = copy_of(name);
        edit(&folder, |manifest| set(manifest, pointer, value.clone()));
        let report = checked(folder.path());
        let found = warnings(&report);
        assert!(found.contains(&id), "{name} {pointer} = {value}: {found:?}");
        let finding = report.warnings().find(|finding| finding.id == id).unwrap();
        assert!(
            !finding.evidence.is_empty() && !finding.suggestions.is_empty(),
            "{finding:?}"
        );
    }
}

/// What is suggested makes the sequence clean, wherever it is a field with a value.
#[test]
fn suggestions_mend() {
    for (name, pointer, value, id) in mistakes() {
        if ![
            "motion.y",
            "motion.units",
            "motion.jittered",
            "jitter.y",
            "reference.transfer",
            "depth.reversed",
        ]
        .contains(&id)
        {
            continue;
        }
        let folder = copy_of(name);
        edit(&folder, |manifest| set(manifest, pointer, value.clone()));
        let report = checked(folder.path());
        edit(&folder, |manifest| {
            for finding in report.warnings() {
                for suggestion in &finding.suggestions {
                    set(
                        manifest,
                        &format!("/{}", suggestion.field.replace('.', "/")),
                        suggestion.value.clone(),
                    );
                }
            }
        });
        let mended = checked(folder.path());
        assert!(
            mended.is_clean(),
            "{name} {pointer}: {:?}, then {:?}",
            report.findings,
            mended.findings
        );
    }
}

#[test]
fn jitter_that_is_not_declared_is_seen() {
    for (change, id) in [
        (json!("zero"), "jitter.missing"),
        (json!("swap"), "jitter.axes"),
        (json!("half"), "jitter.scale"),
    ] {
        let folder = copy_of("pan");
        edit(&folder, |manifest| {
            for frame in manifest["frames"].as_array_mut().unwrap() {
                let [x, y] = [0, 1].map(|i| frame["jitter"][i].as_f64().unwrap());
                frame["jitter"] = match change.as_str().unwrap() {
                    "zero" => json!([0, 0]),
                    "swap" => json!([y, x]),
                    _ => json!([0.5 * x, 0.5 * y]),
                };
            }
        });
        let report = checked(folder.path());
        assert_eq!(warnings(&report), [id], "{:?}", report.findings);
    }
}

#[test]
fn a_reset_that_is_no_cut_is_only_noted() {
    let folder = copy_of("pan");
    edit(&folder, |manifest| manifest["frames"][3]["reset"] = json!(true));
    let report = checked(folder.path());
    assert!(report.is_clean());
    let found: Vec<_> = report
        .findings
        .iter()
        .map(|finding| (finding.id.as_str(), finding.severity))
        .collect();
    assert_eq!(found, [("frames.reset", Severity::Note)]);
}

/// The pan, faster with every frame.
const HASTY: Scene = Scene {
    pose: |frame| Pose {
        x: 0.04 * (frame * frame) as f64,
        yaw: 0.003 * (frame * frame) as f64,
    },
    ..PAN
};

/// The scene, its sky with or without stripes that stand still in the world.
fn sample(scene: &Scene, frame: i64, [x, y]: [f64; 2], striped: bool) -> Sample {
    let mut sample = scene.sample(frame, [x, y]);
    if sample.object_id == 0 && striped {
        let ahead = 1.6;
        let azimuth = libm::atan((2.0 * x / f64::from(scene.size[0]) - 1.0) / ahead) + (scene.pose)(frame).yaw;
        let light = 0.5 + 0.4 * libm::sin(60.0 * azimuth);
        sample.color = sample.color.map(|color| color * light);
    }
    sample
}

/// What is wrong with a dump of the pan whose manifest is right.
#[derive(Clone, Copy, Default)]
struct Flaws {
    striped_sky: bool,
    reference_offset: [f64; 2],
    is_hasty: bool,
    /// Frames by which vectors, and cameras, are late.
    motion_lag: i64,
    camera_lag: i64,
}

fn dump(edit_frame: impl Fn(&mut Vec<Sample>), flaws: Flaws) -> TempDir {
    const N_FRAMES: i64 = 6;
    let folder = tempfile::tempdir().unwrap();
    let scene = if flaws.is_hasty { &HASTY } else { &PAN };
    let [width, height] = scene.size;
    let pixels = || (0..height).flat_map(move |y| (0..width).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]));
    let rgb = |colors: Vec<[f64; 3]>| {
        ["R", "G", "B"]
            .into_iter()
            .enumerate()
            .map(|(i, name)| Channel::float(name.to_owned(), colors.iter().map(move |color| color[i])))
            .collect::<Vec<_>>()
    };
    let mut frames = Vec::new();
    for frame in 0..N_FRAMES {
        let jitter = jitter_px(frame);
        let samples_of = |frame: i64| -> Vec<Sample> {
            let [jx, jy] = jitter_px(frame);
            let at = |[x, y]: [f64; 2]| sample(scene, frame, [x + jx, y + jy], flaws.striped_sky);
            pixels().map(at).collect()
        };
        let mut samples = samples_of(frame);
        if flaws.motion_lag != 0 {
            let other = samples_of(frame - flaws.motion_lag);
            samples
                .iter_mut()
                .zip(other)
                .for_each(|(own, other)| own.motion_px = other.motion_px);
        }
        edit_frame(&mut samples);
        let mut channels = rgb(samples.iter().map(|sample| sample.color).collect());
        let values = |value: fn(&Sample) -> f64| samples.iter().map(value).collect::<Vec<f64>>();
        for (name, values) in [
            ("Z", values(|sample| sample.depth)),
            ("X", values(|sample| sample.motion_px[0])),
            ("Y", values(|sample| sample.motion_px[1])),
            ("id", values(|sample| sample.object_id.into())),
        ] {
            channels.push(Channel::float(name.to_owned(), values.into_iter()));
        }
        write_exr(
            &folder.path().join(format!("{frame}.exr")),
            PAN.size,
            &[Part { name: None, channels }],
        )
        .unwrap();
        let grid = |i: u32| [0.125, 0.375, 0.625, 0.875][i as usize] - 0.5;
        let reference = pixels()
            .map(|[x, y]| {
                let mut sum = [0.0; 3];
                for i in 0..16 {
                    let at = [
                        x + grid(i % 4) + flaws.reference_offset[0],
                        y + grid(i / 4) + flaws.reference_offset[1],
                    ];
                    let color = sample(scene, frame, at, flaws.striped_sky).color;
                    (0..3).for_each(|c| sum[c] += color[c] / 16.0);
                }
                sum
            })
            .collect();
        let part = Part {
            name: None,
            channels: rgb(reference),
        };
        write_exr(&folder.path().join(format!("r{frame}.exr")), PAN.size, &[part]).unwrap();
        frames.push(json!({
            "index": frame, "jitter": jitter,
            "camera": {
                "view": scene.view(frame - flaws.camera_lag), "projection": scene.projection(), "near": NEAR, "far": FAR,
            },
        }));
    }
    let manifest = json!({
        "schema": "afterimage-sequence/1", "name": "dump", "fps": 24, "render_size": PAN.size, "output_size": PAN.size,
        "color": {"path": "{index}.exr", "channels": ["R", "G", "B"], "transfer": "linear"},
        "depth": {"path": "{index}.exr", "channel": "Z", "kind": "linear_view_z"},
        "motion": {
            "path": "{index}.exr", "channels": ["X", "Y"], "units": "pixels_render",
            "direction": "current_to_previous", "y": "down",
        },
        "jitter": {"units": "pixels_render", "meaning": "sample_offset", "y": "down"},
        "object_id": {"path": "{index}.exr", "channel": "id"},
        "reference": {"path": "r{index}.exr", "channels": ["R", "G", "B"]},
        "frames": frames,
    });
    fs::write(folder.path().join("manifest.json"), manifest.to_string()).unwrap();
    folder
}

#[test]
fn the_made_up_dump_itself_is_right() {
    for striped_sky in [false, true] {
        let flaws = Flaws {
            striped_sky,
            ..Flaws::default()
        };
        let folder = dump(|_| (), flaws);
        let report = checked(folder.path());
        assert!(report.findings.is_empty(), "{:?}", report.findings);
    }
}

#[test]
fn half_a_pixel_between_reference_and_colour_is_measured() {
    let flaws = Flaws {
        reference_offset: [0.5, 0.5],
        ..Flaws::default()
    };
    let folder = dump(|_| (), flaws);
    let report = checked(folder.path());
    assert_eq!(warnings(&report), ["grid.offset"], "{:?}", report.findings);
    let evidence = &report.findings[0].evidence;
    assert!(
        (evidence["offset_x_px"] + 0.5).abs() < 0.1 && (evidence["offset_y_px"] + 0.5).abs() < 0.1,
        "{evidence:?}"
    );
}

#[test]
fn motion_that_is_missing_is_seen() {
    let without = |id: u32, striped_sky: bool| {
        let edit = move |samples: &mut Vec<Sample>| {
            let still = samples.iter_mut().filter(|sample| sample.object_id == id);
            still.for_each(|sample| sample.motion_px = [0.0; 2]);
        };
        let flaws = Flaws {
            striped_sky,
            ..Flaws::default()
        };
        checked(dump(edit, flaws).path())
    };
    for (id, finding) in [(0, "motion.sky"), (1, "motion.static"), (2, "motion.object")] {
        let report = without(id, true);
        assert!(
            warnings(&report).contains(&finding),
            "object {id}: {:?}",
            report.findings
        );
    }
    // Nobody sees whether a flat sky moves.
    let report = without(0, false);
    let found: Vec<_> = report
        .findings
        .iter()
        .map(|finding| (finding.id.as_str(), finding.severity))
        .collect();
    assert_eq!(found, [("motion.sky", Severity::Note)]);
}

/// Where motion is steady, the next frame's would do as well.
#[test]
fn vectors_and_cameras_of_another_frame_are_seen() {
    for (flaws, id, suggested) in [
        (Flaws::default(), None, json!(null)),
        (
            Flaws {
                motion_lag: 1,
                ..Flaws::default()
            },
            Some("motion.path"),
            json!("files of index +1"),
        ),
        (
            Flaws {
                motion_lag: -1,
                ..Flaws::default()
            },
            Some("motion.path"),
            json!("files of index -1"),
        ),
        (
            Flaws {
                camera_lag: 1,
                ..Flaws::default()
            },
            Some("camera"),
            json!("of frame index+1"),
        ),
        (
            Flaws {
                camera_lag: -1,
                ..Flaws::default()
            },
            Some("camera"),
            json!("of frame index-1"),
        ),
    ] {
        let folder = dump(
            |_| (),
            Flaws {
                is_hasty: true,
                ..flaws
            },
        );
        let report = checked(folder.path());
        assert_eq!(warnings(&report), Vec::from_iter(id), "{:?}", report.findings);
        if let Some(finding) = report.findings.first() {
            assert_eq!(finding.suggestions[0].value, suggested);
        }
    }
}

#[test]
fn dilated_vectors_are_seen() {
    let dilate = |samples: &mut Vec<Sample>| {
        let [width, height] = PAN.size.map(|side| side as usize);
        let near: Vec<[f64; 2]> = (0..samples.len())
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let block = (y.saturating_sub(1)..(y + 2).min(height))
                    .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
                let nearest = block
                    .min_by(|&a, &b| samples[a].depth.total_cmp(&samples[b].depth))
                    .unwrap();
                samples[nearest].motion_px
            })
            .collect();
        samples
            .iter_mut()
            .zip(near)
            .for_each(|(sample, motion)| sample.motion_px = motion);
    };
    let folder = dump(dilate, Flaws::default());
    let report = checked(folder.path());
    assert_eq!(warnings(&report), ["motion.dilated"], "{:?}", report.findings);
    edit(&folder, |manifest| manifest["motion"]["dilated"] = json!(true));
    assert!(checked(folder.path()).is_clean());
}
