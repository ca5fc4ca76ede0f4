//! `afterimage run`

use super::{JsonTarget, note, print, progress_bar, table, validation};
use afterimage::{
    gpu::Gpu,
    image::{
        Image,
        files::{Backend, FileReader, Limits, exr, png},
    },
    metrics::{Metric, Picture, map::Map},
    run::{self, MetricsOn, Observer, PresetSpec, RunSpec, Until, Validate, report::Report},
    sequence::{Sequence, frame::Rgb},
    taa::{Precision, Skip},
};
use anyhow::Context;
use clap::ValueEnum;
use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

/// Resolve a sequence with one or more presets and compare with its reference
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage run fixtures/pan --preset inside,karis2014
  afterimage run dump.tar --preset all --history f32 --frames 16 --json report.json
  afterimage run dump/manifest.json --preset ema --set current_weight=0.05 --images out
  afterimage run dump --preset all --frames 8 --validate --adapter nvidia --history f32
  afterimage run dump --preset ema --images out --maps flip,ssim
  afterimage run dump --preset ema,karis2014 --set karis2014.history_filter=bilinear --metrics psnr,ssim")]
pub struct Arguments {
    /// Folder with a manifest.json, the manifest itself, or a tar, tar.gz or zip of the folder
    manifest: PathBuf,
    #[command(flatten)]
    pub what: What,
    /// Adapter, by part of its name or by its index in `list adapters`
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// How image files are read: openexr and png natively and the rest by OpenImageIO, or all by one of them
    #[arg(long, value_enum, default_value = "auto")]
    decoder: Decoder,
    /// Where metrics are computed; auto: on the GPU where the adapter is one
    #[arg(long, value_enum, default_value = "auto")]
    metrics_on: Where,
    /// Write the report as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
    /// Write each shown frame as DIR/PRESET/output_0000.exr: linear RGB, 32-bit float; and with --skip DIR/PRESET/skipped.png,
    /// the lighter a tile the more often it was kept
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Draw where the errors of these metrics are: DIR/PRESET/METRIC_0000.png, black to white for good to bad, and the
    /// values as .exr
    #[arg(long, value_name = "METRICS", value_delimiter = ',', requires = "images")]
    maps: Vec<Metric>,
}

/// What to run: shared with `submit`.
#[derive(clap::Args)]
pub struct What {
    /// Presets, separated by commas; `all` for every one that can run on the sequence
    #[arg(long, value_name = "PRESETS", value_delimiter = ',', required = true)]
    preset: Vec<String>,
    /// Override a parameter of every preset, or of one: NAME=VALUE or PRESET.NAME=VALUE
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Precision of the stored history
    #[arg(long, value_enum, default_value = "f16")]
    history: History,
    /// Only the first N frames
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Metrics, separated by commas
    #[arg(long, value_name = "METRICS", value_delimiter = ',', default_value = "psnr,ssim")]
    pub metrics: Vec<Metric>,
    /// Which work may be left out; exact: what changes no bit of any image
    #[arg(long, value_name = "off|exact", default_value_t = Skip::Off)]
    skip: Skip,
    /// End as soon as every preset's mean is known within so much, with 95 % confidence, such as psnr±0.05 (or psnr+-0.05)
    #[arg(long, value_name = "METRIC±WIDTH")]
    until: Option<Until>,
    /// How often each pass of a frame is timed
    #[arg(long, value_name = "N", default_value_t = 1)]
    repeat: u32,
    /// Hold the adapter against the CPU's twin, pass by pass and frame by frame; status 1 where it disagrees. Slow: the twin
    /// computes in f64, seconds for each preset and frame of 1920×1080, so begin with `--frames 8`
    #[arg(long)]
    validate: bool,
    /// Validate, and where anything disagrees swap one pass after another for its twin, to name the one that is wrong
    #[arg(long)]
    bisect: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum History {
    F16,
    F32,
}

#[derive(Clone, Copy, ValueEnum)]
enum Where {
    Auto,
    Cpu,
    Gpu,
}

#[derive(Clone, Copy, ValueEnum)]
enum Decoder {
    Auto,
    Native,
    Openimageio,
}

impl What {
    /// As the library understands it, for this sequence.
    pub fn spec(&self, sequence: &Sequence) -> anyhow::Result<RunSpec> {
        let choice = PresetChoice {
            ids: &self.preset,
            set: &self.set,
        };
        Ok(RunSpec {
            presets: choice.specs(sequence)?,
            metrics: self.metrics.clone(),
            history: match self.history {
                History::F16 => Precision::F16,
                History::F32 => Precision::F32,
            },
            n_frames: self.frames,
            repeat: self.repeat,
            metrics_on: MetricsOn::Auto,
            validate: Validate::asked(self.validate, self.bisect),
            skip: self.skip,
            until: self.until,
        })
    }
}

/// Presets and overrides as the command line has them.
pub struct PresetChoice<'a> {
    /// Preset ids, or `all`.
    pub ids: &'a [String],
    /// `NAME=VALUE` or `PRESET.NAME=VALUE`.
    pub set: &'a [String],
}

