//! Sequences that have several colours for each pixel: four samples, and a pane of glass in front of everything else.

use crate::{
    files::{Channel, Part, write_exr},
    references, rgb,
    scene::{self, ENGINE, Sample, jitter_px},
    write_manifest,
};
use serde_json::{Value, json};
use std::{fs, path::Path};

const N_FRAMES: i64 = 8;
const INPUT: &str = "input/{index:02}.exr";
const REFERENCE: &str = "reference/{index:02}.exr";

/// Where the samples of a pixel lie, from that of the frame: a rotated grid, half as wide as the pixel.
const OFFSETS_PX: [[f64; 2]; 4] = [
    [-0.0625, -0.1875],
    [0.1875, -0.0625],
    [-0.1875, 0.0625],
    [0.0625, 0.1875],
];

/// The pan with four samples a pixel, all in one file.
pub fn samples(folder: &Path) -> anyhow::Result<()> {
    make_folders(folder, &["input", "reference"])?;
    for frame in 0..N_FRAMES {
        let jitter = jitter_px(frame);
        let items = OFFSETS_PX.iter().enumerate().flat_map(|(item, offset)| {
            // The frame's offset and the sample's stay within half a pixel together.
            let at = [0, 1].map(|axis| 0.5 * jitter[axis] + offset[axis]);
            channels(&format!("S{item}."), &crate::render(&ENGINE, frame, at))
        });
        write(folder, frame, items.collect(), references(&ENGINE, frame))?;
    }
    let halved = |frame| jitter_px(frame).map(|axis| 0.5 * axis);
    let manifest = json!({
        "name": "samples", "description": "the pan with four samples of each pixel",
        "samples": {"count": 4},
        "color": {"path": INPUT, "channels": ["S{sample}.R", "S{sample}.G", "S{sample}.B"], "transfer": "linear"},
        "depth": {"path": INPUT, "channel": "S{sample}.depth", "kind": "linear_view_z"},
        "motion": motion("S{sample}."),
    });
    write_manifest(folder, &complete(manifest, halved))
}

/// The pane: how much of a place it covers, what colour it has, how it moves.
struct Pane;

impl Pane {
    const OPACITY: f64 = 0.6;
    const COLOR: [f64; 3] = [0.15, 0.55, 0.35];
    const SPEED_PX: f64 = 1.5;
    const DEPTH: f64 = 1.5;

    /// Its opacity at a position, 0 beside it.
    fn opacity(frame: i64, [x, y]: [f64; 2]) -> f64 {
        let left = 6.0 + Self::SPEED_PX * frame as f64;
        let covers = (left..left + 14.0).contains(&x) && (7.0..25.0).contains(&y);
        if covers { Self::OPACITY } else { 0.0 }
    }

    fn over(frame: i64, position: [f64; 2], behind: [f64; 3]) -> [f64; 3] {
        let opacity = Self::opacity(frame, position);
        [0, 1, 2].map(|i| Self::COLOR[i] * opacity + behind[i] * (1.0 - opacity))
    }
}

/// The pan behind a pane of glass that moves on its own; a file a layer, the nearest first.
pub fn layers(folder: &Path) -> anyhow::Result<()> {
    make_folders(folder, &["layer0", "layer1", "reference"])?;
    let [width, height] = ENGINE.size;
    let pixels = || (0..height).flat_map(move |y| (0..width).map(move |x| [f64::from(x), f64::from(y)]));
    for frame in 0..N_FRAMES {
        let jitter = jitter_px(frame);
        let behind = crate::render(&ENGINE, frame, jitter);
        let opacities: Vec<_> = pixels()
            .map(|[x, y]| Pane::opacity(frame, [x + 0.5 + jitter[0], y + 0.5 + jitter[1]]))
            .collect();
        let pane: Vec<_> = behind.iter().map(|_| pane_sample()).collect();
        let opaque = vec![1.0; opacities.len()];
        for (layer, (samples, opacity)) in [(&pane, &opacities), (&behind, &opaque)].into_iter().enumerate() {
            let mut channels = channels("", samples);
            channels.push(Channel::half("A".to_owned(), opacity.iter().copied()));
            let part = Part { name: None, channels };
            write_exr(
                &folder.join(format!("layer{layer}/{frame:02}.exr")),
                ENGINE.size,
                &[part],
            )?;
        }
        let reference = pixels().map(|[x, y]| reference(frame, [x, y])).collect();
        write_reference(folder, frame, reference)?;
    }
    let path = "layer{layer}/{index:02}.exr";
    let manifest = json!({
        "name": "layers", "description": "the pan behind a moving pane of glass, as two layers",
        "layers": {"count": 2, "alpha": {"path": path, "channel": "A"}},
        "color": {"path": path, "channels": ["R", "G", "B"], "transfer": "linear"},
        "depth": {"path": path, "channel": "depth", "kind": "linear_view_z"},
        "motion": {
            "path": path, "channels": ["motion.X", "motion.Y"],
            "units": "pixels_render", "direction": "current_to_previous", "y": "down",
        },
    });
    write_manifest(folder, &complete(manifest, jitter_px))
}

