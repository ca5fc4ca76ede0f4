//! What several subjects share: one GPU a process, made-up frames, and a resolver run to images.

pub mod agreement;
pub mod browser;
pub mod service;

use afterimage::{
    gpu::{Gpu, ReadbackPool, Texture, Timer, Variant},
    image::{Extent, Image},
    metrics::{
        Better, Display, FrameScores, LateValue, Mask, Metric, MetricError, Picture, Reference, Tonemap,
        gpu::{DeviceTrack, GpuMetrics, Recording, ScoredFrame},
    },
    sequence::{Channels, Frame, frame::Rgb},
    taa::{Inputs, Options, Precision, Recipe, Repeat, Resolver, Skip},
};
use std::{
    collections::BTreeSet,
    sync::{Arc, OnceLock},
};

/// The adapter every test shares (lavapipe keeps what a closed device held). None at all is a failure.
pub fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Gpu::open(None).expect("an adapter; on a bare machine install Mesa's lavapipe"))
}

/// A small generator of repeatable noise in 0..1.
pub fn noise(x: u32, y: u32, seed: u32) -> f32 {
    let mut h = x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ seed.wrapping_mul(0xc2b2_ae35);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    ((h ^ (h >> 15)) >> 8) as f32 / 16_777_216.0
}

/// Frame `index` of a scene that has everything a resolve must cope with: texture, a bright lamp, an object that moves
/// in front, fractional and fast motion, motion that leaves the image, a reset at frame 20, and hostile texels, vectors
/// and depths in every fifth frame.
pub fn frame(extent: Extent, index: usize) -> Frame {
    let t = index as f32;
    let halton = |base: u32| {
        let (mut i, mut f, mut r) = (index as u32 % 16 + 1, 1.0, 0.0);
        while i > 0 {
            f /= f64::from(base);
            r += f * f64::from(i % base);
            i /= base;
        }
        r - 0.5
    };
    let on_box = move |x: u32, y: u32| {
        let cx = 3.0 + 0.7 * t % extent.width as f32;
        (x as f32 - cx).abs() < 4.0 && y % 16 < 9
    };
    let hostile = move |x: u32, y: u32| index % 5 == 4 && noise(x, y, 77) < 0.01;
    let color = Image::from_fn(extent, |x, y| {
        if hostile(x, y) {
            return [f32::NAN, f32::INFINITY, -1.0];
        }
        if on_box(x, y) {
            return [0.8, 0.1 + 0.2 * noise(x, y, index as u32), 0.05];
        }
        let lamp = if (x / 8 + y / 8) % 7 == 3 { 40.0 } else { 1.0 };
        let stripes = 0.5 + 0.5 * libm::sinf((x as f32 + 0.37 * t) * 1.9 + y as f32 * 0.8);
        [
            lamp * stripes,
            0.3 * noise(x, y, 1) + 0.1,
            0.2 + 0.1 * noise(x, y, index as u32 + 9),
        ]
    });
    let depth = Image::from_fn(extent, |x, y| match (hostile(x, y), on_box(x, y)) {
        (true, _) => f32::NAN,
        (_, true) => 2.0,
        _ if y % 13 == 0 => 1e10,
        _ => 5.0 + 0.1 * noise(x, y, 3),
    });
    let motion = Image::from_fn(extent, |x, y| match (hostile(x, y), on_box(x, y)) {
        (true, _) => [f32::INFINITY, f32::NAN],
        (_, true) => [-0.7, 0.0],
        _ if x % 17 == 5 => [18.25, -3.5],
        _ => [0.37, 0.11 * noise(x, y, 4)],
    });
    let object_id = Image::from_fn(extent, |x, y| 1 + u32::from(on_box(x, y)) + (x + index as u32) / 24 * 2);
    let albedo = Image::from_fn(extent, |x, y| {
        match (index % 7 == 3 && noise(x, y, 78) < 0.01, on_box(x, y)) {
            (true, _) => [0.5, f32::NAN, -0.5],
            (_, true) => [0.9, 0.2, 0.1],
            _ => [0.5 * noise(x / 4, y / 4, 6); 3],
        }
    });
    let reactive = Image::from_fn(extent, |x, y| match (hostile(x, y), noise(x / 3, y / 3, 5)) {
        (true, _) => f32::NAN,
        (_, mask) => 4.0 * mask - 3.0,
    });
    Frame {
        index,
        reset: index == 20,
        jitter_px: [halton(2), halton(3)],
        far: 100.0,
        display: Display {
            exposure: 0.75,
            tonemap: Tonemap::ReinhardMax,
        },
        output_size: extent,
        parity: Some(index as u32 % 2),
        color,
        depth: Some(depth),
        motion_px: Some(motion),
        object_id: Some(object_id),
        albedo: Some(albedo),
        reactive: Some(reactive),
        unjittered_color: None,
        reference: None,
        others: None,
    }
}

