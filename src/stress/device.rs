//! A recipe on the adapter, with everything that it shows and keeps read back.

use super::scenario::{Segment, as_loaded};
use crate::{
    gpu::{Floats, Gpu, GpuError, Readback, ReadbackPool, Timer},
    image::Image,
    sequence::{Channels, Frame, Sizes, frame::Rgb},
    taa::{Fault, Inputs, Options, Precision, Recipe, Repeat, Resolver, Skip},
};
use std::collections::BTreeSet;

/// What one frame left on the adapter.
#[derive(Clone, Debug, PartialEq)]
pub struct Left {
    /// Linear RGB.
    pub shown: Image<Rgb>,
    /// By name; what is called so in [`Resolver::kept`].
    pub kept: Vec<(&'static str, Vec<f32>)>,
}

impl Left {
    /// Whether both have the same bits. NaN is like NaN.
    pub fn has_the_bits_of(&self, other: &Self) -> bool {
        let bits = |left: &Self| {
            let shown = left.shown.pixels().iter().flatten();
            let kept = left.kept.iter().flat_map(|(_, values)| values);
            shown.chain(kept).map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        bits(self) == bits(other)
    }

    /// Whether what is kept is equal, whatever is shown.
    pub fn keeps_the_bits_of(&self, other: &Self) -> bool {
        let bits = |left: &Self| {
            let kept = left.kept.iter().flat_map(|(_, values)| values);
            kept.map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        bits(self) == bits(other)
    }
}

/// Why a cell did not end.
#[derive(Debug)]
pub enum CellError {
    Gpu(GpuError),
    Cancelled,
}

impl From<GpuError> for CellError {
    fn from(error: GpuError) -> Self {
        Self::Gpu(error)
    }
}

/// A recipe on an adapter.
#[derive(Clone, Copy)]
pub struct Device<'a> {
    pub gpu: &'a Gpu,
    pub recipe: &'a Recipe,
    pub precision: Precision,
    pub skip: Skip,
    pub fault: Option<Fault<'a>>,
    pub is_cancelled: &'a (dyn Fn() -> bool + Sync),
}

/// Frames on their way at once.
const BATCH: usize = 32;

impl Device<'_> {
    /// An error where the run is to end. Asked between frames: a cell takes up to a minute.
    pub fn go_on(&self) -> Result<(), CellError> {
        match (self.is_cancelled)() {
            true => Err(CellError::Cancelled),
            false => Ok(()),
        }
    }

    /// Resolves all frames of a segment, which `frame` may replace.
    pub fn resolve(&self, segment: &Segment, frame: impl Fn(usize) -> Frame) -> Result<Vec<Left>, CellError> {
        let gpu = self.gpu;
        let mut inputs = self.inputs(segment)?;
        let mut resolver = self.resolver(segment.sizes)?;
        let pool = ReadbackPool::default();
        let mut all = Vec::with_capacity(segment.n_frames);
        let indices: Vec<_> = (0..segment.n_frames).collect();
        for batch in indices.chunks(BATCH) {
            let mut on_their_way = Vec::with_capacity(batch.len());
            for &index in batch {
                self.go_on()?;
                inputs.upload(gpu, &as_loaded(frame(index), self.recipe))?;
                let mut encoder = self.encoder();
                let mut timer = Timer::new(gpu, 0);
                inputs.prepare(gpu, &mut encoder, &mut timer, Repeat::Timed(1))?;
                resolver.resolve(gpu, &mut encoder, &inputs, &mut timer, Repeat::Timed(1))?;
                let copy = OnItsWay::record(gpu, &pool, &mut encoder, &resolver);
                let submission = gpu.scope("submitting a frame", || gpu.queue.submit([encoder.finish()]))?;
                copy.readback.map();
                on_their_way.push((copy, submission));
            }
            for (copy, submission) in on_their_way {
                gpu.wait(submission)?;
                all.push(copy.read(&resolver)?);
            }
            if segment.has_settled(all.len(), |a, b| all[a].keeps_the_bits_of(&all[b])) {
                break;
            }
        }
        for index in all.len()..segment.n_frames {
            all.push(all[index - 2].clone());
        }
        Ok(all)
    }

    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.gpu.device.create_command_encoder(&Default::default())
    }

    pub fn resolver(&self, sizes: Sizes) -> Result<Resolver, GpuError> {
        let options = Options {
            precision: self.precision,
            skip: self.skip,
        };
        Resolver::with_fault(self.gpu, self.recipe.clone(), options, sizes, self.fault)
    }

    /// Room for a frame of a segment with all that the recipe may read.
    pub fn inputs(&self, segment: &Segment) -> Result<Inputs, GpuError> {
        let optional = self.recipe.optional_channels();
        let channels = self.recipe.required_channels().union(Channels {
            albedo: optional.albedo,
            object_id: optional.object_id,
            several: (segment.frames)(0).several(),
            ..Channels::default()
        });
        let wanted = BTreeSet::from([self.recipe.preparation()]);
        let reach_px = (self.skip != Skip::Off).then(|| self.recipe.reach_px());
        Inputs::tracking(self.gpu, segment.sizes, channels, &wanted, reach_px, self.fault)
    }
}

/// Everything that a frame left, on its way to the host.
pub struct OnItsWay {
    pub readback: Readback,
    shown: Floats,
    kept: Vec<(&'static str, Floats)>,
}

impl OnItsWay {
    pub fn record(gpu: &Gpu, pool: &ReadbackPool, encoder: &mut wgpu::CommandEncoder, resolver: &Resolver) -> Self {
        let mut readback = pool.begin();
        let shown = readback.copy_floats(gpu, encoder, resolver.shown().into());
        let kept = resolver.kept().into_iter();
        let kept = kept.map(|(name, what)| (name, readback.copy_floats(gpu, encoder, what)));
        let kept = kept.collect();
        Self { readback, shown, kept }
    }

    /// Once its submission is done.
    pub fn read(&self, resolver: &Resolver) -> Result<Left, GpuError> {
        let shown = self.readback.values(self.shown)?;
        let pixels = shown.chunks_exact(4).map(|rgba| [rgba[0], rgba[1], rgba[2]]).collect();
        let kept = self.kept.iter();
        Ok(Left {
            shown: Image::from_pixels(resolver.shown().extent(), pixels),
            kept: kept
                .map(|(name, at)| Ok((*name, self.readback.values(*at)?)))
                .collect::<Result<_, GpuError>>()?,
        })
    }
}