fn pane_sample() -> Sample {
    Sample {
        color: Pane::COLOR,
        albedo: Pane::COLOR,
        depth: Pane::DEPTH,
        distance: Pane::DEPTH,
        motion_px: [-Pane::SPEED_PX, 0.0],
        object_id: 4,
    }
}

/// The mean of 8 × 8 samples spread evenly over the pixel, each seen through the pane where that covers it.
fn reference(frame: i64, [x, y]: [f64; 2]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for i in 0..64 {
        let position = [x + (f64::from(i % 8) + 0.5) / 8.0, y + (f64::from(i / 8) + 0.5) / 8.0];
        let color = Pane::over(frame, position, ENGINE.sample(frame, position).color);
        (0..3).for_each(|channel| sum[channel] += color[channel] / 64.0);
    }
    sum
}

/// Colour, depth and motion of one sample or layer.
fn channels(prefix: &str, samples: &[Sample]) -> Vec<Channel> {
    let float =
        |name: &str, value: fn(&Sample) -> f64| Channel::float(format!("{prefix}{name}"), samples.iter().map(value));
    let mut channels = rgb(prefix, samples.iter().map(|sample| sample.color));
    channels.extend([
        float("depth", |sample| sample.depth),
        float("motion.X", |sample| sample.motion_px[0]),
        float("motion.Y", |sample| sample.motion_px[1]),
    ]);
    channels
}

fn motion(prefix: &str) -> Value {
    json!({
        "path": INPUT, "channels": [format!("{prefix}motion.X"), format!("{prefix}motion.Y")],
        "units": "pixels_render", "direction": "current_to_previous", "y": "down",
    })
}

fn make_folders(folder: &Path, names: &[&str]) -> anyhow::Result<()> {
    for name in names {
        fs::create_dir_all(folder.join(name))?;
    }
    Ok(())
}

fn write(folder: &Path, frame: i64, channels: Vec<Channel>, reference: Vec<[f64; 3]>) -> anyhow::Result<()> {
    let part = Part { name: None, channels };
    write_exr(&folder.join(format!("input/{frame:02}.exr")), ENGINE.size, &[part])?;
    write_reference(folder, frame, reference)
}

fn write_reference(folder: &Path, frame: i64, reference: Vec<[f64; 3]>) -> anyhow::Result<()> {
    let channels = rgb("", reference.into_iter());
    let part = Part { name: None, channels };
    write_exr(&folder.join(format!("reference/{frame:02}.exr")), ENGINE.size, &[part])
}

/// With what both have.
fn complete(mut manifest: Value, jitter_px: impl Fn(i64) -> [f64; 2]) -> Value {
    let frames = (0..N_FRAMES)
        .map(|frame| json!({"index": frame, "jitter": jitter_px(frame), "reset": frame == 0 || frame == scene::CUT}));
    let common = json!({
        "schema": "afterimage-sequence/1", "license": "CC0-1.0", "source": {"engine": "make_fixtures"},
        "fps": 24, "render_size": ENGINE.size, "output_size": ENGINE.size,
        "jitter": {"units": "pixels_render", "meaning": "sample_offset", "y": "down"},
        "reference": {
            "path": REFERENCE, "channels": ["R", "G", "B"],
            "filter": "box", "filter_radius_px": 0.5, "spp": 64, "averaged_in": "linear",
        },
        "display": {"exposure": 1.0, "tonemap": "reinhard_max"}, "warmup_frames": 2,
        "frames": frames.collect::<Vec<_>>(),
    });
    if let (Value::Object(manifest), Value::Object(common)) = (&mut manifest, common) {
        manifest.extend(common);
    }
    manifest
}
