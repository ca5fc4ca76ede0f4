//! Every metric of made-up sequences, over all pixels and over each mask, on the GPU against the CPU: motion that leaves
//! the image, disocclusion, resets, warm-up, and frames that are not finite.

use crate::support::{DeviceScorer, all_metrics, gpu_tolerance, noise};
use afterimage::{
    image::{Extent, Image},
    metrics::{Display, FrameScores, LateValue, Metric, Picture, Reference, Tonemap, Track, Value},
    sequence::frame::Rgb,
};
use std::sync::Arc;

const DISPLAY: Display = Display {
    exposure: 0.8,
    tonemap: Tonemap::ReinhardMax,
};

/// A frame of a made-up sequence.
struct Made {
    reference: Arc<Image<Rgb>>,
    test: Image<Rgb>,
    motion: Arc<Image<[f32; 2]>>,
    is_reset: bool,
}

/// A still background, in front of which textured stripes move to the right by 0.7 pixels a frame, and behind them
/// something else appears; the image under test lags, is blurred, and flickers.
fn made(extent: Extent, n_frames: usize, resets: &[usize]) -> Vec<Made> {
    let moves = move |y: u32| y % 12 >= 5;
    let stripe = move |x: u32, y: u32, index: usize| {
        let at = f64::from(x) - 0.7 * index as f64;
        let value = 0.5 + 0.4 * libm::sin(0.4 * at + f64::from(y)) + 0.1 * libm::cos(1.3 * at);
        [
            value as f32,
            0.6 * value as f32 + 0.1,
            3.0 * value as f32 * value as f32,
        ]
    };
    let reference = move |index: usize| {
        Image::from_fn(extent, |x, y| match moves(y) {
            true if noise(x / 4, y / 4, index as u32) < 0.05 => [noise(x, y, index as u32); 3],
            true => stripe(x, y, index),
            false => [noise(x / 3, y / 3, 1), 0.4, 0.2 + 0.1 * noise(x, y, 2)],
        })
    };
    let frame = |index: usize| {
        let (now, before) = (reference(index), reference(index.saturating_sub(1)));
        let fades = libm::pow(0.8, (index % 40) as f64) as f32;
        let test = Image::from_fn(extent, |x, y| {
            let around = now.clamped(i64::from(x) + 1, i64::from(y) - 1);
            let (here, ghost) = (now.at(x, y), before.at(x, y));
            let offset = 0.02 * (noise(x, y, 50 + index as u32) - 0.4) + 0.1 * fades;
            std::array::from_fn(|c| 0.7 * here[c] + 0.2 * ghost[c] + 0.1 * around[c] + offset)
        });
        let motion = Image::from_fn(extent, |x, y| match (moves(y), index) {
            (true, _) => [-0.7, 0.0],
            (false, 2) if x == 3 => [f32::NAN, f32::INFINITY],
            (false, _) => [0.0, 0.004 * noise(x, y, 3)],
        });
        Made {
            reference: Arc::new(now),
            test,
            motion: Arc::new(motion),
            is_reset: index == 0 || resets.contains(&index),
        }
    };
    (0..n_frames).map(frame).collect()
}

/// Scores of every frame and what the whole sequence tells; the first two frames after a reset are warm-up.
fn on_cpu(frames: &[Made], metrics: &[Metric]) -> (Vec<FrameScores>, Vec<LateValue>) {
    let mut track = Track::new(metrics);
    let mut previous: Option<Reference> = None;
    let mut age = 0;
    let scores = frames.iter().map(|frame| {
        let picture = Picture::linear(Arc::clone(&frame.reference), DISPLAY);
        age = if frame.is_reset { 0 } else { age + 1 };
        let reference = match &previous {
            None => Reference::new(picture, metrics),
            Some(previous) if frame.is_reset => previous.restart(picture),
            Some(previous) => previous.follow(picture, Some(&frame.motion)),
        };
        let test = Picture::linear(frame.test.clone(), DISPLAY);
        let scores = track.score(&reference, &test, age >= 2).unwrap();
        previous = Some(reference);
        scores
    });
    (scores.collect(), track.finish())
}

fn on_gpu(frames: &[Made], metrics: &[Metric]) -> (Vec<FrameScores>, Vec<LateValue>) {
    let mut device = DeviceScorer::new(frames[0].reference.extent(), DISPLAY, metrics);
    let mut age = 0;
    let scores = frames.iter().map(|frame| {
        age = if frame.is_reset { 0 } else { age + 1 };
        let motion = (!frame.is_reset).then_some(&*frame.motion);
        device.score(&frame.reference, &frame.test, motion, age >= 2)
    });
    let scores = scores.collect();
    (scores, device.finish())
}

/// Whether the GPU's value is the CPU's as far as f32 goes. NaN agrees with NaN alone.
fn agrees(metric: Metric, cpu: Value, gpu: Value, n_pixels: usize) -> bool {
    let tolerance = gpu_tolerance(metric, cpu.0, n_pixels);
    cpu == gpu || (cpu.0 - gpu.0).abs() <= tolerance || cpu.0.is_nan() && gpu.0.is_nan()
}

