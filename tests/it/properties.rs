//! What must hold for any input.

use crate::support::{DeviceScorer, cpu_scores, gpu_tolerance, metrics_for, noise, perfect};
use afterimage::{
    image::{Extent, Image},
    metrics::{Better, Display, FrameScores, Metric, Tonemap},
    sequence::frame::Rgb,
};
use proptest::prelude::*;
use std::sync::Arc;

const DISPLAY: Display = Display {
    exposure: 1.0,
    tonemap: Tonemap::ReinhardMax,
};

fn score(reference: &Image<Rgb>, test: &Image<Rgb>) -> FrameScores {
    let metrics = metrics_for(reference.extent());
    cpu_scores(reference, test, DISPLAY, &metrics).unwrap()
}

fn picture(extent: Extent, seed: u32) -> Image<Rgb> {
    Image::from_fn(extent, |x, y| {
        [4.0 * noise(x / 5, y / 5, seed), noise(x, y, seed + 1), 0.3]
    })
}

#[test]
fn metrics_get_worse_as_noise_grows() {
    let reference = picture(Extent::new(167, 161), 1);
    assert_worse_with_noise(&reference, |test| score(&reference, test));
}

#[test]
fn metrics_get_worse_as_noise_grows_on_the_gpu() {
    let reference = picture(Extent::new(167, 161), 1);
    let mut device = on_gpu(reference.extent());
    let shared = Arc::new(reference.clone());
    assert_worse_with_noise(&reference, |test| device.score(&shared, test, None, true));
}

fn on_gpu(extent: Extent) -> DeviceScorer {
    DeviceScorer::new(extent, DISPLAY, &metrics_for(extent))
}

fn assert_worse_with_noise(reference: &Image<Rgb>, mut score: impl FnMut(&Image<Rgb>) -> FrameScores) {
    let noisy = |amplitude: f32| {
        Image::from_fn(reference.extent(), |x, y| {
            let offset = amplitude * (noise(x, y, 9) - 0.5);
            reference.at(x, y).map(|c| c * (1.0 + offset))
        })
    };
    let mut previous = score(reference).values;
    for amplitude in [0.05, 0.1, 0.2, 0.4, 0.8] {
        let values = score(&noisy(amplitude)).values;
        for metric in metrics_for(reference.extent()) {
            let (now, before) = (values[metric.id()].0, previous[metric.id()].0);
            let worse = match metric.info().better {
                Better::Higher => now < before,
                Better::Lower => now > before,
            };
            assert!(worse, "{metric} at {amplitude}: {now} after {before}");
        }
        previous = values;
    }
}

#[test]
fn scores_do_not_depend_on_the_number_of_threads() {
    let extent = Extent::new(317, 179);
    let (reference, test) = (picture(extent, 1), picture(extent, 2));
    let with_threads = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| score(&reference, &test))
    };
    assert_eq!(with_threads(1), with_threads(7));
}

#[test]
fn a_wide_strip_has_the_score_of_its_repeated_tile() {
    let extent = Extent::new(4096, 16);
    let strip = |seed| Image::from_fn(extent, |x, y| [noise(x % 64, y, seed), 0.5, noise(x % 64, y, seed + 1)]);
    let tile = |image: &Image<Rgb>| Image::from_fn(Extent::new(64, 16), |x, y| image.at(x, y));
    let (reference, test) = (strip(1), strip(3));
    let (wide, narrow) = (
        score(&reference, &test).values,
        score(&tile(&reference), &tile(&test)).values,
    );
    // Windows and filters see other borders.
    let sees_borders = |id: &str| id.starts_with("ssim") || id.contains("flip");
    for metric in metrics_for(extent)
        .into_iter()
        .filter(|metric| !sees_borders(metric.id()))
    {
        let (wide, narrow) = (wide[metric.id()].0, narrow[metric.id()].0);
        assert!((wide - narrow).abs() < 1e-9, "{metric}: {wide} and {narrow}");
    }
    assert!(wide["ssim"].0.is_finite());
    let gpu = on_gpu(extent).score(&Arc::new(reference), &test, None, true).values;
    for metric in metrics_for(extent) {
        let (cpu, gpu) = (wide[metric.id()].0, gpu[metric.id()].0);
        let tolerance = gpu_tolerance(metric, cpu, extent.n_pixels());
        assert!(
            (cpu - gpu).abs() <= tolerance,
            "{metric}: {gpu} on the GPU, {cpu} on the CPU"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn equal_images_are_perfect_and_others_are_not(width in 11..90_u32, height in 11..40_u32, seed in 0..u32::MAX / 2) {
        let reference = picture(Extent::new(width, height), seed);
        let equal = score(&reference, &reference).values;
        let mut changed = reference.clone();
        changed.pixels_mut()[seed as usize % reference.pixels().len()] = [9.0; 3];
        let changed = score(&reference, &changed).values;
        for metric in metrics_for(reference.extent()) {
            prop_assert_eq!(equal[metric.id()].0, perfect(metric), "{}", metric);
            // One pixel is beyond the 95th percentile.
            if metric != Metric::FLIP_P95 {
                prop_assert_ne!(changed[metric.id()].0, perfect(metric), "{}", metric);
            }
        }
    }

    #[test]
    fn similarity_lies_between_minus_one_and_one(width in 11..90_u32, height in 11..40_u32, seed in 0..u32::MAX / 2) {
        let extent = Extent::new(width, height);
        let values = score(&picture(extent, seed), &picture(extent, seed / 2 + 7)).values;
        for id in ["ssim", "ssim.y", "ssim.u8"] {
            prop_assert!(values[id].0.abs() <= 1.0, "{}: {:?}", id, values[id]);
        }
    }
}
