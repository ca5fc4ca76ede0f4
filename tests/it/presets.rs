//! Each preset against a dump written as its engine writes: from clip-space positions, in that engine's units and signs, by
//! code that knows nothing of the loader. What loads must be the scene, to 1e-6.
#![allow(clippy::unwrap_used, reason = "in tests a panic is the message")]

use crate::sequence::{
    ALL,
    files::{Channel, Part, write_exr},
    reader,
    scene::{self, ENGINE, Sample, Scene},
};
use afterimage::sequence::{Frame, Sequence, frame::SKY_DEPTH};
use serde_json::{Value, json};
use std::{fs, path::Path};
use tempfile::TempDir;

const SCENE: Scene = ENGINE;
const N_FRAMES: i64 = 3;
/// A near plane at which 32-bit device depth keeps six digits of the scene's depths.
const NEAR: f64 = 1.0;
const FAR: f64 = 100.0;

fn size() -> [f64; 2] {
    SCENE.size.map(f64::from)
}

/// What the engine's jitter generator gives, in the engine's own numbers of about half a pixel.
fn generated(frame: i64) -> [f64; 2] {
    let [x, y] = scene::jitter_px(frame + 2);
    [x, -0.9 * y]
}

/// How an engine writes.
#[derive(Clone)]
struct Engine {
    preset: &'static str,
    /// What the generated jitter adds to normalised device coordinates, y up.
    jitter_ndc: fn([f64; 2]) -> [f64; 2],
    /// What is written for the jitter.
    jitter_written: fn([f64; 2]) -> [f64; 2],
    /// What is written for a surface at `now` and before at `then`, both normalised device coordinates with y up.
    motion: fn(now: [f64; 2], then: [f64; 2]) -> [f64; 2],
    /// Resting surfaces hold this instead.
    resting: Option<[f64; 2]>,
    jittered: bool,
    depth: Depth,
    exposed: bool,
    /// Fields that the preset leaves to the application.
    fields: Value,
}

#[derive(Clone, Copy)]
enum Depth {
    Linear,
    Device { reversed: bool, infinite: bool },
}

fn pixel_offset([x, y]: [f64; 2]) -> [f64; 2] {
    [2.0 * x / size()[0], -2.0 * y / size()[1]]
}

fn pixels_y_down(now: [f64; 2], then: [f64; 2]) -> [f64; 2] {
    [
        (then[0] - now[0]) * size()[0] / 2.0,
        -(then[1] - now[1]) * size()[1] / 2.0,
    ]
}

fn uv_y_down(now: [f64; 2], then: [f64; 2]) -> [f64; 2] {
    [(then[0] - now[0]) / 2.0, -(then[1] - now[1]) / 2.0]
}

fn minus([x, y]: [f64; 2]) -> [f64; 2] {
    [-x, -y]
}

/// Every engine with every combination of its flags.
fn engines() -> Vec<Engine> {
    let mut all = Vec::new();
    for reversed in [false, true] {
        for infinite in [false, true] {
            for jittered in [false, true] {
                let depth = Depth::Device { reversed, infinite };
                let far = if infinite { json!(-1) } else { json!(FAR) };
                let fields = json!({
                    "depth": {"reversed": reversed, "near": NEAR, "far": far}, "motion": {"jittered": jittered},
                });
                all.extend(engines_with(depth, jittered, &fields));
            }
        }
    }
    all.push(unreal());
    all.push(godot());
    all.push(Engine {
        preset: "blender",
        // The camera is shifted: the sample moves by what is keyed.
        jitter_ndc: |j| minus(pixel_offset(j)),
        jitter_written: |j| j,
        motion: |now, then| {
            let [x, y] = pixels_y_down(now, then);
            [x, -y]
        },
        resting: None,
        jittered: false,
        depth: Depth::Linear,
        exposed: false,
        fields: json!({}),
    });
    all
}

