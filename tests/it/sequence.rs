//! The fixtures, whatever conventions they are in, load as what their scene says; content hashes; archives.
#![allow(clippy::unwrap_used, reason = "in tests a panic is the message")]

use afterimage::{
    image::{
        Image,
        files::{Backend, FileReader, Limits},
    },
    sequence::{
        Channels, Frame, Sequence, archive,
        frame::{Rgb, SKY_DEPTH},
    },
};
use flate2::{Compression, write::GzEncoder};
use serde_json::Value;
use std::{
    fs::{self, File},
    io::{Cursor, Write},
    path::{Path, PathBuf},
};
use tempfile::TempDir;

#[path = "../../examples/make_fixtures/files.rs"]
#[allow(dead_code, reason = "the generator uses the rest")]
pub mod files;
#[path = "../../examples/make_fixtures/scene.rs"]
#[allow(dead_code, reason = "the generator uses the rest")]
pub mod scene;

use scene::{ENGINE, PAN, STATIC, Sample, Scene, UPSCALE, jitter_px};

pub const ALL: Channels = Channels {
    depth: true,
    motion: true,
    object_id: true,
    albedo: true,
    reactive: true,
    unjittered_color: true,
    reference: true,
    several: None,
};

pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

pub fn reader() -> FileReader {
    FileReader::new(Backend::Native, Limits::default())
}

fn open(path: &Path) -> Sequence {
    Sequence::open(path, &reader()).unwrap()
}

