//! Prints the CPU time of metrics on one 1920×1080 frame: `cargo run --release --example bench_metrics`.
//!
//! CPU time is of the whole process over all threads, the least of several tries. `evaluate` includes the display
//! transform of the image under test; `reference` is what every image compared with the same reference shares.

#![allow(clippy::print_stdout, reason = "an example's output")]

use afterimage::{
    image::{Extent, Image},
    metrics::{Display, Metric, Picture, Reference, Tonemap},
    sequence::frame::Rgb,
};
use rustix::time::{ClockId, clock_gettime};

const EXTENT: Extent = Extent::new(1920, 1080);
const N_TRIES: usize = 5;
const N_PRESETS: usize = 8;
const DISPLAY: Display = Display {
    exposure: 1.0,
    tonemap: Tonemap::ReinhardMax,
};

fn main() -> anyhow::Result<()> {
    let reference = picture(0.0);
    let noisy = picture(0.05);
    let mut patched = reference.clone();
    for y in 400..600 {
        patched.pixels_mut()[y * 1920 + 800..][..300].fill([0.5; 3]);
    }
    let [reference, noisy, patched] = [reference, noisy, patched].map(|image| Picture::linear(image, DISPLAY));
    let together = [Metric::PSNR, Metric::SSIM, Metric::MS_SSIM_Y, Metric::FLIP];
    println!("CPU ms a frame        evaluate   3 % changed   reference");
    for metrics in [
        &[Metric::PSNR][..],
        &[Metric::PSNR_LINEAR],
        &[Metric::SSIM],
        &[Metric::SSIM_Y],
        &[Metric::MS_SSIM_Y],
        &[Metric::FLIP],
        &[Metric::REL_MSE],
        &together,
    ] {
        let prepared = Reference::new(reference.clone(), metrics);
        prepared.evaluate(&noisy)?;
        let [all, some] = [&noisy, &patched].map(|test| least_cpu_ms(|| drop(prepared.evaluate(test))));
        // The first evaluation also fills in what the reference shares.
        let first = least_cpu_ms(|| drop(Reference::new(reference.clone(), metrics).evaluate(&noisy)));
        let ids: Vec<_> = metrics.iter().map(|metric| metric.id()).collect();
        println!("{:<22}{all:>8.1}{some:>14.1}{:>12.1}", ids.join(" "), first - all);
    }
    let evaluate_all = |n: usize| {
        let prepared = Reference::new(reference.clone(), &together);
        (0..n).for_each(|_| drop(prepared.evaluate(&noisy)));
    };
    let shared = least_cpu_ms(|| evaluate_all(N_PRESETS));
    let separate = least_cpu_ms(|| (0..N_PRESETS).for_each(|_| evaluate_all(1)));
    println!("{N_PRESETS} presets, all of the last row: {shared:.0} ms shared, {separate:.0} ms separate");
    Ok(())
}

/// Gradients and stripes with values to 4, and noise.
fn picture(amplitude: f32) -> Image<Rgb> {
    Image::from_fn(EXTENT, |x, y| {
        let hash = (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0x2c1b_3c6d);
        let noise = 1.0 + amplitude * ((hash >> 8) as f32 / 16_777_216.0 - 0.5);
        let stripes = 0.5 + 0.5 * libm::sinf(x as f32 * 0.3 + y as f32 * 0.1);
        [4.0 * stripes, x as f32 / 1920.0, 0.2 + y as f32 / 1080.0].map(|c| c * noise)
    })
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