/// The engines that leave depth to the application.
fn engines_with(depth: Depth, jittered: bool, fields: &Value) -> Vec<Engine> {
    let with = |more: Value| {
        let mut fields = fields.clone();
        merge(&mut fields, &more);
        fields
    };
    let base = Engine {
        preset: "fsr",
        jitter_ndc: pixel_offset,
        jitter_written: |j| j,
        motion: pixels_y_down,
        resting: None,
        jittered,
        depth,
        exposed: false,
        fields: fields.clone(),
    };
    vec![
        base.clone(),
        // motionVectorScale from texture coordinates to pixels, and pre-exposure.
        Engine {
            motion: uv_y_down,
            exposed: true,
            fields: with(json!({"motion": {"scale": size()}, "color": {"pre_exposed": true}})),
            ..base.clone()
        },
        Engine {
            preset: "xess",
            ..base.clone()
        },
        Engine {
            preset: "xess",
            motion: |now, then| [then[0] - now[0], then[1] - now[1]],
            fields: with(json!({"motion": {"units": "ndc", "y": "up"}})),
            ..base.clone()
        },
        // mvecScale of pixels.
        Engine {
            preset: "streamline",
            fields: with(json!({"motion": {"scale": [1.0 / size()[0], 1.0 / size()[1]]}})),
            ..base.clone()
        },
        Engine {
            preset: "streamline",
            motion: uv_y_down,
            ..base.clone()
        },
        Engine {
            preset: "arm-nss",
            motion: |now, then| minus(uv_y_down(now, then)),
            ..base.clone()
        },
        Engine {
            preset: "unity",
            // Added to the third column of a projection whose view looks along −z, so the image moves the other way.
            jitter_ndc: |[x, y]| [-2.0 * x / size()[0], -2.0 * y / size()[1]],
            motion: |now, then| minus(uv_y_down(now, then)),
            ..base
        },
    ]
}

fn unreal() -> Engine {
    Engine {
        preset: "unreal",
        jitter_ndc: pixel_offset,
        jitter_written: |j| j,
        motion: |now, then| [0, 1].map(|i| (now[i] - then[i]) * 0.499 * 0.5 + 32767.0 / 65535.0),
        resting: Some([0.0, 0.0]),
        jittered: false,
        depth: Depth::Device {
            reversed: true,
            infinite: true,
        },
        exposed: true,
        fields: json!({"depth": {"near": NEAR}}),
    }
}

fn godot() -> Engine {
    Engine {
        preset: "godot",
        // Halton in [−1, 1] over the viewport's size, added after y was flipped.
        jitter_ndc: |[x, y]| [2.0 * x / size()[0], -2.0 * y / size()[1]],
        jitter_written: |[x, y]| [2.0 * x / size()[0], 2.0 * y / size()[1]],
        motion: uv_y_down,
        resting: Some([-1.0, -1.0]),
        jittered: false,
        depth: Depth::Device {
            reversed: true,
            infinite: false,
        },
        exposed: false,
        fields: json!({"depth": {"near": NEAR, "far": FAR}}),
    }
}

fn merge(into: &mut Value, from: &Value) {
    for (key, value) in from.as_object().unwrap() {
        match into.get_mut(key) {
            Some(known) if known.is_object() && value.is_object() => merge(known, value),
            _ => into[key] = value.clone(),
        }
    }
}

/// Where a pixel's sample lies: the position that the moved projection brings to the pixel's centre.
fn sample_px(engine: &Engine, frame: i64, [x, y]: [u32; 2]) -> [f64; 2] {
    let [jx, jy] = (engine.jitter_ndc)(generated(frame));
    let (px, py) = (jx * size()[0] / 2.0, -jy * size()[1] / 2.0);
    [f64::from(x) + 0.5 - px, f64::from(y) + 0.5 - py]
}

fn samples(engine: &Engine, frame: i64) -> Vec<([f64; 2], Sample)> {
    let [width, height] = SCENE.size;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    pixels
        .map(|pixel| {
            let position = sample_px(engine, frame, pixel);
            (position, SCENE.sample(frame, position))
        })
        .collect()
}

