//! Temporal metrics against sequences whose answers are known by hand, and against defects that they must see.

use crate::{
    golden::{agree, fixture},
    support::{DeviceScorer, cpu_scores, gpu_tolerance, noise},
};
use afterimage::{
    image::{Extent, Image},
    metrics::{Display, FrameScores, LateValue, Metric, Picture, Reference, Track, display::linear_from_srgb},
    sequence::frame::Rgb,
};
use serde::Deserialize;
use std::{collections::BTreeMap, sync::Arc};

const EXTENT: Extent = Extent::new(48, 32);
const TEMPORAL: [Metric; 8] = [
    Metric::TPSNR,
    Metric::WARPED_TPSNR,
    Metric::WARP_EXCESS,
    Metric::FLICKER,
    Metric::FLICKER_LOCAL,
    Metric::GHOST,
    Metric::BLUR,
    Metric::CONVERGE_FRAMES,
];

/// A smooth grey pattern, moved right by `shift` pixels.
fn pattern(x: f64, y: f64, shift: f64) -> f64 {
    0.5 + 0.2 * libm::sin(0.35 * (x - shift)) + 0.15 * libm::cos(0.5 * y + 0.2 * (x - shift))
}

/// The linear image that shows these grey display values.
fn grey(display: impl Fn(u32, u32) -> f64 + Sync) -> Image<Rgb> {
    Image::from_fn(EXTENT, |x, y| [linear_from_srgb(display(x, y)) as f32; 3])
}

fn reference(index: usize, speed: f64) -> Image<Rgb> {
    grey(|x, y| pattern(x.into(), y.into(), speed * index as f64))
}

fn picture(image: Image<Rgb>) -> Picture {
    Picture::linear(image, Display::default())
}

/// Scores `n_frames` of a pattern that moves right, against what `test` makes of them. Resets at `resets`.
fn run(
    n_frames: usize,
    speed: f64,
    resets: &[usize],
    test: impl Fn(usize) -> Image<Rgb>,
) -> (Vec<FrameScores>, Vec<LateValue>) {
    run_metrics(&TEMPORAL, n_frames, speed, resets, test)
}

fn run_metrics(
    metrics: &[Metric],
    n_frames: usize,
    speed: f64,
    resets: &[usize],
    test: impl Fn(usize) -> Image<Rgb>,
) -> (Vec<FrameScores>, Vec<LateValue>) {
    let motion = Arc::new(Image::filled(EXTENT, [-speed as f32, 0.0]));
    let mut track = Track::new(metrics);
    let mut previous: Option<Reference> = None;
    let mut scores = Vec::new();
    for index in 0..n_frames {
        let frame = picture(reference(index, speed));
        let frame = match &previous {
            None => Reference::new(frame, metrics),
            Some(previous) if resets.contains(&index) => Reference::restart(previous, frame),
            Some(previous) => previous.follow(frame, Some(&motion)),
        };
        scores.push(track.score(&frame, &picture(test(index)), true).unwrap());
        previous = Some(frame);
    }
    (scores, track.finish())
}

#[track_caller]
fn assert_near(actual: f64, expected: f64) {
    assert!((actual - expected).abs() < 1e-5, "{actual}, not {expected}");
}

#[test]
fn flicker_of_a_still_image_by_hand() {
    let amplitude = 0.02;
    let sign = |index: usize| if index.is_multiple_of(2) { amplitude } else { -amplitude };
    let (scores, late) = run(6, 0.0, &[], |index| {
        grey(|x, y| pattern(x.into(), y.into(), 0.0) + sign(index))
    });
    assert!(scores[0].values.is_empty(), "nothing comes before: {:?}", scores[0]);
    for scores in &scores[1..] {
        let value = |id: &str| scores.values[id].0;
        let step_db = -20.0 * libm::log10(2.0 * amplitude);
        assert!((value("tpsnr") - step_db).abs() < 1e-3);
        assert!((value("warped_tpsnr") - step_db).abs() < 1e-3);
        assert_near(value("warp_excess"), 2.0 * amplitude);
        assert_near(value("flicker"), 2.0 * amplitude);
        assert!(
            !scores.values.contains_key("ghost"),
            "a still reference leaves no ghost"
        );
    }
    let [
        LateValue {
            frame: 5,
            id: "flicker.local",
            value,
        },
    ] = late[..]
    else {
        panic!("{late:?}");
    };
    assert_near(value.0, amplitude);
}

#[test]
fn ghost_and_blur_are_told_apart() {
    let (ghost, blur) = (0.2, 0.35);
    let box3 = |x: u32, y: u32, shift: f64| {
        let clamp = |at: u32, by: i32, size: u32| f64::from((at as i32 + by).clamp(0, size as i32 - 1));
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
        let sum: f64 = around
            .map(|(dx, dy)| pattern(clamp(x, dx, EXTENT.width), clamp(y, dy, EXTENT.height), shift))
            .sum();
        sum / 9.0
    };
    let (scores, _) = run(4, 1.0, &[], |index| {
        grey(|x, y| {
            let now = pattern(x.into(), y.into(), index as f64);
            let before = pattern(x.into(), y.into(), index as f64 - 1.0);
            now + ghost * (before - now) + blur * (box3(x, y, index as f64) - now)
        })
    });
    for scores in &scores[1..] {
        assert!((scores.values["ghost"].0 - ghost).abs() < 1e-4, "{scores:?}");
        assert!((scores.values["blur"].0 - blur).abs() < 1e-4, "{scores:?}");
    }
}