/// Resolves `frames` on the GPU; the shown image and the number of repaired texels of each.
pub fn resolve_on_gpu(
    recipe: &Recipe,
    precision: Precision,
    frames: impl Iterator<Item = Frame>,
) -> Vec<(Image<Rgb>, u64)> {
    let resolved = resolve_skipping(recipe, precision.into(), frames).into_iter();
    resolved.map(|(image, n_repaired, _)| (image, n_repaired)).collect()
}

/// As [`resolve_on_gpu`], and the share of each frame's tiles that was kept.
pub fn resolve_skipping(
    recipe: &Recipe,
    options: Options,
    frames: impl Iterator<Item = Frame>,
) -> Vec<(Image<Rgb>, u64, f64)> {
    resolve_with(gpu(), recipe, options, frames)
}

/// As [`resolve_skipping`], with passes compiled as `gpu` has it.
pub fn resolve_with(
    gpu: &Gpu,
    recipe: &Recipe,
    options: Options,
    frames: impl Iterator<Item = Frame>,
) -> Vec<(Image<Rgb>, u64, f64)> {
    resolve_between(gpu, gpu, recipe, options, frames)
}

/// The same, with the passes that prepare frames compiled as `preparing` has it.
pub fn resolve_between(
    preparing: &Gpu,
    gpu: &Gpu,
    recipe: &Recipe,
    options: Options,
    frames: impl Iterator<Item = Frame>,
) -> Vec<(Image<Rgb>, u64, f64)> {
    let pool = ReadbackPool::default();
    let mut frames = frames.peekable();
    let first = frames.peek().expect("a frame");
    let (sizes, optional) = (first.sizes(), recipe.optional_channels());
    let channels = recipe.required_channels().union(Channels {
        albedo: optional.albedo && first.albedo.is_some(),
        object_id: optional.object_id && first.object_id.is_some(),
        several: first.several(),
        ..Channels::default()
    });
    let wanted = BTreeSet::from([recipe.preparation()]);
    let n_merges = usize::from(channels.several.is_some());
    let reach_px = (options.skip != Skip::Off).then(|| recipe.reach_px());
    let mut inputs = Inputs::tracking(preparing, sizes, channels, &wanted, reach_px, None).unwrap();
    let mut resolver = Resolver::new(gpu, recipe.clone(), options, sizes).unwrap();
    let passes = recipe.passes_skipping(options.skip, sizes);
    let mut timer = Timer::new(gpu, 2 + passes.len() as u32);
    frames
        .map(|frame| {
            inputs.upload(gpu, &frame).unwrap();
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            inputs.prepare(gpu, &mut encoder, &mut timer, Repeat::Timed(1)).unwrap();
            resolver
                .resolve(gpu, &mut encoder, &inputs, &mut timer, Repeat::Timed(1))
                .unwrap();
            let mut readback = pool.begin();
            let shown = readback.copy_texture(gpu, &mut encoder, resolver.shown());
            let count = inputs.repaired_texels(recipe.preparation());
            let count = readback.copy_buffer(gpu, &mut encoder, count, 4);
            let shares = resolver.copy_shares(gpu, &mut encoder, &mut readback);
            let times = timer.finish(gpu, &mut encoder, &mut readback);
            let submission = gpu.queue.submit([encoder.finish()]);
            readback.map();
            gpu.wait(submission).unwrap();
            let n_timed = times.read(&readback).unwrap().len();
            assert!(
                [0, n_merges + 1 + passes.len()].contains(&n_timed),
                "{n_timed} passes were recorded, `prepare` and {passes:?} announced"
            );
            let n_repaired = readback.bytes(count).unwrap()[..4].try_into().map(u32::from_le_bytes);
            (
                readback.rgb(shown, sizes.output).unwrap(),
                u64::from(n_repaired.unwrap()),
                shares.map_or(0.0, |shares| shares.kept(&readback).unwrap()),
            )
        })
        .collect()
}

/// The value of a metric between equal images.
pub fn perfect(metric: Metric) -> f64 {
    match (metric.info().unit, metric.info().better) {
        ("dB", _) => f64::INFINITY,
        (_, Better::Higher) => 1.0,
        (_, Better::Lower) => 0.0,
    }
}

/// Every metric of two images that are of this size.
pub fn metrics_for(extent: Extent) -> Vec<Metric> {
    let suits = |metric: &Metric| !metric.is_temporal() && metric.check_size(extent).is_ok();
    Metric::ALL.into_iter().filter(suits).collect()
}

/// Metrics as the CPU computes them, of linear images.
pub fn cpu_scores(
    reference: &Image<Rgb>,
    test: &Image<Rgb>,
    display: Display,
    metrics: &[Metric],
) -> Result<FrameScores, MetricError> {
    let [reference, test] = [reference, test].map(|image| Picture::linear(image.clone(), display));
    Reference::new(reference, metrics).evaluate(&test)
}

