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
//!
//! What a frame stored is looked up after it (`settle.wgsl`), where a tile may be kept in the next frame at all: H(t) is that
//! frame's H(t−1). A tile that was not looked at counts as one that changed.

use super::{
    Carried, Recipe,
    changes::{TILE, flag, n_tiles},
    fault::planted,
    inputs::View,
    recipe::{Algorithm, HistoryFilter, InputFilter, Neighbourhood, Sharpen, Spatial, Weight},
    recorder::{Cover, Recorder},
    skip::Skip,
    temporal::{Builder, Prefilter},
};
use crate::{
    gpu::{Gpu, GpuError, Pass, Readback, Texture, Workgroup},
    image::{Extent, Image},
    sequence::Sizes,
};
use wgpu::BufferUsages;

/// The pass before a recipe's own that lists their tiles.
pub const CLASSIFY_PASS: &str = "classify";
/// The pass after them that notes what they left.
pub const SETTLE_PASS: &str = "settle";

const CLASSIFY: &str = include_str!("../../shaders/taa/tiles/classify.wgsl");
const SETTLE: &str = include_str!("../../shaders/taa/tiles/settle.wgsl");

/// What passes over listed tiles and over every pixel are compiled with.
pub const LISTED: &str = include_str!("../../shaders/taa/tiles/listed.wgsl");
pub const EVERY_PIXEL: &str = include_str!("../../shaders/taa/tiles/every_pixel.wgsl");

/// How many pixels of a column an invocation of such passes takes. On a CPU adapter two: what lies beside both is then read once, and
/// of a list a tile's place once for both.
pub fn rows(gpu: &Gpu) -> u32 {
    let workgroup = gpu.workgroup();
    let of_span = tiles_a_span(workgroup) * TILE * TILE;
    match !gpu.uses_workgroup_memory() && of_span.is_multiple_of(2 * workgroup.n_invocations()) {
        true => 2,
        false => 1,
    }
}

/// The same for WGSL: not an override, on which the size of an array may not depend.
pub fn rows_wgsl(gpu: &Gpu) -> String {
    format!("const ROWS: u32 = {}u;", rows(gpu))
}

/// A combination of flags that no tile has.
const NO_TILE: u32 = !0;

/// The most workgroups along one axis of a dispatch.
pub const MAX_TILES: usize = 65535;

/// Words of a list's head: workgroups a span, spans, 1, tiles. The first three are a dispatch.
const HEAD: usize = 4;

/// How many tiles of a list stand in a row of its texture.
const LIST_WIDTH: u32 = 256;

/// Which of a recipe's lists has which head.
const COMPUTED: usize = 0;
const HOPEFUL: usize = 2;

/// One recipe's lists and what they are made from.
#[derive(Debug)]
pub struct Tiles {
    classify: Pass,
    /// Where there is a history to look at.
    settle: Option<Pass>,
    wanted: u32,
    wanted_of_carried: u32,
    /// What is known of each tile's history: `classify.wgsl` has the bits.
    notes: Carried<wgpu::Buffer>,
    /// The tiles that are not kept.
    computed: List,
    /// And those beside them.
    beside: List,
    /// Those of the computed ones that may be kept in the next frame.
    hopeful: List,
    /// Whether this frame's passes run over the lists, or over every pixel.
    is_worth_listing: bool,
    n_tiles: usize,
}

/// Tiles in no order, and the dispatch over them: see `shaders/taa/tiles/listed.wgsl`.
#[derive(Debug)]
pub struct List {
    /// With those of others.
    heads: wgpu::Buffer,
    /// Where its own begins.
    offset: u64,
    tiles: Texture,
    /// Of the passes that it is for, and how many pixels an invocation of theirs takes.
    workgroup: Workgroup,
    rows: u32,
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

    /// The share of tiles of which the host must know that they may be kept for a frame's lists to be worth reading. On a CPU
    /// adapter that costs as much as a fifth of a resolve which looks at no neighbours.
    fn share_worth_listing(&self) -> f64 {
        match self.neighbourhood {
            Neighbourhood::None => 0.2,
            _ => 1.0 / 16.0,
        }
    }

