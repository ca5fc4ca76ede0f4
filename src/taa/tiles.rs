//! Tiles with nothing to do, kept as they are (`shaders/taa/tiles`).
//!
//! Let a tile's surroundings be all pixels within the recipe's reach. The tile is kept in frame t where, over its
//! surroundings, every input has the bits it had in frame t−1 (where the recipe looks at the frame before, in t−1 those of
//! t−2, too), nothing moves, jitter is that of frame t−1 or colour is flat, and where, over the tile, frame t−1 stored the
//! bits that it had read: H(t−1) = H(t−2). Then the resolve of frame t has the operands of the resolve of frame t−1: without
//! motion a pixel reads history at its own texel alone, all other taps weighing exactly 0; and flat colour gives the same
//! whatever the jitter, because all filters interpolate differences. So R(t) = R(t−1): what is shown is shown already, and
//! H(t) = H(t−1) = H(t−2) is what the texture that frame t would write, which frame t−2 wrote, holds already. Nothing is
//! copied, and by induction a kept tile satisfies all this in the next frame as if it had been computed.
//!
//! A part of a flat surface that moves is kept too. Let a tile read settled history in frame t where colour over its
//! surroundings is one value c, all its vectors lead to tiles that were c in frame t−1, too, and the history of those is
//! what c is stored as, in every pixel, and so is the tile's own. A filter that interpolates differences then finds
//! the same bits wherever a vector leads, and if nothing else depends on the vector, the operands are those of every pixel
//! that ever reads settled history of c. So a tile that read it in frame t−1 and in frame t, and stored c itself in frame
//! t−1, has R(t) = R(t−1) and H(t) = H(t−1) = H(t−2) as before.

use super::{
    Carried, Recipe,
    changes::{TILE, flag, n_tiles},
    fault::planted,
    inputs::View,
    recipe::{Algorithm, HistoryFilter, InputFilter, Neighbourhood, Sharpen, Spatial, Weight},
    recorder::Recorder,
    skip::Skip,
    temporal::{Builder, Prefilter},
};
use crate::{
    gpu::{Gpu, GpuError, Pass, Readback},
    image::Extent,
    sequence::Sizes,
};
use wgpu::BufferUsages;

const CLASSIFY: &str = include_str!("../../shaders/taa/tiles/classify.wgsl");

/// What passes over listed tiles and over every pixel are compiled with.
pub const LISTED: &str = include_str!("../../shaders/taa/tiles/listed.wgsl");
pub const EVERY_PIXEL: &str = include_str!("../../shaders/taa/tiles/every_pixel.wgsl");

/// A combination of flags that no tile has.
const NO_TILE: u32 = !0;

/// The most workgroups along one axis of a dispatch.
const MAX_TILES: usize = 65535;

/// One recipe's lists and what they are made from.
#[derive(Debug)]
pub struct Tiles {
    classify: Pass,
    wanted: u32,
    wanted_of_carried: u32,
    /// What is known of each tile's history: `classify.wgsl` has the bits.
    notes: Carried<wgpu::Buffer>,
    /// The tiles that are not kept.
    listed: List,
    /// And those beside them.
    beside: List,
    n_tiles: usize,
}

/// Tiles in no order, and the dispatch over them.
#[derive(Debug)]
pub struct List {
    pub tiles: wgpu::Buffer,
    pub dispatch: wgpu::Buffer,
}

impl Recipe {
    /// Whether tiles of it can be kept: its state is history alone, and grids are one. A count of samples grows for ever.
    pub(super) fn keeps_tiles(&self, skip: Skip, sizes: Sizes) -> bool {
        skip == Skip::Exact
            && self.algorithm == Algorithm::Temporal
            // What is not finite is no multiple of its weight.
            && self.has_guards()
            && !(self.uses_history() && self.weight.counts())
            && self.spatial == Spatial::None
            && Prefilter::passes(self.history_filter).is_empty()
            && sizes == Sizes::native(sizes.render)
            && n_tiles(sizes.output) <= MAX_TILES
    }

    /// How far from a pixel the inputs lie that its resolve depends on, pixels.
    pub fn reach_px(&self) -> u32 {
        let of_box = match self.neighbourhood {
            // The run of texels that share a shift, too.
            Neighbourhood::Variance if self.prefilter_moments => self.variance_window,
            Neighbourhood::Variance => self.variance_window / 2,
            // The box's edges, their own box, and the kernel that finds them.
            Neighbourhood::Sobel => 3,
            _ => 1,
        };
        of_box + u32::from(self.unjitter_neighbourhood)
    }

    /// What a tile of a frame must have to be kept.
    fn wanted_flags(&self) -> u32 {
        let required = self.required_channels();
        let mut wanted = flag::SAME;
        if required.motion {
            wanted |= flag::STILL;
        }
        if self.reads_previous_depth() || required.object_id {
            wanted |= flag::SAME_BEFORE;
        }
        wanted
    }

    /// Whether it keeps parts of flat surfaces that move.
    pub(super) fn keeps_carried_tiles(&self) -> bool {
        self.wanted_flags_of_carried() != NO_TILE
    }

    /// What a tile must have to be kept as part of a flat surface that moves: nothing but where history is may depend on the
    /// vector, and the filter must find the same wherever that is.
    fn wanted_flags_of_carried(&self) -> u32 {
        let filter = matches!(
            self.history_filter,
            HistoryFilter::Texel | HistoryFilter::Bilinear | HistoryFilter::CatmullRom
        );
        let weight = matches!(self.weight, Weight::Fixed | Weight::LumaFeedback) && !self.motion_weight;
        let asks_the_past = self.reads_previous_depth() || self.reject_id || self.finds_edges();
        if !filter || !weight || asks_the_past || self.input_filter == InputFilter::Upsample {
            return NO_TILE;
        }
        flag::CARRIED | if self.motion_blur { flag::SLOW } else { 0 }
    }