fn exposure(frame: i64) -> f64 {
    1.5 + 0.25 * frame as f64
}

/// Writes the dump of `engine` with its manifest.
fn dump(engine: &Engine) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut frames = Vec::new();
    for frame in 0..N_FRAMES {
        write_frame(engine, frame, folder.path());
        frames.push(json!({
            "index": frame, "jitter": (engine.jitter_written)(generated(frame)), "exposure": exposure(frame),
            "camera": {"view": SCENE.view(frame), "projection": SCENE.projection()},
        }));
    }
    let path = "{index}.exr";
    let mut manifest = json!({
        "schema": "afterimage-sequence/1", "name": engine.preset, "fps": 30, "preset": engine.preset,
        "render_size": SCENE.size, "output_size": SCENE.size,
        "color": {"path": path, "channels": ["R", "G", "B"]},
        "depth": {"path": path, "channel": "depth"},
        "motion": {"path": path, "channels": ["motion.X", "motion.Y"]},
        "frames": frames,
    });
    merge(&mut manifest, &engine.fields);
    fs::write(folder.path().join("manifest.json"), manifest.to_string()).unwrap();
    folder
}

fn write_frame(engine: &Engine, frame: i64, folder: &Path) {
    let samples = samples(engine, frame);
    let color = |i: usize| {
        let factor = if engine.exposed { exposure(frame) } else { 1.0 };
        samples.iter().map(move |(_, sample)| sample.color[i] * factor)
    };
    let jitters = [frame, frame - 1].map(|frame| (engine.jitter_ndc)(generated(frame)));
    let ndc = |[x, y]: [f64; 2]| [2.0 * x / size()[0] - 1.0, 1.0 - 2.0 * y / size()[1]];
    let motion: Vec<[f64; 2]> = samples
        .iter()
        .map(|(position, sample)| {
            if let Some(resting) = engine.resting.filter(|_| sample.object_id != 2) {
                return resting;
            }
            let before = [0, 1].map(|i| position[i] + sample.motion_px[i]);
            let [mut now, mut then] = [ndc(*position), ndc(before)];
            if engine.jittered {
                (0..2).for_each(|i| {
                    now[i] += jitters[0][i];
                    then[i] += jitters[1][i];
                });
            }
            (engine.motion)(now, then)
        })
        .collect();
    let depth = samples.iter().map(|(_, sample)| match engine.depth {
        Depth::Linear => sample.depth,
        Depth::Device { reversed, infinite } => {
            let is_sky = sample.object_id == 0;
            let far = if infinite { f64::INFINITY } else { FAR };
            // The third row of a projection that maps [near, far] to [0, 1].
            let device = match (is_sky, infinite) {
                (true, _) => 1.0,
                (false, true) => 1.0 - NEAR / sample.depth,
                (false, false) => far / (far - NEAR) - far * NEAR / (far - NEAR) / sample.depth,
            };
            if reversed { 1.0 - device } else { device }
        }
    });
    let channels = vec![
        Channel::float("R".to_owned(), color(0)),
        Channel::float("G".to_owned(), color(1)),
        Channel::float("B".to_owned(), color(2)),
        Channel::float("depth".to_owned(), depth),
        Channel::float("motion.X".to_owned(), motion.iter().map(|m| m[0])),
        Channel::float("motion.Y".to_owned(), motion.iter().map(|m| m[1])),
    ];
    write_exr(
        &folder.join(format!("{frame}.exr")),
        SCENE.size,
        &[Part { name: None, channels }],
    )
    .unwrap();
}

/// The worst difference between what loads and the scene: jitter in pixels, motion in images, depth and colour relative.
/// None where the manifest is refused.
fn difference(engine: &Engine, folder: &Path) -> Option<f64> {
    let sequence = Sequence::open(folder, &reader()).ok()?;
    let mut worst = 0.0_f64;
    for index in 1..N_FRAMES {
        let frame = sequence.load(index as usize, ALL).unwrap();
        worst = worst.max(frame_difference(engine, &frame, index));
    }
    Some(worst)
}

