//! Prints what metrics cost on 1920×1080 frames: `cargo run --release --example bench_metrics [METRIC…]`.
//!
//! CPU time is of the whole process over all threads, the least of several tries. A first column is of an image that
//! differs everywhere, the next of one that differs in 3 % of its pixels, the next of one that is the reference. Every row
//! includes the display transform of the image under test, which the first row shows alone; `reference` is what follows
//! from the reference and is shared by every image compared with it. Frames are the second of a sequence, so that
//! temporal metrics have a past.
//!
//! `--gpu` prints how long an adapter takes for `psnr` and `ssim`, and for reading both images once.
//!
//! `--peers DIR` writes an 8-bit pair as PNG for `script/bench_peers`, and prints our wall times on it.

#![allow(clippy::print_stdout, reason = "an example's output")]

use afterimage::{
    gpu::{Gpu, Pass, ReadbackPool, Texture, Timer},
    image::{Extent, Image, files::png::write_png},
    metrics::{
        Display, Metric, Picture, Reference, Tonemap, Track,
        gpu::{GpuMetrics, Recording, ScoredFrame},
    },
    sequence::frame::Rgb,
};
use rustix::time::{ClockId, clock_gettime};
use std::{fs, hint::black_box, path::Path, sync::Arc, time::Instant};

const EXTENT: Extent = Extent::new(1920, 1080);
const N_TRIES: usize = 9;
const N_PRESETS: usize = 8;
const DISPLAY: Display = Display {
    exposure: 1.0,
    tonemap: Tonemap::ReinhardMax,
};
/// Everything that a run is likely to ask for.
const TOGETHER: [Metric; 11] = [
    Metric::PSNR,
    Metric::SSIM,
    Metric::MS_SSIM_Y,
    Metric::FLIP,
    Metric::TPSNR,
    Metric::WARPED_TPSNR,
    Metric::WARP_EXCESS,
    Metric::FLICKER,
    Metric::FLICKER_LOCAL,
    Metric::GHOST,
    Metric::BLUR,
];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments == ["--gpu"] {
        return on_adapter();
    }
    if let [flag, folder] = &arguments[..]
        && flag == "--peers"
    {
        return peers(Path::new(folder));
    }
    let frames = Frames::new();
    memory(&frames)?;
    println!("CPU ms a frame, {EXTENT}  all differ   3 % differ   none differ   reference");
    let asked = arguments
        .iter()
        .map(|id| id.parse())
        .collect::<Result<Vec<Metric>, _>>()?;
    let rows: Vec<Vec<Metric>> = match asked.is_empty() {
        true => [Vec::new()]
            .into_iter()
            .chain(Metric::ALL.map(|metric| vec![metric]))
            .chain([["psnr.static", "psnr.moving", "psnr.disoccluded"]
                .map(|id| id.parse().expect("a metric"))
                .into()])
            .chain([TOGETHER.into()])
            .collect(),
        false => vec![asked],
    };
    for metrics in rows {
        let [all, some, none] =
            [&frames.noisy, &frames.patched, &frames.reference].map(|test| frames.cost(&metrics, test));
        let ids: Vec<_> = metrics.iter().map(|metric| metric.id()).collect();
        let reference = frames.cost_with_reference(&metrics) - all;
        println!(
            "{all:>38.1}{some:>13.1}{none:>14.1}{reference:>12.1}   {}",
            ids.join(" ")
        );
    }
    let [reference, test] = pair_of_codes().map(of_codes);
    for metric in [Metric::PSNR, Metric::SSIM, Metric::FLIP] {
        let prepared = Reference::new(reference.clone(), &[metric]);
        let shared = least_cpu_ms(|| drop(black_box(prepared.evaluate(&test))));
        let whole = least_cpu_ms(|| drop(black_box(Reference::new(reference.clone(), &[metric]).evaluate(&test))));
        println!("8-bit pair, all differ: {metric} {shared:.1} ms, with the reference {whole:.1} ms");
    }
    let shared = least_cpu_ms(|| frames.judge(&TOGETHER, N_PRESETS, 1));
    let separate = least_cpu_ms(|| frames.judge(&TOGETHER, 1, N_PRESETS));
    println!(
        "{N_PRESETS} presets, all of the last row: {shared:.0} ms in one run, {separate:.0} ms in {N_PRESETS} runs: {:.2}",
        shared / separate
    );
    Ok(())
}

/// Two references in a row, and what is compared with the second.
struct Frames {
    before: Picture,
    reference: Picture,
    noisy: Picture,
    patched: Picture,
    motion_px: Arc<Image<[f32; 2]>>,
}

