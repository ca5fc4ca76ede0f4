//! The pass that makes one of several samples or layers of each pixel (`shaders/taa/temporal/merge.wgsl`).

use super::{Fault, fault::planted};
use crate::{
    gpu::{Dispatch, Gpu, GpuError, Pass, Texture},
    image::Extent,
    sequence::{Channels, Frame, Merging, Several},
};
use wgpu::TextureFormat;

const MERGE: [&str; 2] = [
    include_str!("../../shaders/taa/temporal/merge.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];

/// The pass and what it reads: stacks with an image for each sample or layer.
#[derive(Debug)]
pub struct Merge {
    pass: Pass,
    channels: Channels,
    colors: Texture,
    opacities: Texture,
    motions: Texture,
    depths: Texture,
}

impl Merge {
    /// The pass's name.
    pub const PASS: &str = "merge";

    /// Room for the frames of a sequence, of which `channels` says what is read.
    pub fn new(
        gpu: &Gpu,
        extent: Extent,
        several: Several,
        channels: Channels,
        fault: Option<Fault<'_>>,
    ) -> Result<Self, GpuError> {
        let flag = |set: bool| f64::from(u8::from(set));
        let is_layered = several.merging != Merging::Samples;
        let overrides = [
            ("layered", flag(is_layered)),
            (
                "premultiplied",
                flag(several.merging == Merging::Layers { premultiplied: true }),
            ),
            ("with_motion", flag(channels.motion)),
            ("with_depth", flag(channels.depth)),
        ];
        let sources = planted(fault, Self::PASS, &MERGE)?;
        let sources: Vec<_> = sources.iter().map(|source| &**source).collect();
        let pass = Pass::new(gpu, Self::PASS, &sources, &overrides)?;
        gpu.scope("making room for samples", || {
            let stack = |label, is_read, format| {
                let (extent, n) = if is_read {
                    (extent, several.n_items)
                } else {
                    (Extent::new(1, 1), 1)
                };
                Texture::stack(gpu, label, extent, n, format)
            };
            Self {
                pass,
                channels,
                colors: stack("colors", true, TextureFormat::Rgba32Float),
                opacities: stack("opacities", is_layered, TextureFormat::R32Float),
                motions: stack("motions", channels.motion, TextureFormat::Rg32Float),
                depths: stack("depths", channels.depth, TextureFormat::R32Float),
            }
        })
    }

    /// Uploads what it reads of a frame. What all share is uploaded for each.
    pub fn upload(&self, gpu: &Gpu, frame: &Frame) {
        let Some(others) = &frame.others else { return };
        let n_items = 1 + others.color.len();
        for (i, color) in [&frame.color].into_iter().chain(&others.color).enumerate() {
            self.colors.layer(i).write_rgb(gpu, color);
        }
        for (i, opacity) in others.opacity.iter().enumerate() {
            self.opacities.layer(i).write_scalar(gpu, opacity);
        }
        for item in 0..n_items {
            if let Some(motion) = frame.motion_of(item).filter(|_| self.channels.motion) {
                self.motions.layer(item).write_vec2(gpu, motion);
            }
            if let Some(depth) = frame.depth_of(item).filter(|_| self.channels.depth) {
                self.depths.layer(item).write_scalar(gpu, depth);
            }
        }
    }

    /// The dispatch that writes the frame's images.
    pub fn dispatch<'a>(
        &'a self,
        gpu: &Gpu,
        color: &'a Texture,
        motion: &'a Texture,
        depth: &'a Texture,
    ) -> Result<Dispatch<'a>, GpuError> {
        self.pass
            .bind("item_colors", &self.colors)
            .bind("item_opacities", &self.opacities)
            .bind("item_motions", &self.motions)
            .bind("item_depths", &self.depths)
            .bind("merged_color", color)
            .bind("merged_motion", motion)
            .bind("merged_depth", depth)
            .over(gpu, color.extent())
    }
}
