//! Mistakes planted in baked scenes: each is named, with what mends it, and nothing else is said.
#![allow(clippy::unwrap_used, reason = "in tests a panic is the message")]

mod geometry;

use crate::{
    sequence::{
        ALL,
        files::{Channel, Part, write_exr},
        reader,
    },
    support::gpu,
};
use afterimage::{
    image::Extent,
    scene::{BakeSettings, bake},
    sequence::{
        Frame, Sequence,
        check::{Report, Severity, check},
    },
};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    path::PathBuf,
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};
use tempfile::TempDir;

const SIZE: Extent = Extent::new(128, 72);
const N_FRAMES: usize = 6;

/// A baked scene. Variants of it are other manifests, and other files beside those that were baked.
struct Baked {
    folder: TempDir,
    manifest: Value,
    frames: Vec<Frame>,
    n_variants: AtomicUsize,
}

/// The scene, baked once a process.
fn baked(scene: &'static str) -> Arc<Baked> {
    static ALL_BAKED: Mutex<BTreeMap<&str, Arc<Baked>>> = Mutex::new(BTreeMap::new());
    let mut all = ALL_BAKED.lock().unwrap();
    Arc::clone(
        all.entry(scene)
            .or_insert_with(|| Arc::new(Baked::new(&settings(scene)))),
    )
}

fn settings(scene: &str) -> BakeSettings {
    // At rest, jitter alone tells the frames apart: it takes more pixels to measure.
    let size = if scene == "static" { Extent::new(160, 90) } else { SIZE };
    BakeSettings {
        n_frames: N_FRAMES,
        render_size: size,
        output_size: size,
        reference_samples: 64,
        ..BakeSettings::new(scene)
    }
}

impl Baked {
    fn new(settings: &BakeSettings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("baked");
        bake(gpu(), settings, &place, &()).unwrap();
        let sequence = Sequence::open(&place, &reader()).unwrap();
        Self {
            manifest: serde_json::from_str(&fs::read_to_string(place.join("manifest.json")).unwrap()).unwrap(),
            frames: (0..settings.n_frames)
                .map(|index| sequence.load(index, ALL).unwrap())
                .collect(),
            folder,
            n_variants: AtomicUsize::new(0),
        }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("baked")
    }

    /// What the check says of the sequence after a change of its manifest.
    fn checked(&self, plant: &dyn Fn(&Self, &mut Value)) -> Report {
        let mut manifest = self.manifest.clone();
        plant(self, &mut manifest);
        let path = self.path().join(format!("{}.json", self.name()));
        fs::write(&path, manifest.to_string()).unwrap();
        check(&Sequence::open(&path, &reader()).unwrap()).unwrap()
    }

    /// A file name that nothing has yet.
    fn name(&self) -> String {
        format!("variant-{}", self.n_variants.fetch_add(1, Ordering::Relaxed))
    }

    /// Writes images, by frame and channel; gives their path in a manifest.
    fn write<const N: usize>(&self, channels: [&str; N], pixel: impl Fn(&Frame, u32, u32) -> [f64; N]) -> String {
        let name = self.name();
        for frame in &self.frames {
            let size = frame.color.extent();
            let places = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
            let pixels: Vec<[f64; N]> = places.map(|(x, y)| pixel(frame, x, y)).collect();
            let channel = |i: usize| Channel::float(channels[i].to_owned(), pixels.iter().map(move |pixel| pixel[i]));
            let part = Part {
                name: None,
                channels: (0..N).map(channel).collect(),
            };
            let path = self.path().join(format!("{name}-{}.exr", frame.index));
            write_exr(&path, [size.width, size.height], &[part]).unwrap();
        }
        format!("{name}-{{index}}.exr")
    }

    /// Device depth.
    fn write_depth(&self, device: fn(f64) -> f64) -> String {
        self.write(["Z"], |frame, x, y| {
            [device(f64::from(frame.depth.as_ref().unwrap().at(x, y)))]
        })
    }

    /// The frames' references, each of which another frame's file stands for.
    fn reference_of(&self, other: impl Fn(usize) -> usize) -> String {
        let name = self.name();
        for index in 0..self.frames.len() {
            let from = self.path().join(format!("reference/{:04}.exr", other(index)));
            fs::copy(from, self.path().join(format!("{name}-{index}.exr"))).unwrap();
        }
        format!("{name}-{{index}}.exr")
    }
}

/// Changes a manifest, and writes the files that it then names.
type Plant = Box<dyn Fn(&Baked, &mut Value)>;

/// Something wrong, the warnings it must raise, and what must be suggested.
struct Mistake {
    what: &'static str,
    plant: Plant,
    finds: &'static [&'static str],
    suggests: Vec<(&'static str, Value)>,
}

