//! A frame on the device. Uploaded once, whatever the number of recipes; colour is repaired and mapped into each
//! working domain once, too.

use super::{
    Carried, Fault, Preparation, Recipe, Source,
    changes::{Changes, flag, n_tiles},
    fault::planted,
    merge::Merge,
    recipe::{Guards, InputFilter},
    recorder::{Cover, Recorder, Repeat, TiledPass},
    tiles::{self, List, MAX_TILES},
};
use crate::{
    gpu::{Gpu, GpuError, Invocation, Pass, Texture, Timer, UniformValue},
    image::Extent,
    metrics::Display,
    sequence::{Channels, Frame, Sizes},
};
use std::collections::{BTreeMap, BTreeSet};
use wgpu::TextureFormat;

/// The current frame's images.
#[derive(Debug)]
pub struct Inputs {
    sizes: Sizes,
    has_history: bool,
    jitter_px: [f64; 2],
    far: f32,
    parity: u32,
    display: Display,
    color: Texture,
    albedo: Texture,
    unjittered_color: Option<Texture>,
    /// One texel where no recipe reads it, so that every pipeline has something to bind.
    depth: Carried,
    object_id: Carried,
    motion: Texture,
    reactive: Texture,
    tracked: Option<Tracked>,
    /// Where pixels have several samples or layers.
    merge: Option<Merge>,
    prepared: BTreeMap<Preparation, Prepared>,
    /// Bound where a recipe does not read what another would.
    nothing: Texture,
    no_ids: Texture,
}

/// What is known of how the frame repeats the one before.
#[derive(Debug)]
struct Tracked {
    changes: Changes,
    /// The tiles whose images changed within the reach of any recipe.
    changed: List,
    /// Their share of all.
    changed_share: f64,
    /// The changes' flags of every tile.
    flags: wgpu::Buffer,
    /// Their regions.
    regions: wgpu::Buffer,
    is_repeat: bool,
    was_repeat: bool,
    keeps: bool,
    keeps_jitter: bool,
}

/// How the frame repeats the one before, for [`super::tiles`].
#[derive(Clone, Copy, Debug)]
pub struct Repetition<'a> {
    /// Flags of every tile; see [`super::changes::flag`].
    pub flags: &'a wgpu::Buffer,
    /// And their regions.
    pub regions: &'a wgpu::Buffer,
    /// The same on the host.
    pub changes: &'a Changes,
    /// Both frames have history, and all else that passes are told of a frame is the same, jitter aside.
    pub keeps: bool,
    /// Jitter, too.
    pub keeps_jitter: bool,
}

/// A frame as the passes of one recipe see it.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    inputs: &'a Inputs,
    recipe: &'a Recipe,
    /// In the recipe's domain.
    color: &'a Texture,
}

/// A colour in a working domain.
#[derive(Debug)]
struct Prepared {
    /// Over the tiles that changed, where changes are tracked.
    pass: TiledPass,
    color: Texture,
    repaired_texels: wgpu::Buffer,
}

const PREPARE: &str = include_str!("../../shaders/taa/temporal/prepare.wgsl");
/// What it is compiled with.
const SHARED: [&str; 4] = [
    include_str!("../../shaders/common/domain.wgsl"),
    include_str!("../../shaders/common/display.wgsl"),
    include_str!("../../shaders/common/roots.wgsl"),
    include_str!("../../shaders/common/color.wgsl"),
];
/// The share of tiles above which a pass so short is faster over every pixel than over a list, on CPU adapters.
const WORTH_LISTING: f64 = 0.7;

impl Inputs {
    /// Room for frames of `sizes` with `channels`, prepared for each of `wanted`.
    pub fn new(gpu: &Gpu, sizes: Sizes, channels: Channels, wanted: &BTreeSet<Preparation>) -> Result<Self, GpuError> {
        Self::tracking(gpu, sizes, channels, wanted, None, None)
    }