#[test]
fn along_the_motion_a_pan_does_not_change() {
    let (scores, late) = run(5, 1.0, &[3], |index| reference(index, 1.0));
    for (index, scores) in scores.iter().enumerate() {
        if index == 0 || index == 3 {
            assert!(scores.values.is_empty(), "frame {index} follows none: {scores:?}");
            continue;
        }
        assert_eq!(scores.values["warped_tpsnr"].0, f64::INFINITY);
        assert_eq!(scores.values["tpsnr"].0, f64::INFINITY);
        for id in ["warp_excess", "flicker", "ghost", "blur"] {
            assert_eq!(scores.values[id].0, 0.0, "{id}");
        }
    }
    assert_eq!(late.len(), 1, "no stretch is long enough to converge: {late:?}");
}

#[test]
fn noise_along_the_motion_is_an_excess_and_a_blur_is_a_lack() {
    let noisy = |index: usize| {
        grey(|x, y| pattern(x.into(), y.into(), 0.5 * index as f64) + 0.05 * f64::from(noise(x, y, index as u32) - 0.5))
    };
    let (scores, _) = run(3, 0.5, &[], noisy);
    assert!(scores[2].values["warp_excess"].0 > 0.01, "{:?}", scores[2]);
    // Half a pixel's interpolation changes the reference; a flat image does not change at all.
    let (scores, _) = run(3, 0.5, &[], |_| grey(|_, _| 0.5));
    assert!(scores[2].values["warp_excess"].0 < 0.0, "{:?}", scores[2]);
}

#[test]
fn frames_to_converge_by_hand() {
    // 20 dB at first, 3 dB more with every frame up to the tenth, the same from there on.
    let error = |age: usize| 0.1 * libm::pow(10.0, -3.0 / 20.0 * age.min(10) as f64);
    let resets = [0, 40];
    let (_, late) = run(73, 0.0, &resets, |index| {
        let age = if index < 40 { index } else { index - 40 };
        grey(|x, y| pattern(x.into(), y.into(), 0.0) + error(age))
    });
    let converged: Vec<_> = late.iter().filter(|late| late.id == "converge_frames").collect();
    let found: Vec<_> = converged.iter().map(|late| (late.frame, late.value.0)).collect();
    assert_eq!(found, [(0, 10.0), (40, 10.0)]);
}

/// A bad pixel spoils its frame and the change to the next one, and no other.
#[test]
fn a_non_finite_pixel_spoils_two_changes() {
    let (scores, late) = run(5, 1.0, &[], |index| {
        let mut image = reference(index, 1.0);
        if index == 2 {
            image.pixels_mut()[77][1] = f32::NAN;
        }
        image
    });
    let bad: Vec<bool> = scores[1..]
        .iter()
        .map(|scores| scores.values["tpsnr"].0.is_nan())
        .collect();
    assert_eq!(bad, [false, true, true, false]);
    assert!(late[0].value.0.is_nan(), "{late:?}");
}

#[test]
fn two_images_have_no_temporal_value() {
    let image = reference(0, 0.0);
    let error = cpu_scores(&image, &image, Display::default(), &[Metric::FLICKER]);
    assert!(error.unwrap_err().to_string().contains("`flicker` needs a sequence"));
}

/// Of a sequence in `fixtures/golden`.
const GOLDEN: Extent = Extent::new(64, 40);
const GOLDEN_METRICS: [Metric; 7] = [
    Metric::TPSNR,
    Metric::WARPED_TPSNR,
    Metric::WARP_EXCESS,
    Metric::FLICKER,
    Metric::FLICKER_LOCAL,
    Metric::GHOST,
    Metric::BLUR,
];

#[derive(Deserialize)]
struct GoldenSequence {
    /// From the second frame on.
    frames: Vec<BTreeMap<Metric, f64>>,
    #[serde(rename = "flicker.local")]
    flicker_local: f64,
}

fn golden_codes(name: &str) -> Vec<Image<[u16; 3]>> {
    let bytes = std::fs::read(fixture(&format!("seq_{name}.rgb8"))).unwrap();
    let frames = bytes.chunks_exact(3 * GOLDEN.n_pixels()).map(|frame| {
        let pixels = frame.as_chunks().0.iter().map(|pixel: &[u8; 3]| pixel.map(u16::from));
        Image::from_pixels(GOLDEN, pixels.collect())
    });
    frames.collect()
}

fn golden_motion() -> Arc<Image<[f32; 2]>> {
    Arc::new(Image::filled(GOLDEN, [-1.5, 0.0]))
}

/// Scores of every frame, and `flicker.local` of all.
type Scored = (Vec<FrameScores>, f64);

