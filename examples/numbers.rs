//! Prints the figures that the project promises, measured here and now:
//! `cargo run --release --example numbers [SEQUENCE…]`.
//!
//! Agreement of the GPU with the f64 twin on the sequences given, how well a run's stages overlap and how soon its
//! first image is there, and the CPU time of a 1080p frame against the plain f32 twin. CPU times are of the whole
//! process; ratios compare figures of this one run.

#![allow(clippy::print_stdout, reason = "an example's output")]

use afterimage::{
    bench::textured,
    gpu::{Gpu, ReadbackPool, Timer},
    image::{
        Extent, Image,
        files::{Backend, FileReader, Limits},
    },
    metrics::Metric,
    run::{self, MetricsOn, Observer, PresetSpec, RunSpec, Validate},
    sequence::{Frame, Sequence, Sizes, frame::Rgb},
    taa::{
        Inputs, Precision, Preset, Repeat, Resolver, Skip,
        reference::{Twin, real::Real},
    },
};
use std::{collections::BTreeSet, path::Path, sync::Mutex, time::Instant};

fn main() -> anyhow::Result<()> {
    // As in a service, whose first job compiles what the next ones find.
    let gpu = Gpu::open(None)?.caching();
    println!("adapter: {:?}\n", gpu.info());
    for path in std::env::args().skip(1) {
        let sequence = Sequence::open(Path::new(&path), &FileReader::new(Backend::Auto, Limits::default()))?;
        agreement(&gpu, &sequence)?;
        overlap(&gpu, &sequence)?;
    }
    speed(&gpu)
}

fn spec(presets: &[&str], history: Precision) -> RunSpec {
    RunSpec {
        presets: presets
            .iter()
            .map(|preset| PresetSpec {
                preset: (*preset).to_owned(),
                parameters: serde_json::Map::new(),
            })
            .collect(),
        metrics: vec![Metric::PSNR, Metric::SSIM],
        history,
        n_frames: None,
        repeat: 1,
        metrics_on: MetricsOn::Auto,
        validate: Validate::No,
        until: None,
        skip: Skip::Off,
    }
}

