//! The metrics, on the CPU and on the GPU, against independent implementations: `fixtures/golden`, whose README says what made each value.

use crate::support::{DeviceScorer, cpu_scores, gpu_scores, gpu_tolerance, metrics_for, noise, perfect};
use afterimage::{
    compare::{Comparison, Criteria, compare},
    gpu::{Variant, Workgroup},
    image::{
        Extent, Image,
        files::{Backend, FileReader, Limits},
    },
    metrics::{Display, Metric, Picture, Tonemap, Value, Values, display::linear_from_srgb, map::Map},
};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Of a CPU metric, in dB or in units of the index.
fn cpu_tolerance(metric: Metric) -> f64 {
    match metric.id() {
        "ms_ssim.y" => 1e-6,
        "flip" | "flip.p95" | "hdr_flip" => 1e-4,
        _ => 1e-9,
    }
}

/// Of every pair.
pub const EXTENT: Extent = Extent::new(256, 192);

/// The 8-bit pairs, and the reference image of each.
pub const PAIRS: [(&str, &str); 9] = [
    ("blur3", "base"),
    ("flat", "flat"),
    ("halfpx", "base"),
    ("identical", "base"),
    ("invert", "base"),
    ("noise", "base"),
    ("one_pixel", "base"),
    ("plus10", "plus10"),
    ("shift1", "base"),
];

/// Names in `golden.json` of what our metrics compute on 8-bit pairs. `ssim.y` is missing there: its luma is Rec. 601.
const NAMES: [(Metric, &str); 12] = [
    (Metric::MSE, "mse_float"),
    (Metric::PSNR, "psnr_float_rgb"),
    (Metric::PSNR, "skimage_psnr"),
    (Metric::PSNR_U8, "psnr8_rgb"),
    (Metric::PSNR_Y, "psnr8_luma709"),
    (Metric::PSNR_LINEAR, "psnr_linear_rgb"),
    (Metric::SNR, "snr_db"),
    (Metric::SSIM, "skimage_ssim_rgb"),
    (Metric::SSIM, "ssim_rgb_valid"),
    (Metric::SSIM_U8, "skimage_ssim_rgb"),
    (Metric::SSIM_U8, "ssim_rgb_valid"),
    (Metric::FLIP, "flip_ldr_mean"),
];

#[derive(Deserialize)]
struct Golden {
    pairs8: BTreeMap<String, BTreeMap<String, serde_json::Value>>,
    hdr: BTreeMap<String, serde_json::Value>,
}

/// Values by metric id.
#[derive(Deserialize)]
struct Additional {
    pairs8: BTreeMap<String, BTreeMap<Metric, Value>>,
    hdr: Vec<HdrValues>,
}

#[derive(Deserialize)]
struct HdrValues {
    display: Display,
    values: BTreeMap<Metric, Value>,
}

pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/golden").join(name)
}

fn json<T: serde::de::DeserializeOwned>(name: &str) -> T {
    serde_json::from_slice(&std::fs::read(fixture(name)).unwrap()).unwrap()
}

pub fn reader() -> FileReader {
    FileReader::new(Backend::Auto, Limits::default())
}

pub fn hdr(name: &str) -> Image<[f32; 3]> {
    reader().read_rgb(&fixture(name)).unwrap().image
}

pub fn scores(reference: &str, test: &str) -> Values {
    let criteria = Criteria {
        metrics: metrics_for(EXTENT),
        display: Display::default(),
    };
    match compare(&reader(), &fixture(reference), &fixture(test), &criteria).unwrap() {
        Comparison::Images(scores) => scores.metrics,
        Comparison::Folders { .. } => panic!("two files"),
    }
}

/// Equal infinities agree; NaN agrees with nothing.
pub fn agree(actual: f64, expected: f64, tolerance: f64) -> bool {
    actual == expected || (actual - expected).abs() <= tolerance
}

#[track_caller]
fn assert_agree(what: &str, metric: Metric, actual: Value, expected: Value) {
    let (actual, expected) = (actual.0, expected.0);
    assert!(
        agree(actual, expected, cpu_tolerance(metric)),
        "{what}: {metric}: {actual} instead of {expected}"
    );
}

