//! Sequences whose frames have fewer samples than the image to be made of them has pixels.

use crate::{
    files::{Part, write_exr},
    float, references, render, rgb,
    scene::{self, ENGINE, PAN, Sample, Scene, UPSCALE, jitter_px},
    write_manifest,
};
use serde_json::{Value, json};
use std::{fs, path::Path};

const N_FRAMES: i64 = 16;
const REFERENCE: &str = "reference/{index:02}.exr";
const INPUT: &str = "input/{index:02}.exr";

/// What the sequences differ in.
struct Sparse {
    name: &'static str,
    description: &'static str,
    render: Scene,
    output: Scene,
    jitter_px: fn(i64) -> [f64; 2],
    /// The manifest's field.
    checkerboard: Value,
    /// Whether a frame shades a pixel.
    is_shaded: fn(frame: i64, x: usize, y: usize) -> bool,
}

/// The pan at half its size, to be upscaled.
pub fn upscale(folder: &Path) -> anyhow::Result<()> {
    Sparse {
        name: "upscale",
        description: "the pan at half its size, to be upscaled to it",
        render: UPSCALE,
        output: PAN,
        jitter_px,
        checkerboard: Value::Null,
        is_shaded: |_, _, _| true,
    }
    .write(folder)
}

/// Every other pixel of the pan, in turns; the others are NaN.
pub fn checkerboard(folder: &Path) -> anyhow::Result<()> {
    Sparse {
        name: "checkerboard",
        description: "every other pixel of the pan, in turns",
        render: ENGINE,
        output: ENGINE,
        jitter_px: |_| [0.0; 2],
        checkerboard: json!({"parity": [0, 1]}),
        is_shaded: |frame, x, y| (x + y) as i64 % 2 == frame % 2,
    }
    .write(folder)
}

impl Sparse {
    fn write(&self, folder: &Path) -> anyhow::Result<()> {
        fs::create_dir_all(folder.join("input"))?;
        fs::create_dir_all(folder.join("reference"))?;
        for frame in 0..N_FRAMES {
            self.write_frame(folder, frame)?;
        }
        write_manifest(folder, &self.manifest())
    }

    fn write_frame(&self, folder: &Path, frame: i64) -> anyhow::Result<()> {
        let width = self.render.size[0] as usize;
        let scale = f64::from(self.output.size[0]) / f64::from(self.render.size[0]);
        let mut samples = render(&self.render, frame, (self.jitter_px)(frame));
        for (i, sample) in samples.iter_mut().enumerate() {
            if !(self.is_shaded)(frame, i % width, i / width) {
                *sample = Sample {
                    color: [f64::NAN; 3],
                    depth: f64::NAN,
                    motion_px: [f64::NAN; 2],
                    ..*sample
                };
            }
        }
        let mut channels = rgb("", samples.iter().map(|sample| sample.color));
        channels.extend([
            float("depth", &samples, |sample| sample.depth),
            float("motion.X", &samples, |sample| sample.motion_px[0] * scale),
            float("motion.Y", &samples, |sample| sample.motion_px[1] * scale),
        ]);
        let write = |path: String, size, channels| {
            let part = Part { name: None, channels };
            write_exr(&folder.join(path), size, &[part])
        };
        write(format!("input/{frame:02}.exr"), self.render.size, channels)?;
        let channels = rgb("", references(&self.output, frame).into_iter());
        write(format!("reference/{frame:02}.exr"), self.output.size, channels)
    }

    fn manifest(&self) -> Value {
        let frames = (0..N_FRAMES).map(|frame| {
            json!({
                "index": frame, "jitter": (self.jitter_px)(frame), "reset": frame == 0 || frame == scene::CUT,
            })
        });
        json!({
            "schema": "afterimage-sequence/1", "name": self.name, "license": "CC0-1.0",
            "description": self.description, "source": {"engine": "make_fixtures"},
            "fps": 24, "render_size": self.render.size, "output_size": self.output.size,
            "checkerboard": self.checkerboard,
            "color": {"path": INPUT, "channels": ["R", "G", "B"], "transfer": "linear"},
            "depth": {"path": INPUT, "channel": "depth", "kind": "linear_view_z"},
            "motion": {
                "path": INPUT, "channels": ["motion.X", "motion.Y"],
                "units": "pixels_output", "direction": "current_to_previous", "y": "down",
            },
            "jitter": {"units": "pixels_render", "meaning": "sample_offset", "y": "down"},
            "reference": {
                "path": REFERENCE, "channels": ["R", "G", "B"],
                "filter": "box", "filter_radius_px": 0.5, "spp": 64, "averaged_in": "linear",
            },
            "display": {"exposure": 1.0, "tonemap": "reinhard_max"}, "warmup_frames": 4,
            "frames": frames.collect::<Vec<_>>(),
        })
    }
}
