//! The benchmark as a user meets it: the JSON it promises, what it refuses, and that its figures follow from the passes.

use crate::support::{
    gpu,
    service::{TestService, packed},
};
use afterimage::{
    bench::{self, BenchSpec},
    image::files::{Backend, FileReader, Limits},
    metrics::Metric,
    run::PresetSpec,
    sequence::Sequence,
    taa::Precision,
};
use serde_json::{Value, json};
use std::path::Path;

fn sequence(name: &str) -> Sequence {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
    Sequence::open(&path, &FileReader::new(Backend::Native, Limits::default())).unwrap()
}

fn spec(presets: &[&str], knobs: Value) -> BenchSpec {
    let preset = |id: &&str| PresetSpec {
        preset: (*id).to_owned(),
        parameters: serde_json::Map::new(),
    };
    BenchSpec {
        presets: presets.iter().map(preset).collect(),
        knobs: serde_json::from_value(knobs).unwrap(),
        metrics: vec![Metric::PSNR],
        metric: Metric::PSNR,
        history: Precision::F16,
        n_frames: None,
        n_timed: 20,
    }
}

#[test]
fn every_point_has_what_was_promised() {
    let knobs = json!({"history": ["f16", "f32"], "rectify": ["none", "clamp"]});
    let report = bench::execute(&spec(&["ema", "smaa1tx"], knobs), &sequence("pan"), gpu(), &()).unwrap();
    // `ema` has no box to clamp to.
    assert_eq!(report.points.len(), 6);
    assert_eq!(report.left_out.len(), 2, "{:?}", report.left_out);
    assert!(report.noise.relative > 0.0 && report.noise.n_frames >= 20);
    let n_pixels = f64::from(report.sequence.output_size.width * report.sequence.output_size.height);
    let copy_ms_per_byte = 1e-6 / report.copy_gb_per_s.unwrap();
    let points = serde_json::to_value(&report).unwrap()["points"].clone();
    for point in points.as_array().unwrap() {
        let time = |name: &str| point["time_ms"][name].as_f64().unwrap();
        assert!(
            0.0 < time("low") && time("low") <= time("median") && time("median") <= time("high"),
            "{point}"
        );
        assert!(time("mad") >= 0.0);
        assert_eq!(point["sequence"], "pan");
        assert!(point["preset"].is_string() && point["parameters"]["history"].is_string());
        assert!(point["metrics"]["psnr"].as_f64().unwrap() > 5.0, "{point}");
        assert_eq!(point["skipped"], 0.0);
        let copies_ms = point["bytes_per_pixel"].as_f64().unwrap() * n_pixels * copy_ms_per_byte;
        let ratio = point["over_copy"].as_f64().unwrap() / (time("median") / copies_ms);
        assert!((ratio - 1.0).abs() < 1e-9, "{point}");
        assert!(point["passes_ms"]["resolve"].as_f64().unwrap() > 0.0);
        assert!(point["dominated_by"].is_null() || point["dominated_by"].is_string());
    }
    assert!(
        report.points.iter().any(|point| point.dominated_by.is_none()),
        "a front has points"
    );
    let svg = report.svg(&[]);
    assert_eq!(svg.matches("<circle").count(), 6, "{svg}");
    assert!(svg.contains("smaa1tx") && !svg.contains("stroke-dasharray"), "{svg}");
    assert!(report.svg(&[&report]).contains("stroke-dasharray"), "an earlier front");
}

/// Bytes counted by hand: `prepare` reads and writes 16 each; `ema` reads colour 16, motion 8 and history, writes history and
/// what is shown, 16; `karis2014` reads depth too, 4.
#[test]
fn bytes_follow_from_what_is_bound() {
    let knobs = json!({"history": ["f16", "f32"]});
    let report = bench::execute(
        &spec(&["none", "ema", "karis2014"], knobs),
        &sequence("pan"),
        gpu(),
        &(),
    )
    .unwrap();
    let expected = [64.0, 64.0, 88.0, 104.0, 92.0, 108.0];
    for (point, expected) in report.points.iter().zip(expected) {
        let found = point.bytes_per_pixel;
        // Uniforms and textures of one texel.
        assert!(
            (found - expected).abs() < 0.1,
            "{}: {found} instead of {expected}",
            point.name()
        );
    }
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let pan = sequence("pan");
    let refused = |spec: &BenchSpec| bench::validate(spec, &pan).unwrap_err().to_string();
    assert!(refused(&spec(&["ema"], json!({"no_such": [1]}))).contains("no_such"));
    assert!(refused(&spec(&["ema"], json!({"history": ["f8"]}))).contains("history"));
    assert!(refused(&spec(&["ema"], json!({"workgroup": ["9"]}))).contains("workgroup"));
    assert!(refused(&spec(&["checkerboard"], json!({}))).contains("checkerboard"));
    let few = BenchSpec {
        n_timed: 19,
        ..spec(&["ema"], json!({}))
    };
    assert!(refused(&few).contains("n_timed"));
    let other = BenchSpec {
        metric: Metric::SSIM,
        ..spec(&["ema"], json!({}))
    };
    assert!(refused(&other).contains("ssim"));
}

