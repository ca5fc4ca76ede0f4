//! What must fail, fails: every metric on known-bad input, on the CPU and on the GPU.

use crate::{
    golden::{PAIRS, agree, fixture, hdr, reader, scores},
    support::{DeviceScorer, cpu_scores, metrics_for, noise},
};
use afterimage::{
    compare::{CompareError, Comparison, Criteria, compare},
    image::{
        Extent, Image,
        files::exr::{FloatFormat, write_rgb_exr},
    },
    metrics::{Better, Display, FrameScores, Metric},
    sequence::frame::Rgb,
};
use std::sync::Arc;

const EXTENT: Extent = Extent::new(67, 41);

fn picture() -> Image<Rgb> {
    Image::from_fn(EXTENT, |x, y| {
        [noise(x / 3, y / 3, 1), 0.5 * noise(x, y, 2), y as f32 / 41.0]
    })
}

fn noisy(amplitude: f32) -> Image<Rgb> {
    let picture = picture();
    Image::from_fn(EXTENT, |x, y| {
        picture.at(x, y).map(|c| c + amplitude * (noise(x, y, 5) - 0.5))
    })
}

fn on_cpu(reference: &Image<Rgb>, test: &Image<Rgb>) -> FrameScores {
    cpu_scores(reference, test, Display::default(), &metrics_for(EXTENT)).unwrap()
}

/// Every pair is scored as if it followed nothing.
fn on_gpu() -> impl FnMut(&Image<Rgb>, &Image<Rgb>) -> FrameScores {
    let mut device = DeviceScorer::new(EXTENT, Display::default(), &metrics_for(EXTENT));
    move |reference, test| device.score(&Arc::new(reference.clone()), test, None, true)
}

/// Scores a reference and a test image.
type Score = dyn FnMut(&Image<Rgb>, &Image<Rgb>) -> FrameScores;

/// The golden comparison is only worth something if it can say no.
#[test]
fn the_golden_comparison_tells_pairs_apart() {
    for (pair, _) in PAIRS.into_iter().filter(|&(pair, _)| pair != "noise") {
        let (right, wrong) = (
            scores("base_ref.png", "noise_test.png"),
            scores("base_ref.png", &format!("{pair}_test.png")),
        );
        for metric in metrics_for(EXTENT) {
            assert!(
                !agree(wrong[metric.id()].0, right[metric.id()].0, 1e-5),
                "{metric} of {pair} passes for noise"
            );
        }
    }
    assert!(!agree(f64::NAN, f64::NAN, 1.0) && !agree(f64::INFINITY, 99.0, 1e9));
}

/// Only these know which image is the reference.
#[test]
fn swapping_changes_snr_and_rel_mse_and_hdr_flip_alone() {
    let (a, b) = (picture(), noisy(0.5));
    let mut on_gpu = on_gpu();
    // Drivers add up in an order of their own: the same but for rounding.
    for (forth, back, rounding) in [
        (on_cpu(&a, &b), on_cpu(&b, &a), 0.0),
        (on_gpu(&a, &b), on_gpu(&b, &a), 1e-6),
    ] {
        for metric in metrics_for(EXTENT) {
            let [forth, back] = [&forth, &back].map(|scores| scores.values[metric.id()].0);
            let same = (forth - back).abs() <= rounding * forth.abs();
            let symmetric = ![Metric::SNR, Metric::REL_MSE, Metric::HDR_FLIP].contains(&metric);
            assert_eq!(same, symmetric, "{metric}");
        }
    }
}

#[test]
fn a_shift_by_one_pixel_is_seen_by_every_metric() {
    let picture = picture();
    let shifted = Image::from_fn(EXTENT, |x, y| picture.clamped(i64::from(x) - 1, i64::from(y)));
    let mut on_gpu = on_gpu();
    let mut on_cpu = on_cpu;
    let both: [&mut Score; 2] = [&mut on_cpu, &mut on_gpu];
    for scores in both {
        let (right, wrong) = (scores(&picture, &noisy(0.02)), scores(&picture, &shifted));
        for metric in metrics_for(EXTENT) {
            let [right, wrong] = [&right, &wrong].map(|scores| scores.values[metric.id()].0);
            let info = metric.info();
            let worse = match (info.better, info.unit) {
                (Better::Lower, _) => wrong > 1.5 * right,
                (Better::Higher, "dB") => wrong < right - 6.0,
                (Better::Higher, _) => wrong < right - 0.1,
            };
            assert!(worse, "{metric}: shifted {wrong}, right {right}");
        }
    }
}

