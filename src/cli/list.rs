//! `afterimage list`

use super::{print, table};
use afterimage::{
    gpu,
    metrics::{Listing, Metric},
    taa::PRESETS,
};
use clap::ValueEnum;
use serde::Serialize;

/// Show the presets, metrics or adapters there are
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  afterimage list presets\n  afterimage list metrics --json\n  afterimage list adapters"
)]
pub struct Arguments {
    /// What to show
    what: What,
    /// As JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum What {
    Presets,
    Metrics,
    Adapters,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    match arguments.what {
        What::Presets => show(
            arguments.json,
            &PRESETS,
            &["preset", "description", "publication"],
            |preset| {
                vec![
                    preset.id.to_owned(),
                    preset.description.to_owned(),
                    preset.publication.to_owned(),
                ]
            },
        )?,
        What::Metrics => {
            show(
                arguments.json,
                &Metric::list(),
                &["metric", "unit", "better", "version", "over", "description"],
                |Listing { info, masks }| {
                    let better = format!("{:?}", info.better).to_lowercase();
                    let masks: String = masks.iter().map(|mask| format!(".{mask} ")).collect();
                    let version = info.version.to_string();
                    let text = [
                        info.id,
                        info.unit,
                        &better,
                        &version,
                        masks.trim_end(),
                        info.description,
                    ];
                    text.map(str::to_owned).to_vec()
                },
            )?;
        }
        What::Adapters => {
            let adapters = gpu::adapters();
            if adapters.is_empty() {
                anyhow::bail!(gpu::NO_DRIVER);
            }
            let mut index = 0..;
            show(
                arguments.json,
                &adapters,
                &["index", "adapter", "kind", "driver", "version"],
                |adapter| {
                    let number = index.next().unwrap_or_default().to_string();
                    let text = [
                        &number,
                        &adapter.name,
                        &adapter.kind,
                        &adapter.driver,
                        &adapter.driver_version,
                    ];
                    text.map(Clone::clone).to_vec()
                },
            )?;
        }
    }
    Ok(true)
}

fn show<T: Serialize>(
    json: bool,
    items: &[T],
    header: &[&str],
    mut row: impl FnMut(&T) -> Vec<String>,
) -> anyhow::Result<()> {
    if json {
        print(&(serde_json::to_string_pretty(items)? + "\n"));
        return Ok(());
    }
    let mut table = table::new(header.iter().map(|name| (*name).to_owned()).collect(), header.len());
    for item in items {
        table.add_row(row(item));
    }
    print(&format!("{table}\n"));
    Ok(())
}
