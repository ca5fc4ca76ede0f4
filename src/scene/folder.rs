//! A baked sequence on disk. Written into a folder beside its place and renamed when whole, so that nobody ever takes a
//! part for a sequence.

use super::{BakeError, BakeSettings, BakeTimes, BakedFrame, Baker};
use crate::{
    gpu::Gpu,
    image::{
        Image,
        files::{
            Plane,
            exr::{Compression, FloatFormat, write_exr},
        },
    },
    sequence::{
        frame::Rgb,
        manifest::{NoiseFloor, SCHEMA},
    },
};
use glam::DMat4;
use serde_json::{Value, json};
use std::{
    fs,
    path::Path,
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

/// Frames a second of every baked sequence.
pub(super) const FPS: u32 = 30;

/// Told how a bake goes on.
pub trait BakeObserver: Sync {
    /// Frames done, of how many.
    fn progress(&self, _n_done: usize, _n_total: usize) {}

    /// Whether to stop. Asked between frames.
    fn cancelled(&self) -> bool {
        false
    }
}

impl BakeObserver for () {}

/// What a bake says when it is done.
#[derive(Clone, Debug)]
pub struct BakeSummary {
    /// How noisy the reference is; none without one.
    pub noise_floor: Option<NoiseFloor>,
    /// Where the threads' time went.
    pub times: BakeTimes,
    /// From the first frame to the last file.
    pub elapsed: Duration,
}

/// Bakes a sequence into `folder`, which must be missing or empty.
///
/// # Errors
/// See [`BakeError`]. `folder` is then as it was.
pub fn bake(
    gpu: &Gpu,
    settings: &BakeSettings,
    folder: &Path,
    observer: &dyn BakeObserver,
) -> Result<BakeSummary, BakeError> {
    settings.validate()?;
    into_place(folder, |place| {
        for name in ["input", "reference"] {
            let path = place.join(name);
            fs::create_dir_all(&path).map_err(BakeError::io(path))?;
        }
        write_frames(gpu, settings, place, observer)
    })
}

/// Has `fill` write a folder elsewhere and renames it to `folder`, which must be missing or empty.
pub(super) fn into_place<T>(folder: &Path, fill: impl FnOnce(&Path) -> Result<T, BakeError>) -> Result<T, BakeError> {
    refuse_occupied(folder)?;
    let parent = folder.parent().filter(|parent| !parent.as_os_str().is_empty());
    let parent = parent.unwrap_or(Path::new("."));
    fs::create_dir_all(parent).map_err(BakeError::io(parent))?;
    let temporary = tempfile::Builder::new()
        .prefix(".bake-")
        .tempdir_in(parent)
        .map_err(BakeError::io(parent))?;
    let place = temporary.path().join("sequence");
    let filled = fill(&place)?;
    // An empty folder is replaced by the rename.
    refuse_occupied(folder)?;
    fs::rename(&place, folder).map_err(BakeError::io(folder))?;
    Ok(filled)
}

fn refuse_occupied(folder: &Path) -> Result<(), BakeError> {
    match fs::read_dir(folder) {
        Ok(mut entries) => match entries.next() {
            None => Ok(()),
            Some(_) => Err(BakeError::NotEmpty(folder.to_owned())),
        },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(BakeError::io(folder)(error)),
    }
}

/// Renders on this thread and writes on another; at most one frame waits between them.
fn write_frames(
    gpu: &Gpu,
    settings: &BakeSettings,
    place: &Path,
    observer: &dyn BakeObserver,
) -> Result<BakeSummary, BakeError> {
    let begin = Instant::now();
    let mut baker = Baker::new(gpu, settings)?;
    let mut entries = Vec::with_capacity(settings.n_frames);
    let written = thread::scope(|scope| {
        let (sender, frames) = mpsc::sync_channel::<BakedFrame>(1);
        let writer = scope.spawn(move || {
            let mut spent = Duration::ZERO;
            for frame in frames {
                let begin = Instant::now();
                write_frame(place, &frame)?;
                spent += begin.elapsed();
            }
            Ok::<_, BakeError>(spent)
        });
        let rendered = (0..settings.n_frames).try_for_each(|index| {
            if observer.cancelled() {
                return Err(BakeError::Cancelled);
            }
            let frame = baker.frame(index)?;
            entries.push(entry(&frame, baker.near()));
            observer.progress(index + 1, settings.n_frames);
            // The writer only goes away with an error, which is found below.
            let _ = sender.send(frame);
            match writer.is_finished() {
                true => Err(BakeError::Cancelled),
                false => Ok(()),
            }
        });
        drop(sender);
        let written = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        written.and_then(|spent| rendered.map(|()| spent))
    })?;
    let manifest = manifest(settings, &baker, &entries);
    write_json(&place.join("manifest.json"), &manifest)?;
    if settings.karis && settings.reference_samples > 0 {
        write_json(&place.join("manifest-karis.json"), &with_karis(manifest))?;
    }
    Ok(BakeSummary {
        noise_floor: baker.noise_floor(),
        times: BakeTimes {
            write: written,
            ..baker.times()
        },
        elapsed: begin.elapsed(),
    })
}

fn write_json(path: &Path, value: &Value) -> Result<(), BakeError> {
    let text = serde_json::to_string_pretty(value).expect("JSON made of JSON") + "\n";
    fs::write(path, text).map_err(BakeError::io(path))
}

fn channel(image: &Image<Rgb>, i: usize) -> Plane {
    Plane::F32(image.pixels().iter().map(|pixel| pixel[i]).collect())
}

fn rgb<'a>(names: [&'a str; 3], image: &Image<Rgb>) -> impl Iterator<Item = (&'a str, Plane)> {
    (0..3).map(move |i| (names[i], channel(image, i)))
}

