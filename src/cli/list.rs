//! `afterimage list`

use super::{print, table};
use afterimage::{
    gpu,
    metrics::{Listing, Metric},
    taa::{
        PRESETS,
        recipe::{Kind, parameters},
    },
};
use clap::ValueEnum;
use serde::Serialize;

/// Show the presets, their parameters, the metrics or the adapters there are
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  afterimage list presets\n  afterimage list parameters\n  afterimage list metrics --json\n  afterimage list adapters"
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
    Parameters,
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
        What::Parameters => {
            show(
                arguments.json,
                parameters(),
                &["parameter", "values", "unit", "default", "description"],
                |parameter| {
                    let values = match &parameter.kind {
                        Kind::Flag => "true, false".to_owned(),
                        Kind::Choice { values } => {
                            let names: Vec<_> = values.iter().map(|value| value.name.as_str()).collect();
                            names.join(", ")
                        }
                        Kind::Integer(range) | Kind::Number(range) => range.to_string(),
                    };
                    let default = parameter.default.to_string();
                    let text = [
                        &parameter.name,
                        &values,
                        parameter.unit.as_deref().unwrap_or_default(),
                        default.trim_matches('"'),
                        &parameter.description,
                    ];
                    text.map(str::to_owned).to_vec()
                },
            )?;
        }
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