fn frame_difference(engine: &Engine, frame: &Frame, index: i64) -> f64 {
    let [x, y] = sample_px(engine, index, [0, 0]);
    let mut worst = (frame.jitter_px[0] - (x - 0.5))
        .abs()
        .max((frame.jitter_px[1] - (y - 0.5)).abs());
    let (motion, depth) = (frame.motion_px.as_ref().unwrap(), frame.depth.as_ref().unwrap());
    for (i, (_, truth)) in samples(engine, index).iter().enumerate() {
        let finite_far = matches!(engine.depth, Depth::Device { infinite: false, .. });
        let z = f64::from(depth.pixels()[i]);
        let depth_error = match truth.object_id {
            // Sky of a buffer with a far plane lies on it.
            0 if finite_far => (z / FAR - 1.0).abs(),
            0 => f64::from(u8::from(z != f64::from(SKY_DEPTH))),
            _ => (z / truth.depth - 1.0).abs(),
        };
        // Motion derived from a far plane is not that of the sky.
        let derived_sky = truth.object_id == 0 && engine.resting.is_some() && finite_far;
        let vector = motion.pixels()[i];
        let motion_error = (0..2)
            .map(|axis| (f64::from(vector[axis]) - truth.motion_px[axis]).abs() / size()[axis])
            .fold(0.0, f64::max);
        let color_error = (0..3)
            .map(|c| (f64::from(frame.color.pixels()[i][c]) - truth.color[c]).abs() / truth.color[c])
            .fold(0.0, f64::max);
        let errors = [depth_error, if derived_sky { 0.0 } else { motion_error }, color_error];
        worst = errors.into_iter().fold(
            worst,
            |worst, error| if error.is_nan() { 1.0 } else { worst.max(error) },
        );
    }
    worst
}

#[test]
fn every_engine_loads_as_the_scene() {
    for engine in engines() {
        let folder = dump(&engine);
        let error = difference(&engine, folder.path()).unwrap_or_else(|| panic!("{} {}", engine.preset, engine.fields));
        assert!(error < 1e-6, "{} {}: {error:e}", engine.preset, engine.fields);
    }
}

/// One field wrong, and the scene does not come out.
#[test]
fn every_convention_matters() {
    let wrong: [(&str, &str, [Value; 2]); 9] = [
        ("motion", "units", [json!("uv"), json!("pixels_render")]),
        (
            "motion",
            "direction",
            [json!("current_to_previous"), json!("previous_to_current")],
        ),
        ("motion", "y", [json!("up"), json!("down")]),
        ("motion", "jittered", [json!(true), json!(false)]),
        ("jitter", "units", [json!("ndc"), json!("pixels_render")]),
        (
            "jitter",
            "meaning",
            [json!("sample_offset"), json!("projection_offset")],
        ),
        ("jitter", "y", [json!("up"), json!("down")]),
        ("depth", "reversed", [json!(true), json!(false)]),
        ("color", "pre_exposed", [json!(true), json!(false)]),
    ];
    for engine in engines() {
        let folder = dump(&engine);
        let path = folder.path().join("manifest.json");
        let text = fs::read_to_string(&path).unwrap();
        for (section, field, values) in &wrong {
            // One of both values is what holds; the other must be seen. Linear depth cannot be reversed at all.
            let mut seen = 0;
            for value in values {
                let mut manifest: Value = serde_json::from_str(&text).unwrap();
                if *section == "jitter" && manifest.get("jitter").is_none() {
                    manifest["jitter"] = match engine.preset {
                        "blender" => json!({"units": "pixels_render", "meaning": "sample_offset", "y": "down"}),
                        "unity" => json!({"units": "pixels_render", "meaning": "sample_offset", "y": "up"}),
                        "godot" => json!({"units": "ndc", "meaning": "projection_offset", "y": "down"}),
                        _ => json!({"units": "pixels_render", "meaning": "projection_offset", "y": "down"}),
                    };
                }
                manifest[*section][*field] = value.clone();
                fs::write(&path, manifest.to_string()).unwrap();
                if difference(&engine, folder.path()).is_none_or(|error| error > 1e-3) {
                    seen += 1;
                }
            }
            let alike = *section == "motion" && *field == "units" && seen == 2;
            assert!(
                seen == 1 || alike,
                "{} {}: {section}.{field} seen {seen} times",
                engine.preset,
                engine.fields
            );
        }
    }
}