const COLOR: [&str; 3] = ["R", "G", "B"];
const ALBEDO: [&str; 3] = ["albedo.R", "albedo.G", "albedo.B"];
const UNJITTERED: [&str; 3] = ["unjittered.R", "unjittered.G", "unjittered.B"];
const KARIS: [&str; 3] = ["karis.R", "karis.G", "karis.B"];

/// What stands before a channel's name where a pixel has several samples.
const SAMPLE: &str = "S{sample}.";

/// Colours as half floats, what is measured as 32 bits.
fn write_frame(place: &Path, frame: &BakedFrame) -> Result<(), BakeError> {
    let extent = frame.color.extent();
    let name = format!("{:04}.exr", frame.index);
    let mut colors = Vec::new();
    let mut geometry = Vec::new();
    for (prefix, color, depth, motion_px) in samples(frame) {
        let named = |(name, plane): (&str, Plane)| (format!("{prefix}{name}"), plane);
        let motion = |axis: usize| Plane::F32(motion_px.pixels().iter().map(|motion| motion[axis]).collect());
        colors.extend(rgb(COLOR, color).map(named));
        let depth = Plane::F32(depth.pixels().to_vec());
        geometry.extend([("depth", depth), ("motion.X", motion(0)), ("motion.Y", motion(1))].map(named));
    }
    let (names, planes): (Vec<String>, Vec<Plane>) = colors.into_iter().unzip();
    let colors: Vec<_> = names
        .iter()
        .map(String::as_str)
        .zip(planes)
        .chain(rgb(ALBEDO, &frame.albedo))
        .chain(rgb(UNJITTERED, &frame.unjittered_color))
        .chain([("reactive", Plane::F32(frame.reactive.pixels().to_vec()))])
        .collect();
    let path = place.join("input").join(format!("color_{name}"));
    write_exr(&path, extent, &colors, FloatFormat::Half, Compression::ZIP16)?;
    let (names, planes): (Vec<String>, Vec<Plane>) = geometry.into_iter().unzip();
    let mut geometry: Vec<_> = names.iter().map(String::as_str).zip(planes).collect();
    geometry.push(("id", Plane::U32(frame.object_id.pixels().to_vec())));
    if let Some(mask) = &frame.disoccluded {
        geometry.push(("disoccluded", Plane::F32(mask.pixels().to_vec())));
    }
    let path = place.join("input").join(format!("geometry_{name}"));
    write_exr(&path, extent, &geometry, FloatFormat::Float, Compression::ZIP16)?;
    if let Some(reference) = &frame.reference {
        let mut channels: Vec<_> = rgb(COLOR, reference).collect();
        channels.extend(frame.reference_karis.iter().flat_map(|image| rgb(KARIS, image)));
        let path = place.join("reference").join(name);
        let extent = reference.extent();
        write_exr(&path, extent, &channels, FloatFormat::Float, Compression::ZIP16)?;
    }
    Ok(())
}