/// One pixel in either image, with everything else equal: no metric may come out perfect, or as any number at all.
#[test]
fn a_non_finite_pixel_spoils_every_metric_and_is_counted() {
    let mut on_gpu = on_gpu();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for at in [0, 66, 41 * 67 / 2, 41 * 67 - 1] {
            let (good, mut spoilt) = (picture(), picture());
            spoilt.pixels_mut()[at][1] = bad;
            for (reference, test) in [(&good, &spoilt), (&spoilt, &good), (&spoilt, &spoilt)] {
                for scores in [on_cpu(reference, test), on_gpu(reference, test)] {
                    assert_eq!(scores.non_finite_pixels, 1, "{bad} at {at}");
                    assert_eq!(scores.values.len(), metrics_for(EXTENT).len(), "{scores:?}");
                    assert!(
                        scores.values.values().all(|value| value.0.is_nan()),
                        "{bad} at {at}: {scores:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn bad_pixels_of_both_images_are_counted_once() {
    let (mut a, mut b) = (picture(), picture());
    for at in [3, 4] {
        a.pixels_mut()[at][0] = f32::NAN;
    }
    for at in [4, 5] {
        b.pixels_mut()[at][2] = f32::INFINITY;
    }
    assert_eq!(
        [on_cpu(&a, &b), on_gpu()(&a, &b)].map(|scores| scores.non_finite_pixels),
        [3, 3]
    );
}

#[test]
fn images_that_do_not_fit_are_refused_by_name() {
    let small = |metrics: &[Metric], width, height| {
        let image = Image::filled(Extent::new(width, height), [0.5; 3]);
        cpu_scores(&image, &image, Display::default(), metrics)
    };
    assert!(small(&[Metric::SSIM, Metric::FLIP], 11, 11).is_ok());
    assert!(small(&[Metric::MS_SSIM_Y], 161, 161).is_ok());
    assert!(small(&[Metric::MS_SSIM_Y], 161, 160).is_err());
    assert!(small(&[Metric::PSNR], 1, 1).is_ok());
    for (width, height) in [(10, 50), (50, 10)] {
        let error = small(&[Metric::PSNR, Metric::SSIM_Y], width, height)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("`ssim.y`") && error.contains(&format!("{width}×{height}")),
            "{error}"
        );
    }
}

fn criteria() -> Criteria {
    Criteria {
        metrics: vec![Metric::PSNR],
        display: Display::default(),
    }
}

#[test]
fn compare_names_what_does_not_match() {
    let error = |a: &str, b: &str| {
        compare(&reader(), &fixture(a), &fixture(b), &criteria())
            .unwrap_err()
            .to_string()
    };
    assert!(error("base_ref.png", "missing.png").contains("missing.png"));
    assert!(error("base_ref.png", ".").contains("two images or two folders"));

    let [a, b] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let compare_folders = || compare(&reader(), a.path(), b.path(), &criteria());
    assert!(matches!(compare_folders(), Err(CompareError::Empty(_))));
    let copy = |folder: &tempfile::TempDir, name: &str, from: &str| {
        std::fs::copy(fixture(from), folder.path().join(name)).unwrap();
    };
    copy(&a, "1.png", "base_ref.png");
    copy(&b, "1.png", "identical_test.png");
    copy(&a, "2.png", "base_ref.png");
    let message = compare_folders().unwrap_err().to_string();
    assert!(
        message.contains("2.png") && message.contains(&b.path().display().to_string()),
        "{message}"
    );

    copy(&b, "2.png", "noise_test.png");
    let Comparison::Folders { frames, summary } = compare_folders().unwrap() else {
        panic!("two folders");
    };
    assert_eq!(
        frames.iter().map(|frame| frame.name.as_str()).collect::<Vec<_>>(),
        ["1.png", "2.png"]
    );
    assert_eq!(
        (summary["psnr"].infinite, summary["psnr"].mean),
        (1, frames[1].scores.metrics["psnr"])
    );
    let json = serde_json::to_value(compare_folders().unwrap()).unwrap();
    assert_eq!(json["frames"][0]["metrics"]["psnr"], "inf");
}

#[test]
fn compare_counts_bad_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let mut image = hdr("hdr_test.exr");
    image.pixels_mut()[7][0] = f32::NAN;
    let spoilt = folder.path().join("spoilt.exr");
    write_rgb_exr(&spoilt, &image, FloatFormat::Float).unwrap();
    let comparison = compare(&reader(), &fixture("hdr_ref.exr"), &spoilt, &criteria()).unwrap();
    assert_eq!(comparison.non_finite_pixels(), 1);
    assert_eq!(serde_json::to_value(comparison).unwrap()["metrics"]["psnr"], "nan");
}