/// One of Arm's data sets: two frames at half size, and a second sequence where asked for.
fn data_set(names: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let truth = Scene {
        size: SCENE.size.map(|side| 2 * side),
        ..SCENE
    };
    for name in names {
        let mut frames = Vec::new();
        for frame in 0..2_i64 {
            let jitter = generated(frame);
            let at = |[x, y]: [f64; 2]| [x - jitter[0], y - jitter[1]];
            let pixels = |scene: &Scene| {
                let [width, height] = scene.size;
                (0..height)
                    .flat_map(|y| (0..width).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]))
                    .collect::<Vec<_>>()
            };
            let samples: Vec<Sample> = pixels(&SCENE).into_iter().map(|p| SCENE.sample(frame, at(p))).collect();
            let rgb = |samples: &[Sample]| {
                let channel =
                    |(i, name): (usize, &str)| Channel::float(name.to_owned(), samples.iter().map(move |s| s.color[i]));
                ["R", "G", "B"].into_iter().enumerate().map(channel).collect::<Vec<_>>()
            };
            let truths: Vec<Sample> = pixels(&truth).into_iter().map(|p| truth.sample(frame, p)).collect();
            let uv = |axis: usize| samples.iter().map(move |s| -s.motion_px[axis] / size()[axis]);
            let depth = samples
                .iter()
                .map(|s| if s.object_id == 0 { 1.0 } else { 1.0 - NEAR / s.depth });
            for (kind, size, channels) in [
                ("x2/color", SCENE.size, rgb(&samples)),
                ("ground_truth", truth.size, rgb(&truths)),
                ("x2/depth", SCENE.size, vec![Channel::float("R".to_owned(), depth)]),
                (
                    "x2/motion",
                    SCENE.size,
                    vec![
                        Channel::float("R".to_owned(), uv(0)),
                        Channel::float("G".to_owned(), uv(1)),
                    ],
                ),
            ] {
                let folder = folder.path().join(kind).join(name);
                fs::create_dir_all(&folder).unwrap();
                write_exr(
                    &folder.join(format!("{:04}.exr", frame + 7)),
                    size,
                    &[Part { name: None, channels }],
                )
                .unwrap();
            }
            let (view, projection) = (SCENE.view(frame), SCENE.projection());
            let product = |i: usize, j: usize| (0..4).map(|k| projection[i][k] * view[k][j]).sum::<f64>();
            let view_projection: Vec<f64> = (0..16).map(|k| product(k / 4, k % 4)).collect();
            let mut entry = json!({
                "CameraNearPlane": NEAR, "CameraFarPlane": -1, "CameraCut": false, "Exposure": 0.5,
                "ViewProjection": view_projection,
                "NormalizedPerRatioJitter": [{"X": 9, "Y": 9}, {"X": jitter[0] / size()[0], "Y": jitter[1] / size()[1]}],
            });
            // Both names are in use.
            entry[if frame == 0 { "Frame" } else { "FrameNumber" }] = json!(frame + 7);
            frames.push(entry);
        }
        let metadata = json!({
            "EmulatedFramerate": 30, "ReverseZ": false, "UpscalingRatiosIndices": {"x1_5_index": 0, "x2_index": 1},
            "Samples": {"Count": 16}, "Frames": frames,
        });
        fs::write(folder.path().join(format!("{name}.json")), metadata.to_string()).unwrap();
    }
    folder
}