/// A fixture's copy, for tests that damage it.
pub fn copy_of(name: &str) -> TempDir {
    fn copy(from: &Path, to: &Path) {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
            let (from, to) = (entry.path(), to.join(entry.file_name()));
            match from.is_dir() {
                true => copy(&from, &to),
                false => drop(fs::copy(from, to).unwrap()),
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    copy(&fixture(name), folder.path());
    folder
}

/// Changes the manifest of a copy.
pub fn edit(folder: &TempDir, change: impl FnOnce(&mut Value)) {
    let path = folder.path().join("manifest.json");
    let mut manifest = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    change(&mut manifest);
    fs::write(path, manifest.to_string()).unwrap();
}

/// Every pixel's largest difference from `truth`, which gets the pixel's place and true sample.
fn max_error<T: Copy + Send + Sync>(
    image: &Image<T>,
    scene: &Scene,
    frame: i64,
    error: impl Fn(T, &Sample) -> f64,
) -> f64 {
    let jitter = jitter_px(frame);
    let mut worst = 0.0_f64;
    for y in 0..scene.size[1] {
        for x in 0..scene.size[0] {
            let position = [f64::from(x) + 0.5 + jitter[0], f64::from(y) + 0.5 + jitter[1]];
            let error = error(image.at(x, y), &scene.sample(frame, position));
            assert!(!error.is_nan(), "({x}, {y})");
            worst = worst.max(error);
        }
    }
    worst
}

fn rgb_error(loaded: Rgb, truth: [f64; 3]) -> f64 {
    let relative = |i: usize| (f64::from(loaded[i]) - truth[i]).abs() / truth[i].max(1e-2);
    (0..3).map(relative).fold(0.0, f64::max)
}

fn depth_error(loaded: f32, truth: &Sample) -> f64 {
    (f64::from(loaded) / truth.depth - 1.0).abs()
}

/// In pixels, relative where vectors are long: they are stored as f32.
fn motion_error(loaded: [f32; 2], truth: &Sample) -> f64 {
    let error = |i: usize| {
        let truth = truth.motion_px[i];
        (f64::from(loaded[i]) - truth).abs() / truth.abs().max(1.0)
    };
    error(0).max(error(1))
}

fn assert_jitter(frame: &Frame) {
    let truth = jitter_px(frame.index as i64);
    assert!((0..2).all(|i| (frame.jitter_px[i] - truth[i]).abs() < 1e-12));
}

/// Half floats keep eleven bits.
const HALF: f64 = 1.0 / 2048.0;

#[test]
fn blender_conventions_load_as_the_scene() {
    let sequence = open(&fixture("pan"));
    sequence.verify_files().unwrap();
    assert_eq!((sequence.name(), sequence.n_frames()), ("pan", 12));
    for t in 0..12 {
        let frame = sequence.load(t as usize, ALL).unwrap();
        assert_jitter(&frame);
        assert_eq!(frame.reset, t == 0 || t == scene::CUT);
        assert_eq!(frame.far, 100.0);
        let color = max_error(&frame.color, &PAN, t, |c, truth| rgb_error(c, truth.color));
        let albedo = max_error(frame.albedo.as_ref().unwrap(), &PAN, t, |c, truth| {
            rgb_error(c, truth.albedo)
        });
        assert!(color < HALF && albedo < HALF, "{t}: {color} {albedo}");
        assert!(max_error(frame.depth.as_ref().unwrap(), &PAN, t, depth_error) < 1e-6);
        assert!(max_error(frame.motion_px.as_ref().unwrap(), &PAN, t, motion_error) < 1e-6);
        let ids = frame.object_id.as_ref().unwrap();
        assert_eq!(
            max_error(ids, &PAN, t, |id, truth| f64::from(id.abs_diff(truth.object_id))),
            0.0
        );
        let reference = frame.reference.as_ref().unwrap();
        assert!(rgb_error(reference.at(40, 30), PAN.reference(t, 40, 30)) < HALF);
        assert!(frame.reactive.is_none() && frame.unjittered_color.is_none());
    }
}

#[test]
fn ray_distance_hostile_texels_and_a_shared_reference_load() {
    let sequence = open(&fixture("static"));
    sequence.verify_files().unwrap();
    let frames: Vec<Frame> = (0..8).map(|t| sequence.load(t, ALL).unwrap()).collect();
    for (t, frame) in frames.iter().enumerate() {
        assert_jitter(frame);
        assert!(frame.far.is_infinite());
        assert!(max_error(frame.depth.as_ref().unwrap(), &STATIC, t as i64, depth_error) < 1e-6);
        assert!(frame.depth.as_ref().unwrap().pixels().contains(&SKY_DEPTH));
        assert!(
            frame
                .motion_px
                .as_ref()
                .unwrap()
                .pixels()
                .iter()
                .all(|m| *m == [0.0; 2])
        );
        assert_eq!(frame.reference, frames[0].reference);
    }
    let n_hostile = |frame: &Frame| {
        let is_color = |c: &f32| c.is_finite() && *c >= 0.0;
        frame
            .color
            .pixels()
            .iter()
            .filter(|rgb| !rgb.iter().all(is_color))
            .count()
    };
    let counts: Vec<usize> = frames.iter().map(n_hostile).collect();
    assert_eq!(counts, [0, 0, 0, 4, 0, 0, 0, 0]);
    let color = &frames[3].color;
    assert!(color.at(7, 5)[0].is_nan() && color.at(30, 18)[1] == f32::INFINITY && color.at(31, 18)[0] == -1.0);
    assert!(
        color.pixels().iter().any(|rgb| rgb[0] > 3000.0),
        "the lamp keeps its range"
    );
}

/// Pre-exposed sRGB in PNG: half a step of 16 bits, times the curve's steepest slope, over the smallest exposure.
const PNG16: f64 = 0.5 / 65535.0 * 2.3 / 0.4;

#[test]
fn a_game_engines_conventions_load_as_the_same_scene() {
    let sequence = open(&fixture("engine"));
    sequence.verify_files().unwrap();
    assert!(!sequence.available().reference);
    for t in 0..8 {
        let frame = sequence.load(t as usize, ALL).unwrap();
        assert_jitter(&frame);
        assert!(frame.far.is_infinite() && frame.reference.is_none() && frame.albedo.is_none());
        let absolute = |c: Rgb, truth: &Sample| {
            (0..3)
                .map(|i| (f64::from(c[i]) - truth.color[i]).abs())
                .fold(0.0, f64::max)
        };
        let color = max_error(&frame.color, &ENGINE, t, absolute);
        assert!(color < PNG16, "{t}: {color}");
        assert!(max_error(frame.depth.as_ref().unwrap(), &ENGINE, t, depth_error) < 1e-6);
        // The first frame's vectors hold a jitter before the first, and no history will ever be fetched by them.
        if t > 0 {
            let motion = max_error(frame.motion_px.as_ref().unwrap(), &ENGINE, t, motion_error);
            assert!(motion < 1e-6, "{t}: {motion}");
        }
        let id = |id: u32, truth: &Sample| f64::from(id.abs_diff(u32::MAX - truth.object_id));
        assert_eq!(max_error(frame.object_id.as_ref().unwrap(), &ENGINE, t, id), 0.0);
        let reactive = |r: f32, truth: &Sample| (f64::from(r) - scene::reactive(truth.object_id)).abs();
        assert_eq!(max_error(frame.reactive.as_ref().unwrap(), &ENGINE, t, reactive), 0.0);
        let unjittered = frame.unjittered_color.as_ref().unwrap();
        assert!(rgb_error(unjittered.at(20, 10), ENGINE.sample(t, [20.5, 10.5]).color) < HALF);
    }
}

#[test]
fn a_sequence_to_be_upscaled_loads_at_both_sizes() {
    let sequence = open(&fixture("upscale"));
    sequence.verify_files().unwrap();
    for t in 0..16 {
        let mut frame = sequence.load(t as usize, ALL).unwrap();
        assert_jitter(&frame);
        assert_eq!(frame.sizes().scale(), [2.0, 2.0]);
        let color = max_error(&frame.color, &UPSCALE, t, |c, truth| rgb_error(c, truth.color));
        assert!(color < HALF, "{t}: {color}");
        assert!(max_error(frame.depth.as_ref().unwrap(), &UPSCALE, t, depth_error) < 1e-6);
        let motion = frame.motion_px.as_ref().unwrap();
        assert!(max_error(motion, &UPSCALE, t, motion_error) < 1e-6);
        let at_texel = motion.at(20, 15);
        let of_output = frame.take_output_motion_px().unwrap();
        let reference = frame.reference.as_ref().unwrap();
        assert!(rgb_error(reference.at(40, 30), PAN.reference(t, 40, 30)) < HALF);
        assert_eq!(of_output.extent(), reference.extent());
        assert_eq!(of_output.at(41, 31), at_texel.map(|m| 2.0 * m));
    }
}

#[test]
fn a_checkerboard_loads_as_the_scene_where_it_is_shaded() {
    let sequence = open(&fixture("checkerboard"));
    sequence.verify_files().unwrap();
    for t in 0..4 {
        let frame = sequence.load(t, ALL).unwrap();
        let (depth, motion) = (frame.depth.as_ref().unwrap(), frame.motion_px.as_ref().unwrap());
        for (x, y) in (0..48).flat_map(|x| (0..32).map(move |y| (x, y))) {
            if (x + y) as usize % 2 == t % 2 {
                let truth = ENGINE.sample(t as i64, [f64::from(x) + 0.5, f64::from(y) + 0.5]);
                assert!(rgb_error(frame.color.at(x, y), truth.color) < HALF);
                assert!(depth_error(depth.at(x, y), &truth) < 1e-6 && motion_error(motion.at(x, y), &truth) < 1e-6);
            } else {
                assert_eq!((frame.color.at(x, y), depth.at(x, y)), ([0.0; 3], SKY_DEPTH));
                assert!(motion.at(x, y)[0].is_nan());
            }
        }
    }
}

/// The comparison above must notice a convention declared wrongly.
#[test]
fn a_wrong_convention_loads_as_something_else() {
    let motion_error_with = |field: &str, value: Value| {
        let folder = copy_of("engine");
        edit(&folder, |manifest| *manifest.pointer_mut(field).unwrap() = value);
        let frame = open(folder.path()).load(2, ALL).unwrap();
        max_error(frame.motion_px.as_ref().unwrap(), &ENGINE, 2, motion_error)
    };
    assert!(motion_error_with("/name", "same".into()) < 1e-6);
    for (field, value) in [
        ("/motion/y", Value::from("down")),
        ("/motion/direction", "current_to_previous".into()),
        ("/motion/units", "ndc".into()),
        ("/motion/jittered", false.into()),
        ("/motion/invalid_value", Value::Null),
        ("/jitter/meaning", "sample_offset".into()),
        ("/jitter/y", "down".into()),
        ("/depth/reversed", false.into()),
    ] {
        let error = motion_error_with(field, value);
        assert!(error > 0.02, "{field}: {error}");
    }
}

#[test]
fn only_what_is_wanted_and_declared_is_loaded() {
    let sequence = open(&fixture("engine"));
    let frame = sequence.load(1, Channels::default()).unwrap();
    assert!(frame.depth.is_none() && frame.motion_px.is_none() && frame.object_id.is_none());
    // Motion is derived from depth here, which is read for it but not handed out.
    let motion = Channels {
        motion: true,
        ..Channels::default()
    };
    let frame = sequence.load(1, motion).unwrap();
    assert!(frame.depth.is_none());
    assert_eq!(frame.motion_px, sequence.load(1, ALL).unwrap().motion_px);
    let error = sequence.load(8, ALL).unwrap_err().to_string();
    assert_eq!(error, "there is no frame 8: the sequence has 8");
}

#[test]
fn frames_load_from_several_threads() {
    let sequence = open(&fixture("pan"));
    let load = |index| sequence.load(index, ALL).unwrap().color;
    let expected: Vec<_> = (0..4).map(load).collect();
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|index| scope.spawn(move || load(index))).collect();
        for (thread, expected) in threads.into_iter().zip(&expected) {
            assert_eq!(&thread.join().unwrap(), expected);
        }
    });
}

