//! CPU time of each metric on a 1080p pair. `cargo run --release --example bench_metrics`
#![allow(clippy::print_stdout, reason = "the figures are the program's output")]

use afterimage::{
    image::{Extent, Image},
    metrics::{Display, Metric, Reference, Tonemap},
};
use rustix::time::{ClockId, clock_gettime};
use std::time::Instant;

fn main() {
    let extent = Extent::new(1920, 1080);
    let display = Display {
        exposure: 1.0,
        tonemap: Tonemap::ReinhardMax,
    };
    let reference = Image::from_fn(extent, |x, y| {
        [x as f32 / 1920.0, y as f32 / 540.0, ((x ^ y) & 255) as f32 / 64.0]
    });
    let test = reference.map(|[r, g, b]| [g * 0.1 + r * 0.9, g * 1.01, b + 0.01]);
    println!("1920×1080, {} threads; least of 5", rayon::current_num_threads());
    report("display transform only", || {
        drop(Reference::new(&test, display, &[Metric::Psnr]))
    });
    for metric in Metric::ALL {
        let reference = Reference::new(&reference, display, &[metric]);
        report(metric.id(), || assert!(reference.evaluate(&test).is_ok()));
    }
    let reference = Reference::new(&reference, display, &Metric::ALL);
    report("all", || assert!(reference.evaluate(&test).is_ok()));
}

fn report(name: &str, f: impl Fn()) {
    let (mut least_cpu, mut least_wall) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..5 {
        let (cpu, wall) = (cpu_ms(), Instant::now());
        f();
        least_cpu = least_cpu.min(cpu_ms() - cpu);
        least_wall = least_wall.min(wall.elapsed().as_secs_f64() * 1e3);
    }
    println!("{name:24} {least_cpu:8.1} ms CPU {least_wall:8.1} ms wall");
}

fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