/// Every metric of sequences of this size, over all pixels and over each mask.
pub fn all_metrics(extent: Extent) -> Vec<Metric> {
    let suits = |metric: &Metric| metric.check_size(extent).is_ok();
    let masked = |metric: Metric| Mask::ALL.into_iter().filter_map(move |mask| metric.over(mask));
    let all = Metric::ALL.into_iter().filter(suits);
    all.flat_map(|metric| [metric].into_iter().chain(masked(metric)))
        .collect()
}

/// How far a value that the GPU computes may be from the CPU's `value`, of frames of `n_pixels` in which each mask has no
/// pixel or a tenth of them.
pub fn gpu_tolerance(metric: Metric, value: f64, n_pixels: usize) -> f64 {
    let id = metric.id();
    let is = |base: &str| id == base || id.starts_with(&format!("{base}.")) && !id.starts_with("flicker.local");
    if id.starts_with("psnr.u8") {
        // A value that f32 puts on the other side of a rounding boundary changes Σ(T−R)² by about 1. Two may.
        let n = n_pixels as f64 * if metric.mask().is_some() { 0.1 } else { 1.0 };
        let codes_error = 255.0 * 255.0 * libm::pow(10.0, -0.1 * value) * 3.0 * n;
        return 1e-3 + 10.0 * libm::log10(1.0 + 2.0 / codes_error);
    }
    match metric.info().unit {
        // Display values are rounded by about 1e-7, and few pixels are a poor mean of that: three standard deviations.
        "dB" => {
            let rmse = libm::pow(10.0, -0.05 * value);
            let n_samples = 3.0 * n_pixels as f64 * if metric.mask().is_some() { 0.1 } else { 1.0 };
            1e-3 + 3.0 * 8.686 * 1e-7 / (rmse * n_samples.sqrt())
        }
        _ if is("rel_mse") || is("smape") => 1e-5 * value,
        _ if is("flip") || is("hdr_flip") => 1e-3,
        // A mask may hold a hundred pixels, of which one such value moves the windows.
        _ if id.starts_with("ssim.u8.") => 1e-4,
        _ if is("ms_ssim.y") || is("ghost") || is("blur") => 1e-4,
        _ if is("converge_frames") => 0.0,
        _ => 1e-5,
    }
}

/// One preset's frames, scored on the device.
pub struct DeviceScorer {
    gpu: Gpu,
    passes: GpuMetrics,
    track: DeviceTrack,
    test: Texture,
    timer: Timer,
    pool: ReadbackPool,
}

impl DeviceScorer {
    pub fn new(extent: Extent, display: Display, metrics: &[Metric]) -> Self {
        Self::with(Variant::default(), extent, display, metrics)
    }

    pub fn with(variant: Variant, extent: Extent, display: Display, metrics: &[Metric]) -> Self {
        let gpu = gpu().with(variant);
        Self {
            passes: GpuMetrics::new(&gpu, extent, display, metrics, 1).unwrap(),
            track: DeviceTrack::new(metrics),
            test: Texture::new(&gpu, "test", extent, wgpu::TextureFormat::Rgba32Float),
            timer: Timer::new(&gpu, 1),
            pool: ReadbackPool::default(),
            gpu,
        }
    }

    /// Scores the next frame, which follows the one before where it has motion.
    pub fn score(
        &mut self,
        reference: &Arc<Image<Rgb>>,
        test: &Image<Rgb>,
        motion_px: Option<&Image<[f32; 2]>>,
        settled: bool,
    ) -> FrameScores {
        let gpu = &self.gpu;
        self.test.write_rgb(gpu, test);
        let mut readback = self.pool.begin();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut recording = Recording {
            gpu,
            encoder: &mut encoder,
            readback: &mut readback,
        };
        let frame = ScoredFrame {
            reference,
            motion_px,
            follows: motion_px.is_some(),
            settled,
        };
        let recorded = self
            .passes
            .record(&mut recording, &mut self.timer, frame, &[&self.test]);
        let recorded = recorded.unwrap();
        let times = self.timer.finish(gpu, &mut encoder, &mut readback);
        let submission = gpu.queue.submit([encoder.finish()]);
        readback.map();
        gpu.wait(submission).unwrap();
        let ms = times.read(&readback).unwrap();
        assert!(ms.iter().all(|ms| *ms > 0.0), "{ms:?}");
        self.track.score(&recorded[0], &readback).unwrap()
    }

    pub fn finish(self) -> Vec<LateValue> {
        self.track.finish()
    }
}

/// Metrics as the GPU computes them.
pub fn gpu_scores(reference: &Image<Rgb>, test: &Image<Rgb>, display: Display, metrics: &[Metric]) -> FrameScores {
    let reference = Arc::new(reference.clone());
    DeviceScorer::new(reference.extent(), display, metrics).score(&reference, test, None, true)
}
