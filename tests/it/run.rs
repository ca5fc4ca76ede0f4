//! A whole run: what the report says, and that metrics do not depend on where they are computed.

use crate::support::{all_metrics, gpu, gpu_tolerance, metrics_for};
use afterimage::{
    image::{
        Extent, Image,
        files::{Backend, FileReader, Limits},
    },
    metrics::{Metric, Value},
    run::{self, MetricsOn, Observer, PresetSpec, RunError, RunSpec, Validate, report::Report},
    sequence::{Sequence, frame::Rgb},
    taa::{Precision, Skip},
};
use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

fn sequence(path: &str) -> Sequence {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    Sequence::open(&path, &FileReader::new(Backend::Auto, Limits::default())).unwrap()
}

pub fn spec(presets: &[&str]) -> RunSpec {
    RunSpec {
        presets: presets
            .iter()
            .map(|preset| PresetSpec {
                preset: (*preset).to_owned(),
                parameters: serde_json::Map::new(),
            })
            .collect(),
        metrics: metrics_for(Extent::new(11, 11)),
        history: Precision::F32,
        n_frames: None,
        repeat: 1,
        metrics_on: MetricsOn::Cpu,
        validate: Validate::No,
        until: None,
        skip: Skip::Off,
    }
}

/// Counts; cancels once `cancel_after` pairs are done.
struct Count {
    n_done: AtomicUsize,
    n_images: AtomicUsize,
    cancel_after: usize,
}

impl Count {
    fn new(cancel_after: usize) -> Self {
        Self {
            n_done: AtomicUsize::new(0),
            n_images: AtomicUsize::new(0),
            cancel_after,
        }
    }
}

