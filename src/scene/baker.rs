//! One frame of a bake at a time, in memory.

use super::{
    BakeError, BakeSettings,
    disocclusion::Disocclusion,
    model::Alpha,
    moment::Clip,
    reference::{Accumulator, Mean, NoiseSums, half_views},
    renderer::{PreparedFrame, Renderer, SurfaceTarget, View},
};
use crate::{
    gpu::{Gpu, GpuError, ReadbackPool},
    image::{Extent, Image},
    metrics::{Display, display::Tonemap},
    random::Random,
    sequence::{Frame, Merging, Others, frame::Rgb, manifest::NoiseFloor},
};
use std::{
    ops::AddAssign,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

/// A frame as it was rendered, in canonical form.
#[derive(Clone, Debug)]
pub struct BakedFrame {
    /// Position in the sequence, from 0.
    pub index: usize,
    /// Another shot begins here.
    pub reset: bool,
    /// Texel `(x, y)` holds the scene at `(x + 0.5 + jitter_px[0], y + 0.5 + jitter_px[1])`; y down.
    pub jitter_px: [f64; 2],
    /// The camera, without jitter.
    pub camera: Clip,
    /// How its linear colour is shown.
    pub display: Display,
    /// Linear RGB; of the first sample where a pixel has several, as are depth and motion.
    pub color: Image<Rgb>,
    /// Linear RGB without jitter, the mean of as many samples.
    pub unjittered_color: Image<Rgb>,
    /// Unlit colour.
    pub albedo: Image<Rgb>,
    /// Linear view depth; sky is 1e10.
    pub depth: Image<f32>,
    /// Pixels, current to previous, y down, without jitter.
    pub motion_px: Image<[f32; 2]>,
    /// 0 is the sky.
    pub object_id: Image<u32>,
    /// Where something without motion vectors lies on top, or a surface asks for it.
    pub reactive: Image<f32>,
    /// Ground truth averaged in linear light; of the output's size.
    pub reference: Option<Image<Rgb>>,
    /// The same averaged in Karis's c / (1 + luma).
    pub reference_karis: Option<Image<Rgb>>,
    /// Where it was asked for: 1 where the surface was hidden or outside in the frame before, 0 where it was seen, 0.5 at
    /// an edge.
    pub disoccluded: Option<Image<f32>>,
    /// Colour, depth and motion of the other samples.
    pub others: Option<Others>,
}

impl BakedFrame {
    /// As the loader would give it.
    pub fn into_frame(self) -> Frame {
        Frame {
            index: self.index,
            reset: self.reset,
            jitter_px: self.jitter_px,
            far: f64::INFINITY,
            display: self.display,
            output_size: self.reference.as_ref().map_or(self.color.extent(), Image::extent),
            parity: None,
            color: self.color,
            depth: Some(self.depth),
            motion_px: Some(self.motion_px),
            object_id: Some(self.object_id),
            albedo: Some(self.albedo),
            reactive: Some(self.reactive),
            unjittered_color: Some(self.unjittered_color),
            reference: self.reference,
            others: self.others,
        }
    }
}

/// Where a bake's time went, summed over the threads that work at once.
#[derive(Clone, Copy, Debug, Default)]
pub struct BakeTimes {
    /// Preparing and drawing, until the device was done.
    pub raster: Duration,
    /// Copying back, converting, and measuring the noise.
    pub readback: Duration,
    /// Encoding and writing files.
    pub write: Duration,
}

impl AddAssign for BakeTimes {
    fn add_assign(&mut self, other: Self) {
        self.raster += other.raster;
        self.readback += other.readback;
        self.write += other.write;
    }
}

/// Renders the frames of a sequence.
pub struct Baker {
    gpu: Gpu,
    settings: BakeSettings,
    renderer: Renderer,
    surface: SurfaceTarget,
    /// For what has no jitter.
    input: Accumulator,
    reference: Option<Accumulator>,
    /// Of a CPU adapter: what renders the other half of a reference meanwhile, on a device of its own. One device leaves the
    /// cores idle while it prepares its triangles.
    beside: Option<Arc<(Renderer, Accumulator)>>,
    disocclusion: Option<Disocclusion>,
    /// Of a scene at rest: what every frame's would be, but for its noise.
    rested: Option<[Option<Image<Rgb>>; 2]>,
    noise: NoiseSums,
    pool: ReadbackPool,
    times: BakeTimes,
}

/// Offsets of four samples around the jitter: a grid turned by arctan ½, as multisampling hardware has it.
const ROTATED_GRID: [[f64; 2]; 4] = [[-0.125, -0.375], [0.375, -0.125], [-0.375, 0.125], [0.125, 0.375]];

impl Baker {
    /// Builds the scene and uploads it.
    ///
    /// # Errors
    /// As [`BakeSettings::validate`], and what the device says.
    pub fn new(gpu: &Gpu, settings: &BakeSettings) -> Result<Self, BakeError> {
        settings.validate()?;
        settings.validate_on(gpu)?;
        let scene = settings.build()?;
        let blends = scene.materials.iter().any(|material| material.alpha == Alpha::Blended);
        if blends && !gpu.can_blend_f32() {
            return Err(BakeError::Gpu(GpuError::Unsupported {
                adapter: gpu.info().name,
                message: format!("cannot blend 32-bit floats, which scene `{}` needs", settings.scene),
            }));
        }
        let referenced = settings.reference_samples > 0;
        let sum = |gpu: &Gpu| {
            Accumulator::new(
                gpu,
                settings.output_size,
                settings.reference_fineness(gpu),
                settings.karis,
            )
        };
        let beside = |gpu: &Gpu| -> Result<_, GpuError> {
            let gpu = gpu.second()?;
            let renderer = Renderer::new(&gpu, Arc::clone(&scene), settings.texturing())?;
            Ok(Arc::new((renderer, sum(&gpu)?)))
        };
        Ok(Self {
            gpu: gpu.clone(),
            reference: referenced.then(|| sum(gpu)).transpose()?,
            beside: (referenced && gpu.is_cpu()).then(|| beside(gpu)).transpose()?,
            renderer: Renderer::new(gpu, scene, settings.texturing())?,
            surface: SurfaceTarget::new(gpu, settings.render_size),
            input: Accumulator::new(gpu, settings.render_size, 1, false)?,
            disocclusion: settings
                .disocclusion
                .then(|| Disocclusion::new(gpu, settings.render_size))
                .transpose()?,
            rested: None,
            noise: NoiseSums::default(),
            pool: ReadbackPool::default(),
            times: BakeTimes::default(),
            settings: settings.clone(),
        })
    }

    /// How linear colour is shown.
    pub fn display(&self) -> Display {
        Display {
            exposure: self.renderer.scene.exposure,
            tonemap: Tonemap::Aces,
        }
    }

    /// Nearest distance that is drawn.
    pub fn near(&self) -> f64 {
        self.renderer.scene.near
    }

    /// How noisy the references made so far are; none without references.
    pub fn noise_floor(&self) -> Option<NoiseFloor> {
        self.reference.as_ref().map(|_| self.noise.floor())
    }

    /// Where time went so far; nothing was written here.
    pub fn times(&self) -> BakeTimes {
        self.times
    }

    /// Renders frame `index`.
    pub fn frame(&mut self, index: usize) -> Result<BakedFrame, BakeError> {
        let settings = &self.settings.clone();
        let seed = Random::new(settings.seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)).bits();
        let is_wanted = self.reference.is_some() && self.rested.is_none();
        let views = &[1, 2].map(|which| {
            let seed = Random::new(seed.wrapping_add(which)).bits();
            let fineness = settings.reference_fineness(&self.gpu);
            half_views(settings.reference_pattern, settings.reference_samples, fineness, seed)
        });
        let beside = self.beside.clone().filter(|_| is_wanted);
        let (mut baked, halves) = thread::scope(|scope| {
            // Before all else, so that it goes on while the inputs are drawn and read back.
            let second = beside.as_deref().map(|(renderer, sum)| {
                scope.spawn(move || mean_of(renderer, sum, &prepare(settings, renderer, index)?, &views[1]))
            });
            let frame = prepare(settings, &self.renderer, index)?;
            let baked = self.inputs(&frame, index, seed)?;
            let half = |which: usize| {
                let sum = self.reference.as_ref().filter(|_| is_wanted);
                let half = sum.map(|sum| mean_of(&self.renderer, sum, &frame, &views[which]));
                half.transpose()
            };
            let first = half(0)?;
            let second = match second {
                Some(thread) => Some(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?),
                None => half(1)?,
            };
            Ok::<_, BakeError>((baked, first.zip(second).map(|(a, b)| [a, b])))
        })?;
        if let Some(halves) = halves {
            let reference = self.reference_of(halves);
            if settings.at_rest {
                self.rested = Some(reference.clone());
            }
            [baked.reference, baked.reference_karis] = reference;
        } else if let Some(rested) = &self.rested {
            [baked.reference, baked.reference_karis] = rested.clone();
        }
        Ok(baked)
    }

    /// All but the reference.
    fn inputs(&mut self, frame: &PreparedFrame, index: usize, seed: u64) -> Result<BakedFrame, BakeError> {
        let begin = Instant::now();
        let (n_samples, jitter) = (self.settings.samples, self.settings.jitter);
        let jitter_px = jitter.offset_px(index).map(|j| j * self.settings.jitter_scale);
        let view = |jitter_px, salt: u32| View {
            jitter_px,
            seed: (seed >> 32) as u32 ^ salt,
            fineness: 1,
        };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.renderer
            .draw_surface(&mut encoder, frame, view(jitter_px, 0), &self.surface)?;
        if let Some(disocclusion) = &self.disocclusion {
            disocclusion.record(&self.gpu, &mut encoder, &self.renderer, frame, &self.surface, jitter_px)?;
        }
        let submission = self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait(submission)?;
        self.times.raster += begin.elapsed();
        let mut baked = self.read_surface(index, jitter_px, frame)?;
        let around = |center_px: [f64; 2], salts: std::iter::StepBy<std::ops::RangeFrom<u32>>| -> Vec<View> {
            let offsets = if n_samples > 1 { &ROTATED_GRID[..] } else { &[[0.0; 2]] };
            let views = offsets.iter().zip(salts);
            views
                .map(|(offset, salt)| view([center_px[0] + offset[0], center_px[1] + offset[1]], salt))
                .collect()
        };
        let (mean, times) = mean_of(&self.renderer, &self.input, frame, &around([0.0; 2], (1..).step_by(16)))?;
        self.times += times;
        baked.unjittered_color = mean.linear;
        if n_samples > 1 {
            self.add_samples(frame, &around(jitter_px, (2..).step_by(1)), &mut baked)?;
        }
        Ok(baked)
    }

    /// Puts the first of several samples in the place of the one at the jitter, and the others beside it.
    fn add_samples(&mut self, frame: &PreparedFrame, views: &[View], baked: &mut BakedFrame) -> Result<(), BakeError> {
        let mut others = Others {
            merging: Merging::Samples,
            color: Vec::new(),
            opacity: Vec::new(),
            motion_px: Vec::new(),
            depth: Vec::new(),
        };
        for (item, view) in views.iter().enumerate() {
            let begin = Instant::now();
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            self.renderer.draw_surface(&mut encoder, frame, *view, &self.surface)?;
            let submission = self.gpu.queue.submit([encoder.finish()]);
            self.gpu.wait(submission)?;
            self.times.raster += begin.elapsed();
            let sample = self.read_surface(baked.index, view.jitter_px, frame)?;
            if item == 0 {
                (baked.color, baked.depth, baked.motion_px) = (sample.color, sample.depth, sample.motion_px);
            } else {
                others.color.push(sample.color);
                others.depth.push(sample.depth);
                others.motion_px.push(sample.motion_px);
            }
        }
        baked.others = Some(others);
        Ok(())
    }

    /// In linear light, and where asked for in Karis's space, of two halves.
    fn reference_of(&mut self, halves: [(Mean, BakeTimes); 2]) -> [Option<Image<Rgb>>; 2] {
        let begin = Instant::now();
        let [a, b] = halves.map(|(half, times)| {
            self.times += times;
            half
        });
        self.noise.add([&a.linear, &b.linear], self.display());
        let linear = mean(&a.linear, &b.linear);
        let karis = a.karis.zip(b.karis).map(|(a, b)| mean_karis(&a, &b));
        self.times.readback += begin.elapsed();
        [Some(linear), karis]
    }

    fn read_surface(
        &mut self,
        index: usize,
        jitter_px: [f64; 2],
        frame: &PreparedFrame,
    ) -> Result<BakedFrame, BakeError> {
        let begin = Instant::now();
        let extent = self.settings.render_size;
        let mut readback = self.pool.begin();
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let slots = self
            .surface
            .images
            .each_ref()
            .map(|image| readback.copy_texture(&self.gpu, &mut encoder, image));
        let mask = self
            .disocclusion
            .as_ref()
            .map(|pass| readback.copy_texture(&self.gpu, &mut encoder, pass.mask()));
        let submission = self.gpu.queue.submit([encoder.finish()]);
        readback.map();
        self.gpu.wait(submission)?;
        let geometry: Vec<[f32; 4]> = readback.texels(slots[1], extent)?;
        let color = readback.rgb(slots[0], extent)?;
        let ids = readback.texels(slots[2], extent)?;
        let disoccluded = mask.map(|slot| readback.texels(slot, extent)).transpose()?;
        let baked = BakedFrame {
            index,
            reset: index == 0 || !self.settings.at_rest && self.renderer.scene.cuts.contains(&index),
            jitter_px,
            camera: frame.moment.camera,
            display: self.display(),
            unjittered_color: color.clone(),
            color,
            albedo: readback.rgb(slots[3], extent)?,
            depth: plane(extent, &geometry, |texel| texel[2]),
            motion_px: plane(extent, &geometry, |texel| [texel[0], texel[1]]),
            object_id: Image::from_pixels(extent, ids),
            reactive: plane(extent, &geometry, |texel| texel[3]),
            reference: None,
            reference_karis: None,
            disoccluded: disoccluded.map(|mask| Image::from_pixels(extent, mask)),
            others: None,
        };
        self.times.readback += begin.elapsed();
        Ok(baked)
    }
}

