//! The temporal pass (`shaders/taa/temporal`), and the passes before it that some of its blocks need.

mod chain;
mod moments;
mod prefilter;
mod quasi_cubic;

use super::{
    Carried, Fault, Precision, Recipe,
    changes::TILE,
    fault::planted,
    inputs::View,
    recipe::{Dilation, InputFilter, Neighbourhood, Sharpen},
    recorder::{Recorder, TiledPass},
    sobel2018::Edges,
    tiles::{self, Tiles},
};
use crate::{
    gpu::{Bound, Gpu, GpuError, Pass, Texture, Workgroup},
    image::Extent,
    sequence::Sizes,
};
use chain::{Chain, DIFFERENCE};
use moments::Moments;
pub use prefilter::Prefilter;
use wgpu::TextureFormat;

/// What every pass of a recipe is compiled with.
const SHARED: [&str; 17] = [
    include_str!("../../shaders/taa/temporal/recipe.wgsl"),
    include_str!("../../shaders/taa/temporal/reproject.wgsl"),
    include_str!("../../shaders/taa/temporal/filters.wgsl"),
    include_str!("../../shaders/taa/temporal/upsample.wgsl"),
    include_str!("../../shaders/taa/temporal/neighbourhood.wgsl"),
    include_str!("../../shaders/taa/temporal/weight.wgsl"),
    include_str!("../../shaders/taa/temporal/output.wgsl"),
    include_str!("../../shaders/taa/sobel2018/box.wgsl"),
    include_str!("../../shaders/taa/spatial/color.wgsl"),
    include_str!("../../shaders/taa/spatial/smaa_area.wgsl"),
    include_str!("../../shaders/taa/spatial/smaa_diagonals.wgsl"),
    include_str!("../../shaders/common/rectify.wgsl"),
    include_str!("../../shaders/common/sampling.wgsl"),
    include_str!("../../shaders/common/domain.wgsl"),
    include_str!("../../shaders/common/display.wgsl"),
    include_str!("../../shaders/common/roots.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];
const RESOLVE: &str = include_str!("../../shaders/taa/temporal/resolve.wgsl");
const SHARPEN: &str = include_str!("../../shaders/taa/temporal/sharpen.wgsl");
const NEAR_CACHED: &str = include_str!("../../shaders/taa/temporal/near_cached.wgsl");
const NEAR_ROWS: &str = include_str!("../../shaders/taa/temporal/near_rows.wgsl");
const NEAR_SHARED: &str = include_str!("../../shaders/taa/temporal/near_shared.wgsl");
const HISTORY_F16: &str = include_str!("../../shaders/taa/temporal/history_f16.wgsl");
const HISTORY_F32: &str = include_str!("../../shaders/taa/temporal/history_f32.wgsl");

/// What the passes of a recipe are made from.
#[derive(Clone, Copy, Debug)]
pub struct Builder<'a> {
    pub gpu: &'a Gpu,
    pub recipe: &'a Recipe,
    pub precision: Precision,
    pub sizes: Sizes,
    pub keeps_tiles: bool,
    pub fault: Option<Fault<'a>>,
}

impl Builder<'_> {
    /// Compiles a pass of the recipe; `overrides` are its own.
    pub fn pass(&self, name: &str, text: &str, overrides: &[(&str, f64)]) -> Result<Pass, GpuError> {
        self.compile(name, text, [tiles::EVERY_PIXEL, NEAR_CACHED], overrides)
    }

    /// Compiles a pass that runs over the tiles of a list.
    pub fn listed_pass(&self, name: &str, text: &str, overrides: &[(&str, f64)]) -> Result<Pass, GpuError> {
        self.compile(name, text, [tiles::LISTED, NEAR_CACHED], overrides)
    }

    /// Compiles a pass that may run over listed tiles where the recipe keeps others.
    pub fn tiled_pass(&self, name: &str, text: &str) -> Result<TiledPass, GpuError> {
        self.compile_tiled(name, text, [NEAR_CACHED; 2])
    }

    /// The same of a pass that gathers what lies beside its pixels before it looks at it.
    fn gathering_pass(&self, name: &str, text: &str) -> Result<TiledPass, GpuError> {
        let Workgroup { x, y } = self.gpu.workgroup();
        let near = |[width, height]: [u32; 2]| {
            // Not overrides: naga takes one array at most whose size depends on some.
            format!("const GROUP_WIDTH: u32 = {width}u;\nconst GROUP_HEIGHT: u32 = {height}u;\n{NEAR_SHARED}")
        };
        if !looks_one_texel_far(self.recipe) {
            return self.compile_tiled(name, text, [NEAR_CACHED; 2]);
        }
        if !self.gpu.uses_workgroup_memory() {
            return self.compile_tiled(name, text, [NEAR_ROWS; 2]);
        }
        // Tiles that follow one another in a list need not lie beside each other, and a piece of one must be whole rows.
        let listed = (x <= TILE && x * y >= TILE).then(|| near([TILE, x * y / TILE]));
        self.compile_tiled(name, text, [&near([x, y]), listed.as_deref().unwrap_or(NEAR_CACHED)])
    }

    /// `near` for every pixel, and for listed tiles.
    fn compile_tiled(&self, name: &str, text: &str, near: [&str; 2]) -> Result<TiledPass, GpuError> {
        let compile = |grid, near| self.compile(name, text, [grid, near], &[]);
        Ok(TiledPass {
            every_pixel: compile(tiles::EVERY_PIXEL, near[0])?,
            listed: self.keeps_tiles.then(|| compile(tiles::LISTED, near[1])).transpose()?,
            rows: tiles::rows(self.gpu),
        })
    }

    /// `grid` says which pixels there are and how what lies beside them is read.
    fn compile(&self, name: &str, text: &str, grid: [&str; 2], overrides: &[(&str, f64)]) -> Result<Pass, GpuError> {
        let store = match self.precision {
            Precision::F16 => HISTORY_F16,
            Precision::F32 => HISTORY_F32,
        };
        let rows = tiles::rows_wgsl(self.gpu);
        let shared = SHARED.into_iter().chain([store, &rows]);
        let sources: Vec<_> = [text].into_iter().chain(shared).chain(grid).collect();
        let sources = planted(self.fault, name, &sources)?;
        let sources: Vec<_> = sources.iter().map(|source| &**source).collect();
        let overrides = [&self.recipe.overrides(), overrides].concat();
        Pass::new(self.gpu, name, &sources, &overrides)
    }

    /// The format of a colour's history.
    pub fn history_format(&self) -> TextureFormat {
        match self.precision {
            Precision::F16 => TextureFormat::Rgba16Float,
            Precision::F32 => TextureFormat::Rgba32Float,
        }
    }

    /// A 32-bit colour image.
    pub fn color(&self, label: &str, extent: Extent) -> Texture {
        Texture::new(self.gpu, label, extent, TextureFormat::Rgba32Float)
    }
}

