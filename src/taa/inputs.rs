//! A frame on the device. Uploaded once, whatever the number of recipes; colour is repaired and mapped into each
//! working domain once, too.

use super::{Source, recipe::Domain};
use crate::{
    gpu::{Gpu, GpuError, Pass, Texture, Timer},
    image::Extent,
    sequence::{Channels, Frame},
};
use std::collections::{BTreeMap, BTreeSet};
use wgpu::TextureFormat;

/// The current frame's images.
#[derive(Debug)]
pub struct Inputs {
    extent: Extent,
    has_history: bool,
    jitter_px: [f64; 2],
    color: Texture,
    unjittered_color: Option<Texture>,
    /// One texel where no recipe reads it, so that every pipeline has something to bind.
    pub(super) depth: Texture,
    pub(super) motion: Texture,
    prepare: BTreeMap<Domain, Pass>,
    prepared: BTreeMap<(Source, Domain), Prepared>,
}

/// A colour in a working domain.
#[derive(Debug)]
struct Prepared {
    color: Texture,
    repaired_texels: wgpu::Buffer,
}

const PREPARE: [&str; 2] = [
    include_str!("../../shaders/taa/temporal/prepare.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];

impl Inputs {
    /// Room for frames of `extent` with `channels`, prepared for each of `wanted`.
    pub fn new(
        gpu: &Gpu,
        extent: Extent,
        channels: Channels,
        wanted: &BTreeSet<(Source, Domain)>,
    ) -> Result<Self, GpuError> {
        let mut prepare = BTreeMap::new();
        for &(_, domain) in wanted {
            let overrides = [("domain", f64::from(domain as u32))];
            prepare.insert(domain, Pass::new(gpu, "prepare", &PREPARE, &overrides)?);
        }
        gpu.scope("making room for a frame", || {
            let texture = |label, format| Texture::new(gpu, label, extent, format);
            let if_read = |read, label, format| {
                let extent = if read { extent } else { Extent::new(1, 1) };
                Texture::new(gpu, label, extent, format)
            };
            let prepared = wanted
                .iter()
                .map(|&key| {
                    (
                        key,
                        Prepared::new(gpu, texture("prepared color", TextureFormat::Rgba32Float)),
                    )
                })
                .collect();
            Self {
                extent,
                has_history: false,
                jitter_px: [0.0; 2],
                color: texture("color", TextureFormat::Rgba32Float),
                unjittered_color: channels
                    .unjittered_color
                    .then(|| texture("unjittered color", TextureFormat::Rgba32Float)),
                depth: if_read(channels.depth, "depth", TextureFormat::R32Float),
                motion: if_read(channels.motion, "motion", TextureFormat::Rg32Float),
                prepare,
                prepared,
            }
        })
    }

    /// Uploads `frame`, which must have the channels that were asked for.
    pub fn upload(&mut self, gpu: &Gpu, frame: &Frame) -> Result<(), GpuError> {
        self.has_history = frame.index > 0 && !frame.reset;
        self.jitter_px = frame.jitter_px;
        gpu.scope("uploading a frame", || {
            self.color.write_rgb(gpu, &frame.color);
            if let (Some(texture), Some(image)) = (&self.unjittered_color, &frame.unjittered_color) {
                texture.write_rgb(gpu, image);
            }
            if let Some(depth) = frame.depth.as_ref().filter(|_| self.depth.extent() == self.extent) {
                self.depth.write_scalar(gpu, depth);
            }
            if let Some(motion) = frame.motion_px.as_ref().filter(|_| self.motion.extent() == self.extent) {
                self.motion.write_vec2(gpu, motion);
            }
        })
    }

    /// Records the preparation of every colour and domain wanted, in their order, `repeat` times each.
    pub fn prepare(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        repeat: u32,
    ) -> Result<(), GpuError> {
        for (&(source, domain), prepared) in &self.prepared {
            let dispatch = self.prepare[&domain]
                .bind("input_color", self.color_of(source))
                .bind("color", &prepared.color)
                .bind("repaired_texels", &prepared.repaired_texels)
                .over(gpu, self.extent)?;
            for _ in 0..repeat {
                encoder.clear_buffer(&prepared.repaired_texels, 0, None);
                dispatch.record(encoder, timer.time());
            }
        }
        Ok(())
    }

    /// The count of hostile texels that preparing a colour repaired: one `u32`.
    pub fn repaired_texels(&self, source: Source, domain: Domain) -> &wgpu::Buffer {
        &self.prepared[&(source, domain)].repaired_texels
    }

    pub(super) fn prepared(&self, source: Source, domain: Domain) -> &Texture {
        &self.prepared[&(source, domain)].color
    }

    pub(super) fn extent(&self) -> Extent {
        self.extent
    }

    pub(super) fn has_history(&self) -> bool {
        self.has_history
    }

    pub(super) fn jitter_px(&self) -> [f64; 2] {
        self.jitter_px
    }

    fn color_of(&self, source: Source) -> &Texture {
        match (source, &self.unjittered_color) {
            (Source::UnjitteredIfPresent, Some(texture)) => texture,
            _ => &self.color,
        }
    }
}

impl Prepared {
    fn new(gpu: &Gpu, color: Texture) -> Self {
        Self {
            color,
            repaired_texels: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("repaired texels"),
                size: 4,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
        }
    }
}