/// What stands before their channels' names, colour, depth and motion of every sample.
type Sample<'a> = (String, &'a Image<Rgb>, &'a Image<f32>, &'a Image<[f32; 2]>);

fn samples(frame: &BakedFrame) -> Vec<Sample<'_>> {
    let Some(others) = &frame.others else {
        return vec![(String::new(), &frame.color, &frame.depth, &frame.motion_px)];
    };
    let colors = [&frame.color].into_iter().chain(&others.color);
    let depths = [&frame.depth].into_iter().chain(&others.depth);
    let motions = [&frame.motion_px].into_iter().chain(&others.motion_px);
    let named = colors.zip(depths).zip(motions).enumerate();
    named
        .map(|(i, ((color, depth), motion))| (SAMPLE.replace("{sample}", &i.to_string()), color, depth, motion))
        .collect()
}

fn rows(matrix: DMat4) -> [[f64; 4]; 4] {
    matrix.transpose().to_cols_array_2d()
}

fn entry(frame: &BakedFrame, near: f64) -> Value {
    json!({
        "index": frame.index,
        "jitter": frame.jitter_px,
        "reset": frame.reset,
        "camera": {
            "view": rows(frame.camera.view),
            "projection": rows(frame.camera.projection),
            "near": near,
            "far": null,
        },
    })
}

fn manifest(settings: &BakeSettings, baker: &Baker, entries: &[Value]) -> Value {
    let (description, license) = settings.description().expect("it was baked");
    let color = "input/color_{index:04}.exr";
    let geometry = "input/geometry_{index:04}.exr";
    let plane = |path: &str, channel: &str| json!({"path": path, "channel": channel});
    let prefix = if settings.samples > 1 { SAMPLE } else { "" };
    let named = |name: &str| format!("{prefix}{name}");
    let motion = ["motion.X", "motion.Y"].map(named);
    let reference = baker.noise_floor().map(|noise_floor| {
        json!({
            "path": "reference/{index:04}.exr", "channels": COLOR, "transfer": "linear",
            "filter": "box", "filter_radius_px": 0.5, "spp": settings.reference_samples,
            "averaged_in": "linear", "noise_floor": noise_floor,
        })
    });
    json!({
        "schema": SCHEMA,
        "name": settings.scene,
        "description": description,
        "license": license,
        "source": {"engine": "afterimage bake", "version": env!("CARGO_PKG_VERSION")},
        "fps": FPS,
        "render_size": settings.render_size,
        "output_size": settings.output_size,
        "samples": (settings.samples > 1).then(|| json!({"count": settings.samples})),
        "color": {"path": color, "channels": COLOR.map(named).to_vec(), "transfer": "linear"},
        "unjittered_color": {"path": color, "channels": UNJITTERED, "transfer": "linear"},
        "albedo": {"path": color, "channels": ALBEDO, "transfer": "linear"},
        "reactive": plane(color, "reactive"),
        "depth": {"path": geometry, "channel": named("depth"), "kind": "linear_view_z", "near": baker.near(), "far": null},
        "motion": {
            "path": geometry, "channels": motion, "units": "pixels_render",
            "direction": "current_to_previous", "y": "down",
        },
        "object_id": plane(geometry, "id"),
        "disoccluded": settings.disocclusion.then(|| plane(geometry, "disoccluded")),
        "jitter": {"units": "pixels_render", "meaning": "sample_offset", "y": "down"},
        "reference": reference,
        "display": baker.display(),
        "warmup_frames": settings.n_frames.saturating_sub(1).min(8),
        "bake": settings,
        "frames": entries,
    })
}

/// The same sequence with the reference that was averaged in Karis's space; its noise was not measured.
fn with_karis(mut manifest: Value) -> Value {
    let reference = &mut manifest["reference"];
    reference["channels"] = json!(KARIS);
    reference["averaged_in"] = json!("karis");
    reference["noise_floor"] = Value::Null;
    manifest
}