    /// What a tile must have beside for the jitter not to matter; none where it always does.
    fn flags_without_jitter(&self) -> Option<u32> {
        let edges = if self.finds_edges() { flag::FLAT_DEPTH } else { 0 };
        (self.input_filter != InputFilter::Upsample).then_some(flag::FLAT | edges)
    }
}

impl Tiles {
    pub const PASS: &str = "classify";

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let Builder { gpu, recipe, .. } = builder;
        let sources = planted(builder.fault, Self::PASS, &[CLASSIFY])?;
        let lists_beside = f64::from(u8::from(recipe.sharpen != Sharpen::None));
        let classify = Pass::new(gpu, Self::PASS, &[&*sources[0]], &[("lists_beside", lists_beside)])?;
        let n_tiles = n_tiles(builder.sizes.output);
        let n_groups = (TILE * TILE).div_ceil(gpu.workgroup().n_invocations());
        gpu.scope("making room for tiles", || Self {
            classify,
            wanted: recipe.wanted_flags(),
            wanted_of_carried: recipe.wanted_flags_of_carried(),
            notes: Carried::of([0, 1].map(|_| words(gpu, "notes of tiles", n_tiles))),
            listed: List::new(gpu, n_tiles, n_groups),
            beside: List::new(gpu, n_tiles, n_groups),
            n_tiles,
        })
    }

    /// Records the lists of a frame.
    pub fn record(&mut self, recorder: &mut Recorder<'_>, view: View<'_>) -> Result<(), GpuError> {
        self.notes.advance();
        let repetition = view.repetition();
        let wanted = match (
            repetition.keeps,
            repetition.keeps_jitter,
            view.recipe().flags_without_jitter(),
        ) {
            (true, true, _) => self.wanted,
            (true, false, Some(flags)) => self.wanted | flags,
            _ => NO_TILE,
        };
        let carried = match repetition.keeps {
            true => self.wanted_of_carried,
            false => NO_TILE,
        };
        let Extent { width, height } = view.sizes().output;
        let size = Extent::new(width.div_ceil(TILE), height.div_ceil(TILE));
        let classify = self
            .classify
            .bind("frame_flags", repetition.flags)
            .bind("regions", repetition.regions)
            .bind("notes_before", self.notes.previous())
            .bind("notes", self.notes.current())
            .bind("dispatch", &self.listed.dispatch)
            .bind("listed_tiles", &self.listed.tiles)
            .bind("dispatch_beside", &self.beside.dispatch)
            .bind("listed_beside", &self.beside.tiles)
            .uniform(
                "wanted",
                &[
                    ("flags", wanted.into()),
                    ("carried", carried.into()),
                    ("size", [size.width, size.height].into()),
                ],
            )
            .over(recorder.gpu, size)?;
        recorder.record_counting(&classify, &[&self.listed.dispatch, &self.beside.dispatch])
    }

    pub fn notes(&self) -> &wgpu::Buffer {
        self.notes.current()
    }

    pub fn listed(&self) -> &List {
        &self.listed
    }

    pub fn beside(&self) -> &List {
        &self.beside
    }

    /// Copies how many tiles were listed, and which; see [`Kept`].
    pub fn copy_back(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, readback: &mut Readback) -> Kept {
        let count = readback.copy_buffer(gpu, encoder, &self.listed.dispatch, 4);
        let tiles = readback.copy_buffer(gpu, encoder, &self.listed.tiles, self.n_tiles as u64 * 4);
        Kept {
            count,
            tiles,
            n_tiles: self.n_tiles,
        }
    }
}

impl List {
    fn new(gpu: &Gpu, n_tiles: usize, n_groups: u32) -> Self {
        let list = Self {
            tiles: words(gpu, "listed tiles", n_tiles),
            dispatch: words(gpu, "dispatch", 3),
        };
        let empty = [0, n_groups, 1];
        gpu.queue.write_buffer(&list.dispatch, 0, bytemuck::cast_slice(&empty));
        list
    }
}

/// Where a frame's list is read back from.
#[derive(Debug)]
pub struct Kept {
    count: usize,
    tiles: usize,
    n_tiles: usize,
}

impl Kept {
    /// Which share of the tiles was kept, 0 to 1.
    pub fn share(&self, readback: &Readback) -> Result<f64, GpuError> {
        Ok(1.0 - self.n_listed(readback)? as f64 / self.n_tiles as f64)
    }

    fn n_listed(&self, readback: &Readback) -> Result<usize, GpuError> {
        let bytes = readback.bytes(self.count)?;
        Ok(u32::from_le_bytes(std::array::from_fn(|i| bytes[i])) as usize)
    }

    /// Whether each tile was kept, row by row of `columns` tiles.
    pub fn read(&self, readback: &Readback, columns: usize) -> Result<Vec<bool>, GpuError> {
        let word = |bytes: &[u8]| u32::from_le_bytes(std::array::from_fn(|i| bytes[i]));
        let mut kept = vec![true; self.n_tiles];
        for tile in readback
            .bytes(self.tiles)?
            .chunks_exact(4)
            .take(self.n_listed(readback)?)
        {
            let tile = word(tile) as usize;
            kept[(tile >> 16) * columns + (tile & 0xffff)] = false;
        }
        Ok(kept)
    }
}

fn words(gpu: &Gpu, label: &str, n: usize) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: n as u64 * 4,
        usage: BufferUsages::STORAGE | BufferUsages::INDIRECT | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