#[test]
fn eight_bit_pairs_match_published_implementations() {
    let golden: Golden = json("golden.json");
    let additional: Additional = json("additional.json");
    assert_eq!(golden.pairs8.len(), PAIRS.len());
    for (pair, reference) in PAIRS {
        let actual = scores(&format!("{reference}_ref.png"), &format!("{pair}_test.png"));
        for (metric, name) in NAMES {
            let expected = serde_json::from_value(golden.pairs8[pair][name].clone()).unwrap();
            assert_agree(&format!("{pair} against {name}"), metric, actual[metric.id()], expected);
        }
        for (metric, expected) in &additional.pairs8[pair] {
            assert_agree(pair, *metric, actual[metric.id()], *expected);
        }
    }
}

#[test]
fn flip_matches_the_published_maps_and_percentiles() {
    let golden: Golden = json("golden.json");
    for (pair, reference) in PAIRS {
        let values = scores(&format!("{reference}_ref.png"), &format!("{pair}_test.png"));
        let expected = golden.pairs8[pair]["flip_ldr_p50_p95_max"][1].as_f64().unwrap();
        assert_agree(pair, Metric::FLIP_P95, values["flip.p95"], Value(expected));
    }
    for pair in ["blur3", "noise", "shift1"] {
        let [reference, test] = ["base_ref.png".to_owned(), format!("{pair}_test.png")]
            .map(|name| Picture::linear(linear(&name), Display::default()));
        let map = Map::new(Metric::FLIP, &reference, &test).unwrap().values;
        let bytes = std::fs::read(fixture(&format!("{pair}_flip.f32"))).unwrap();
        let expected = bytes
            .chunks_exact(4)
            .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()));
        assert_eq!(expected.len(), map.pixels().len());
        for (i, (actual, expected)) in map.pixels().iter().zip(expected).enumerate() {
            assert!(
                (actual - expected).abs() < 2e-3,
                "{pair}, pixel {i}: {actual}, not {expected}"
            );
        }
    }
}

/// The published values are of Rec. 601 luma, so they are compared on grey images of that luma.
#[test]
fn ms_ssim_matches_published_implementations() {
    let golden: Golden = json("golden.json");
    let grey = |name: String| {
        let encoded = reader().read_rgb(&fixture(&name)).unwrap().image;
        encoded.map(|[r, g, b]| {
            let luma = 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
            [linear_from_srgb(luma) as f32; 3]
        })
    };
    for (pair, reference) in PAIRS {
        let [reference, test] = [format!("{reference}_ref.png"), format!("{pair}_test.png")].map(grey);
        let scores = cpu_scores(&reference, &test, Display::default(), &[Metric::MS_SSIM_Y]);
        let expected = golden.pairs8[pair]["msssim_luma601"].as_f64().unwrap();
        assert_agree(
            pair,
            Metric::MS_SSIM_Y,
            scores.unwrap().values["ms_ssim.y"],
            Value(expected),
        );
    }
}

#[test]
fn equal_images_are_perfect_to_the_last_bit() {
    let scores = scores("base_ref.png", "identical_test.png");
    for metric in metrics_for(EXTENT) {
        assert_eq!(scores[metric.id()], Value(perfect(metric)), "{metric}");
    }
}

#[test]
fn hdr_pair_matches_under_every_display_transform() {
    let (reference, test) = (hdr("hdr_ref.exr"), hdr("hdr_test.exr"));
    let additional: Additional = json("additional.json");
    assert_eq!(additional.hdr.len(), 6);
    for HdrValues { display, values } in additional.hdr {
        let actual = cpu_scores(&reference, &test, display, &metrics_for(EXTENT)).unwrap();
        for (metric, expected) in values {
            assert_agree(&format!("{display:?}"), metric, actual.values[metric.id()], expected);
        }
    }
}

