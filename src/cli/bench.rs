//! `afterimage bench`

use super::{
    Bar, JsonTarget, note, print, progress_bar,
    run::{PresetChoice, file_reader},
    table,
};
use afterimage::{
    bench::{self, BenchReport, BenchSpec, Point},
    gpu::Gpu,
    image::files::Backend,
    metrics::Metric,
    sequence::Sequence,
    taa::Precision,
};
use anyhow::Context;
use serde::Serialize;
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Measure run time against error over a sweep of settings, and find the Pareto front
#[derive(clap::Args)]
#[command(after_help = "Knobs are the parameters of a recipe, and:
  history    f16, f32
  skip       off, exact
  workgroup  shape of workgroups, such as 8x8 or 64x1
  workgroup_memory
             whether a workgroup keeps what its pixels read in common: true, false

Times are CPU time of the process on a CPU adapter and timestamps on a GPU; close other programs. Before anything else
the first setting is measured beside itself; settings whose times differ by less than that are not told apart.

Examples:
  afterimage bench fixtures/pan --preset all
  afterimage bench dump --preset karis2014 --sweep history_filter=bilinear,catmull_rom_5 --sweep history=f16,f32
  afterimage bench dump other --preset inside,salvi2016 --metric flip --json points.json --svg front.svg
  afterimage bench --tune")]
pub struct Arguments {
    /// Folders with a manifest.json, manifests, or archives of such folders
    #[arg(required_unless_present = "tune")]
    manifests: Vec<PathBuf>,
    #[command(flatten)]
    presets: Presets,
    /// Values of a knob to try: NAME=VALUE,VALUE…; given several times, all combinations
    #[arg(long, value_name = "NAME=VALUES")]
    sweep: Vec<String>,
    /// Metrics, separated by commas
    #[arg(long, value_name = "METRICS", value_delimiter = ',', default_value = "psnr,ssim")]
    metrics: Vec<Metric>,
    /// The metric that the front is drawn on; the first of --metrics if left out
    #[arg(long, value_name = "METRIC")]
    metric: Option<Metric>,
    /// Only the first N frames
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// At least so many timed frames a setting, 20 to 1000
    #[arg(long, value_name = "N", default_value_t = 20)]
    timed: usize,
    /// Adapter, by part of its name or by its index in `list adapters`
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Write the points as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
    /// Write the points as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draw the front; of several sequences each in its own file, FILE-NAME.svg
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Find the fastest shape of workgroups for this adapter and driver, and keep it for every later run
    #[arg(long)]
    tune: bool,
}

/// Which presets.
#[derive(clap::Args)]
struct Presets {
    /// Presets, separated by commas; `all` for every one that can run on the sequence
    #[arg(
        long,
        value_name = "PRESETS",
        value_delimiter = ',',
        required_unless_present = "tune"
    )]
    preset: Vec<String>,
    /// Override a parameter of every preset, or of one: NAME=VALUE or PRESET.NAME=VALUE
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Output<'a> {
    points: Vec<&'a Point>,
    /// By sequence.
    noise: BTreeMap<&'a str, &'a bench::Noise>,
    metric: Metric,
    clock: Option<bench::Clock>,
    copy_gb_per_s: Option<f64>,
    adapter: Option<&'a afterimage::run::report::AdapterInfo>,
    left_out: Vec<&'a String>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let sequences = arguments
        .manifests
        .iter()
        .map(|path| Sequence::open(path, &file_reader(Backend::Auto)))
        .collect::<Result<Vec<_>, _>>()?;
    let specs = sequences
        .iter()
        .map(|sequence| arguments.spec(sequence))
        .collect::<anyhow::Result<Vec<_>>>()?;
    for (spec, sequence) in specs.iter().zip(&sequences) {
        bench::validate(spec, sequence).with_context(|| sequence.name().to_owned())?;
    }
    let gpu = Gpu::open(arguments.adapter.as_deref())?;
    if arguments.tune {
        tune(&gpu)?;
    }
    let mut reports = Vec::new();
    for (spec, sequence) in specs.iter().zip(&sequences) {
        let bar = Bar(progress_bar(sequence.name(), 0));
        let report = bench::execute(spec, sequence, &gpu, &bar).with_context(|| sequence.name().to_owned())?;
        bar.0.finish_and_clear();
        for reason in &report.left_out {
            note(&format!("{}: left out {reason}", sequence.name()));
        }
        reports.push(report);
    }
    if let Some(target) = &arguments.json {
        target.write(&output(&reports, arguments.front_metric()))?;
    }
    if let Some(path) = &arguments.csv {
        fs::write(path, bench::csv(&points(&reports))).with_context(|| format!("--csv {}", path.display()))?;
    }
    if let Some(path) = &arguments.svg {
        draw(&reports, path)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        for report in &reports {
            print(&show(report));
        }
    }
    Ok(true)
}

impl Arguments {
    fn front_metric(&self) -> Metric {
        self.metric.unwrap_or(self.metrics[0])
    }

