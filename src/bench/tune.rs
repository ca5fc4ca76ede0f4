//! Which shape of workgroups is fastest on an adapter: measured on one made-up frame, to be kept
//! ([`Gpu::keep_workgroup`]) for every later run.

use super::{BenchError, clock::cost, copy::Copy};
use crate::{
    gpu::{Gpu, Timer, Variant, Workgroup},
    image::{Extent, Image},
    metrics::Display,
    random::lattice,
    sequence::{Frame, Sizes},
    statistics::median,
    taa::{Inputs, Precision, Preset, Repeat, Resolver, Skip},
};
use std::collections::BTreeSet;

const EXTENT: Extent = Extent::new(960, 540);
const N_ROUNDS: usize = 9;
/// Reads everything that recipes commonly read.
const PRESET: &str = "karis2014";

/// Each candidate with its milliseconds a frame, fastest first.
pub fn tune(gpu: &Gpu) -> Result<Vec<(Workgroup, f64)>, BenchError> {
    let recipe = &Preset::find(PRESET).expect("a preset of this crate").recipe;
    let sizes = Sizes::native(EXTENT);
    let wanted = BTreeSet::from([recipe.preparation()]);
    let mut inputs = Inputs::new(gpu, sizes, recipe.required_channels(), &wanted)?;
    inputs.upload(gpu, &textured(EXTENT, 1))?;
    let mut candidates = Vec::new();
    for workgroup in Workgroup::CANDIDATES {
        let gpu = gpu.with(Variant {
            workgroup: Some(workgroup),
            ..Variant::default()
        });
        let resolver = Resolver::new(&gpu, recipe.clone(), Precision::F16, sizes)?;
        candidates.push((workgroup, resolver, Vec::new()));
    }
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    inputs.prepare(gpu, &mut encoder, &mut Timer::new(gpu, 0), Repeat::Timed(1))?;
    gpu.wait(gpu.queue.submit([encoder.finish()]))?;
    let mut copy = Copy::new(gpu)?;
    let mut timer = Timer::new(gpu, recipe.passes_skipping(Skip::Off, sizes).len() as u32);
    // The first round compiles.
    for round in 0..=N_ROUNDS {
        copy.wake()?;
        for (_, resolver, times) in &mut candidates {
            let (cost, ()) = cost(gpu, &mut timer, |encoder, timer, _| {
                resolver.resolve(gpu, encoder, &inputs, timer, Repeat::Timed(1))
            })?;
            if round > 0 {
                times.push(cost.ms);
            }
        }
    }
    let mut measured: Vec<_> = candidates
        .into_iter()
        .map(|(workgroup, _, times)| (workgroup, median(&times)))
        .collect();
    measured.sort_by(|a, b| a.1.total_cmp(&b.1));
    Ok(measured)
}

/// A frame whose texels all differ, with motion everywhere and two depths: nothing in it is easy on the caches.
pub fn textured(extent: Extent, index: usize) -> Frame {
    let hash = |x: u32, y: u32| lattice(i64::from(x), i64::from(y), index as u64) as f32;
    Frame {
        index,
        reset: index == 0,
        jitter_px: [0.125, -0.25],
        far: 100.0,
        output_size: extent,
        display: Display::default(),
        parity: None,
        color: Image::from_fn(extent, |x, y| [hash(x, y), hash(y, x), 2.0 * hash(x + y, x)]),
        depth: Some(Image::from_fn(extent, |x, y| {
            if (x / 40 + y / 40) % 2 == 0 { 2.0 } else { 5.0 }
        })),
        motion_px: Some(Image::from_fn(extent, |x, y| [1.5 + hash(x / 40, y / 40), -0.75])),
        object_id: None,
        albedo: None,
        reactive: None,
        unjittered_color: None,
        reference: None,
        others: None,
    }
}
