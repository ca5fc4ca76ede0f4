//! Writes the frame sequences under `fixtures/`: the same analytic scene as different engines would dump it.
//!
//! `cargo run --example make_fixtures [FOLDER]`. The result depends on nothing but this code.

mod files;
mod scene;
mod several;
mod sparse;

use files::{Channel, Part, write_exr, write_png16};
use scene::{ENGINE, FAR, HOSTILE_FRAME, NEAR, PAN, STATIC, Sample, Scene, exposure, hostile, jitter_px, reactive};
use serde_json::{Value, json};
use std::{
    fs,
    path::{Path, PathBuf},
};

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os()
        .nth(1)
        .map_or_else(|| "fixtures".into(), PathBuf::from);
    pan(&folder.join("pan"))?;
    still(&folder.join("static"))?;
    engine(&folder.join("engine"))?;
    sparse::upscale(&folder.join("upscale"))?;
    sparse::checkerboard(&folder.join("checkerboard"))?;
    several::samples(&folder.join("samples"))?;
    several::layers(&folder.join("layers"))
}

/// Every pixel's sample of a jittered frame, row by row.
fn render(scene: &Scene, frame: i64, jitter_px: [f64; 2]) -> Vec<Sample> {
    let [width, height] = scene.size;
    let positions = (0..height).flat_map(|y| (0..width).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]));
    positions
        .map(|[x, y]| scene.sample(frame, [x + jitter_px[0], y + jitter_px[1]]))
        .collect()
}

fn references(scene: &Scene, frame: i64) -> Vec<[f64; 3]> {
    let [width, height] = scene.size;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels.map(|(x, y)| scene.reference(frame, x, y)).collect()
}

/// Red, green and blue as half floats, named `{prefix}R` and so on.
fn rgb(prefix: &str, pixels: impl Iterator<Item = [f64; 3]> + Clone) -> Vec<Channel> {
    let channel = |(i, name)| Channel::half(format!("{prefix}{name}"), pixels.clone().map(|pixel| pixel[i]));
    ["R", "G", "B"].into_iter().enumerate().map(channel).collect()
}

fn float(name: &str, samples: &[Sample], value: impl Fn(&Sample) -> f64) -> Channel {
    Channel::float(name.to_owned(), samples.iter().map(value))
}

fn write_manifest(folder: &Path, manifest: &Value) -> anyhow::Result<()> {
    Ok(fs::write(folder.join("manifest.json"), format!("{manifest:#}\n"))?)
}

/// A panning camera in Blender's conventions: a part a pass, full channel names, y up, ids as floats.
fn pan(folder: &Path) -> anyhow::Result<()> {
    const N_FRAMES: i64 = 12;
    fs::create_dir_all(folder.join("input"))?;
    fs::create_dir_all(folder.join("reference"))?;
    let mut frames = Vec::new();
    for frame in 0..N_FRAMES {
        let jitter = jitter_px(frame);
        let file_frame = frame + 1;
        pan_files(folder, frame, file_frame, jitter)?;
        frames.push(json!({
            "index": frame, "file_frame": file_frame, "jitter": jitter, "reset": frame == 0 || frame == scene::CUT,
            "camera": {"view": PAN.view(frame), "projection": PAN.projection(), "near": NEAR, "far": FAR},
        }));
    }
    let input = "input/{file_frame:04}.exr";
    let pass = |name: &str| ["R", "G", "B"].map(|channel| format!("ViewLayer.{name}.{channel}"));
    write_manifest(
        folder,
        &json!({
            "schema": "afterimage-sequence/1", "name": "pan", "license": "CC0-1.0",
            "description": "checkers, thin lines and a moving box; the camera pans, and cuts once",
            "source": {"engine": "make_fixtures"},
            "fps": 24, "render_size": PAN.size, "output_size": PAN.size, "preset": "blender",
            "color": {"path": input, "channels": pass("Combined"), "transfer": "linear"},
            "depth": {"path": input, "channel": "ViewLayer.Depth.Z", "near": NEAR, "far": FAR},
            "motion": {"path": input, "channels": ["ViewLayer.Vector.X", "ViewLayer.Vector.Y"]},
            "albedo": {"path": input, "channels": pass("Diffuse Color")},
            "object_id": {"path": input, "channel": "ViewLayer.Object Index.X"},
            "reference": {
                "path": "reference/{file_frame:04}.exr", "channels": pass("Combined"),
                "filter": "box", "filter_radius_px": 0.5, "spp": 64, "averaged_in": "linear",
            },
            "display": {"exposure": 1.0, "tonemap": "reinhard_max"}, "warmup_frames": 2, "frames": frames,
        }),
    )
}