fn golden_on_cpu(name: &str) -> Scored {
    let mut track = Track::new(&GOLDEN_METRICS);
    let mut previous: Option<Reference> = None;
    let mut scores = Vec::new();
    for (reference, test) in golden_codes("ref").into_iter().zip(golden_codes(name)) {
        let reference = Picture::codes(reference, 255);
        let mut reference = match &previous {
            None => Reference::new(reference, &GOLDEN_METRICS),
            Some(previous) => previous.follow(reference, Some(&golden_motion())),
        };
        scores.push(track.score(&reference, &Picture::codes(test, 255), true).unwrap());
        reference.retire();
        previous = Some(reference);
    }
    (scores, track.finish()[0].value.0)
}

fn golden_on_gpu(name: &str) -> Scored {
    let mut device = DeviceScorer::new(GOLDEN, Display::default(), &GOLDEN_METRICS);
    let linear =
        |codes: Image<[u16; 3]>| codes.map(|pixel| pixel.map(|code| linear_from_srgb(f64::from(code) / 255.0) as f32));
    let motion = golden_motion();
    let frames = golden_codes("ref").into_iter().zip(golden_codes(name)).enumerate();
    let scores = frames.map(|(index, (reference, test))| {
        let motion = (index > 0).then_some(&*motion);
        device.score(&Arc::new(linear(reference)), &linear(test), motion, true)
    });
    (scores.collect(), device.finish()[0].value.0)
}

/// What differs from the golden values of a sequence.
fn golden_differences(
    name: &str,
    (scores, flicker_local): &Scored,
    tolerance: impl Fn(Metric, f64) -> f64,
) -> Vec<String> {
    let golden = std::fs::read(fixture("temporal.json")).unwrap();
    let golden: BTreeMap<String, GoldenSequence> = serde_json::from_slice(&golden).unwrap();
    let golden = &golden[name];
    assert_eq!(scores.len(), golden.frames.len() + 1);
    let mut all = vec![(Metric::FLICKER_LOCAL, *flicker_local, golden.flicker_local)];
    for (scores, frame) in scores[1..].iter().zip(&golden.frames) {
        assert_eq!(frame.len(), GOLDEN_METRICS.len() - 1);
        all.extend(
            frame
                .iter()
                .map(|(metric, value)| (*metric, scores.values[metric.id()].0, *value)),
        );
    }
    let wrong = all
        .into_iter()
        .filter(|(metric, actual, expected)| !agree(*actual, *expected, tolerance(*metric, *expected)));
    wrong
        .map(|(metric, actual, expected)| format!("{name}: {metric} is {actual}, not {expected}"))
        .collect()
}

#[test]
fn golden_sequences_match_on_the_cpu() {
    for name in ["blur", "flicker", "ghost"] {
        let wrong = golden_differences(name, &golden_on_cpu(name), |_, _| 1e-9);
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }
}

/// Errors are those of display values, about 1e-7, which is all that is left of a change at 57 dB.
#[test]
fn golden_sequences_match_on_the_gpu() {
    for name in ["blur", "flicker", "ghost"] {
        let wrong = golden_differences(name, &golden_on_gpu(name), |metric, value| {
            gpu_tolerance(metric, value, GOLDEN.n_pixels())
        });
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }
}

#[test]
fn golden_sequences_are_told_apart() {
    let wrong = golden_differences("blur", &golden_on_cpu("ghost"), |_, _| 1e-3);
    for metric in GOLDEN_METRICS.into_iter().filter(|metric| *metric != Metric::FLICKER) {
        assert!(
            wrong.iter().any(|line| line.contains(&format!(" {metric} is"))),
            "{metric} of blur passes for ghost"
        );
    }
}

/// Noise that is new in every frame, more and more of it.
#[test]
fn temporal_metrics_get_worse_as_noise_grows() {
    let worse_with_noise = [
        Metric::TPSNR,
        Metric::WARPED_TPSNR,
        Metric::WARP_EXCESS,
        Metric::FLICKER_LOCAL,
    ];
    let noisy = |amplitude: f64| {
        let (scores, late) = run_metrics(&worse_with_noise, 4, 1.0, &[], |index| {
            let offset = |x, y| amplitude * f64::from(noise(x, y, index as u32) - 0.5);
            grey(|x, y| pattern(x.into(), y.into(), index as f64) + offset(x, y))
        });
        let last = scores[3].values.iter().map(|(id, value)| (*id, value.0));
        last.chain(late.iter().map(|late| (late.id, late.value.0)))
            .collect::<BTreeMap<_, _>>()
    };
    let mut previous = noisy(0.0);
    for amplitude in [0.01, 0.03, 0.1, 0.3] {
        let values = noisy(amplitude);
        for metric in worse_with_noise {
            let (now, before) = (values[metric.id()], previous[metric.id()]);
            let worse = match metric.info().unit {
                "dB" => now < before,
                _ => now > before,
            };
            assert!(worse, "{metric} at {amplitude}: {now} after {before}");
        }
        previous = values;
    }
}