/// The passes of a temporal recipe and what they keep.
#[derive(Debug)]
pub struct Temporal {
    prefilter: Option<Prefilter>,
    difference: Option<Chain>,
    moments: Option<Moments>,
    edges: Option<Edges>,
    tiles: Option<Tiles>,
    resolve: TiledPass,
    /// And the resolved image it reads, in the working domain.
    sharpen: Option<(TiledPass, Texture)>,
    history: Carried,
    n_samples: Carried,
    /// Bound where a recipe does not read what another would.
    nothing: Texture,
}

impl Temporal {
    /// The names of the passes, in the order recorded.
    pub fn passes(recipe: &Recipe) -> Vec<&'static str> {
        let mut passes = Prefilter::passes(recipe.history_filter);
        if recipe.finds_differences() {
            passes.extend(chain::names(DIFFERENCE));
        }
        if needs_moments(recipe) {
            passes.extend(Moments::PASSES);
        }
        if recipe.finds_edges() {
            passes.extend(Edges::PASSES);
        }
        passes.push("resolve");
        if recipe.sharpen != Sharpen::None {
            passes.push("sharpen");
        }
        passes
    }

    pub fn new(builder: Builder<'_>) -> Result<Self, GpuError> {
        let Builder { gpu, recipe, .. } = builder;
        let extent = builder.sizes.output;
        let prefilter = Prefilter::new(builder)?;
        let difference = recipe
            .finds_differences()
            .then(|| Chain::new(builder, DIFFERENCE, builder.sizes.render))
            .transpose()?;
        let moments = needs_moments(recipe).then(|| Moments::new(builder)).transpose()?;
        let edges = recipe.finds_edges().then(|| Edges::new(builder)).transpose()?;
        let tiles = builder.keeps_tiles.then(|| Tiles::new(builder)).transpose()?;
        let resolve = builder.gathering_pass("resolve", RESOLVE)?;
        let sharpen = (recipe.sharpen != Sharpen::None)
            .then(|| builder.tiled_pass("sharpen", SHARPEN))
            .transpose()?;
        let unused = Extent::new(1, 1);
        let counted = if recipe.weight.counts() { extent } else { unused };
        // What is stored beyond a texture's edge is dropped.
        let kept = if recipe.uses_history() { extent } else { unused };
        gpu.scope("making room for history", || Self {
            prefilter,
            difference,
            moments,
            edges,
            tiles,
            resolve,
            sharpen: sharpen.map(|pass| (pass, builder.color("resolved", extent))),
            history: Carried::new(gpu, "history", kept, builder.history_format()),
            n_samples: Carried::new(gpu, "samples", counted, TextureFormat::R32Float),
            nothing: Texture::new(gpu, "nothing", unused, TextureFormat::Rgba32Float),
        })
    }

    /// Records the frame's passes; the last writes `shown`.
    pub fn record(&mut self, recorder: &mut Recorder<'_>, view: View<'_>, shown: &Texture) -> Result<(), GpuError> {
        self.history.advance();
        self.n_samples.advance();
        if let Some(tiles) = &mut self.tiles {
            tiles.classify(recorder, view)?;
        }
        let tiles = self.tiles.as_ref();
        let history = self.history.previous();
        let nothing = &self.nothing;
        if let Some(prefilter) = &self.prefilter {
            prefilter.record(recorder, view, history)?;
        }
        let prefiltered = self.prefilter.as_ref().map_or(nothing, Prefilter::prefiltered);
        if let Some(difference) = &self.difference {
            difference.record(recorder, view, &[("history", history), ("prefiltered", prefiltered)])?;
        }
        if let Some(moments) = &self.moments {
            moments.record(recorder, view)?;
        }
        if let Some(edges) = &mut self.edges {
            edges.record(recorder, view, tiles)?;
        }
        let extent = view.sizes().output;
        recorder.record_tiled(&self.resolve, tiles.map(Tiles::computed), extent, &[], |pass| {
            view.bind_to(pass)
                .bind("history", history)
                .bind("prefiltered", prefiltered)
                .bind("next_history", self.history.current())
                .bind("n_samples", self.n_samples.previous())
                .bind("next_n_samples", self.n_samples.current())
                .bind("difference_rows", self.difference.as_ref().map_or(nothing, Chain::made))
                .bind("window_means", self.moments.as_ref().map_or(nothing, Moments::means))
                .bind(
                    "window_variances",
                    self.moments.as_ref().map_or(nothing, Moments::variances),
                )
                .bind("stable_edges", self.edges.as_ref().map_or(nothing, Edges::stable))
                .bind("shown", self.sharpen.as_ref().map_or(shown, |(_, resolved)| resolved))
        })?;
        if let Some((sharpen, resolved)) = &self.sharpen {
            recorder.record_tiled(sharpen, tiles.map(Tiles::beside), extent, &[], |pass| {
                let bound = match view.recipe().motion_blur {
                    true => view.bind_to(pass),
                    false => view.bind_no_image_to(pass),
                };
                bound.bind("resolved", resolved).bind("shown", shown)
            })?;
        }
        let Some(tiles) = tiles else { return Ok(()) };
        let edges = self.edges.as_ref().map_or([nothing; 2], Edges::histories);
        tiles.settle(recorder, view, [history, self.history.current()], edges)
    }

    /// What it leaves to the next frame.
    pub fn kept(&self) -> Vec<(&'static str, Bound<'_>)> {
        let mut kept: Vec<(&'static str, Bound<'_>)> = vec![
            ("history", self.history.current().into()),
            ("samples", self.n_samples.current().into()),
        ];
        if let Some(edges) = &self.edges {
            kept.push(("edge history", edges.kept().into()));
        }
        kept
    }
}