    /// The same. With `reach_px`, every frame is compared with the one before, so that recipes that look that far
    /// ([`Recipe::reach_px`]) may skip what repeats; with `fault`, there is a mistake in `merge` or `prepare`.
    pub fn tracking(
        gpu: &Gpu,
        sizes: Sizes,
        channels: Channels,
        wanted: &BTreeSet<Preparation>,
        reach_px: Option<u32>,
        fault: Option<Fault<'_>>,
    ) -> Result<Self, GpuError> {
        let extent = sizes.render;
        let tracks = reach_px.is_some();
        let prepared = wanted
            .iter()
            .map(|&key| Ok((key, Prepared::new(gpu, extent, key, channels, tracks, fault)?)))
            .collect::<Result<_, GpuError>>()?;
        let tracked = reach_px
            .map(|reach_px| Tracked::new(gpu, extent, channels, reach_px))
            .transpose()?;
        let merge = channels
            .several
            .map(|several| Merge::new(gpu, extent, several, channels, fault))
            .transpose()?;
        // Passes cannot write two channels.
        let motion_format = match merge {
            Some(_) => TextureFormat::Rgba32Float,
            None => TextureFormat::Rg32Float,
        };
        gpu.scope("making room for a frame", || {
            let texture = |label, format| Texture::new(gpu, label, extent, format);
            let if_read = |read, label, format| {
                let extent = if read { extent } else { Extent::new(1, 1) };
                Texture::new(gpu, label, extent, format)
            };
            let carried = |read, label, format| {
                let extent = if read { extent } else { Extent::new(1, 1) };
                Carried::new(gpu, label, extent, format)
            };
            Self {
                sizes,
                has_history: false,
                jitter_px: [0.0; 2],
                far: 1.0,
                parity: 0,
                display: Display::default(),
                color: texture("color", TextureFormat::Rgba32Float),
                unjittered_color: channels
                    .unjittered_color
                    .then(|| texture("unjittered color", TextureFormat::Rgba32Float)),
                depth: carried(channels.depth, "depth", TextureFormat::R32Float),
                object_id: carried(channels.object_id, "object id", TextureFormat::R32Uint),
                motion: if_read(channels.motion, "motion", motion_format),
                reactive: if_read(channels.reactive, "reactive mask", TextureFormat::R32Float),
                albedo: if_read(channels.albedo, "albedo", TextureFormat::Rgba32Float),
                tracked,
                merge,
                prepared,
                nothing: Texture::new(gpu, "nothing", Extent::new(1, 1), TextureFormat::Rgba32Float),
                no_ids: Texture::new(gpu, "no ids", Extent::new(1, 1), TextureFormat::R32Uint),
            }
        })
    }

    /// Uploads `frame`, which must have the channels that were asked for.
    pub fn upload(&mut self, gpu: &Gpu, frame: &Frame) -> Result<(), GpuError> {
        self.track(gpu, frame);
        self.has_history = frame.index > 0 && !frame.reset;
        self.jitter_px = frame.jitter_px;
        self.far = frame.finite_far() as f32;
        self.parity = frame.parity.unwrap_or_default();
        self.display = frame.display;
        // Depth and object ids alternate between two textures: a repeat finds its own there only if the frame before was one.
        let (is_repeat, is_second) = self.tracked.as_ref().map_or((false, false), |tracked| {
            (tracked.is_repeat, tracked.is_repeat && tracked.was_repeat)
        });
        gpu.scope("uploading a frame", || {
            self.depth.advance();
            self.object_id.advance();
            if !is_second {
                self.upload_carried(gpu, frame);
            }
            if !is_repeat {
                self.upload_current(gpu, frame);
            }
        })
    }

    /// Compares `frame` with the one before.
    fn track(&mut self, gpu: &Gpu, frame: &Frame) {
        let Some(tracked) = &mut self.tracked else { return };
        let has_history = frame.index > 0 && !frame.reset;
        // Which pixels are shaded matters to `checkerboard` alone, which keeps none.
        let is_told_the_same = (self.far, self.display) == (frame.finite_far() as f32, frame.display);
        tracked.changes.see(frame);
        tracked.list_changed(gpu, is_told_the_same);
        gpu.queue
            .write_buffer(&tracked.flags, 0, bytemuck::cast_slice(tracked.changes.tiles()));
        gpu.queue
            .write_buffer(&tracked.regions, 0, bytemuck::cast_slice(tracked.changes.regions()));
        tracked.was_repeat = tracked.is_repeat;
        tracked.is_repeat = tracked.changes.is_repeat() && self.display == frame.display;
        tracked.keeps = has_history && self.has_history && is_told_the_same;
        tracked.keeps_jitter = self.jitter_px == frame.jitter_px;
    }