fn mistake<const N: usize>(
    what: &'static str,
    finds: &'static [&'static str],
    suggests: [(&'static str, Value); N],
    plant: impl Fn(&Baked, &mut Value) + 'static,
) -> Mistake {
    Mistake {
        what,
        plant: Box::new(plant),
        finds,
        suggests: suggests.into(),
    }
}

/// The same, of a field that is declared wrong.
fn declared(pointer: &'static str, wrong: Value, right: Value) -> Mistake {
    let (parent, field) = pointer.rsplit_once('.').unwrap();
    mistake(pointer, &[], [(pointer, right)], move |_, manifest| {
        manifest[parent][field] = wrong.clone()
    })
    .found(pointer)
}

impl Mistake {
    fn found(mut self, id: &'static str) -> Self {
        self.finds = Vec::leak(vec![id]);
        self
    }
}

fn is_about(found: &Value, expected: &Value) -> bool {
    match (found.as_f64(), expected.as_f64()) {
        (Some(found), Some(expected)) => (found - expected).abs() <= 0.02 * expected.abs(),
        _ => match (found.as_array(), expected.as_array()) {
            (Some(found), Some(expected)) => found.iter().zip(expected).all(|(a, b)| is_about(a, b)),
            _ => found == expected,
        },
    }
}

/// Every mistake is named, the scene itself is not.
fn assert_named(scene: &'static str, mistakes: Vec<Mistake>) {
    let baked = baked(scene);
    let clean = baked.checked(&|_, _| ());
    assert!(clean.findings.is_empty(), "{scene}: {:?}", clean.findings);
    let mut wrong = String::new();
    for Mistake {
        what,
        plant,
        finds,
        suggests,
    } in mistakes
    {
        let report = baked.checked(&*plant);
        let mut found: Vec<&str> = report.warnings().map(|finding| finding.id.as_str()).collect();
        found.sort_unstable();
        let all = || report.findings.iter().flat_map(|finding| &finding.suggestions);
        let is_suggested = |(field, value): &(&str, Value)| {
            all().any(|suggestion| suggestion.field == *field && is_about(&suggestion.value, value))
        };
        if found != finds || !suggests.iter().all(is_suggested) {
            wrong += &format!(
                "{scene}, {what}: {found:?} in place of {finds:?}, {suggests:?}: {:?}\n",
                report.findings
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

/// Changes every frame's jitter, which it gets with those of all frames.
fn jitters(change: fn(usize, &[[f64; 2]]) -> [f64; 2]) -> impl Fn(&Baked, &mut Value) {
    move |baked, manifest| {
        let all: Vec<[f64; 2]> = baked.frames.iter().map(|frame| frame.jitter_px).collect();
        for index in 0..all.len() {
            manifest["frames"][index]["jitter"] = json!(change(index, &all));
        }
    }
}

fn jitter_mistakes() -> Vec<Mistake> {
    let meaning = ("jitter.meaning", json!("projection_offset"));
    let y = ("jitter.y", json!("up"));
    let value = |text: &str| ("frames[].jitter", json!(text));
    vec![
        mistake(
            "x turned",
            &["jitter.x"],
            [meaning.clone(), y.clone()],
            jitters(|i, all| [-all[i][0], all[i][1]]),
        ),
        mistake(
            "y turned",
            &["jitter.y"],
            [y],
            jitters(|i, all| [all[i][0], -all[i][1]]),
        ),
        mistake(
            "both turned",
            &["jitter.meaning"],
            [meaning],
            jitters(|i, all| all[i].map(|axis| -axis)),
        ),
        mistake(
            "axes swapped",
            &["jitter.axes"],
            [value("[y, x]")],
            jitters(|i, all| [all[i][1], all[i][0]]),
        ),
        mistake(
            "half as long",
            &["jitter.scale"],
            [value("times 2")],
            jitters(|i, all| all[i].map(|axis| 0.5 * axis)),
        ),
        mistake(
            "half a pixel more, wrapped",
            &["jitter.offset"],
            [value("half a pixel more or less along x and y, within half a pixel")],
            jitters(|i, all| all[i].map(|axis| if axis > 0.0 { axis - 0.5 } else { axis + 0.5 })),
        ),
        mistake(
            "a frame late",
            &["jitter.frame"],
            [value("of frame index+1")],
            jitters(|i, all| all[(i + all.len() - 1) % all.len()]),
        ),
        mistake("of another sequence", &["jitter.unexplained"], [], |_, manifest| {
            let others = [
                [-0.34, -0.17],
                [0.4, 0.03],
                [0.41, -0.04],
                [0.08, -0.07],
                [-0.48, -0.12],
                [-0.45, -0.15],
            ];
            for (index, other) in others.into_iter().enumerate() {
                manifest["frames"][index]["jitter"] = json!(other);
            }
        }),
        mistake(
            "samples at the centres",
            &["jitter.absent"],
            [("frames[].jitter", json!([0, 0]))],
            |_, manifest| {
                manifest["color"]["channels"] = manifest["unjittered_color"]["channels"].clone();
            },
        ),
    ]
}

#[test]
fn jitter_where_nothing_moves() {
    assert_named("static", jitter_mistakes());
}

#[test]
fn jitter_where_the_camera_turns() {
    assert_named("pan", jitter_mistakes());
}

#[test]
fn jitter_where_a_ball_passes() {
    assert_named("sphere", jitter_mistakes());
}

fn srgb(c: f64) -> f64 {
    match c {
        c if c <= 0.003_130_8 => 12.92 * c,
        c => 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055,
    }
}

const RGB: [&str; 3] = ["R", "G", "B"];

fn color_mistakes() -> Vec<Mistake> {
    let reference = |frame: &Frame, x, y| frame.reference.as_ref().unwrap().at(x, y).map(f64::from);
    vec![
        declared("reference.transfer", json!("srgb"), json!("linear")),
        declared("reference.transfer", json!("pq"), json!("linear")),
        declared("color.transfer", json!("srgb"), json!("linear")),
        mistake(
            "the reference is stored as sRGB",
            &["reference.transfer"],
            [("reference.transfer", json!("srgb"))],
            move |baked, manifest| {
                let path = baked.write(RGB, |frame, x, y| reference(frame, x, y).map(srgb));
                manifest["reference"]["path"] = json!(path);
            },
        ),
        mistake(
            "both are stored as sRGB",
            &["color.transfer"],
            [("color.transfer", json!("srgb")), ("reference.transfer", json!("srgb"))],
            move |baked, manifest| {
                let path = baked.write(RGB, |frame, x, y| reference(frame, x, y).map(srgb));
                manifest["reference"]["path"] = json!(path);
                let path = baked.write(RGB, |frame, x, y| frame.color.at(x, y).map(|c| srgb(f64::from(c))));
                manifest["color"]["path"] = json!(path);
            },
        ),
        mistake("brighter", &["reference.brightness"], [], move |baked, manifest| {
            let path = baked.write(RGB, |frame, x, y| reference(frame, x, y).map(|c| 1.5 * c));
            manifest["reference"]["path"] = json!(path);
        }),
    ]
}

#[test]
fn encodings_where_the_camera_walks() {
    assert_named("atrium", color_mistakes());
}

#[test]
fn encodings_where_the_camera_turns() {
    assert_named("pan", color_mistakes());
}

#[test]
fn references_of_other_frames() {
    for scene in ["atrium", "pan", "sphere"] {
        let of = |what, suggested: &str, lag: isize| {
            let suggests = [("reference.path", json!(suggested))];
            mistake(what, &["reference.frame"], suggests, move |baked, manifest| {
                let n = baked.frames.len();
                let path = baked.reference_of(|index| index.saturating_add_signed(lag).min(n - 1));
                manifest["reference"]["path"] = json!(path);
            })
        };
        assert_named(
            scene,
            vec![
                of("the frame before's", "files of index +1", -1),
                of("the frame after's", "files of index -1", 1),
            ],
        );
    }
}

/// Of a reference twice as fine, moved by one of its pixels.
#[test]
fn a_reference_half_a_pixel_off() {
    let baked = Baked::new(&BakeSettings {
        render_size: SIZE,
        output_size: Extent::new(2 * SIZE.width, 2 * SIZE.height),
        ..settings("static")
    });
    assert!(baked.checked(&|_, _| ()).findings.is_empty());
    // Read at the input's size, which must be the output's, so that one file serves both.
    let moved = |by: [u32; 2]| {
        baked.write(RGB, |frame, x, y| {
            let reference = frame.reference.as_ref().unwrap();
            let Extent { width, height } = reference.extent();
            let at = |i: u32| {
                [
                    (2 * x + by[0] + i % 2).min(width - 1),
                    (2 * y + by[1] + i / 2).min(height - 1),
                ]
            };
            let four = (0..4).map(at).map(|[x, y]| reference.at(x, y));
            four.fold([0.0; 3], |sum, c| {
                std::array::from_fn(|i| sum[i] + 0.25 * f64::from(c[i]))
            })
        })
    };
    for (by, found) in [
        ([0, 0], None),
        ([1, 0], Some([-0.5, 0.0])),
        ([1, 1], Some([-0.5, -0.5])),
    ] {
        let path = moved(by);
        let report = baked.checked(&|_, manifest| {
            manifest["reference"]["path"] = json!(path);
            manifest["output_size"] = manifest["render_size"].clone();
        });
        let warnings: Vec<&str> = report.warnings().map(|finding| finding.id.as_str()).collect();
        let Some(expected) = found else {
            assert!(warnings.is_empty(), "{:?}", report.findings);
            continue;
        };
        assert_eq!(warnings, ["grid.offset"], "{:?}", report.findings);
        let evidence = &report.findings[0].evidence;
        let measured = [evidence["offset_x_px"], evidence["offset_y_px"]];
        assert!((0..2).all(|i| (measured[i] - expected[i]).abs() < 0.1), "{evidence:?}");
    }
}

/// Long sequences at rest, of which frames are chosen.
#[test]
fn jitter_that_leans_or_never_changes() {
    let baked = Baked::new(&BakeSettings {
        n_frames: 20,
        at_rest: true,
        ..settings("static")
    });
    let chosen = |keep: &dyn Fn(&[f64; 2]) -> bool, moved: f64| {
        baked.checked(&|baked, manifest| {
            for section in [
                "color",
                "depth",
                "motion",
                "object_id",
                "reference",
                "reactive",
                "albedo",
                "unjittered_color",
            ] {
                let path = manifest[section]["path"]
                    .as_str()
                    .unwrap()
                    .replace("{index", "{file_frame");
                manifest[section]["path"] = json!(path);
            }
            let kept = baked.frames.iter().filter(|frame| keep(&frame.jitter_px));
            let frames = kept.enumerate().map(|(index, frame)| {
                let mut entry = manifest["frames"][frame.index].clone();
                (entry["index"], entry["file_frame"]) = (json!(index), json!(frame.index));
                entry["reset"] = json!(index == 0);
                entry["jitter"] = json!(frame.jitter_px.map(|axis| axis + moved));
                entry
            });
            manifest["frames"] = frames.collect();
        })
    };
    let ids = |report: &Report| {
        report
            .findings
            .iter()
            .map(|finding| finding.id.clone())
            .collect::<Vec<_>>()
    };
    let all = chosen(&|_| true, 0.0);
    assert!(all.findings.is_empty(), "{:?}", all.findings);
    let leaning = chosen(&|[x, _]| *x > 0.05, 0.0);
    assert_eq!(ids(&leaning), ["jitter.mean"], "{:?}", leaning.findings);
    assert!(leaning.findings[0].evidence["mean_x_px"] > 0.2);
    // The same mean, but the samples do not lean.
    let moved = chosen(&|jitter| jitter.iter().all(|axis| axis.abs() < 0.26), 0.24);
    assert_eq!(ids(&moved), ["jitter.offset"], "{:?}", moved.findings);
    let evidence = &moved.findings[0].evidence;
    assert!((evidence["offset_x_px"] - 0.24).abs() < 0.06 && (evidence["offset_y_px"] - 0.24).abs() < 0.06);

    // One frame over and over, declared as it is, then with its true neighbours' images.
    let constant = |is_rendered_so: bool| {
        baked.checked(&|baked, manifest| {
            for index in 0..20 {
                manifest["frames"][index]["jitter"] = json!(baked.frames[3].jitter_px);
            }
            if is_rendered_so {
                manifest["color"]["path"] = json!("input/color_0003.exr");
            }
        })
    };
    let report = constant(true);
    assert_eq!(ids(&report), ["jitter.constant"], "{:?}", report.findings);
    let report = constant(false);
    assert_eq!(ids(&report), ["jitter.missing"], "{:?}", report.findings);
}

/// A cut that is not declared, and one that is but is not there.
#[test]
fn resets_where_the_camera_jumps() {
    let baked = Baked::new(&BakeSettings {
        n_frames: 2 * N_FRAMES,
        ..settings("cut")
    });
    let cut = (1..2 * N_FRAMES).find(|&index| baked.frames[index].reset).unwrap();
    for (frame, reset, severity) in [(cut, false, Severity::Warning), (cut - 1, true, Severity::Note)] {
        let report = baked.checked(&|_, manifest| manifest["frames"][frame]["reset"] = json!(reset));
        let found: Vec<_> = report
            .findings
            .iter()
            .map(|finding| (finding.id.as_str(), finding.severity))
            .collect();
        assert_eq!(found, [("frames.reset", severity)], "{:?}", report.findings);
    }
}

/// What hurts a resolve most is not taken for a mistake of the dump.
#[test]
fn scenes_that_hurt_are_not_warned_of() {
    for scene in ["fence", "foliage", "blinds", "spaceship", "fireflies", "cut", "flicker"] {
        // Those two do so later.
        let n_frames = if ["cut", "flicker"].contains(&scene) {
            2 * N_FRAMES
        } else {
            N_FRAMES
        };
        let settings = BakeSettings {
            n_frames,
            ..settings(scene)
        };
        let report = Baked::new(&settings).checked(&|_, _| ());
        assert!(report.is_clean(), "{scene}: {:?}", report.findings);
    }
}