impl Temporal {
    /// The lists of tiles, where any is kept.
    pub fn tiles(&self) -> Option<&Tiles> {
        self.tiles.as_ref()
    }
}

/// Whether the resolve reads colour, depth or motion beside a pixel, and nowhere else.
fn looks_one_texel_far(recipe: &Recipe) -> bool {
    let by_box = match recipe.neighbourhood {
        _ if recipe.unjitter_neighbourhood => None,
        Neighbourhood::None => Some(false),
        Neighbourhood::Cross | Neighbourhood::Box3 | Neighbourhood::Rounded => Some(true),
        Neighbourhood::Variance => (recipe.variance_window == 3 && !recipe.prefilter_moments).then_some(true),
        Neighbourhood::Sobel | Neighbourhood::Shrunk => None,
    };
    let by_filter = match recipe.input_filter {
        InputFilter::Texel | InputFilter::Unjitter => Some(false),
        InputFilter::BlackmanHarris => Some(true),
        InputFilter::Upsample => None,
    };
    let looks = |by_box, by_filter| by_box || by_filter || recipe.dilation != Dilation::None;
    by_box
        .zip(by_filter)
        .is_some_and(|(by_box, by_filter)| looks(by_box, by_filter))
}

fn needs_moments(recipe: &Recipe) -> bool {
    recipe.uses_history() && recipe.prefilter_moments
}
