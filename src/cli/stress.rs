//! `afterimage stress`

use super::{JsonTarget, lavapipe, print, progress_bar, table};
use afterimage::{
    gpu::Gpu,
    image::Extent,
    run::PresetSpec,
    stress::{
        self, Observer, Pictures, StressSpec,
        report::{Cell, StressReport, Verdict},
    },
    taa::{Precision, recipe::Guards},
};
use anyhow::Context;
use clap::ValueEnum;
use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    sync::Mutex,
};

/// Try to break recipes numerically, and compare what they do with their f64 twins
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage stress --quick
  afterimage stress --preset karis2014,inside --hazard texel --json cells.json
  afterimage stress --hazard feedback.static --preset ema --size 64x64 --every-frame
  afterimage stress --hazard variance --guards both --images out
  afterimage stress --markdown docs/stability.md

A cell passes, degrades (finite, bounded, but beyond what is promised) or fails. Exit status 1: a cell failed.")]
pub struct Arguments {
    /// Presets, separated by commas; all by default
    #[arg(long, value_name = "PRESETS", value_delimiter = ',')]
    preset: Vec<String>,
    /// Override a parameter of every preset: NAME=VALUE
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Hazards or families of hazards, separated by commas; all by default
    #[arg(long, value_name = "HAZARDS", value_delimiter = ',')]
    hazard: Vec<String>,
    /// Precision of the stored history
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["f16", "f32"])]
    precision: Vec<History>,
    /// With what keeps recipes stable, with the literal formulas, or both
    #[arg(long, value_enum, default_value = "on")]
    guards: With,
    /// Size of the frames, such as 64x64; each hazard's own by default
    #[arg(long, value_name = "WxH", value_parser = extent)]
    size: Option<Extent>,
    /// Number of frames; each hazard's own by default
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Chooses noise and places
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u32,
    /// Fewer hazards, and fewer frames of them
    #[arg(long)]
    quick: bool,
    /// Run every frame of very long hazards, even where the state repeats
    #[arg(long)]
    every_frame: bool,
    /// Adapters, by part of their name or by their index in `list adapters`, separated by commas
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    adapter: Vec<String>,
    /// Write the cells as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
    /// Write the matrix as Markdown to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    markdown: Option<JsonTarget>,
    /// Write frames of each cell, the worst among them, as DIR/HAZARD/PRESET-PRECISION.png: adapter, twin, difference
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// List the hazards and what they do, and run nothing
    #[arg(long)]
    list: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum History {
    F16,
    F32,
}

#[derive(Clone, Copy, ValueEnum)]
enum With {
    On,
    Off,
    Both,
}

fn extent(text: &str) -> Result<Extent, String> {
    let sides = text.split_once(['x', '×']);
    let sides = sides.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let (width, height) = sides.ok_or("needs the form WIDTHxHEIGHT, such as 64x64")?;
    Ok(Extent::new(width, height))
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    if arguments.list {
        print(&list());
        return Ok(true);
    }
    let spec = arguments.spec()?;
    stress::validate(&spec)?;
    if spec.size.is_none() {
        // Cells run side by side, so the driver's threads only cost: at every dispatch they wait for each other, which takes
        // longer than the few hundred pixels of a hazard.
        lavapipe::without_threads()?;
    }
    let wanted: Vec<_> = match arguments.adapter.as_slice() {
        [] => vec![None],
        names => names.iter().map(|name| Some(name.as_str())).collect(),
    };
    let mut reports = Vec::new();
    for name in wanted {
        let gpu = Gpu::open(name)?;
        let screen = Screen {
            bar: progress_bar("stress", 0),
            images: arguments.images.as_deref(),
            failed: Mutex::new(None),
        };
        reports.push(stress::execute(&spec, &gpu, &screen)?);
        screen.bar.finish_and_clear();
        if let Some(error) = screen.failed.into_inner().unwrap_or_default() {
            return Err(error);
        }
    }
    arguments.write(&reports)?;
    let failed = reports.iter().flat_map(|report| &report.cells);
    Ok(!failed.into_iter().any(|cell| cell.verdict == Verdict::Fails))
}

impl Arguments {
    fn spec(&self) -> anyhow::Result<StressSpec> {
        let mut parameters = serde_json::Map::new();
        for assignment in &self.set {
            let (name, value) = assignment
                .split_once('=')
                .with_context(|| format!("--set {assignment}: needs the form NAME=VALUE"))?;
            let value = serde_json::from_str(value).unwrap_or_else(|_| value.into());
            parameters.insert(name.to_owned(), value);
        }
        let all = afterimage::taa::PRESETS.iter().map(|preset| preset.id.to_owned());
        let presets = match self.preset.is_empty() || self.preset.iter().any(|id| id == "all") {
            true => all.collect(),
            false => self.preset.clone(),
        };
        let presets = presets.into_iter().map(|preset| PresetSpec {
            preset,
            parameters: parameters.clone(),
        });
        Ok(StressSpec {
            presets: presets.collect(),
            hazards: self.hazard.clone(),
            precisions: self
                .precision
                .iter()
                .map(|history| match history {
                    History::F16 => Precision::F16,
                    History::F32 => Precision::F32,
                })
                .collect(),
            guards: match self.guards {
                With::On => vec![Guards::On],
                With::Off => vec![Guards::Off],
                With::Both => vec![Guards::On, Guards::Off],
            },
            size: self.size,
            n_frames: self.frames,
            seed: self.seed,
            quick: self.quick,
            every_frame: self.every_frame,
        })
    }