impl Frames {
    fn new() -> Self {
        let reference = scene(1.0, 0.0);
        let mut patched = reference.clone();
        for y in 400..600 {
            patched.pixels_mut()[y * 1920 + 800..][..300].fill([0.5; 3]);
        }
        let [before, noisy, reference, patched] =
            [scene(0.0, 0.0), scene(1.0, 0.05), reference, patched].map(|image| Picture::linear(image, DISPLAY));
        Self {
            before,
            reference,
            noisy,
            patched,
            motion_px: Arc::new(Image::from_fn(EXTENT, |x, _| [if x < 960 { -1.0 } else { 0.0 }, 0.0])),
        }
    }

    /// The second frame's reference, and the past of a test image.
    fn begin(&self, metrics: &[Metric]) -> (Reference, Track) {
        let first = Reference::new(self.before.clone(), metrics);
        let mut track = Track::new(metrics);
        track.score(&first, &self.before, true).expect("of one size");
        (first.follow(self.reference.clone(), Some(&self.motion_px)), track)
    }

    fn cost(&self, metrics: &[Metric], test: &Picture) -> f64 {
        let (reference, mut track) = self.begin(metrics);
        let mut score = || drop(black_box(track.score(&reference, test, true)));
        // The first fills in what images share.
        score();
        least_cpu_ms(score)
    }

    fn cost_with_reference(&self, metrics: &[Metric]) -> f64 {
        let first = Reference::new(self.before.clone(), metrics);
        let mut track = Track::new(metrics);
        least_cpu_ms(|| {
            track.score(&first, &self.before, true).expect("of one size");
        });
        least_cpu_ms(|| {
            let next = first.follow(self.reference.clone(), Some(&self.motion_px));
            drop(black_box(track.score(&next, &self.noisy, true)));
        })
    }

    /// A frame of `n_runs` runs of `n_presets` each.
    fn judge(&self, metrics: &[Metric], n_presets: usize, n_runs: usize) {
        for _ in 0..n_runs {
            let first = Reference::new(self.before.clone(), metrics);
            let next = first.follow(self.reference.clone(), Some(&self.motion_px));
            for _ in 0..n_presets {
                let mut track = Track::new(metrics);
                drop(black_box(track.score(&next, &self.noisy, true)));
            }
        }
    }
}

/// Gradients, and stripes that move a pixel a frame on the left, with values to 4; and noise.
fn scene(frame: f32, amplitude: f32) -> Image<Rgb> {
    Image::from_fn(EXTENT, |x, y| {
        let hash = (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0x2c1b_3c6d);
        let noise = 1.0 + amplitude * ((hash >> 8) as f32 / 16_777_216.0 - 0.5);
        let moved = x as f32 - if x < 960 { frame } else { 0.0 };
        let stripes = 0.5 + 0.5 * libm::sinf(moved * 0.3 + y as f32 * 0.1);
        [4.0 * stripes, x as f32 / 1920.0, 0.2 + y as f32 / 1080.0].map(|c| c * noise)
    })
}

/// Peak memory of judging an image by everything, over what the images themselves take, in frames of f32 RGB.
fn memory(frames: &Frames) -> anyhow::Result<()> {
    for n_presets in [1, N_PRESETS] {
        fs::write("/proc/self/clear_refs", "5")?;
        let before = resident_bytes("VmRSS")?;
        let mut first = Reference::new(frames.before.clone(), &TOGETHER);
        let mut tracks: Vec<Track> = (0..n_presets).map(|_| Track::new(&TOGETHER)).collect();
        for track in &mut tracks {
            track.score(&first, &frames.before, true)?;
        }
        first.retire();
        let next = first.follow(frames.reference.clone(), Some(&frames.motion_px));
        drop(first);
        for track in &mut tracks {
            track.score(&next, &frames.noisy, true)?;
        }
        let peak = resident_bytes("VmHWM")? - before;
        let n_frames = peak / (EXTENT.n_pixels() * size_of::<Rgb>()) as f64;
        println!("memory for {n_presets} preset(s), all of the last row below: {n_frames:.1} frames of f32 RGB");
    }
    Ok(())
}

fn resident_bytes(field: &str) -> anyhow::Result<f64> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix(field)?.strip_prefix(':'));
    let kibibytes: f64 = line.unwrap_or_default().trim().trim_end_matches(" kB").parse()?;
    Ok(kibibytes * 1024.0)
}

/// What `script/bench_peers` compares with other programs: wall times, since those are what one waits for.
fn peers(folder: &Path) -> anyhow::Result<()> {
    let codes = pair_of_codes();
    write_png(&folder.join("reference.png"), &codes[0], &[])?;
    write_png(&folder.join("test.png"), &codes[1], &[])?;
    let [reference, test] = codes.map(|codes| Picture::codes(codes.map(|pixel| pixel.map(u16::from)), 255));
    for metric in [Metric::PSNR, Metric::SSIM, Metric::FLIP] {
        let mut value = None;
        let tries = (0..N_TRIES).map(|_| {
            let start = Instant::now();
            value = Reference::new(reference.clone(), &[metric]).evaluate(&test).ok();
            start.elapsed().as_secs_f64() * 1e3
        });
        let least = tries.fold(f64::INFINITY, f64::min);
        let value = value.expect("evaluated").values[metric.id()];
        println!("afterimage {metric} {least:.1} ms {value:.12}");
    }
    Ok(())
}