impl Observer for Count {
    fn progress(&self, n_done: usize, n_total: usize) {
        assert!(n_done <= n_total);
        self.n_done.fetch_max(n_done, Ordering::Relaxed);
    }
    fn wants_output(&self) -> bool {
        true
    }
    fn output(&self, _: usize, _: usize, _: &Image<Rgb>) -> std::io::Result<()> {
        self.n_images.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
    fn cancelled(&self) -> bool {
        self.n_done.load(Ordering::Relaxed) >= self.cancel_after
    }
}

pub fn execute(spec: &RunSpec, sequence: &Sequence) -> Report {
    run::execute(spec, sequence, gpu(), &Count::new(usize::MAX)).unwrap()
}

#[test]
fn metrics_agree_wherever_they_are_computed() {
    agree_wherever_computed("fixtures/pan", &["inside", "salvi2016"]);
}

/// Vectors are those of the texel under a pixel, times the scale.
#[test]
fn metrics_of_upsampled_frames_agree_wherever_they_are_computed() {
    agree_wherever_computed("fixtures/upscale", &["taau"]);
}

/// Half of the vectors of every frame are none.
#[test]
fn metrics_of_a_checkerboard_agree_wherever_they_are_computed() {
    agree_wherever_computed("fixtures/checkerboard", &["checkerboard"]);
}

/// Every metric over all pixels and over each mask: of every frame, and of the whole sequence.
fn agree_wherever_computed(path: &str, presets: &[&str]) {
    let sequence = sequence(path);
    let extent = sequence.output_size();
    let on = |metrics_on| {
        let metrics = all_metrics(extent);
        let wanted = RunSpec {
            metrics_on,
            metrics,
            ..spec(presets)
        };
        execute(&wanted, &sequence)
    };
    let (on_cpu, on_gpu) = (on(MetricsOn::Cpu), on(MetricsOn::Gpu));
    let agree = |place: String, id: &str, a: Value, b: Value| {
        let exposures = id.starts_with("hdr_flip") && id.ends_with("exposure");
        let tolerance = match id.parse() {
            Ok(metric) => gpu_tolerance(metric, a.0, extent.n_pixels()),
            Err(_) if exposures => 0.0,
            Err(error) => panic!("{error}"),
        };
        let close = a == b || (a.0 - b.0).abs() <= tolerance || a.0.is_nan() && b.0.is_nan();
        assert!(close, "{place}: {id}: {} on the GPU, {} on the CPU", b.0, a.0);
    };
    for (a, b) in on_cpu.reports.iter().zip(&on_gpu.reports) {
        for (a, b) in a.frames.iter().zip(&b.frames) {
            assert!(a.metrics.keys().eq(b.metrics.keys()), "frame {}", a.index);
            for (id, value) in &a.metrics {
                agree(format!("frame {}", a.index), id, *value, b.metrics[id]);
            }
        }
        assert!(a.summary.keys().eq(b.summary.keys()));
        assert!(
            a.summary.len() >= metrics_for(extent).len() + 7,
            "{:?}",
            a.summary.keys()
        );
        for (id, summary) in &a.summary {
            agree("mean".to_owned(), id, summary.mean, b.summary[id].mean);
        }
    }
}

/// Without images or metrics that the host computes nothing of a frame is read back but sums, and the report is the same.
#[test]
fn on_the_gpu_metrics_need_no_images() {
    struct Blind;
    impl Observer for Blind {
        fn progress(&self, _: usize, _: usize) {}
        fn wants_output(&self) -> bool {
            false
        }
        fn output(&self, _: usize, _: usize, _: &Image<Rgb>) -> std::io::Result<()> {
            panic!("nobody asked for images");
        }
        fn cancelled(&self) -> bool {
            false
        }
    }
    let sequence = sequence("fixtures/pan");
    let wanted = RunSpec {
        metrics_on: MetricsOn::Gpu,
        ..spec(&["ema"])
    };
    let seen = execute(&wanted, &sequence);
    let blind = run::execute(&wanted, &sequence, gpu(), &Blind).unwrap();
    for (a, b) in seen.reports[0].frames.iter().zip(&blind.reports[0].frames) {
        assert_eq!(a.metrics, b.metrics);
    }
}

#[test]
fn the_report_says_what_a_reader_must_know() {
    let static_ = execute(&spec(&["none", "ema"]), &sequence("fixtures/static"));
    let repaired: Vec<_> = static_.reports[1]
        .frames
        .iter()
        .map(|frame| frame.repaired_texels)
        .collect();
    assert!(
        repaired.iter().any(|&n| n > 0),
        "one frame has hostile texels: {repaired:?}"
    );
    assert!(repaired.contains(&0));
    let said = static_.reports[1]
        .notes
        .iter()
        .find(|note| note.contains("input texels were repaired"));
    let n_texels: u64 = repaired.iter().sum();
    assert!(
        said.is_some_and(|said| said.starts_with(&format!("{n_texels} "))),
        "{:?}",
        static_.reports[1].notes
    );
    assert!(static_.is_finite(), "repair keeps bad values out of every image");

    let pan = execute(&spec(&["none"]), &sequence("fixtures/pan"));
    assert!(
        pan.reports[0].notes[0].contains("jittered"),
        "{:?}",
        pan.reports[0].notes
    );
    let n_warmup = pan.reports[0].frames.iter().filter(|frame| frame.warmup).count();
    let resets: Vec<_> = pan.reports[0]
        .frames
        .iter()
        .filter(|frame| frame.reset)
        .map(|frame| frame.index)
        .collect();
    assert!(resets.len() > 1, "a reset in the middle warms up again: {resets:?}");
    assert_eq!(n_warmup, resets.len() * sequence("fixtures/pan").warmup_frames());

    let engine = execute(&spec(&["karis2014"]), &sequence("fixtures/engine"));
    assert!(engine.reports[0].frames.iter().all(|frame| frame.metrics.is_empty()));
    assert!(
        engine.reports[0].notes[0].contains("no reference"),
        "{:?}",
        engine.reports[0].notes
    );
}

#[test]
fn the_same_run_twice_gives_the_same_numbers() {
    let sequence = sequence("fixtures/pan");
    let metrics = |report: &Report| -> Vec<_> {
        let frames = report.reports.iter().flat_map(|preset| &preset.frames);
        frames.map(|frame| frame.metrics.clone()).collect()
    };
    let presets: Vec<_> = run::admitted(&sequence).0.iter().map(|preset| preset.id).collect();
    assert!(presets.len() >= 15, "{presets:?}");
    let mut repeated = spec(&presets);
    let once = execute(&repeated, &sequence);
    repeated.repeat = 4;
    let again = execute(&repeated, &sequence);
    assert_eq!(metrics(&once), metrics(&again), "repeats change nothing but times");
    assert_eq!(once.sequence.hash, again.sequence.hash);
}

#[test]
fn a_cancelled_run_ends_between_frames() {
    let observer = Count::new(2);
    let result = run::execute(&spec(&["ema"]), &sequence("fixtures/pan"), gpu(), &observer);
    assert!(matches!(result, Err(RunError::Cancelled)), "{result:?}");
    let n_images = observer.n_images.load(Ordering::Relaxed);
    assert!((2..12).contains(&n_images), "{n_images}");
}

/// A preset, its mean PSNR in dB and its mean SSIM.
type Published = (&'static str, f64, f64);

/// What the presets score on real renders, measured with an independent float64 implementation: mean PSNR in dB
/// and mean SSIM after warm-up.
const SHIP: &[Published] = &[
    ("none", 25.038, 0.8473),
    ("unjitter_only", 30.975, 0.9204),
    ("accumulate", 23.650, 0.8163),
    ("ema", 27.846, 0.8838),
    ("amortized", 31.060, 0.9148),
    ("smaa1tx", 30.186, 0.9216),
    ("inside", 31.933, 0.9354),
    ("inside_ycocg", 31.832, 0.9314),
    ("uncharted4", 28.154, 0.9067),
    ("karis2014", 32.265, 0.9401),
    ("salvi2016", 33.241, 0.9489),
    ("salvi2016_wide", 31.429, 0.9300),
    ("phlm2016", 31.506, 0.9266),
    ("sobel2018", 31.776, 0.9397),
    ("taau", 32.220, 0.9391),
];
const STRESS: &[Published] = &[
    ("none", 16.300, 0.5468),
    ("unjitter_only", 21.188, 0.6977),
    ("accumulate", 17.376, 0.3917),
    ("ema", 20.994, 0.6622),
    ("amortized", 23.348, 0.7528),
    ("smaa1tx", 21.989, 0.7366),
    ("inside", 23.273, 0.7268),
    ("inside_ycocg", 23.452, 0.7170),
    ("uncharted4", 18.037, 0.5797),
    ("karis2014", 22.788, 0.7307),
    ("salvi2016", 22.709, 0.7440),
    ("salvi2016_wide", 22.176, 0.6833),
    ("phlm2016", 23.278, 0.7444),
    ("sobel2018", 21.684, 0.6834),
    ("taau", 21.904, 0.6814),
];

#[test]
fn ship_scores_as_an_independent_implementation_found() {
    scores("ship", SHIP);
}

#[test]
fn stress_scores_as_an_independent_implementation_found() {
    scores("stress", STRESS);
}

#[allow(clippy::print_stdout, reason = "a test that is skipped says so")]
fn scores(name: &str, expected: &[Published]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/sequences")
        .join(name);
    if !folder.is_dir() {
        println!("skipped: {} is not here", folder.display());
        return;
    }
    let sequence = Sequence::open(&folder, &FileReader::new(Backend::Auto, Limits::default())).unwrap();
    let presets: Vec<_> = expected.iter().map(|(preset, ..)| *preset).collect();
    let mut wanted = spec(&presets);
    wanted.metrics = vec![Metric::PSNR, Metric::SSIM];
    let report = execute(&wanted, &sequence);
    for (&(preset, psnr, ssim), found) in expected.iter().zip(&report.reports) {
        let mean = |id: &str| found.summary[id].mean.0;
        let [found_psnr, found_ssim] = [mean("psnr"), mean("ssim")];
        assert!((found_psnr - psnr).abs() < 1e-3, "{name} {preset}: {found_psnr} dB");
        assert!((found_ssim - ssim).abs() < 1e-4, "{name} {preset}: SSIM {found_ssim}");
    }
}

/// Validation is part of the report, takes its share of the progress, and a report with a disagreement says no.
#[test]
fn a_run_can_be_validated() {
    let sequence = sequence("fixtures/pan");
    let wanted = RunSpec {
        validate: Validate::Bisect,
        n_frames: Some(6),
        metrics: Vec::new(),
        history: Precision::F32,
        ..spec(&["ema", "uncharted4"])
    };
    let count = Count::new(usize::MAX);
    let mut report = run::execute(&wanted, &sequence, gpu(), &count).unwrap();
    assert_eq!(count.n_done.load(Ordering::Relaxed), 2 * 2 * 6);
    assert!(report.agrees());
    let names: Vec<_> = report
        .reports
        .iter()
        .map(|preset| {
            let found = preset.validation.as_ref().unwrap();
            assert!(
                found.agrees && found.bisection.is_none() && found.frames.len() == 6,
                "{found:?}"
            );
            found.passes.iter().map(|pass| pass.name.clone()).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(
        names,
        [vec!["prepare", "resolve"], vec!["prepare", "resolve", "sharpen"]]
    );
    report.reports[1].validation.as_mut().unwrap().agrees = false;
    assert!(!report.agrees() && report.is_finite());
    let cancelled = run::execute(&wanted, &sequence, gpu(), &Count::new(14));
    assert!(matches!(cancelled, Err(RunError::Cancelled)), "{cancelled:?}");
}

/// The report speaks of the frames that ran.
#[test]
fn a_run_can_end_when_it_knows_enough() {
    let sequence = sequence("fixtures/pan");
    let until = |text: &str| RunSpec {
        until: Some(text.parse().unwrap()),
        ..spec(&["none", "ema"])
    };
    let n_all = sequence.n_frames();
    let early = run::execute(&until("psnr±100"), &sequence, gpu(), &Count::new(usize::MAX)).unwrap();
    let n_frames = early.sequence.n_frames;
    assert!(n_frames < n_all, "{n_frames} of {n_all}");
    for preset in &early.reports {
        assert_eq!(preset.frames.len(), n_frames);
        assert_eq!(preset.frames.iter().filter(|frame| !frame.warmup).count(), 6);
        let notes = &preset.notes;
        assert!(notes.iter().any(|note| note.contains("psnr±100")), "{notes:?}");
    }
    let never = run::execute(&until("psnr±1e-9"), &sequence, gpu(), &Count::new(usize::MAX)).unwrap();
    assert_eq!(never.sequence.n_frames, n_all);
    let absent = RunSpec {
        metrics: Vec::new(),
        ..until("psnr±1")
    };
    let refused = run::validate(&absent, &sequence).unwrap_err();
    assert!(refused.to_string().contains("until"), "{refused}");
}