impl PresetChoice<'_> {
    /// As the library understands them, for this sequence.
    pub fn specs(&self, sequence: &Sequence) -> anyhow::Result<Vec<PresetSpec>> {
        let ids = match self.ids.iter().any(|id| id == "all") {
            true => all_presets(sequence)?,
            false => self.ids.to_vec(),
        };
        let spec = |preset| PresetSpec {
            preset,
            parameters: serde_json::Map::new(),
        };
        let mut specs: Vec<_> = ids.into_iter().map(spec).collect();
        for assignment in self.set {
            assign(&mut specs, assignment).with_context(|| format!("--set {assignment}"))?;
        }
        Ok(specs)
    }
}

/// Every preset that can run on `sequence`. Says on standard error which are left out, and why.
fn all_presets(sequence: &Sequence) -> anyhow::Result<Vec<String>> {
    let (admitted, refused) = run::admitted(sequence);
    let mut by_reason: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (preset, reason) in refused {
        by_reason.entry(reason.to_string()).or_default().push(preset.id);
    }
    for (reason, ids) in by_reason {
        note(&format!(
            "{}: `all` leaves out {}: {reason}",
            sequence.name(),
            ids.join(", ")
        ));
    }
    anyhow::ensure!(
        !admitted.is_empty(),
        "--preset all: none of them can run on this sequence"
    );
    Ok(admitted.into_iter().map(|preset| preset.id.to_owned()).collect())
}

/// Applies `NAME=VALUE` or `PRESET.NAME=VALUE`. A value that is no JSON is a string: `bilinear` needs no quotes.
fn assign(presets: &mut [PresetSpec], assignment: &str) -> anyhow::Result<()> {
    let (name, value) = assignment.split_once('=').context("needs the form NAME=VALUE")?;
    let value: serde_json::Value = serde_json::from_str(value).unwrap_or_else(|_| value.into());
    let (preset, name) = match name.split_once('.') {
        Some((preset, name)) => (Some(preset), name),
        None => (None, name),
    };
    let mut found = false;
    for spec in presets
        .iter_mut()
        .filter(|spec| preset.is_none_or(|preset| spec.preset == preset))
    {
        spec.parameters.insert(name.to_owned(), value.clone());
        found = true;
    }
    anyhow::ensure!(found, "--preset does not ask for `{}`", preset.unwrap_or_default());
    Ok(())
}

/// The reader that all commands use.
pub fn file_reader(backend: Backend) -> FileReader {
    FileReader::new(backend, Limits::default())
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let reader = file_reader(match arguments.decoder {
        Decoder::Auto => Backend::Auto,
        Decoder::Native => Backend::Native,
        Decoder::Openimageio => Backend::OpenImageIo,
    });
    let sequence = Sequence::open(&arguments.manifest, &reader)?;
    let mut spec = RunSpec {
        metrics_on: match arguments.metrics_on {
            Where::Auto => MetricsOn::Auto,
            Where::Cpu => MetricsOn::Cpu,
            Where::Gpu => MetricsOn::Gpu,
        },
        ..arguments.what.spec(&sequence)?
    };
    for metric in &arguments.maps {
        metric.check_map().context("--maps")?;
        if !spec.metrics.contains(metric) {
            spec.metrics.push(*metric);
        }
    }
    run::validate(&spec, &sequence)?;
    let gpu = Gpu::open(arguments.adapter.as_deref())?;
    let observer = Screen {
        bar: progress_bar(sequence.name(), 0),
        images: arguments.images.as_deref(),
        maps: &arguments.maps,
        folders: spec.folders(),
    };
    observer.make_folders()?;
    let report = run::execute(&spec, &sequence, &gpu, &observer)?;
    observer.bar.finish_and_clear();
    observer.draw_skipped(&report)?;
    if let Some(target) = &arguments.json {
        target.write(&report)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        print(&show(&report, &spec.metrics));
        print(&validation::show(&report));
    }
    Ok(report.is_finite() && report.agrees())
}

