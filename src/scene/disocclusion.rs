//! Which surfaces the frame before did not see: a known answer for what rejects history.
//!
//! The geometry of the frame before is drawn again, without jitter and [`FINER`] times as fine along each axis, and the
//! point that each pixel shows is looked for in it. Where all texels around that place agree the answer is sure: 1 hidden
//! or outside the image, 0 seen. Where they do not, the place lies within 1/[`FINER`] of a pixel of an edge: 0.5.

use super::renderer::{PreparedFrame, Renderer, SurfaceTarget};
use crate::{
    gpu::{Gpu, GpuError, Pass, RasterSpec, Texture},
    image::Extent,
};

/// Texels of the previous depth for a pixel, along each axis.
const FINER: u32 = 4;

#[derive(Debug)]
pub(super) struct Disocclusion {
    pass: Pass,
    previous_depth: Texture,
    mask: Texture,
}

const SOURCE: &str = include_str!("../../shaders/scene/disocclusion.wgsl");

impl Disocclusion {
    pub fn new(gpu: &Gpu, extent: Extent) -> Result<Self, GpuError> {
        let finer = Extent::new(extent.width * FINER, extent.height * FINER);
        if finer.width.max(finer.height) > gpu.max_side() {
            return Err(GpuError::Unsupported {
                adapter: gpu.info().name,
                message: format!("has no room for the mask of disocclusion, which needs a texture of {finer}"),
            });
        }
        let pass = Pass::new(gpu, "disocclusion", &[SOURCE], &[])?;
        gpu.scope("making room for the mask of disocclusion", || Self {
            pass,
            previous_depth: Texture::target(gpu, "previous depth", finer, RasterSpec::DEPTH_FORMAT),
            mask: Texture::new(gpu, "disocclusion", extent, wgpu::TextureFormat::R32Float),
        })
    }

    /// 1 hidden, 0 seen, 0.5 at an edge.
    pub fn mask(&self) -> &Texture {
        &self.mask
    }

    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        renderer: &Renderer,
        frame: &PreparedFrame,
        surface: &SurfaceTarget,
        jitter_px: [f64; 2],
    ) -> Result<(), GpuError> {
        renderer.draw_previous_depth(encoder, frame, &self.previous_depth)?;
        let near = renderer.scene.near as f32;
        let fields = [("jitter_px", jitter_px.map(|j| j as f32).into()), ("near", near.into())];
        let dispatch = self
            .pass
            .bind("geometry", &surface.images[1])
            .bind("albedo", &surface.images[3])
            .bind("previous_depth", &self.previous_depth)
            .bind("mask", &self.mask)
            .uniform("parameters", &fields)
            .over(gpu, self.mask.extent())?;
        dispatch.record(encoder, None);
        Ok(())
    }
}