#[test]
fn hdr_pair_matches_the_published_values() {
    let (reference, test) = (hdr("hdr_ref.exr"), hdr("hdr_test.exr"));
    let golden: Golden = json("golden.json");
    let expected = |name: &str| golden.hdr[name].as_f64().unwrap();
    let metrics = [Metric::PSNR, Metric::PSNR_LINEAR, Metric::REL_MSE, Metric::HDR_FLIP];
    let scores = cpu_scores(&reference, &test, Display::default(), &metrics).unwrap();
    for (metric, expected) in [
        (Metric::PSNR, expected("psnr_clip_srgb")),
        (Metric::PSNR_LINEAR, -10.0 * libm::log10(expected("mse"))),
        (Metric::REL_MSE, expected("relMSE_eps1e-2")),
        (Metric::HDR_FLIP, expected("flip_hdr_mean")),
    ] {
        assert_agree("hdr", metric, scores.values[metric.id()], Value(expected));
    }
    let parameters = &golden.hdr["flip_hdr_params"];
    for (ours, name) in [("start", "startExposure"), ("stop", "stopExposure")] {
        let (actual, expected) = (
            scores.values[&*format!("hdr_flip.{ours}_exposure")].0,
            parameters[name].as_f64(),
        );
        assert!((actual - expected.unwrap()).abs() < 1e-5, "{name}: {actual}");
    }
}

/// The linear image that a display shows as these 8-bit codes.
fn linear(name: &str) -> Image<[f32; 3]> {
    let encoded = reader().read_rgb(&fixture(name)).unwrap().image;
    encoded.map(|pixel| pixel.map(|c| linear_from_srgb(f64::from(c)) as f32))
}

/// Against `expected`; what it has no value of is not compared.
#[track_caller]
fn assert_on_gpu(what: &str, actual: &Values, expected: impl IntoIterator<Item = (Metric, Value)>, extent: Extent) {
    for (metric, Value(expected)) in expected {
        let actual = actual[metric.id()].0;
        let tolerance = gpu_tolerance(metric, expected, extent.n_pixels());
        assert!(
            agree(actual, expected, tolerance),
            "{what}: {metric}: {actual} on the GPU, not {expected}"
        );
    }
}

#[test]
fn gpu_matches_published_implementations_on_eight_bit_pairs() {
    let additional: Additional = json("additional.json");
    let mut device = DeviceScorer::new(EXTENT, Display::default(), &metrics_for(EXTENT));
    for (pair, reference) in PAIRS {
        let (reference, test) = (
            linear(&format!("{reference}_ref.png")),
            linear(&format!("{pair}_test.png")),
        );
        let cpu = cpu_scores(&reference, &test, Display::default(), &metrics_for(EXTENT)).unwrap();
        let actual = device.score(&Arc::new(reference), &test, None, true).values;
        assert_on_gpu(pair, &actual, additional.pairs8[pair].clone(), EXTENT);
        let on_cpu = metrics_for(EXTENT)
            .into_iter()
            .map(|metric| (metric, cpu.values[metric.id()]));
        assert_on_gpu(pair, &actual, on_cpu, EXTENT);
    }
}

#[test]
fn gpu_matches_the_hdr_pair_under_every_display_transform() {
    let additional: Additional = json("additional.json");
    let (reference, test) = (hdr("hdr_ref.exr"), hdr("hdr_test.exr"));
    for HdrValues { display, values } in additional.hdr {
        let metrics = metrics_for(EXTENT);
        let actual = gpu_scores(&reference, &test, display, &metrics).values;
        assert_on_gpu(&format!("{display:?}"), &actual, values, EXTENT);
        let cpu = cpu_scores(&reference, &test, display, &metrics).unwrap();
        let on_cpu = metrics.into_iter().map(|metric| (metric, cpu.values[metric.id()]));
        assert_on_gpu(&format!("{display:?}"), &actual, on_cpu, EXTENT);
    }
}

