//! SMAA 1x, preset ultra: its three passes.

use super::View;
use crate::{
    gpu::{GpuError, Pass, Texture},
    taa::{recorder::Recorder, smaa_area::AREAS, temporal::Builder},
};
use wgpu::{BufferUsages, TextureFormat};

const EDGES: &str = include_str!("../../../shaders/taa/spatial/smaa_edges.wgsl");
const WEIGHTS: &str = include_str!("../../../shaders/taa/spatial/smaa_weights.wgsl");
const BLEND: &str = include_str!("../../../shaders/taa/spatial/smaa_blend.wgsl");

/// The passes, and what they leave each other.
#[derive(Debug)]
pub struct Smaa {
    find: Pass,
    weigh: Pass,
    blend: Pass,
    edges: Texture,
    weights: Texture,
    areas: wgpu::Buffer,
}

impl Smaa {
    pub const PASSES: [&str; 3] = ["smaa_edges", "smaa_weights", "smaa_blend"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [edges, weights, blend] = Self::PASSES;
        let find = builder.pass(edges, EDGES, &[])?;
        let weigh = builder.pass(weights, WEIGHTS, &[])?;
        let blend = builder.pass(blend, BLEND, &[])?;
        let (gpu, extent) = (builder.gpu, builder.sizes.render);
        let table: &[u8] = bytemuck::cast_slice(AREAS.table());
        gpu.scope("making room for edges", || {
            let areas = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("areas"),
                size: table.len() as u64,
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            gpu.queue.write_buffer(&areas, 0, table);
            Self {
                find,
                weigh,
                blend,
                edges: Texture::new(gpu, "edges", extent, TextureFormat::R32Uint),
                weights: builder.color("weights", extent),
                areas,
            }
        })
    }

    pub fn record(&self, recorder: &mut Recorder<'_>, view: View<'_>, antialiased: &Texture) -> Result<(), GpuError> {
        let (gpu, extent) = (recorder.gpu, view.sizes().render);
        let find = view
            .bind_to(&self.find)
            .bind("next_edges", &self.edges)
            .over(gpu, extent)?;
        recorder.record(&find)?;
        let weigh = view
            .bind_to(&self.weigh)
            .bind("smaa_edges", &self.edges)
            .bind("areas", &self.areas)
            .bind("next_weights", &self.weights)
            .over(gpu, extent)?;
        recorder.record(&weigh)?;
        let blend = view
            .bind_to(&self.blend)
            .bind("weights", &self.weights)
            .bind("antialiased", antialiased)
            .over(gpu, extent)?;
        recorder.record(&blend)
    }
}