    /// What a tile of a frame must have for it to be worth knowing what that frame left in it: as the next frame's flags will be
    /// where it repeats this one, and its jitter, too, if this one's is that of the frame before.
    fn hopeful_flags(&self, keeps_jitter: bool) -> [u32; 2] {
        let still = self.wanted_flags() & flag::STILL;
        let rests = match (keeps_jitter, self.flags_without_jitter()) {
            (true, _) => still,
            (false, Some(flags)) => still | flags,
            (false, None) => NO_TILE,
        };
        [
            rests,
            if self.keeps_carried_tiles() {
                flag::FLAT
            } else {
                NO_TILE
            },
        ]
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
    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let Builder { gpu, recipe, .. } = builder;
        let flag = |is_set| f64::from(u8::from(is_set));
        let sources = planted(builder.fault, CLASSIFY_PASS, &[CLASSIFY])?;
        let lists_beside = [("lists_beside", flag(recipe.sharpen != Sharpen::None))];
        let classify = Pass::new(gpu, CLASSIFY_PASS, &[&*sources[0], &rows_wgsl(gpu)], &lists_beside)?;
        let settles = [
            ("notes_settled", flag(recipe.keeps_carried_tiles())),
            ("keeps_edges", flag(recipe.finds_edges())),
        ];
        let settle = recipe
            .uses_history()
            .then(|| builder.listed_pass(SETTLE_PASS, SETTLE, &settles))
            .transpose()?;
        let n_tiles = n_tiles(builder.sizes.output);
        gpu.scope("making room for tiles", || {
            let [computed, beside, hopeful] = List::several(gpu, n_tiles);
            Self {
                classify,
                settle,
                wanted: recipe.wanted_flags(),
                wanted_of_carried: recipe.wanted_flags_of_carried(),
                notes: Carried::of([0, 1].map(|_| words(gpu, "notes of tiles", n_tiles))),
                computed,
                beside,
                hopeful,
                is_worth_listing: false,
                n_tiles,
            }
        })
    }

    /// Records the lists of a frame, before its other passes.
    pub fn classify(&mut self, recorder: &mut Recorder<'_>, view: View<'_>) -> Result<(), GpuError> {
        self.notes.advance();
        let repetition = view.repetition();
        let resting = match (repetition.keeps_jitter, view.recipe().flags_without_jitter()) {
            (true, _) => self.wanted,
            (false, Some(flags)) => self.wanted | flags,
            (false, None) => NO_TILE,
        };
        let wanted = [resting, self.wanted_of_carried];
        let is_worth_listing = |wanted| repetition.changes.share_with(wanted) >= view.recipe().share_worth_listing();
        self.is_worth_listing = repetition.keeps && is_worth_listing(wanted);
        // What every pixel is computed of is not kept.
        let [resting, carried] = if self.is_worth_listing { wanted } else { [NO_TILE; 2] };
        // What is shown without a history leaves nothing to be looked at.
        let hopeful = match self.settle {
            Some(_) => view.recipe().hopeful_flags(repetition.keeps_jitter),
            None => [0, 0],
        };
        let hopeful = if is_worth_listing(hopeful) {
            hopeful
        } else {
            [NO_TILE; 2]
        };
        let Extent { width, height } = view.sizes().output;
        let size = Extent::new(width.div_ceil(TILE), height.div_ceil(TILE));
        let classify = self
            .classify
            .bind("frame_flags", repetition.flags)
            .bind("regions", repetition.regions)
            .bind("notes_before", self.notes.previous())
            .bind("notes", self.notes.current())
            .bind("heads", &self.computed.heads)
            .bind("computed", &self.computed.tiles)
            .bind("beside", &self.beside.tiles)
            .bind("hopeful", &self.hopeful.tiles)
            .uniform(
                "wanted",
                &[
                    ("flags", resting.into()),
                    ("carried", carried.into()),
                    ("hopeful", hopeful.into()),
                    ("size", [size.width, size.height].into()),
                ],
            )
            .over(recorder.gpu, size)?;
        recorder.record_counting(&classify, &[&self.computed.heads])
    }

    /// Records what is noted of the frame for the next one, after its other passes; `history` and `edges` before and after them.
    pub fn settle(
        &self,
        recorder: &mut Recorder<'_>,
        view: View<'_>,
        history: [&Texture; 2],
        edges: [&Texture; 2],
    ) -> Result<(), GpuError> {
        let Some(settle) = &self.settle else { return Ok(()) };
        let settle = view
            .bind_to(settle)
            .bind("history", history[0])
            .bind("stored", history[1])
            .bind("edge_history", edges[0])
            .bind("stored_edges", edges[1])
            .bind("notes", self.notes.current());
        recorder.record_listed(settle, &self.hopeful, &[])
    }

    /// The tiles that a pass must run over.
    pub fn computed(&self) -> Cover<'_> {
        self.cover(&self.computed)
    }

    /// Those that a pass which looks at its neighbours' results must.
    pub fn beside(&self) -> Cover<'_> {
        self.cover(&self.beside)
    }

    fn cover<'a>(&self, list: &'a List) -> Cover<'a> {
        Cover {
            list,
            is_worth_listing: self.is_worth_listing,
        }
    }

    /// Copies which tiles were computed.
    pub fn copy_back(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, readback: &mut Readback) -> Kept {
        Kept {
            shares: self.copy_shares(gpu, encoder, readback),
            computed: readback.copy_texture(gpu, encoder, &self.computed.tiles),
            extent: self.computed.tiles.extent(),
        }
    }

    /// Copies how many tiles were computed, and how many of those were looked at afterwards.
    pub fn copy_shares(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, readback: &mut Readback) -> Shares {
        Shares {
            heads: readback.copy_buffer(gpu, encoder, &self.computed.heads, self.computed.heads.size()),
            n_tiles: self.n_tiles,
        }
    }
}

