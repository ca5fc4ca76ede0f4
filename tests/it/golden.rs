//! The metrics against independent implementations: `fixtures/golden`, whose README says what made each value.

use afterimage::{
    compare::{Comparison, Criteria, compare},
    image::{
        Image,
        files::{Backend, FileReader, Limits},
    },
    metrics::{Display, Metric, Reference, Value, Values},
};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Of every CPU metric, in dB or in units of the index.
const CPU_TOLERANCE: f64 = 1e-9;

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
const NAMES: [(Metric, &str); 11] = [
    (Metric::Mse, "mse_float"),
    (Metric::Psnr, "psnr_float_rgb"),
    (Metric::Psnr, "skimage_psnr"),
    (Metric::PsnrU8, "psnr8_rgb"),
    (Metric::PsnrY, "psnr8_luma709"),
    (Metric::PsnrLinear, "psnr_linear_rgb"),
    (Metric::Snr, "snr_db"),
    (Metric::Ssim, "skimage_ssim_rgb"),
    (Metric::Ssim, "ssim_rgb_valid"),
    (Metric::SsimU8, "skimage_ssim_rgb"),
    (Metric::SsimU8, "ssim_rgb_valid"),
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
        metrics: Metric::ALL.to_vec(),
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
fn assert_agree(what: &str, actual: Value, expected: Value) {
    let (actual, expected) = (actual.0, expected.0);
    assert!(
        agree(actual, expected, CPU_TOLERANCE),
        "{what}: {actual} instead of {expected}"
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
            assert_agree(
                &format!("{pair}: {metric} against {name}"),
                actual[metric.id()],
                expected,
            );
        }
        for (metric, expected) in &additional.pairs8[pair] {
            assert_agree(&format!("{pair}: {metric}"), actual[metric.id()], *expected);
        }
    }
}

#[test]
fn equal_images_are_perfect_to_the_last_bit() {
    let scores = scores("base_ref.png", "identical_test.png");
    for metric in Metric::ALL {
        let perfect = match metric {
            Metric::Mse | Metric::Rmse => 0.0,
            Metric::Ssim | Metric::SsimY | Metric::SsimU8 => 1.0,
            _ => f64::INFINITY,
        };
        assert_eq!(scores[metric.id()], Value(perfect), "{metric}");
    }
}

#[test]
fn hdr_pair_matches_under_every_display_transform() {
    let (reference, test) = (hdr("hdr_ref.exr"), hdr("hdr_test.exr"));
    let additional: Additional = json("additional.json");
    assert_eq!(additional.hdr.len(), 6);
    for HdrValues { display, values } in additional.hdr {
        let actual = Reference::new(&reference, display, &Metric::ALL)
            .evaluate(&test)
            .unwrap();
        for (metric, expected) in values {
            assert_agree(&format!("{display:?}: {metric}"), actual.values[metric.id()], expected);
        }
    }
}

#[test]
fn hdr_pair_matches_the_published_values() {
    let (reference, test) = (hdr("hdr_ref.exr"), hdr("hdr_test.exr"));
    let golden: Golden = json("golden.json");
    let expected = |name: &str| golden.hdr[name].as_f64().unwrap();
    let metrics = [Metric::Psnr, Metric::PsnrLinear];
    let scores = Reference::new(&reference, Display::default(), &metrics)
        .evaluate(&test)
        .unwrap();
    assert_agree("psnr", scores.values["psnr"], Value(expected("psnr_clip_srgb")));
    let linear_db = Value(-10.0 * libm::log10(expected("mse")));
    assert_agree("psnr.linear", scores.values["psnr.linear"], linear_db);
}