/// Uploads frame `index` to a renderer.
fn prepare(settings: &BakeSettings, renderer: &Renderer, index: usize) -> Result<PreparedFrame, GpuError> {
    let output = settings.output_size;
    let aspect = f64::from(output.width) / f64::from(output.height);
    let times = match settings.at_rest {
        true => [0.0; 2],
        false => [index as f64, index as f64 - 1.0],
    };
    renderer.prepare(times, settings.render_size, aspect)
}

/// The mean of some views of a frame.
fn mean_of(
    renderer: &Renderer,
    sum: &Accumulator,
    frame: &PreparedFrame,
    views: &[View],
) -> Result<(Mean, BakeTimes), GpuError> {
    let begin = Instant::now();
    sum.accumulate(renderer, frame, views)?;
    let drawn = Instant::now();
    let mean = sum.read()?;
    let times = BakeTimes {
        raster: drawn - begin,
        readback: drawn.elapsed(),
        write: Duration::ZERO,
    };
    Ok((mean, times))
}

fn plane<T: Copy + Send + Sync>(extent: Extent, texels: &[[f32; 4]], of: impl Fn([f32; 4]) -> T) -> Image<T> {
    Image::from_pixels(extent, texels.iter().map(|texel| of(*texel)).collect())
}

fn mean(a: &Image<Rgb>, b: &Image<Rgb>) -> Image<Rgb> {
    Image::from_fn(a.extent(), |x, y| {
        let (a, b) = (a.at(x, y), b.at(x, y));
        std::array::from_fn(|i| 0.5 * (a[i] + b[i]))
    })
}

/// The mean of two means in Karis's space.
fn mean_karis(a: &Image<Rgb>, b: &Image<Rgb>) -> Image<Rgb> {
    let luma = |c: Rgb| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    Image::from_fn(a.extent(), |x, y| {
        let [a, b] = [a.at(x, y), b.at(x, y)].map(|c| c.map(|v| v / (1.0 + luma(c))));
        let t: Rgb = std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
        t.map(|v| v / (1.0 - luma(t)).max(f32::EPSILON))
    })
}