/// The differences that are too large; how far each metric is off is printed when a test fails.
fn compare(frames: &[Made], metrics: &[Metric]) {
    let n_pixels = frames[0].reference.extent().n_pixels();
    let ((cpu, cpu_late), (gpu, gpu_late)) = (on_cpu(frames, metrics), on_gpu(frames, metrics));
    let mut wrong = Vec::new();
    for (index, (cpu, gpu)) in cpu.iter().zip(&gpu).enumerate() {
        assert_eq!(cpu.non_finite_pixels, gpu.non_finite_pixels, "frame {index}");
        assert!(cpu.values.keys().eq(gpu.values.keys()), "frame {index}");
        for (id, value) in &cpu.values {
            let found = gpu.values[id];
            let close = match id.parse() {
                Ok(metric) => agrees(metric, *value, found, n_pixels),
                Err(_) => *value == found,
            };
            if !close {
                wrong.push(format!(
                    "frame {index}: {id}: {} on the GPU, {} on the CPU",
                    found.0, value.0
                ));
            }
        }
    }
    let sorted = |mut late: Vec<LateValue>| {
        late.sort_by_key(|late| (late.id, late.frame));
        late
    };
    let (cpu_late, gpu_late) = (sorted(cpu_late), sorted(gpu_late));
    let keys = |late: &[LateValue]| -> Vec<_> { late.iter().map(|late| (late.id, late.frame)).collect() };
    assert_eq!(keys(&cpu_late), keys(&gpu_late));
    for (cpu, gpu) in cpu_late.iter().zip(&gpu_late) {
        if !agrees(cpu.id.parse().unwrap(), cpu.value, gpu.value, n_pixels) {
            wrong.push(format!("{gpu:?} on the GPU, {cpu:?} on the CPU"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_long_sequence_converges_alike() {
    let extent = Extent::new(61, 37);
    let frames = made(extent, 40, &[4, 5]);
    compare(&frames, &all_metrics(extent));
}

#[test]
fn sizes_that_fill_no_workgroup() {
    for (width, height) in [(11, 11), (161, 161), (320, 180)] {
        let extent = Extent::new(width, height);
        compare(&made(extent, 4, &[]), &all_metrics(extent));
    }
}

#[test]
fn frames_that_are_not_finite_spoil_the_same_values() {
    let extent = Extent::new(61, 37);
    let mut frames = made(extent, 9, &[]);
    frames[3].test.pixels_mut()[700][1] = f32::NAN;
    let mut reference = (*frames[6].reference).clone();
    reference.pixels_mut()[200][0] = f32::INFINITY;
    frames[6].reference = Arc::new(reference);
    compare(&frames, &all_metrics(extent));
}

/// The fit divides by how much the reference changes: rounding of display values, about 1e-7, over that.
#[test]
fn a_reference_that_hardly_changes() {
    let extent = Extent::new(61, 37);
    let metrics = [Metric::GHOST, Metric::BLUR];
    for change in [1e-2_f32, 1e-3, 1e-4] {
        let reference = |index: usize| {
            let factor = |x, y| 1.0 + change * (noise(x, y, 90 + index as u32) - 0.5);
            Image::from_fn(extent, |x, y| {
                [0.2 + 0.3 * noise(x / 3, y / 3, 1), 0.4, 0.2 + 0.1 * noise(x, y, 2)].map(|c| c * factor(x, y))
            })
        };
        let frame = |index: usize| {
            let (now, before) = (reference(index), reference(index.saturating_sub(1)));
            Made {
                test: Image::from_fn(extent, |x, y| {
                    std::array::from_fn(|c| 0.8 * now.at(x, y)[c] + 0.2 * before.at(x, y)[c])
                }),
                reference: Arc::new(now),
                motion: Arc::new(Image::filled(extent, [0.0; 2])),
                is_reset: index == 0,
            }
        };
        let frames: Vec<_> = (0..2).map(frame).collect();
        let [cpu, gpu] = [on_cpu(&frames, &metrics), on_gpu(&frames, &metrics)].map(|(scores, _)| scores[1].clone());
        for metric in metrics {
            let [cpu, gpu] = [&cpu, &gpu].map(|scores| scores.values[metric.id()].0);
            let tolerance = 1e-7 / f64::from(change);
            assert!((cpu - gpu).abs() < tolerance, "{metric} at {change}: {gpu}, CPU {cpu}");
        }
    }
}

/// The comparison can say no: of frames in another order, moved by a pixel, or of another image.
#[test]
fn other_frames_have_other_values() {
    let extent = Extent::new(61, 37);
    let metrics: Vec<_> = all_metrics(extent)
        .into_iter()
        .filter(|metric| !metric.is_late())
        .collect();
    let frames = made(extent, 3, &[]);
    let shift = |mut made: Vec<Made>| {
        let test = made[2].test.clone();
        made[2].test = Image::from_fn(extent, |x, y| test.clamped(i64::from(x) - 1, i64::from(y)));
        made
    };
    let swap = |mut made: Vec<Made>| {
        let reference = Arc::new(made[2].test.clone());
        made[2].test = (*made[2].reference).clone();
        made[2].reference = reference;
        made
    };
    let right = &on_gpu(&frames, &metrics).0[2];
    let n_pixels = extent.n_pixels();
    for (what, others) in [
        ("shifted", shift(made(extent, 3, &[]))),
        ("swapped", swap(made(extent, 3, &[]))),
    ] {
        let wrong = &on_gpu(&others, &metrics).0[2];
        for metric in &metrics {
            // Some metrics of two images know no reference: tests/it/negative_controls.rs. Changes know what came before.
            let is_change = metric.is_temporal() && metric.mask().is_none();
            if what == "swapped" && !is_change {
                continue;
            }
            let [right, wrong] = [right, wrong].map(|scores| scores.values.get(metric.id()).copied());
            let (Some(right), Some(wrong)) = (right, wrong) else {
                continue;
            };
            assert!(
                !agrees(*metric, right, wrong, n_pixels),
                "{what}: {metric} is still {wrong:?}"
            );
        }
    }
}