    fn upload_carried(&self, gpu: &Gpu, frame: &Frame) {
        if let Some(depth) = frame.depth.as_ref().filter(|_| self.is_uploaded(self.depth.current())) {
            self.depth.current().write_scalar(gpu, depth);
        }
        let ids = frame.object_id.as_ref();
        if let Some(ids) = ids.filter(|_| self.is_read(self.object_id.current())) {
            self.object_id.current().write_u32(gpu, ids);
        }
    }

    fn upload_current(&self, gpu: &Gpu, frame: &Frame) {
        match &self.merge {
            Some(merge) => merge.upload(gpu, frame),
            None => self.color.write_rgb(gpu, &frame.color),
        }
        if let (Some(texture), Some(image)) = (&self.unjittered_color, &frame.unjittered_color) {
            texture.write_rgb(gpu, image);
        }
        if let Some(albedo) = frame.albedo.as_ref().filter(|_| self.is_read(&self.albedo)) {
            self.albedo.write_rgb(gpu, albedo);
        }
        if let Some(motion) = frame.motion_px.as_ref().filter(|_| self.is_uploaded(&self.motion)) {
            self.motion.write_vec2(gpu, motion);
        }
        if let Some(reactive) = frame.reactive.as_ref().filter(|_| self.is_read(&self.reactive)) {
            self.reactive.write_scalar(gpu, reactive);
        }
    }

    fn is_read(&self, texture: &Texture) -> bool {
        texture.extent() == self.sizes.render
    }

    /// Merging writes colour, depth and motion where there is something to merge.
    fn is_uploaded(&self, texture: &Texture) -> bool {
        self.is_read(texture) && self.merge.is_none()
    }

    /// Whether everything that depends on the frame's images alone is there already.
    fn is_repeat(&self) -> bool {
        self.tracked.as_ref().is_some_and(|tracked| tracked.is_repeat)
    }

    /// Which share of the tiles has images that changed.
    pub fn changed_share(&self) -> f64 {
        self.tracked.as_ref().map_or(1.0, |tracked| tracked.changed_share)
    }

    /// Records the preparation of every colour wanted, in their order, as often as `repeat` says.
    pub fn prepare(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        repeat: Repeat,
    ) -> Result<(), GpuError> {
        let mut recorder = Recorder {
            gpu,
            encoder,
            timer,
            repeat,
            watch: None,
        };
        self.record(&mut recorder)
    }

    /// Records the merging of samples or layers, if there are any, and the preparation of every colour wanted, in their order.
    pub fn record(&self, recorder: &mut Recorder<'_>) -> Result<(), GpuError> {
        if let Some(merge) = &self.merge {
            let merge = merge.dispatch(recorder.gpu, &self.color, &self.motion, self.depth.current())?;
            recorder.record(&merge)?;
        }
        let changed = self.changed();
        for (preparation, prepared) in &self.prepared {
            let counters = [&prepared.repaired_texels];
            recorder.record_tiled(&prepared.pass, changed, self.sizes.render, &counters, |pass| {
                pass.bind("input_color", self.color_of(preparation.source))
                    .bind("input_albedo", &self.albedo)
                    .bind("color", &prepared.color)
                    .bind("repaired_texels", &prepared.repaired_texels)
                    .uniform("display", &self.display_fields())
            })?;
        }
        Ok(())
    }