    fn spec(&self, sequence: &Sequence) -> anyhow::Result<BenchSpec> {
        let choice = PresetChoice {
            ids: &self.presets.preset,
            set: &self.presets.set,
        };
        let mut metrics = self.metrics.clone();
        if !metrics.contains(&self.front_metric()) {
            metrics.push(self.front_metric());
        }
        Ok(BenchSpec {
            presets: choice.specs(sequence)?,
            knobs: self
                .sweep
                .iter()
                .map(|text| knob(text))
                .collect::<anyhow::Result<_>>()?,
            metrics,
            metric: self.front_metric(),
            history: Precision::default(),
            n_frames: self.frames,
            n_timed: self.timed,
        })
    }
}

/// `NAME=VALUE,VALUE`. A value that is no JSON is a string.
fn knob(text: &str) -> anyhow::Result<(String, Vec<Value>)> {
    let (name, values) = text
        .split_once('=')
        .with_context(|| format!("--sweep {text}: needs the form NAME=VALUE,VALUE"))?;
    let value = |text: &str| serde_json::from_str(text).unwrap_or_else(|_| text.into());
    Ok((name.to_owned(), values.split(',').map(value).collect()))
}

fn tune(gpu: &Gpu) -> anyhow::Result<()> {
    let measured = bench::tune(gpu)?;
    let mut table = table::new(["workgroup", "ms"].map(str::to_owned).to_vec(), 1);
    for (workgroup, ms) in &measured {
        table.add_row([workgroup.to_string(), format!("{ms:.3}")]);
    }
    let path = gpu.keep_workgroup(measured[0].0)?;
    print(&format!(
        "{}\n{table}\n{} is kept in {}\n",
        gpu.info().name,
        measured[0].0,
        path.display()
    ));
    Ok(())
}

fn points(reports: &[BenchReport]) -> Vec<&Point> {
    reports.iter().flat_map(|report| &report.points).collect()
}

fn output(reports: &[BenchReport], metric: Metric) -> Output<'_> {
    Output {
        points: points(reports),
        noise: reports
            .iter()
            .map(|report| (report.sequence.name.as_str(), &report.noise))
            .collect(),
        metric,
        clock: reports.first().map(|report| report.clock),
        copy_gb_per_s: reports.first().and_then(|report| report.copy_gb_per_s),
        adapter: reports.first().map(|report| &report.adapter),
        left_out: reports.iter().flat_map(|report| &report.left_out).collect(),
    }
}

fn show(report: &BenchReport) -> String {
    let mut header = vec!["setting".to_owned(), "dominated by".to_owned()];
    let metrics: Vec<_> = report.points[0].metrics.keys().cloned().collect();
    header.extend(metrics.iter().cloned());
    header.extend(["ms", "mad", "95 %", "B/px", "copies", "skipped", "MiB"].map(str::to_owned));
    let mut table = table::new(header, 2);
    for point in &report.points {
        let time = &point.time_ms;
        let mut row = vec![point.name(), point.dominated_by.clone().unwrap_or_default()];
        let value = |id: &String| {
            point
                .metrics
                .get(id)
                .map_or_else(|| "–".to_owned(), |value| table::value(*value))
        };
        row.extend(metrics.iter().map(value));
        row.extend([
            format!("{:.3}", time.median),
            format!("{:.3}", time.mad),
            format!("{:.3}–{:.3}", time.low, time.high),
            format!("{:.0}", point.bytes_per_pixel),
            point
                .over_copy
                .map_or_else(|| "–".to_owned(), |ratio| format!("{ratio:.2}")),
            format!("{:.0} %", 100.0 * point.skipped),
            point
                .peak_gpu_bytes
                .map_or_else(|| "–".to_owned(), |bytes| format!("{:.1}", bytes as f64 / 1_048_576.0)),
        ]);
        table.add_row(row);
    }
    let (sequence, adapter, noise) = (&report.sequence, &report.adapter, &report.noise);
    let copy = report.copy_gb_per_s.map_or_else(String::new, |speed| {
        format!("copies: a frame's time over that of moving its bytes once, as a plain copy does at {speed:.0} GB/s\n")
    });
    format!(
        "{} {} · {} frames · {} ({} {}) · times: {}\n{table}\nnoise: {} twice differs by up to {:.1} % ({} frames)\n{copy}",
        sequence.name,
        sequence.output_size,
        sequence.n_frames,
        adapter.name,
        adapter.driver,
        adapter.driver_version,
        report.clock.description(),
        noise.setting,
        100.0 * noise.relative,
        noise.n_frames
    )
}

fn draw(reports: &[BenchReport], path: &Path) -> anyhow::Result<()> {
    for report in reports {
        let name = &report.sequence.name;
        let path = match reports.len() {
            1 => path.to_owned(),
            _ => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                path.with_file_name(format!("{stem}-{}.svg", name.replace('/', "_")))
            }
        };
        fs::write(&path, report.svg(&[])).with_context(|| format!("--svg {}", path.display()))?;
    }
    Ok(())
}