    fn write(&self, reports: &[StressReport]) -> anyhow::Result<()> {
        let cells: Vec<&Cell> = reports.iter().flat_map(|report| &report.cells).collect();
        let mut screen_is_taken = false;
        if let Some(target) = &self.json {
            let adapters: Vec<_> = reports.iter().map(|report| &report.adapter).collect();
            let revision = reports.first().map(|report| &report.revision);
            target.write(&serde_json::json!({
                "adapters": adapters, "revision": revision, "seed": self.seed, "cells": cells,
            }))?;
            screen_is_taken |= JsonTarget::takes_stdout(Some(target));
        }
        if let Some(target) = &self.markdown {
            let arguments = env::args().skip(1).collect::<Vec<_>>().join(" ");
            target.write_text(&stress::markdown(reports, &format!("afterimage {arguments}")))?;
            screen_is_taken |= JsonTarget::takes_stdout(Some(target));
        }
        if !screen_is_taken {
            print(&show(&cells));
        }
        Ok(())
    }
}

/// Shows progress, and writes images where asked to.
struct Screen<'a> {
    bar: indicatif::ProgressBar,
    images: Option<&'a Path>,
    failed: Mutex<Option<anyhow::Error>>,
}

impl Observer for Screen<'_> {
    fn cell(&self, _index: usize, cell: &Cell, pictures: Option<&Pictures>, n_done: usize, n_total: usize) {
        self.bar.set_length(n_total as u64);
        self.bar.set_position(n_done as u64);
        if let (Some(folder), Some(pictures)) = (self.images, pictures)
            && let Err(error) = write_pictures(folder, cell, pictures)
            && let Ok(mut failed) = self.failed.lock()
        {
            failed.get_or_insert(error);
        }
    }

    fn cancelled(&self) -> bool {
        self.failed.lock().is_ok_and(|failed| failed.is_some())
    }
}

fn write_pictures(folder: &Path, cell: &Cell, pictures: &Pictures) -> anyhow::Result<()> {
    let folder = folder.join(&cell.hazard);
    fs::create_dir_all(&folder).with_context(|| format!("--images {}", folder.display()))?;
    let name = cell.recipe.replace([' ', ',', '/'], "_");
    let unguarded = if cell.guards == Guards::Off { "-unguarded" } else { "" };
    let path = folder.join(format!("{name}-{}{unguarded}.png", cell.precision.id()));
    fs::write(&path, pictures.png()).with_context(|| format!("--images {}", path.display()))
}

fn list() -> String {
    let mut rows = table::new(["hazard", "what happens", "quick"].map(str::to_owned).to_vec(), 3);
    for hazard in stress::hazards() {
        rows.add_row([hazard.id, hazard.about, if hazard.quick { "yes" } else { "" }]);
    }
    format!("{rows}\n")
}

/// Every cell that did not pass, then how many of each verdict there are.
fn show(cells: &[&Cell]) -> String {
    let header = [
        "hazard",
        "recipe",
        "history",
        "verdict",
        "max error",
        "frame",
        "recovered",
        "reason",
    ];
    let mut rows = table::new(header.map(str::to_owned).to_vec(), 8);
    let number = |n: Option<usize>| n.map_or_else(|| "–".to_owned(), |n| n.to_string());
    let few = cells.len() <= 40;
    for cell in cells.iter().filter(|cell| few || cell.verdict >= Verdict::Degrades) {
        rows.add_row([
            cell.hazard.clone(),
            if cell.guards == Guards::Off {
                format!("{}, no guards", cell.recipe)
            } else {
                cell.recipe.clone()
            },
            cell.precision.id().to_owned(),
            cell.verdict.id().to_owned(),
            table::value(cell.max_error),
            number(cell.frame),
            number(cell.recovered_after),
            cell.reason.clone(),
        ]);
    }
    let mut counts: BTreeMap<Verdict, usize> = BTreeMap::new();
    for cell in cells {
        *counts.entry(cell.verdict).or_default() += 1;
    }
    let words: Vec<_> = counts
        .iter()
        .map(|(verdict, n)| format!("{n} {}", verdict.id()))
        .collect();
    format!("{rows}\n{} cells: {}\n", cells.len(), words.join(", "))
}