    /// The tiles whose images changed, where changes are tracked: all that passes over images alone must run over.
    fn changed(&self) -> Option<Cover<'_>> {
        self.tracked.as_ref().map(|tracked| Cover {
            list: &tracked.changed,
            is_worth_listing: tracked.changed_share < WORTH_LISTING && n_tiles(self.sizes.render) <= MAX_TILES,
        })
    }

    /// The count of hostile texels that preparing a colour repaired: one `u32`.
    pub fn repaired_texels(&self, preparation: Preparation) -> &wgpu::Buffer {
        &self.prepared[&preparation].repaired_texels
    }

    /// The frame as the passes of `recipe` see it.
    pub(super) fn view<'a>(&'a self, recipe: &'a Recipe) -> View<'a> {
        View {
            inputs: self,
            recipe,
            color: &self.prepared[&recipe.preparation()].color,
        }
    }

    fn display_fields(&self) -> [(&'static str, UniformValue); 2] {
        [
            ("exposure", (self.display.exposure as f32).into()),
            ("tonemap", (self.display.tonemap as u32).into()),
        ]
    }

    fn color_of(&self, source: Source) -> &Texture {
        match (source, &self.unjittered_color) {
            (Source::UnjitteredIfPresent, Some(texture)) => texture,
            _ => &self.color,
        }
    }
}

impl<'a> View<'a> {
    /// The same frame with another colour, in the same domain.
    pub fn with_color(self, color: &'a Texture) -> Self {
        Self { color, ..self }
    }

    /// Whether the frame's images are those of the frame before.
    pub fn is_repeat(self) -> bool {
        self.inputs.is_repeat()
    }

