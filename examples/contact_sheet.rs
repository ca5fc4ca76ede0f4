//! Draws every built-in scene, or those that are named, into one PNG: `docs/scenes.png`, or the channels of a frame.
//!
//! ```sh
//! LP_NUM_THREADS=0 cargo run --release --example contact_sheet -- docs/scenes.png
//! LP_NUM_THREADS=0 cargo run --release --example contact_sheet -- sphere.png --size 640x360 --frame 9 --channels sphere
//! ```
//!
//! `src/cli/lavapipe.rs` says why without lavapipe's threads.

use afterimage::{
    gpu::Gpu,
    image::{Extent, Image},
    scene::{BakeSettings, BakedFrame, Baker, SCENES},
};
use anyhow::Context;
use clap::Parser;
use std::path::PathBuf;

#[derive(Parser)]
struct Arguments {
    /// Where to write
    out: PathBuf,
    /// Scenes, all of them where none is named
    scenes: Vec<String>,
    /// Size of a picture
    #[arg(long, default_value = "240x135")]
    size: String,
    /// Pictures side by side
    #[arg(long, default_value_t = 4)]
    columns: usize,
    /// Which frame
    #[arg(long, default_value_t = 9)]
    frame: usize,
    /// Samples a pixel
    #[arg(long, default_value_t = 16)]
    samples: u32,
    /// Colour, reference, motion, depth, ids, reactive mask and disocclusion instead of the reference alone
    #[arg(long)]
    channels: bool,
}

type Picture = Image<[u8; 3]>;

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let (width, height) = arguments.size.split_once('x').context("--size WxH")?;
    let extent = Extent::new(width.parse()?, height.parse()?);
    let gpu = Gpu::open(None)?;
    let all = SCENES.iter().map(|scene| scene.id.to_owned());
    let scenes: Vec<String> = if arguments.scenes.is_empty() {
        all.collect()
    } else {
        arguments.scenes.clone()
    };
    let mut pictures = Vec::new();
    for scene in &scenes {
        let settings = BakeSettings {
            render_size: extent,
            output_size: extent,
            n_frames: arguments.frame + 1,
            reference_samples: arguments.samples,
            disocclusion: arguments.channels,
            ..BakeSettings::new(scene)
        };
        let mut baker = Baker::new(&gpu, &settings)?;
        let display = baker.display();
        let frame = baker.frame(arguments.frame)?;
        let shown = |image: &Image<[f32; 3]>| -> Picture {
            Image::from_fn(extent, |x, y| {
                display.apply(image.at(x, y)).map(|c| (255.0 * c + 0.5) as u8)
            })
        };
        let reference = shown(frame.reference.as_ref().context("a reference")?);
        if arguments.channels {
            pictures.extend([shown(&frame.color), reference]);
            pictures.extend(channels(&frame, extent));
        } else {
            pictures.push(reference);
        }
    }
    let rows = pictures.len().div_ceil(arguments.columns);
    let sheet = Extent::new(extent.width * arguments.columns as u32, extent.height * rows as u32);
    let pixel = |x: u32, y: u32| {
        let index = (y / extent.height) as usize * arguments.columns + (x / extent.width) as usize;
        pictures
            .get(index)
            .map_or([255; 3], |picture| picture.at(x % extent.width, y % extent.height))
    };
    let bytes: Vec<u8> = Image::from_fn(sheet, pixel).pixels().concat();
    image::save_buffer(
        &arguments.out,
        &bytes,
        sheet.width,
        sheet.height,
        image::ColorType::Rgb8,
    )?;
    Ok(())
}

/// Motion as red and green about grey, a pixel for 8 steps; depth as nearness; ids as colours; masks.
fn channels(frame: &BakedFrame, extent: Extent) -> [Picture; 6] {
    let grey = |value: f32| [(255.0 * value.clamp(0.0, 1.0)) as u8; 3];
    let image = |f: &(dyn Fn(u32, u32) -> [u8; 3] + Sync)| Image::from_fn(extent, f);
    [
        image(&|x, y| {
            let [u, v] = frame.motion_px.at(x, y).map(|m| (128.0 + 8.0 * m) as u8);
            [u, v, 128]
        }),
        image(&|x, y| grey(2.0 / frame.depth.at(x, y))),
        image(&|x, y| {
            let id = frame.object_id.at(x, y).wrapping_mul(0x9e37_79b9);
            [(id >> 24) as u8, (id >> 16) as u8, (id >> 8) as u8]
        }),
        image(&|x, y| grey(frame.reactive.at(x, y))),
        image(&|x, y| frame.disoccluded.as_ref().map_or([0; 3], |mask| grey(mask.at(x, y)))),
        image(&|x, y| {
            frame
                .albedo
                .at(x, y)
                .map(|c| (255.0 * libm::powf(c.clamp(0.0, 1.0), 1.0 / 2.2)) as u8)
        }),
    ]
}
