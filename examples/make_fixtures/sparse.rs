//! Sequences whose frames have fewer samples than the image to be made of them has pixels.

use crate::{
    files::{Part, write_exr},
    float, references, render, rgb,
    scene::{self, PAN, UPSCALE, jitter_px},
    write_manifest,
};
use serde_json::json;
use std::{fs, path::Path};

/// The pan at half its size, to be upscaled: motion in pixels of the output, a reference of its size.
pub fn upscale(folder: &Path) -> anyhow::Result<()> {
    const N_FRAMES: i64 = 16;
    fs::create_dir_all(folder.join("input"))?;
    fs::create_dir_all(folder.join("reference"))?;
    let scale = f64::from(PAN.size[0]) / f64::from(UPSCALE.size[0]);
    let mut frames = Vec::new();
    for frame in 0..N_FRAMES {
        let samples = render(&UPSCALE, frame, jitter_px(frame));
        let mut channels = rgb("", samples.iter().map(|sample| sample.color));
        channels.extend([
            float("depth", &samples, |sample| sample.depth),
            float("motion.X", &samples, |sample| sample.motion_px[0] * scale),
            float("motion.Y", &samples, |sample| sample.motion_px[1] * scale),
        ]);
        let input = Part { name: None, channels };
        write_exr(&folder.join(format!("input/{frame:02}.exr")), UPSCALE.size, &[input])?;
        let channels = rgb("", references(&PAN, frame).into_iter());
        let reference = Part { name: None, channels };
        write_exr(
            &folder.join(format!("reference/{frame:02}.exr")),
            PAN.size,
            &[reference],
        )?;
        frames.push(json!({
            "index": frame, "jitter": jitter_px(frame), "reset": frame == 0 || frame == scene::CUT,
        }));
    }
    let input = "input/{index:02}.exr";
    write_manifest(
        folder,
        &json!({
            "schema": "afterimage-sequence/1", "name": "upscale", "license": "CC0-1.0",
            "description": "the pan at half its size, to be upscaled to it",
            "source": {"engine": "make_fixtures"},
            "fps": 24, "render_size": UPSCALE.size, "output_size": PAN.size,
            "color": {"path": input, "channels": ["R", "G", "B"], "transfer": "linear"},
            "depth": {"path": input, "channel": "depth", "kind": "linear_view_z"},
            "motion": {
                "path": input, "channels": ["motion.X", "motion.Y"],
                "units": "pixels_output", "direction": "current_to_previous", "y": "down",
            },
            "jitter": {"units": "pixels_render", "meaning": "sample_offset", "y": "down"},
            "reference": {
                "path": "reference/{index:02}.exr", "channels": ["R", "G", "B"],
                "filter": "box", "filter_radius_px": 0.5, "spp": 64, "averaged_in": "linear",
            },
            "display": {"exposure": 1.0, "tonemap": "reinhard_max"}, "warmup_frames": 4, "frames": frames,
        }),
    )
}
