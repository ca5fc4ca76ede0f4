//! `afterimage paper`

use super::{JsonTarget, lavapipe, note, print};
use afterimage::{
    gpu::Gpu,
    paper::{self, Effort, Finding, Lab, page},
};
use anyhow::{Context, ensure};
use std::path::PathBuf;

/// Try the orderings that the papers print on like scenes, and say which hold
#[derive(clap::Args)]
#[command(
    after_help = "Scenes that move are baked once and kept. Everything takes about ten minutes of CPU where there is no GPU, the first time a few
more; --quick takes two.

Examples:
  afterimage paper --quick
  afterimage paper --only thesis,survey.resampling --json findings.json
  afterimage paper --pages docs"
)]
pub struct Arguments {
    /// Only experiments whose name begins so, separated by commas; `--list` shows the names
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    only: Vec<String>,
    /// Small frames, few of them, few samples: a look, in which orderings may differ
    #[arg(long)]
    quick: bool,
    /// Show the names of the experiments and end
    #[arg(long)]
    list: bool,
    /// Write the findings as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
    /// Write DIR/reproduction.md and its pictures
    #[arg(long, value_name = "DIR")]
    pages: Option<PathBuf>,
    /// Adapter, by part of its name or by its index in `list adapters`
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let mut experiments = paper::experiments();
    if !arguments.only.is_empty() {
        for name in &arguments.only {
            let known = experiments
                .iter()
                .any(|experiment| experiment.id.starts_with(name.as_str()));
            ensure!(known, "--only {name}: no experiment begins so; `--list` shows all");
        }
        experiments.retain(|experiment| {
            arguments
                .only
                .iter()
                .any(|name| experiment.id.starts_with(name.as_str()))
        });
    }
    if arguments.list {
        for experiment in &experiments {
            print(&format!("{}\n", experiment.id));
        }
        return Ok(true);
    }
    lavapipe::without_threads()?;
    let gpu = Gpu::open(arguments.adapter.as_deref())?;
    let lab = Lab::new(&gpu, if arguments.quick { Effort::QUICK } else { Effort::FULL });
    let quiet = JsonTarget::takes_stdout(arguments.json.as_ref());
    let mut findings = Vec::new();
    for (index, experiment) in experiments.iter().enumerate() {
        note(&format!("{} of {}: {}", index + 1, experiments.len(), experiment.id));
        let finding = experiment.run(&lab).with_context(|| experiment.id.to_owned())?;
        if !quiet {
            print(&show(&finding));
        }
        findings.push(finding);
    }
    if let Some(target) = &arguments.json {
        target.write(&findings)?;
    }
    if let Some(folder) = &arguments.pages {
        page::write(folder, &lab, &findings).with_context(|| format!("--pages {}", folder.display()))?;
    }
    if !quiet {
        print(&format!("\n{}\n", page::count(&findings)));
    }
    Ok(true)
}

fn show(finding: &Finding) -> String {
    let mut text = format!("\n{} · {} ({})\n", finding.id, finding.title, finding.source);
    for table in &finding.tables {
        let header = [String::new()].into_iter().chain(table.columns.clone()).collect();
        let mut shown = super::table::new(header, 1);
        for (name, cells) in &table.rows {
            shown.add_row([name.clone()].into_iter().chain(cells.iter().map(ToString::to_string)));
        }
        text += &format!("{}\n{shown}\n", table.caption);
    }
    for ordering in &finding.orderings {
        text += &format!("  {}\n", page::sentence(ordering).replace("**", ""));
    }
    text
}
