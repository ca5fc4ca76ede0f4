//! The command line as a user meets it: the built binary, its output, its exit status.

use serde_json::Value;
use std::{
    fs,
    path::PathBuf,
    process::{Command, Output, Stdio},
    thread,
    time::Duration,
};

fn afterimage(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_afterimage"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Standard output of a command that must succeed.
fn succeed(arguments: &[&str]) -> String {
    let output = afterimage(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The complaint of a command that must refuse with status 2.
fn refuse(arguments: &[&str]) -> String {
    let output = afterimage(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output.stdout));
    text(&output.stderr)
}

#[test]
fn run_reports_in_json_what_it_promises() {
    let json = succeed(&[
        "run",
        "fixtures/pan",
        "--preset",
        "none,karis2014",
        "--metrics",
        "psnr,ssim",
        "--repeat",
        "3",
        "--json",
        "-",
    ]);
    let report: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(report["sequence"]["name"], "pan");
    assert_eq!(report["sequence"]["hash"].as_str().unwrap().len(), 64);
    assert!(!report["adapter"]["name"].as_str().unwrap().is_empty());
    let karis = &report["reports"][1];
    assert_eq!(karis["preset"], "karis2014");
    assert_eq!(karis["parameters"]["history_filter"], "catmull_rom_5");
    let frames = karis["frames"].as_array().unwrap();
    for (index, frame) in frames.iter().enumerate() {
        assert_eq!(frame["index"], index);
        assert!(frame["metrics"]["psnr"].as_f64().unwrap() > 5.0, "{frame}");
        assert!(frame["times_ms"]["resolve"].as_f64().unwrap() > 0.0, "{frame}");
    }
    assert_eq!(frames[0]["warmup"], true);
    for key in ["mean", "min", "p5", "pooled", "infinite"] {
        assert!(karis["summary"]["psnr"].get(key).is_some(), "{key}");
    }
    let n_counted = frames.iter().filter(|frame| frame["warmup"] == false).count();
    assert_eq!(
        karis["times_ms"]["resolve"]["n"],
        3 * n_counted,
        "warm-up is not counted"
    );
}

#[test]
fn all_means_those_that_the_sequence_admits() {
    let output = afterimage(&["run", "fixtures/upscale", "--preset", "all", "--json", "-"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let reports = report["reports"].as_array().unwrap();
    assert_eq!(reports.len(), 1);
    assert_eq!(reports[0]["preset"], "taau");
    let note = text(&output.stderr);
    assert!(
        note.contains("`all` leaves out none, ") && note.contains("does not upscale"),
        "{note}"
    );
    let refused = refuse(&["run", "fixtures/upscale", "--preset", "taau,inside"]);
    assert!(refused.contains("`inside` does not upscale"), "{refused}");
}

#[test]
fn run_writes_the_shown_frames() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().to_str().unwrap();
    succeed(&[
        "run",
        "fixtures/pan",
        "--preset",
        "ema,ema",
        "--set",
        "ema.current_weight=1",
        "--frames",
        "2",
        "--images",
        images,
    ]);
    let path = |preset: &str, frame: u32| folder.path().join(preset).join(format!("output_{frame:04}.exr"));
    let all: Vec<PathBuf> = vec![path("ema", 0), path("ema", 1), path("ema-2", 0), path("ema-2", 1)];
    for path in &all {
        assert!(path.is_file(), "{}", path.display());
    }
    let [first, second] = [&all[0], &all[2]].map(|path| path.to_str().unwrap());
    let json: Value = serde_json::from_str(&succeed(&["compare", first, second, "--json", "-"])).unwrap();
    assert_eq!(json["metrics"]["psnr"], "inf", "the same recipe twice");
}

#[test]
fn run_draws_maps_beside_the_frames() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().to_str().unwrap();
    let asked = [
        "run",
        "fixtures/pan",
        "--preset",
        "ema",
        "--frames",
        "2",
        "--metrics",
        "psnr",
    ];
    let maps = |maps| [&asked[..], &["--images", images, "--maps", maps]].concat();
    succeed(&maps("flip,ssim"));
    for name in ["flip_0000", "flip_0001", "ssim_0000", "ssim_0001"] {
        for extension in ["png", "exr"] {
            let path = folder.path().join(format!("ema/{name}.{extension}"));
            assert!(path.is_file(), "{}", path.display());
        }
    }
    let complaint = refuse(&maps("flicker"));
    assert!(
        complaint.contains("--maps") && complaint.contains("`flicker` has no map"),
        "{complaint}"
    );
    let complaint = refuse(&[&asked[..], &["--maps", "flip"]].concat());
    assert!(complaint.contains("--images"), "{complaint}");
}

#[test]
fn overrides_change_the_result_and_mistakes_are_named() {
    let psnr = |set: &str| {
        let json = succeed(&["run", "fixtures/pan", "--preset", "ema", "--set", set, "--json", "-"]);
        let report: Value = serde_json::from_str(&json).unwrap();
        report["reports"][0]["summary"]["psnr"]["mean"].as_f64().unwrap()
    };
    assert_ne!(psnr("current_weight=0.1"), psnr("history_filter=catmull_rom"));
    let run = |preset: &str, set: &str| refuse(&["run", "fixtures/pan", "--preset", preset, "--set", set]);
    assert!(run("ema", "curent_weight=0.1").contains("did you mean `current_weight`"));
    assert!(run("ema", "current_weight=0").contains("current_weight: must be above 0"));
    assert!(run("ema", "dilation=nearest").contains("dilation"));
    assert!(run("ema", "karis2014.dilation=none").contains("--preset does not ask for `karis2014`"));
    assert!(run("karis2041", "dilation=none").contains("did you mean `karis2014`"));
}

#[test]
fn wrong_use_names_the_thing() {
    let missing = refuse(&["run", "fixtures/nowhere", "--preset", "ema"]);
    assert!(missing.contains("fixtures/nowhere"), "{missing}");
    let metric = refuse(&["run", "fixtures/pan", "--preset", "ema", "--metrics", "pnsr"]);
    assert!(metric.contains("did you mean `psnr`"), "{metric}");
    let adapter = refuse(&["run", "fixtures/pan", "--preset", "ema", "--adapter", "voodoo"]);
    assert!(adapter.contains("no adapter matches `voodoo`"), "{adapter}");
    let repeat = refuse(&["run", "fixtures/pan", "--preset", "ema", "--repeat", "0"]);
    assert!(repeat.contains("repeat"), "{repeat}");
    assert!(
        refuse(&["submit", "http://127.0.0.1:1", "fixtures/pan", "--preset", "ema"]).contains("is the service running")
    );
}

/// The loader finds no driver at all where the list of drivers is empty.
#[test]
fn no_driver_says_what_to_install() {
    let output = Command::new(env!("CARGO_BIN_EXE_afterimage"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", "fixtures/pan", "--preset", "ema"])
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("mesa-vulkan-drivers"),
        "{}",
        text(&output.stderr)
    );
}

#[test]
fn compare_says_no_to_bad_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nan.exr");
    let extent = afterimage::image::Extent::new(16, 16);
    let image = afterimage::image::Image::from_fn(extent, |x, _| [if x == 3 { f32::NAN } else { 0.5 }; 3]);
    afterimage::image::files::exr::write_rgb_exr(&path, &image, afterimage::image::files::exr::FloatFormat::Float)
        .unwrap();
    let path = path.to_str().unwrap();
    let output = afterimage(&["compare", path, path]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("16"), "the count of bad pixels");
}

#[test]
fn compare_draws_maps_that_say_what_they_show() {
    let folder = tempfile::tempdir().unwrap();
    let maps = folder.path().to_str().unwrap();
    let (reference, test) = ("fixtures/golden/base_ref.png", "fixtures/golden/blur3_test.png");
    succeed(&["compare", reference, test, "--metrics", "flip,ssim", "--maps", maps]);
    for (metric, white) in [("flip", "1"), ("ssim", "0")] {
        let png = png::Decoder::new(std::io::BufReader::new(
            fs::File::open(folder.path().join(format!("{metric}.png"))).unwrap(),
        ));
        let info = png.read_info().unwrap().info().clone();
        let texts: Vec<_> = info
            .uncompressed_latin1_text
            .iter()
            .map(|text| (&*text.keyword, &*text.text))
            .collect();
        assert!(
            texts.contains(&("Metric", metric)) && texts.contains(&("White", white)),
            "{texts:?}"
        );
        assert!(folder.path().join(format!("{metric}.exr")).is_file());
    }
    let complaint = refuse(&["compare", reference, test, "--metrics", "flicker", "--maps", maps]);
    assert!(complaint.contains("`flicker`"), "{complaint}");
}

#[test]
fn compare_says_no_beyond_its_limits() {
    let golden = |name: &str| format!("{}/fixtures/golden/{name}", env!("CARGO_MANIFEST_DIR"));
    let [reference, test] = ["base_ref.png", "noise_test.png"].map(golden);
    // PSNR 26.9 dB, FLIP 0.1001.
    for (limits, status) in [
        (&["--min", "psnr=26.9", "--max", "flip=0.101"][..], 0),
        (&["--min", "psnr=27"], 1),
        (&["--max", "flip=0.1"], 1),
        (&["--min", "psnr=26.9,ssim=0.99"], 1),
        (&["--min", "psnr"], 2),
        (&["--min", "pnsr=30"], 2),
        (&["--min", "tpsnr=30"], 2),
    ] {
        let output = afterimage(&[&["compare", reference.as_str(), test.as_str()], limits].concat());
        assert_eq!(
            output.status.code(),
            Some(status),
            "{limits:?}: {}",
            text(&output.stderr)
        );
    }
}

#[test]
fn lists_are_complete_in_both_forms() {
    for (what, some) in [
        ("presets", "salvi2016"),
        ("metrics", "psnr.linear"),
        ("adapters", "driver"),
    ] {
        assert!(succeed(&["list", what]).contains(some), "{what}");
        let json: Value = serde_json::from_str(&succeed(&["list", what, "--json"])).unwrap();
        assert!(!json.as_array().unwrap().is_empty(), "{what}");
    }
}

#[test]
fn every_command_shows_examples() {
    for command in ["run", "compare", "serve", "submit", "list"] {
        let help = succeed(&[command, "--help"]);
        assert!(help.contains("Examples:"), "{command}");
    }
}

#[test]
fn run_validates_the_adapter() {
    let arguments = [
        "run",
        "fixtures/pan",
        "--preset",
        "ema,phlm2016",
        "--frames",
        "4",
        "--history",
        "f32",
    ];
    let shown = succeed(&[&arguments[..], &["--validate"]].concat());
    for expected in ["ema: the adapter agrees with the twin", "still", "model", "max |Δ|"] {
        assert!(shown.contains(expected), "{shown}");
    }
    assert!(!succeed(&arguments).contains("twin"));
    let measured = succeed(&["run", "fixtures/pan", "--preset", "inside", "--frames", "2", "--bisect"]);
    assert!(
        measured.contains("frames (measured)") && measured.contains("--history f32"),
        "{measured}"
    );
}

#[test]
fn bench_prints_points_noise_and_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let [svg, csv] = ["front.svg", "points.csv"].map(|name| folder.path().join(name));
    let json = succeed(&[
        "bench",
        "fixtures/pan",
        "--preset",
        "none,ema",
        "--sweep",
        "skip=off,exact",
        "--metrics",
        "psnr",
        "--json",
        "-",
        "--svg",
        svg.to_str().unwrap(),
        "--csv",
        csv.to_str().unwrap(),
    ]);
    let output: Value = serde_json::from_str(&json).unwrap();
    let points = output["points"].as_array().unwrap();
    assert_eq!(points.len(), 4);
    assert_eq!(points[1]["parameters"]["skip"], "exact");
    assert_eq!(points[0]["metrics"], points[1]["metrics"], "skipping changes nothing");
    assert!(output["noise"]["pan"]["relative"].as_f64().unwrap() > 0.0);
    assert!(fs::read_to_string(svg).unwrap().starts_with("<svg"));
    let csv = fs::read_to_string(csv).unwrap();
    assert_eq!(csv.lines().count(), 5, "{csv}");
    assert!(csv.starts_with("sequence,preset,parameters,median_ms,"), "{csv}");
    let wrong = refuse(&["bench", "fixtures/pan", "--preset", "ema", "--sweep", "current_weight"]);
    assert!(wrong.contains("NAME=VALUE"), "{wrong}");
    refuse(&["bench"]);
}

#[test]
fn check_says_what_is_wrong_and_exits_with_it() {
    let clean = succeed(&["check", "fixtures/pan"]);
    assert!(
        clean.contains("no warning for `pan`") && clean.contains("motion.y"),
        "{clean}"
    );

    let folder = crate::sequence::copy_of("pan");
    crate::sequence::edit(&folder, |manifest| manifest["motion"]["y"] = "down".into());
    let path = folder.path().to_str().unwrap();
    let output = afterimage(&["check", path]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let shown = text(&output.stdout);
    assert!(
        shown.contains("motion y looks flipped: error") && shown.contains("set motion.y to \"up\""),
        "{shown}"
    );

    let output = afterimage(&["check", path, "--json", "-"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let finding = &report["findings"][0];
    assert_eq!(
        (&finding["id"], &finding["severity"]),
        (&"motion.y".into(), &"warning".into())
    );
    assert!(finding["evidence"]["error_declared"].as_f64() > finding["evidence"]["error_corrected"].as_f64());
    assert!(refuse(&["check", "fixtures"]).contains("no manifest.json there"));
}

/// They may free what another still uses: `src/cli/lavapipe.rs`.
#[test]
fn a_bake_goes_without_lavapipes_threads() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut bake = Command::new(env!("CARGO_BIN_EXE_afterimage"))
        .args("bake static --frames 1 --size 64x36 --reference-samples 2".split(' '))
        .arg("--cache")
        .arg(folder.path().join("cache"))
        .arg("--out")
        .arg(&out)
        .env_remove("LP_NUM_THREADS")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let environment = format!("/proc/{}/environ", bake.id());
    let is_without = || {
        let environment = fs::read_to_string(&environment).unwrap_or_default();
        environment.split('\0').any(|it| it == "LP_NUM_THREADS=0")
    };
    while !is_without() {
        assert!(bake.try_wait().unwrap().is_none(), "it ended with lavapipe's threads");
        thread::sleep(Duration::from_millis(1));
    }
    assert!(bake.wait().unwrap().success());
    assert!(out.join("manifest.json").is_file());
}