/// One frame of the pan and its reference.
fn pan_files(folder: &Path, frame: i64, file_frame: i64, jitter_px: [f64; 2]) -> anyhow::Result<()> {
    let samples = render(&PAN, frame, jitter_px);
    let part = |name: &'static str, channels| Part {
        name: Some(name),
        channels,
    };
    let mut combined = rgb("ViewLayer.Combined.", samples.iter().map(|sample| sample.color));
    combined.push(Channel::half(
        "ViewLayer.Combined.A".to_owned(),
        samples.iter().map(|_| 1.0),
    ));
    let vector = vec![
        float("ViewLayer.Vector.X", &samples, |sample| sample.motion_px[0]),
        float("ViewLayer.Vector.Y", &samples, |sample| -sample.motion_px[1]),
        float("ViewLayer.Vector.Z", &samples, |_| 0.0),
        float("ViewLayer.Vector.W", &samples, |_| 0.0),
    ];
    let depth = float("ViewLayer.Depth.Z", &samples, |sample| sample.depth);
    let id = float("ViewLayer.Object Index.X", &samples, |sample| sample.object_id.into());
    let parts = [
        part("ViewLayer.Combined", combined),
        part("ViewLayer.Depth", vec![depth]),
        part("ViewLayer.Vector", vector),
        part("ViewLayer.Object Index", vec![id]),
        part(
            "ViewLayer.Diffuse Color",
            rgb("ViewLayer.Diffuse Color.", samples.iter().map(|sample| sample.albedo)),
        ),
    ];
    write_exr(&folder.join(format!("input/{file_frame:04}.exr")), PAN.size, &parts)?;
    let reference = Part {
        name: None,
        channels: rgb("ViewLayer.Combined.", references(&PAN, frame).into_iter()),
    };
    write_exr(
        &folder.join(format!("reference/{file_frame:04}.exr")),
        PAN.size,
        &[reference],
    )
}

/// Nothing moves; a lamp far above 1, a frame with texels that are no colours, depth from the eye, one shared reference.
fn still(folder: &Path) -> anyhow::Result<()> {
    const N_FRAMES: i64 = 8;
    fs::create_dir_all(folder.join("input"))?;
    let mut frames = Vec::new();
    for frame in 0..N_FRAMES {
        let jitter = jitter_px(frame);
        let samples = render(&STATIC, frame, jitter);
        let color = samples.iter().enumerate().map(|(i, sample)| {
            let (x, y) = (i as u32 % STATIC.size[0], i as u32 / STATIC.size[0]);
            hostile(x, y).filter(|_| frame == HOSTILE_FRAME).unwrap_or(sample.color)
        });
        let mut channels = rgb("", color);
        channels.push(float("distance", &samples, |sample| sample.distance));
        channels.push(Channel::half("motion.X".to_owned(), samples.iter().map(|_| 0.0)));
        channels.push(Channel::half("motion.Y".to_owned(), samples.iter().map(|_| 0.0)));
        let part = Part { name: None, channels };
        write_exr(&folder.join(format!("input/{frame:02}.exr")), STATIC.size, &[part])?;
        frames.push(json!({
            "index": frame, "jitter": jitter, "reset": frame == 0,
            "camera": {"view": STATIC.view(frame), "projection": STATIC.projection()},
        }));
    }
    let reference = Part {
        name: None,
        channels: rgb("", references(&STATIC, 0).into_iter()),
    };
    write_exr(&folder.join("reference.exr"), STATIC.size, &[reference])?;
    let input = "input/{index:02}.exr";
    write_manifest(
        folder,
        &json!({
            "schema": "afterimage-sequence/1", "name": "static", "license": "CC0-1.0",
            "description": "nothing moves; an HDR lamp, and in one frame texels that are no colours",
            "source": {"engine": "make_fixtures"},
            "fps": 60, "render_size": STATIC.size, "output_size": STATIC.size,
            "color": {"path": input, "channels": ["R", "G", "B"], "transfer": "linear"},
            "depth": {"path": input, "channel": "distance", "kind": "ray_distance", "sky_value": scene::SKY},
            "motion": {
                "path": input, "channels": ["motion.X", "motion.Y"],
                "units": "pixels_render", "direction": "current_to_previous", "y": "down",
            },
            "jitter": {"units": "pixels_render", "meaning": "sample_offset", "y": "down"},
            "reference": {
                "path": "reference.exr", "channels": ["R", "G", "B"],
                "filter": "box", "filter_radius_px": 0.5, "spp": 64, "averaged_in": "linear",
            },
            "display": {"exposure": 1.0, "tonemap": "aces"}, "warmup_frames": 2, "frames": frames,
        }),
    )
}