/// Sizes that fill no workgroup, dark and bright images, errors from gross to the last bit of f16.
#[test]
fn gpu_matches_the_cpu_on_odd_sizes_and_small_errors() {
    let display = Display {
        exposure: 0.7,
        tonemap: Tonemap::Aces,
    };
    for (width, height) in [(11, 11), (61, 37), (129, 12), (12, 150), (161, 163), (320, 180)] {
        let extent = Extent::new(width, height);
        let reference = Arc::new(Image::from_fn(extent, |x, y| {
            [x as f32 / width as f32, noise(x, y, 1), 8.0 * noise(x / 9, y / 7, 2)]
        }));
        let metrics = metrics_for(extent);
        let mut device = DeviceScorer::new(extent, display, &metrics);
        for error in [1.0, 1e-2, 5e-4] {
            let test = Image::from_fn(extent, |x, y| {
                reference.at(x, y).map(|c| c * (1.0 + error * (noise(x, y, 3) - 0.5)))
            });
            let cpu = cpu_scores(&reference, &test, display, &metrics).unwrap();
            let gpu = device.score(&reference, &test, None, true);
            let on_cpu = metrics.iter().map(|metric| (*metric, cpu.values[metric.id()]));
            assert_on_gpu(&format!("{extent}, error {error}"), &gpu.values, on_cpu, extent);
            for exposure in ["hdr_flip.start_exposure", "hdr_flip.stop_exposure"] {
                assert_eq!(gpu.values[exposure], cpu.values[exposure], "{exposure}");
            }
        }
    }
}

/// Sums are added up apart on a CPU and together on a GPU; here both, for all that can be measured.
#[test]
fn workgroups_that_add_up_together_find_the_same() {
    let extent = Extent::new(61, 43);
    let image = |seed, amplitude: f32| {
        Image::from_fn(extent, |x, y| {
            [noise(x / 3, y, 1), 4.0 * noise(x / 5, y / 5, 2), 0.3].map(|c| c * (1.0 + amplitude * noise(x, y, seed)))
        })
    };
    let metrics = metrics_for(extent);
    let motion_px = Image::from_fn(extent, |x, _| [if x < 30 { -1.0 } else { 0.0 }, 0.0]);
    let [apart, together] = [false, true].map(|together| {
        let variant = Variant {
            workgroup: Some(Workgroup::new(8, 8)),
            workgroup_memory: Some(together),
            ..Variant::default()
        };
        let mut device = DeviceScorer::with(variant, extent, Display::default(), &metrics);
        device.score(&Arc::new(image(3, 0.1)), &image(4, 0.1), None, true);
        device
            .score(&Arc::new(image(5, 0.1)), &image(6, 0.1), Some(&motion_px), true)
            .values
    });
    assert_on_gpu(
        "together",
        &together,
        metrics.iter().map(|metric| (*metric, apart[metric.id()])),
        extent,
    );
    assert!(apart["psnr"].0 > 10.0 && apart["psnr"].0 < 60.0, "{}", apart["psnr"].0);
}

#[test]
fn equal_images_are_perfect_on_the_gpu() {
    for extent in [Extent::new(61, 37), Extent::new(167, 161)] {
        let image = Image::from_fn(extent, |x, y| [noise(x, y, 1), 4.0 * noise(x / 5, y / 5, 2), 0.3]);
        let values = gpu_scores(&image, &image, Display::default(), &metrics_for(extent)).values;
        for metric in metrics_for(extent) {
            assert_eq!(values[metric.id()].0, perfect(metric), "{metric}");
        }
    }
}

/// Rounding of display values, about 1e-7, adds to errors that are no larger.
#[test]
fn gpu_psnr_of_tiny_errors() {
    let extent = Extent::new(160, 90);
    let reference = Arc::new(Image::from_fn(extent, |x, y| {
        [noise(x, y, 1), 0.5 + 0.5 * noise(x / 5, y / 5, 2), noise(x, y, 3)]
    }));
    let metrics = [Metric::PSNR, Metric::PSNR_Y, Metric::SNR];
    let mut device = DeviceScorer::new(extent, Display::default(), &metrics);
    for error in [1e-4_f32, 3e-5, 1e-5, 3e-6] {
        let test = Image::from_fn(extent, |x, y| {
            reference.at(x, y).map(|c| c * (1.0 + error * (noise(x, y, 4) - 0.5)))
        });
        let cpu = cpu_scores(&reference, &test, Display::default(), &metrics)
            .unwrap()
            .values;
        let gpu = device.score(&reference, &test, None, true).values;
        for metric in metrics {
            let [cpu, gpu] = [&cpu, &gpu].map(|values| values[metric.id()].0);
            let rounding_db = 10.0 * libm::log10(1.0 + 2e-7 * 2e-7 * libm::pow(10.0, 0.1 * cpu));
            assert!(agree(gpu, cpu, 1e-3 + rounding_db), "{metric}: {gpu} dB, CPU {cpu} dB");
        }
    }
}