    /// The tiles whose images changed within the recipe's reach, and maybe others, where changes are tracked.
    pub fn changed(self) -> Option<Cover<'a>> {
        self.inputs.changed()
    }

    /// How the frame repeats the one before.
    ///
    /// # Panics
    /// Where changes are not tracked.
    pub fn repetition(self) -> Repetition<'a> {
        let tracked = self.inputs.tracked.as_ref();
        let tracked = tracked.expect("a recipe that skips comes with tracked inputs");
        Repetition {
            flags: &tracked.flags,
            regions: &tracked.regions,
            changes: &tracked.changes,
            keeps: tracked.keeps,
            keeps_jitter: tracked.keeps_jitter,
        }
    }

    pub fn sizes(self) -> Sizes {
        self.inputs.sizes
    }

    pub fn recipe(self) -> &'a Recipe {
        self.recipe
    }

    /// Starts an invocation of a recipe's pass by binding what every such pass may read
    /// (`shaders/taa/temporal/recipe.wgsl`).
    pub fn bind_to(self, pass: &'a Pass) -> Invocation<'a> {
        let inputs = self.inputs;
        // Shaders name more images than a recipe's pipeline reads.
        let reads = self.recipe.required_channels().union(self.recipe.optional_channels());
        let if_read = |is_read: bool, image: &'a Texture| if is_read { image } else { &inputs.nothing };
        let ids_if = |is_read: bool, image: &'a Texture| if is_read { image } else { &inputs.no_ids };
        self.bind_frame_to(pass)
            .offer("color", self.color)
            .offer("depth", if_read(reads.depth, inputs.depth.current()))
            .offer(
                "previous_depth",
                if_read(self.recipe.reads_previous_depth(), inputs.depth.previous()),
            )
            .offer("object_id", ids_if(reads.object_id, inputs.object_id.current()))
            .offer(
                "previous_object_id",
                ids_if(self.recipe.reject_id, inputs.object_id.previous()),
            )
            .offer("motion", if_read(reads.motion, &inputs.motion))
            .offer("reactive_mask", if_read(reads.reactive, &inputs.reactive))
    }

    /// The same for a pass that looks at none of the frame's images.
    pub fn bind_no_image_to(self, pass: &'a Pass) -> Invocation<'a> {
        let Inputs { nothing, no_ids, .. } = self.inputs;
        let images = ["color", "depth", "previous_depth", "motion", "reactive_mask"];
        let ids = ["object_id", "previous_object_id"];
        let bound = self.bind_frame_to(pass);
        let bound = images.iter().fold(bound, |bound, name| bound.offer(name, nothing));
        ids.iter().fold(bound, |bound, name| bound.offer(name, no_ids))
    }

    fn bind_frame_to(self, pass: &'a Pass) -> Invocation<'a> {
        let inputs = self.inputs;
        let [x, y] = inputs.jitter_px;
        let Extent { width, height } = inputs.sizes.output;
        pass.start()
            .offer_uniform("display", &inputs.display_fields())
            .offer_uniform(
                "frame",
                &[
                    ("input_weights_x", InputFilter::axis_weights(x).map(|w| w as f32).into()),
                    ("input_weights_y", InputFilter::axis_weights(y).map(|w| w as f32).into()),
                    ("jitter_px", [x as f32, y as f32].into()),
                    ("has_history", u32::from(inputs.has_history).into()),
                    ("far", inputs.far.into()),
                    ("parity", inputs.parity.into()),
                    ("output_size", [width as f32, height as f32].into()),
                ],
            )
    }
}

impl Tracked {
    /// Nothing seen yet.
    fn new(gpu: &Gpu, extent: Extent, channels: Channels, reach_px: u32) -> Result<Self, GpuError> {
        let buffer = |label, n_words: usize| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: 4 * n_words as u64,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let n_tiles = n_tiles(extent);
        gpu.scope("making room for tiles", || {
            let [changed] = List::several(gpu, n_tiles);
            Self {
                changes: Changes::new(extent, channels, reach_px),
                changed,
                changed_share: 1.0,
                flags: buffer("flags of tiles", n_tiles),
                regions: buffer("regions of tiles", 2 * n_tiles),
                is_repeat: false,
                was_repeat: false,
                keeps: false,
                keeps_jitter: false,
            }
        })
    }

    /// Lists the tiles that changed; all, unless passes are told the same of both frames.
    fn list_changed(&mut self, gpu: &Gpu, is_told_the_same: bool) {
        let changed: Vec<_> = self
            .changes
            .tiles_without(if is_told_the_same { flag::SAME | flag::SOUND } else { !0 })
            .collect();
        self.changed_share = changed.len() as f64 / self.changes.tiles().len() as f64;
        self.changed.write(gpu, changed.into_iter());
    }
}

impl Prepared {
    fn new(
        gpu: &Gpu,
        extent: Extent,
        key: Preparation,
        channels: Channels,
        tracks: bool,
        fault: Option<Fault<'_>>,
    ) -> Result<Self, GpuError> {
        let overrides = [
            ("domain", f64::from(key.domain as u32)),
            ("with_albedo", f64::from(u8::from(key.albedo && channels.albedo))),
            ("guards", f64::from(u8::from(key.guards == Guards::On))),
        ];
        let rows = tiles::rows_wgsl(gpu);
        let pass = |grid: &'static str| {
            let sources: Vec<_> = [PREPARE]
                .into_iter()
                .chain(SHARED)
                .chain([grid, rows.as_str()])
                .collect();
            let sources = planted(fault, "prepare", &sources)?;
            let sources: Vec<_> = sources.iter().map(|source| &**source).collect();
            Pass::new(gpu, "prepare", &sources, &overrides)
        };
        let pass = TiledPass {
            every_pixel: pass(tiles::EVERY_PIXEL)?,
            listed: tracks.then(|| pass(tiles::LISTED)).transpose()?,
            rows: tiles::rows(gpu),
        };
        gpu.scope("making room for a colour", || Self {
            pass,
            color: Texture::new(gpu, "prepared color", extent, TextureFormat::Rgba32Float),
            repaired_texels: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("repaired texels"),
                size: 4,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
        })
    }
}

impl InputFilter {
    /// Weights of the samples at -1, 0 and 1 along one axis, where all are shifted by `jitter_px`. The kernel
    /// `exp(-2.29 d²)` is the product of its axes, and so is its normalisation.
    fn axis_weights(jitter_px: f64) -> [f64; 3] {
        let weights = [-1.0, 0.0, 1.0].map(|offset: f64| {
            let d = offset + jitter_px;
            libm::exp(-2.29 * d * d)
        });
        let sum: f64 = weights.iter().sum();
        weights.map(|weight| weight / sum)
    }
}
