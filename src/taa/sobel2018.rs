//! The edges that widen the box `sobel` (`shaders/taa/sobel2018`): found in the frame, then made stable over time.

use super::{
    Carried,
    inputs::View,
    recorder::{Recorder, TiledPass},
    temporal::Builder,
    tiles::Tiles,
};
use crate::gpu::{GpuError, Texture};
use wgpu::TextureFormat;

const EDGES: &str = include_str!("../../shaders/taa/sobel2018/edges.wgsl");
const STABILISE: &str = include_str!("../../shaders/taa/sobel2018/stabilise.wgsl");

/// The pass that runs over the tiles whose images changed.
pub const EDGES_PASS: &str = "edges";

#[derive(Debug)]
pub struct Edges {
    find: TiledPass,
    stabilise: TiledPass,
    edges: Texture,
    /// 32-bit whatever the precision, because adapters need not store one channel of f16; rounded to it all the same.
    history: Carried,
    stable: Texture,
}

impl Edges {
    pub const PASSES: [&str; 2] = [EDGES_PASS, "stabilise"];

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let [find, stabilise] = Self::PASSES;
        let find = builder.tiled_pass(find, EDGES)?;
        let stabilise = builder.tiled_pass(stabilise, STABILISE)?;
        let (gpu, extent) = (builder.gpu, builder.sizes.render);
        let scalar = |label| Texture::new(gpu, label, extent, TextureFormat::R32Float);
        gpu.scope("making room for edges", || Self {
            find,
            stabilise,
            edges: scalar("edges"),
            history: Carried::new(gpu, "edge history", extent, TextureFormat::R32Float),
            stable: scalar("stable edges"),
        })
    }

    pub fn record(
        &mut self,
        recorder: &mut Recorder<'_>,
        view: View<'_>,
        tiles: Option<&Tiles>,
    ) -> Result<(), GpuError> {
        self.history.advance();
        let extent = view.sizes().render;
        recorder.record_tiled(&self.find, view.changed(), extent, &[], |pass| {
            view.bind_to(pass).bind("edges", &self.edges)
        })?;
        recorder.record_tiled(&self.stabilise, tiles.map(Tiles::computed), extent, &[], |pass| {
            view.bind_to(pass)
                .bind("edges", &self.edges)
                .bind("edge_history", self.history.previous())
                .bind("next_edge_history", self.history.current())
                .bind("stabilised", &self.stable)
        })
    }

    /// What the edges leave to the next frame.
    pub fn kept(&self) -> &Texture {
        self.history.current()
    }

    /// What the frame before left, and what this one does.
    pub fn histories(&self) -> [&Texture; 2] {
        [self.history.previous(), self.history.current()]
    }

    /// How strong the edge through each pixel is, 0 to 1.
    pub fn stable(&self) -> &Texture {
        &self.stable
    }
}