/// An 8-bit reference, and an image that differs from it everywhere.
fn pair_of_codes() -> [Image<[u8; 3]>; 2] {
    [0.0, 0.05].map(|amplitude| {
        let shown = |pixel: Rgb| DISPLAY.apply(pixel).map(|value| (255.0 * value).round() as u8);
        scene(1.0, amplitude).map(shown)
    })
}

fn of_codes(codes: Image<[u8; 3]>) -> Picture {
    Picture::codes(codes.map(|pixel| pixel.map(u16::from)), 255)
}

/// Reads every texel of two images once, in strips as the metrics do, and adds them up so that no read can be left out.
const READ_BOTH: &str = "
    override WORKGROUP_X: u32 = 8u;
    override WORKGROUP_Y: u32 = 8u;
    @group(0) @binding(0) var reference: texture_2d<f32>;
    @group(0) @binding(1) var test: texture_2d<f32>;
    @group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
    @compute @workgroup_size(WORKGROUP_X, WORKGROUP_Y)
    fn main(@builtin(global_invocation_id) id: vec3u) {
        let size = textureDimensions(reference);
        if (id.x >= size.x || id.y * 64u >= size.y) {
            return;
        }
        var sum = vec4f(0.0);
        for (var y = id.y * 64u; y < min(id.y * 64u + 64u, size.y); y++) {
            sum += textureLoad(reference, vec2u(id.x, y), 0) + textureLoad(test, vec2u(id.x, y), 0);
        }
        sums[id.y * size.x + id.x] = sum;
    }
";

/// The least time between timestamps, of metrics and of a pass that only reads what they compare.
fn on_adapter() -> anyhow::Result<()> {
    let gpu = Gpu::open(None)?;
    let [reference, noisy] = [0.0, 0.05].map(|amplitude| Arc::new(scene(1.0, amplitude)));
    let textures = [&reference, &noisy].map(|image| {
        let texture = Texture::new(&gpu, "image", EXTENT, wgpu::TextureFormat::Rgba32Float);
        texture.write_rgb(&gpu, image);
        texture
    });
    let strips = Extent::new(EXTENT.width, EXTENT.height.div_ceil(64));
    let sums = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("sums"),
        size: 16 * strips.n_pixels() as u64,
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    });
    let read = Pass::new(&gpu, "read both", &[READ_BOTH], &[])?;
    let read = read
        .bind("reference", &textures[0])
        .bind("test", &textures[1])
        .bind("sums", &sums)
        .over(&gpu, strips)?;
    // Of one image, and of two, which share what is made of the reference.
    let mut passes = [1, 2].map(|n| GpuMetrics::new(&gpu, EXTENT, DISPLAY, &[Metric::PSNR, Metric::SSIM], n));
    let (mut timer, pool) = (Timer::new(&gpu, 3), ReadbackPool::default());
    let mut least_ms = [f64::INFINITY; 3];
    // Many, because a GPU takes a while to raise its clocks.
    for _ in 0..=4 * N_TRIES {
        let mut readback = pool.begin();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut recording = Recording {
            gpu: &gpu,
            encoder: &mut encoder,
            readback: &mut readback,
        };
        let frame = ScoredFrame {
            reference: &reference,
            motion_px: None,
            follows: false,
            settled: true,
        };
        for (passes, n) in passes.iter_mut().zip(1..) {
            let passes = passes.as_mut().map_err(|error| anyhow::anyhow!("{error}"))?;
            passes.record(&mut recording, &mut timer, frame, &vec![&textures[1]; n])?;
        }
        read.record(&mut encoder, timer.time());
        let times = timer.finish(&gpu, &mut encoder, &mut readback);
        let submission = gpu.queue.submit([encoder.finish()]);
        readback.map();
        gpu.wait(submission)?;
        for (least, ms) in least_ms.iter_mut().zip(times.read(&readback)?) {
            *least = least.min(ms);
        }
    }
    let [one_ms, two_ms, read_ms] = least_ms;
    let own_ms = two_ms - one_ms;
    println!("{}, {EXTENT}: reading both images {read_ms:.3} ms", gpu.info().name);
    println!(
        "psnr and ssim: {own_ms:.3} ms an image, {:.1} times that",
        own_ms / read_ms
    );
    println!("and of the reference, once: {:.3} ms", one_ms - own_ms);
    Ok(())
}

fn least_cpu_ms(mut work: impl FnMut()) -> f64 {
    let tries = (0..N_TRIES).map(|_| {
        let before = cpu_ms();
        work();
        cpu_ms() - before
    });
    tries.fold(f64::INFINITY, f64::min)
}

fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