/// Shows progress, and writes images where asked to.
struct Screen<'a> {
    bar: indicatif::ProgressBar,
    images: Option<&'a Path>,
    maps: &'a [Metric],
    folders: Vec<String>,
}

impl Screen<'_> {
    fn make_folders(&self) -> anyhow::Result<()> {
        for folder in &self.folders {
            if let Some(path) = self.images.map(|images| images.join(folder)) {
                fs::create_dir_all(&path).with_context(|| format!("--images {}", path.display()))?;
            }
        }
        Ok(())
    }
}

impl Screen<'_> {
    /// Writes which tiles each preset kept, where it may keep some.
    fn draw_skipped(&self, report: &Report) -> anyhow::Result<()> {
        let Some(images) = self.images else { return Ok(()) };
        for (folder, preset) in self.folders.iter().zip(&report.reports) {
            if let Some(skipped) = &preset.skipped {
                png::write_png(&images.join(folder).join("skipped.png"), &skipped.heatmap(), &[])?;
            }
        }
        Ok(())
    }
}

impl Observer for Screen<'_> {
    fn progress(&self, n_done: usize, n_total: usize) {
        self.bar.set_length(n_total as u64);
        self.bar.set_position(n_done as u64);
    }

    fn wants_output(&self) -> bool {
        self.images.is_some()
    }

    fn output(&self, preset_index: usize, frame_index: usize, image: &Image<Rgb>) -> io::Result<()> {
        let Some(images) = self.images else { return Ok(()) };
        let path = images
            .join(&self.folders[preset_index])
            .join(format!("output_{frame_index:04}.exr"));
        exr::write_rgb_exr(&path, image, exr::FloatFormat::Float).map_err(io::Error::other)
    }

    fn compared(&self, preset_index: usize, frame_index: usize, reference: &Picture, test: &Picture) -> io::Result<()> {
        let Some(images) = self.images else { return Ok(()) };
        for metric in self.maps {
            let map = Map::new(*metric, reference, test).map_err(io::Error::other)?;
            let folder = images.join(&self.folders[preset_index]);
            let name = format!("{metric}_{frame_index:04}");
            map.write(&folder, &name).map_err(io::Error::other)?;
        }
        Ok(())
    }

    fn cancelled(&self) -> bool {
        false
    }
}

fn show(report: &Report, metrics: &[Metric]) -> String {
    let sequence = &report.sequence;
    let adapter = &report.adapter;
    let mut header = vec!["preset".to_owned()];
    header.extend(metrics.iter().map(|metric| metric.id().to_owned()));
    header.push("GPU ms".to_owned());
    let mut table = table::new(header, 1);
    let mut notes = String::new();
    for preset in &report.reports {
        let mut row = vec![preset.preset.clone()];
        row.extend(metrics.iter().map(|metric| table::mean(&preset.summary, metric.id())));
        row.push(table::gpu_ms(&preset.times_ms));
        table.add_row(row);
        for note in &preset.notes {
            notes += &format!("{}: {note}\n", preset.preset);
        }
        for frame in preset.frames.iter().filter(|frame| frame.non_finite_pixels > 0) {
            let (index, n) = (frame.index, frame.non_finite_pixels);
            notes += &format!("{}: frame {index} has {n} non-finite pixels\n", preset.preset);
        }
    }
    format!(
        "{} {} · {} frames · {} ({} {})\n{table}\n{notes}",
        sequence.name, sequence.output_size, sequence.n_frames, adapter.name, adapter.driver, adapter.driver_version
    )
}