#[test]
fn arm_data_sets_are_read_as_they_are() {
    let folder = data_set(&["city"]);
    let paths = ["", "city.json", "x2/color/city"].map(|path| folder.path().join(path));
    for path in &paths {
        let sequence = Sequence::open(path, &reader()).unwrap();
        sequence.verify_files().unwrap();
        assert_eq!((sequence.name(), sequence.n_frames()), ("city", 2));
        assert_eq!(sequence.output_size().width, 2 * SCENE.size[0]);
        let frame = sequence.load(1, ALL).unwrap();
        assert!(!frame.reset && frame.reference.is_some());
        let jitter = generated(1);
        assert!(
            (0..2).all(|i| (frame.jitter_px[i] + jitter[i]).abs() < 1e-6),
            "{:?}",
            frame.jitter_px
        );
        let entries = &sequence.manifest().frames;
        let projector = |index: usize| {
            afterimage::sequence::convention::Projector::new(
                entries[index].camera.as_ref().unwrap(),
                sequence.render_size(),
            )
            .unwrap()
        };
        let (current, previous) = (projector(1), projector(0));
        let (motion, depth) = (frame.motion_px.unwrap(), frame.depth.unwrap());
        for y in 0..SCENE.size[1] {
            for x in 0..SCENE.size[0] {
                let position = [f64::from(x) + 0.5 - jitter[0], f64::from(y) + 0.5 - jitter[1]];
                let truth = SCENE.sample(1, position);
                let loaded = motion.at(x, y);
                assert!((0..2).all(|i| (f64::from(loaded[i]) - truth.motion_px[i]).abs() / size()[i] < 1e-6));
                if truth.object_id == 1 {
                    assert!((f64::from(depth.at(x, y)) / truth.depth - 1.0).abs() < 1e-6);
                    let derived = current.motion_px(&previous, position.into(), truth.depth);
                    assert!(
                        (0..2).all(|i| (derived[i] - truth.motion_px[i]).abs() < 1e-9),
                        "the camera"
                    );
                }
            }
        }
    }
    assert!(!folder.path().join("manifest.json").exists(), "nothing is written");
    let mut packed = Vec::new();
    let sequence = Sequence::open(folder.path(), &reader()).unwrap();
    sequence.pack(&mut packed).unwrap();
    let archive = folder.path().join("packed.tar");
    fs::write(&archive, packed).unwrap();
    assert_eq!(
        Sequence::open(&archive, &reader()).unwrap().hash().unwrap(),
        sequence.hash().unwrap()
    );
}

#[test]
fn arm_data_sets_that_are_none_are_refused() {
    let error = |path: &Path| Sequence::open(path, &reader()).unwrap_err().to_string();
    let two = data_set(&["city", "forest"]);
    assert!(error(two.path()).contains("has several sequences; name the file of one: city.json, forest.json"));
    assert!(Sequence::open(&two.path().join("forest.json"), &reader()).is_ok());

    let change = |name: &str, edit: &dyn Fn(&mut Value)| {
        let folder = data_set(&["city"]);
        let path = folder.path().join("city.json");
        let mut metadata = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        edit(&mut metadata);
        fs::write(&path, metadata.to_string()).unwrap();
        let message = error(folder.path());
        assert!(message.contains(name), "`{message}` does not name {name}");
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            3,
            "nothing is left behind"
        );
    };
    change("has no list `Frames`", &|metadata| *metadata = json!({"frames": []}));
    change("Frames[1].CameraNearPlane is missing", &|metadata| {
        metadata["Frames"][1].as_object_mut().unwrap().remove("CameraNearPlane");
    });
    change("Frames[0].NormalizedPerRatioJitter is missing", &|metadata| {
        metadata["Frames"][0]
            .as_object_mut()
            .unwrap()
            .remove("NormalizedPerRatioJitter");
    });
    change("ViewProjection (a perspective matrix", &|metadata| {
        metadata["Frames"][0]["ViewProjection"] = json!([1, 2])
    });
    // Another engine's folder.
    let fsr = dump(&engines()[0]);
    fs::rename(fsr.path().join("manifest.json"), fsr.path().join("dump.json")).unwrap();
    assert!(error(fsr.path()).contains("no manifest.json there"));
}