impl List {
    /// Empty ones with room for `n_tiles` each, whose heads are one after the other in one buffer.
    pub fn several<const N: usize>(gpu: &Gpu, n_tiles: usize) -> [Self; N] {
        let workgroup = gpu.workgroup();
        let n_places = (n_tiles as u32).next_multiple_of(tiles_a_span(workgroup));
        let extent = Extent::new(LIST_WIDTH, n_places.div_ceil(LIST_WIDTH));
        let heads = words(gpu, "dispatches over tiles", N * HEAD);
        std::array::from_fn(|index| Self {
            heads: heads.clone(),
            offset: (4 * HEAD * index) as u64,
            tiles: Texture::new(gpu, "listed tiles", extent, wgpu::TextureFormat::R32Uint),
            workgroup,
            rows: rows(gpu),
        })
    }

    /// Makes it a list of `tiles`, column and row each.
    pub fn write(&self, gpu: &Gpu, tiles: impl Iterator<Item = [u32; 2]>) {
        let mut places: Vec<u32> = tiles.map(|[x, y]| (x | y << 16) + 1).collect();
        let (n_tiles, tiles_a_span) = (places.len() as u32, tiles_a_span(self.workgroup));
        let workgroups_a_span = tiles_a_span * TILE * TILE / (self.workgroup.n_invocations() * self.rows);
        let head = [workgroups_a_span, n_tiles.div_ceil(tiles_a_span), 1, n_tiles];
        gpu.queue
            .write_buffer(&self.heads, self.offset, bytemuck::cast_slice(&head));
        places.resize(self.tiles.extent().n_pixels(), 0);
        self.tiles
            .write_u32(gpu, &Image::from_pixels(self.tiles.extent(), places));
    }

    /// Whether it is for a pass, whose invocations take `rows` pixels: one with other workgroups would read it otherwise.
    pub fn fits(&self, pass: &Pass, rows: u32) -> bool {
        (pass.workgroup(), rows) == (self.workgroup, self.rows)
    }

    /// What listed.wgsl reads.
    pub fn tiles(&self) -> &Texture {
        &self.tiles
    }

    /// The dispatch over it: in which buffer, and where.
    pub fn dispatch(&self) -> (&wgpu::Buffer, u64) {
        (&self.heads, self.offset)
    }
}

/// How many tiles a workgroup covers, or a part of.
fn tiles_a_span(workgroup: Workgroup) -> u32 {
    (workgroup.x / TILE).max(1)
}

/// Where the heads of a frame's lists are read back from.
#[derive(Debug)]
pub struct Shares {
    heads: usize,
    n_tiles: usize,
}

impl Shares {
    /// Which share of the tiles was kept, 0 to 1.
    pub fn kept(&self, readback: &Readback) -> Result<f64, GpuError> {
        Ok(1.0 - self.n_listed(readback, COMPUTED)? as f64 / self.n_tiles as f64)
    }

    /// Which share of the tiles was looked at after the frame, 0 to 1.
    pub fn settled(&self, readback: &Readback) -> Result<f64, GpuError> {
        Ok(self.n_listed(readback, HOPEFUL)? as f64 / self.n_tiles as f64)
    }

    /// How many tiles a list has.
    fn n_listed(&self, readback: &Readback, list: usize) -> Result<usize, GpuError> {
        let heads = readback.bytes(self.heads)?;
        let n_tiles = &heads[4 * (list * HEAD + HEAD - 1)..];
        Ok(bytemuck::pod_read_unaligned::<u32>(&n_tiles[..4]) as usize)
    }
}

/// Where it is read back from which tiles of a frame were kept.
#[derive(Debug)]
pub struct Kept {
    shares: Shares,
    computed: usize,
    extent: Extent,
}

impl Kept {
    /// Whether each tile was kept, row by row of `columns` tiles.
    pub fn read(&self, readback: &Readback, columns: usize) -> Result<Vec<bool>, GpuError> {
        let n_computed = self.shares.n_listed(readback, COMPUTED)?;
        let computed: Vec<u32> = readback.texels(self.computed, self.extent)?;
        let mut kept = vec![true; self.shares.n_tiles];
        for place in &computed[..n_computed] {
            let [x, y] = [(place - 1) & 0xffff, (place - 1) >> 16];
            kept[y as usize * columns + x as usize] = false;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaders_have_the_same_numbers() {
        for (text, name, number) in [
            (CLASSIFY, "TILE", TILE),
            (LISTED, "TILE", TILE),
            (CLASSIFY, "LIST_WIDTH", LIST_WIDTH),
            (LISTED, "LIST_WIDTH", LIST_WIDTH),
            (CLASSIFY, "HEAD", HEAD as u32),
            (CLASSIFY, "COMPUTED", COMPUTED as u32),
            (CLASSIFY, "HOPEFUL", HOPEFUL as u32),
        ] {
            assert!(text.contains(&format!("const {name}: u32 = {number}u;")), "{name}");
        }
    }
}