fn ids(presets: &[&'static Preset]) -> Vec<&'static str> {
    presets.iter().map(|preset| preset.id).collect()
}

/// Keeps the shown images, and when the first came.
#[derive(Default)]
struct Keep {
    images: Mutex<Vec<(usize, usize, Image<Rgb>)>>,
    first: Mutex<Option<Instant>>,
}

impl Observer for Keep {
    fn wants_output(&self) -> bool {
        true
    }
    fn output(&self, preset: usize, frame: usize, image: &Image<Rgb>) -> std::io::Result<()> {
        self.first
            .lock()
            .expect("not poisoned")
            .get_or_insert_with(Instant::now);
        self.images
            .lock()
            .expect("not poisoned")
            .push((preset, frame, image.clone()));
        Ok(())
    }
}

/// Every preset of the GPU against the f64 twin, in display units of the sequence.
fn agreement(gpu: &Gpu, sequence: &Sequence) -> anyhow::Result<()> {
    println!(
        "agreement with the f64 twin on {} (f32 history; bounds: max 2e-3, mean 2e-5, beyond 0.05 %)",
        sequence.name()
    );
    let (presets, _) = run::admitted(sequence);
    let keep = Keep::default();
    let ids = ids(&presets);
    run::execute(&spec(&ids, Precision::F32), sequence, gpu, &keep)?;
    let images = keep.images.into_inner().expect("not poisoned");
    let display = sequence.display();
    for (index, preset) in presets.iter().enumerate() {
        let mut twin = Twin::<f64>::new(preset.recipe.clone(), Precision::F32);
        let optional = preset.recipe.optional_channels().intersection(sequence.available());
        let channels = preset.recipe.required_channels().union(optional);
        let (mut max, mut sum, mut n_beyond, mut n) = (0.0_f64, 0.0, 0_usize, 0_usize);
        for frame_index in 0..sequence.n_frames() {
            let expected = twin.resolve(&sequence.load(frame_index, channels)?).shown;
            let (_, _, shown) = images
                .iter()
                .find(|(preset, frame, _)| (*preset, *frame) == (index, frame_index))
                .expect("every frame was shown");
            for (a, b) in shown.pixels().iter().zip(expected.pixels()) {
                let b = display.apply(b.map(|v| v as f32));
                let worst = display
                    .apply(*a)
                    .iter()
                    .zip(b)
                    .fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
                max = max.max(worst);
                n_beyond += usize::from(worst > 2e-3);
                sum += if worst > 2e-3 { 0.0 } else { worst };
                n += 1;
            }
        }
        println!(
            "  {:<14} max {max:.1e}  mean {:.1e}  beyond {:.4} %",
            preset.id,
            sum / n as f64,
            100.0 * n_beyond as f64 / n as f64
        );
    }
    Ok(())
}

/// Wall time of a whole run against its slowest stage, and the time to its first image.
fn overlap(gpu: &Gpu, sequence: &Sequence) -> anyhow::Result<()> {
    let (presets, _) = run::admitted(sequence);
    let ids = ids(&presets);
    let one = ids.iter().position(|id| *id == "karis2014").unwrap_or(0);
    for presets in [&ids[..], &ids[one..=one]] {
        let spec = spec(presets, Precision::F16);
        // Once to compile its passes.
        run::execute(&spec, sequence, gpu, &Keep::default())?;
        let keep = Keep::default();
        let start = Instant::now();
        let report = run::execute(&spec, sequence, gpu, &keep)?;
        let first = keep.first.into_inner().expect("not poisoned").expect("an image came");
        let total = report.stages_ms["total"];
        let stages = report.stages_ms.iter().filter(|(stage, _)| *stage != "total");
        let (slowest, slowest_ms) = stages.clone().max_by(|a, b| a.1.total_cmp(b.1)).expect("stages");
        println!(
            "overlap on {}, {} presets: total {total:.0} ms = {:.2} × {slowest} ({slowest_ms:.0} ms); sum of stages \
             {:.0} ms; first image after {:.0} ms",
            sequence.name(),
            presets.len(),
            total / slowest_ms,
            stages.map(|(_, ms)| ms).sum::<f64>(),
            (first - start).as_secs_f64() * 1e3
        );
    }
    println!();
    Ok(())
}

/// CPU time of the whole process, milliseconds.
fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

/// Median CPU time and median wall time of `work`, milliseconds, after one run that is not counted.
fn measure(n: usize, mut work: impl FnMut() -> anyhow::Result<()>) -> anyhow::Result<(f64, f64)> {
    work()?;
    let (mut cpu, mut wall) = (Vec::new(), Vec::new());
    for _ in 0..n {
        let (start_cpu, start) = (cpu_ms(), Instant::now());
        work()?;
        cpu.push(cpu_ms() - start_cpu);
        wall.push(start.elapsed().as_secs_f64() * 1e3);
    }
    cpu.sort_by(f64::total_cmp);
    wall.sort_by(f64::total_cmp);
    Ok((cpu[n / 2], wall[n / 2]))
}

/// 1080p frames, GPU passes against the plain twin in f32.
fn speed(gpu: &Gpu) -> anyhow::Result<()> {
    let extent = Extent::new(1920, 1080);
    println!("CPU ms a frame at {extent} (wall in brackets), f16 history");
    let frames: Vec<_> = (0..4).map(|index| textured(extent, index)).collect();
    for id in ["ema", "inside", "karis2014", "salvi2016"] {
        let preset = Preset::find(id)?;
        let recipe = &preset.recipe;
        let wanted = BTreeSet::from([recipe.preparation()]);
        let mut inputs = Inputs::new(gpu, Sizes::native(extent), recipe.required_channels(), &wanted)?;
        let mut resolver = Resolver::new(gpu, recipe.clone(), Precision::F16, Sizes::native(extent))?;
        let mut timer = Timer::new(gpu, 0);
        let mut gpu_frame = |frame: Option<&Frame>| -> anyhow::Result<()> {
            if let Some(frame) = frame {
                inputs.upload(gpu, frame)?;
            }
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            inputs.prepare(gpu, &mut encoder, &mut timer, Repeat::Timed(1))?;
            resolver.resolve(gpu, &mut encoder, &inputs, &mut timer, Repeat::Timed(1))?;
            gpu.wait(gpu.queue.submit([encoder.finish()]))?;
            Ok(())
        };
        gpu_frame(Some(&frames[1]))?;
        let (passes, passes_wall) = measure(15, || gpu_frame(None))?;
        let (uploaded, uploaded_wall) = measure(15, || gpu_frame(Some(&frames[1])))?;
        let mut twin = Twin::<f32>::new(recipe.clone(), Precision::F16);
        twin.resolve(&frames[0]);
        let (plain, plain_wall) = measure(5, || {
            std::hint::black_box(twin.resolve(&frames[1]).shown.at(0, 0)[0].to_f64());
            Ok(())
        })?;
        println!(
            "  {id:<10} passes {passes:.0} ({passes_wall:.0})  with upload {uploaded:.0} ({uploaded_wall:.0})  plain f32 twin \
             {plain:.0} ({plain_wall:.0})  ratio {:.2}, with upload {:.2}",
            passes / plain,
            uploaded / plain
        );
    }
    readback(gpu, extent)
}

fn readback(gpu: &Gpu, extent: Extent) -> anyhow::Result<()> {
    let texture = afterimage::gpu::Texture::new(gpu, "shown", extent, wgpu::TextureFormat::Rgba32Float);
    let pool = ReadbackPool::default();
    let (cpu, wall) = measure(15, || {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut readback = pool.begin();
        let slot = readback.copy_texture(gpu, &mut encoder, &texture);
        let submission = gpu.queue.submit([encoder.finish()]);
        readback.map();
        gpu.wait(submission)?;
        std::hint::black_box(readback.rgb(slot, extent)?);
        Ok(())
    })?;
    println!("  read-back  {cpu:.0} ({wall:.0})");
    Ok(())
}