#[test]
fn the_service_keeps_benchmarks_and_draws_their_fronts() {
    let service = TestService::with_gpu();
    let client = service.client();
    client.put("pan", &packed("pan"));
    let body = |presets: Value, metric: &str| {
        json!({"sequence": "pan", "label": "first", "bench": {
            "presets": presets, "knobs": {"history": ["f16", "f32"]}, "metrics": ["psnr", "mse"], "metric": metric}})
    };
    let one = json!([{"preset": "ema"}]);
    let mut unset = body(one.clone(), "psnr");
    unset["bench"]["knobs"]["history"] = json!([]);
    client
        .post("/bench", &unset)
        .is_problem(422, "invalid_bench", Some("bench.knobs"), "`history` has no values");
    client.post("/bench", &body(one.clone(), "ssim")).is_problem(
        422,
        "invalid_bench",
        Some("bench.metric"),
        "not among the metrics",
    );
    client
        .post(
            "/bench",
            &json!({"sequence": "nowhere", "bench": body(one.clone(), "psnr")["bench"]}),
        )
        .is_problem(422, "unknown_sequence", Some("sequence"), "nowhere");
    assert_eq!(client.get("/bench").json()["runs"], json!([]));
    let mut jobs = Vec::new();
    for _ in 0..2 {
        let answer = client.post("/bench", &body(json!([{"preset": "none"}, {"preset": "ema"}]), "psnr"));
        assert_eq!(answer.status, 202, "{}", answer.text());
        let id = answer.json()["id"].as_i64().unwrap();
        let job = client.wait_for(id, &["done", "failed"]);
        assert_eq!((&job["status"], &job["n_done"]), (&json!("done"), &json!(4)), "{job}");
        jobs.push(id);
    }
    let run = client.get(&format!("/bench/{}", jobs[1])).json();
    assert_eq!(run["points"].as_array().unwrap().len(), 4);
    let clock = if gpu().is_cpu() {
        "process_cpu"
    } else {
        "gpu_timestamps"
    };
    assert_eq!((&run["metric"], &run["clock"]), (&json!("psnr"), &json!(clock)));
    let listed = client.get("/bench?sequence=pan&limit=1").json();
    assert_eq!(listed["runs"][0]["job_id"], json!(jobs[1]));
    assert_eq!(client.get("/bench?sequence=other").json()["runs"], json!([]));
    client
        .get("/bench/77")
        .is_problem(404, "not_found", None, "has no benchmark");
    let svg = client.get(&format!("/bench/{}/front.svg?metric=mse", jobs[1]));
    assert!(
        svg.text().starts_with("<svg") && svg.text().contains(">mse<"),
        "{}",
        svg.text()
    );
    let csv = client.get(&format!("/bench/{}/points.csv", jobs[1]));
    assert_eq!(csv.text().lines().count(), 5, "{}", csv.text());
    let page = |path: String| {
        let mut answer = ureq::get(service.url(&path)).call().unwrap();
        answer.body_mut().read_to_string().unwrap()
    };
    // The second is drawn over the front of the first.
    let newest = page("/bench".to_owned());
    assert!(
        newest.contains("on the front") && newest.contains("stroke-dasharray"),
        "{newest}"
    );
    assert!(!page(format!("/bench?job={}", jobs[0])).contains("stroke-dasharray"));
    assert!(page(format!("/bench?job={}&metric=mse", jobs[0])).contains(">mse<"));
    assert!(page("/jobs".to_owned()).contains("/bench?job="));
}