fn tar_of(folder: &Path, top: &str) -> Vec<u8> {
    let mut tar = tar::Builder::new(Vec::new());
    tar.append_dir_all(top, folder).unwrap();
    tar.into_inner().unwrap()
}

fn zip_of(folder: &Path, sequence: &Sequence) -> Vec<u8> {
    let mut names = vec!["manifest.json".to_owned()];
    names.extend((0..sequence.n_frames()).map(|i| format!("input/{i:02}.exr")));
    names.push("reference.exr".to_owned());
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for name in names {
        zip.start_file(name.as_str(), zip::write::SimpleFileOptions::default())
            .unwrap();
        zip.write_all(&fs::read(folder.join(name)).unwrap()).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(bytes).unwrap();
    gzip.finish().unwrap()
}

#[test]
fn the_hash_does_not_depend_on_the_container() {
    let sequence = open(&fixture("static"));
    let hash = sequence.hash().unwrap();
    assert!(hash.len() == 64 && hash.chars().all(|c| c.is_ascii_hexdigit()));
    let mut packed = Vec::new();
    sequence.pack(&mut packed).unwrap();
    let folder = tempfile::tempdir().unwrap();
    // As tools write it that compress pieces side by side.
    let (begin, end) = packed.split_at(packed.len() / 2);
    for (name, bytes) in [
        ("pieces.tar.gz", [gzip(begin), gzip(end)].concat()),
        ("top.tar", tar_of(&fixture("static"), "")),
        ("nested.tar", tar_of(&fixture("static"), "static")),
        ("sequence.tar.gz", gzip(&packed)),
        ("sequence.zip", zip_of(&fixture("static"), &sequence)),
        ("packed", packed),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let sequence = open(&path);
        assert_eq!(sequence.hash().unwrap(), hash, "{name}");
        assert_eq!(sequence.load(2, ALL).unwrap().index, 2, "{name}");
    }
    assert_eq!(open(&fixture("static/manifest.json")).hash().unwrap(), hash);
}

#[test]
fn the_hash_follows_content_only() {
    let hash = |folder: &TempDir| open(folder.path()).hash().unwrap();
    let folder = copy_of("static");
    let original = hash(&folder);
    // Another layout of the same manifest, and a file that no frame names.
    edit(&folder, |_| {});
    fs::write(folder.path().join("notes.txt"), "not part of it").unwrap();
    assert_eq!(hash(&folder), original);
    edit(&folder, |manifest| manifest["warmup_frames"] = 3.into());
    let other_manifest = hash(&folder);
    assert_ne!(other_manifest, original);
    let image = folder.path().join("input/05.exr");
    let mut bytes = fs::read(&image).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&image, bytes).unwrap();
    assert_ne!(hash(&folder), other_manifest);
    fs::copy(folder.path().join("input/04.exr"), image).unwrap();
    assert_ne!(hash(&folder), other_manifest);
}

#[test]
fn a_packed_sequence_has_its_files_and_no_others() {
    let folder = copy_of("pan");
    fs::write(folder.path().join("input/secret.txt"), "stays here").unwrap();
    let archive = folder.path().join("packed.tar");
    open(folder.path()).pack(File::create(&archive).unwrap()).unwrap();
    let into = folder.path().join("unpacked");
    archive::extract(&archive, &into, archive::Limits::default()).unwrap();
    let count = |folder: &str| fs::read_dir(into.join(folder)).unwrap().count();
    assert_eq!((count(""), count("input"), count("reference")), (3, 12, 12));
    let mut again = Vec::new();
    open(folder.path()).pack(&mut again).unwrap();
    assert_eq!(
        again,
        fs::read(archive).unwrap(),
        "equal sequences pack into equal bytes"
    );
}