/// The pan as a game engine would dump it: pre-exposed sRGB colour in PNG, device depth reversed with no far plane,
/// motion in texture coordinates with y up, jitter inside, and none for what rests; jitter as a projection offset.
fn engine(folder: &Path) -> anyhow::Result<()> {
    const N_FRAMES: i64 = 8;
    fs::create_dir_all(folder.join("color"))?;
    fs::create_dir_all(folder.join("gbuffer"))?;
    let [width, height] = ENGINE.size.map(f64::from);
    let mut frames = Vec::new();
    for frame in 0..N_FRAMES {
        let jitter = jitter_px(frame);
        engine_files(folder, frame)?;
        frames.push(json!({
            "index": frame, "reset": frame == 0 || frame == scene::CUT, "exposure": exposure(frame),
            "jitter": [-jitter[0] * 2.0 / width, jitter[1] * 2.0 / height],
            "camera": engine_camera(frame),
        }));
    }
    let gbuffer = "gbuffer/{index:04}.exr";
    write_manifest(
        folder,
        &json!({
            "schema": "afterimage-sequence/1", "name": "engine", "license": "CC0-1.0",
            "description": "the pan in a game engine's conventions, without a reference",
            "source": {"engine": "make_fixtures"},
            "fps": 30, "render_size": ENGINE.size, "output_size": ENGINE.size,
            "color": {
                "path": "color/{index:04}.png", "channels": ["R", "G", "B"], "transfer": "srgb", "pre_exposed": true,
            },
            "depth": {"path": gbuffer, "channel": "depth", "kind": "device", "reversed": true},
            "motion": {
                "path": gbuffer, "channels": ["motion.X", "motion.Y"], "units": "uv",
                "direction": "previous_to_current", "y": "up", "jittered": true, "invalid_value": [0, 0],
            },
            "jitter": {"units": "ndc", "meaning": "projection_offset", "y": "up"},
            "object_id": {"path": gbuffer, "channel": "id"},
            "reactive": {"path": gbuffer, "channel": "reactive"},
            "unjittered_color": {
                "path": gbuffer, "channels": ["unjittered.R", "unjittered.G", "unjittered.B"],
                "transfer": "linear", "pre_exposed": false,
            },
            "display": {"exposure": 1.0, "tonemap": "none"}, "warmup_frames": 2, "frames": frames,
        }),
    )
}

/// One frame of the engine's dump.
fn engine_files(folder: &Path, frame: i64) -> anyhow::Result<()> {
    let [width, height] = ENGINE.size.map(f64::from);
    let (jitter, previous_jitter) = (jitter_px(frame), jitter_px(frame - 1));
    let samples = render(&ENGINE, frame, jitter);
    let colors = samples.iter().map(|sample| sample.color.map(|c| c * exposure(frame)));
    write_png16(&folder.join(format!("color/{frame:04}.png")), ENGINE.size, colors)?;
    let motion = |sample: &Sample, axis: usize, unit: f64| match sample.object_id {
        2 => -(sample.motion_px[axis] - (previous_jitter[axis] - jitter[axis])) / unit,
        _ => 0.0,
    };
    let mut channels = rgb(
        "unjittered.",
        render(&ENGINE, frame, [0.0; 2]).iter().map(|sample| sample.color),
    );
    channels.extend([
        float("depth", &samples, |sample| match sample.object_id {
            0 => 0.0,
            _ => NEAR / sample.depth,
        }),
        float("motion.X", &samples, |sample| motion(sample, 0, width)),
        float("motion.Y", &samples, |sample| motion(sample, 1, -height)),
        Channel::uint(
            "id".to_owned(),
            samples.iter().map(|sample| u32::MAX - sample.object_id),
        ),
        Channel::half(
            "reactive".to_owned(),
            samples.iter().map(|sample| reactive(sample.object_id)),
        ),
    ]);
    let part = Part { name: None, channels };
    write_exr(&folder.join(format!("gbuffer/{frame:04}.exr")), ENGINE.size, &[part])
}

/// View space looks along +z, as Direct3D has it; reversed depth without a far plane.
fn engine_camera(frame: i64) -> Value {
    let mut view = ENGINE.view(frame);
    view[2] = view[2].map(|element| -element);
    let [x, y, ..] = ENGINE.projection();
    let projection = [x, y, [0.0, 0.0, 0.0, NEAR], [0.0, 0.0, 1.0, 0.0]];
    json!({"view": view, "projection": projection, "near": NEAR, "far": null})
}
