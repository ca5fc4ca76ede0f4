//! `afterimage compare`

use super::{JsonTarget, complain, print, run::file_reader, table};
use afterimage::{
    compare::{self, Comparison, Criteria, Limit},
    image::files::Backend,
    metrics::{Display, Metric, Tonemap},
};
use std::path::PathBuf;

/// Compare two images, or two folders of images by name
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage compare reference.png output.png
  afterimage compare reference/ output/ --metrics psnr,ssim --json -
  afterimage compare reference.exr output.exr --exposure 2 --tonemap aces
  afterimage compare reference/ output/ --min psnr=38 --max flip=0.05
  afterimage compare reference.png output.png --metrics flip,ssim --maps errors

8- and 16-bit files are compared as they are; float files are linear and are shown by --exposure and --tonemap first.
Exit status: 0 all limits are kept, 1 one is not or a pixel is not finite, 2 wrong use or bad input.")]
pub struct Arguments {
    /// The truth: an image or a folder
    reference: PathBuf,
    /// What is compared with it
    test: PathBuf,
    /// Metrics, separated by commas
    #[arg(long, value_name = "METRICS", value_delimiter = ',', default_value = "psnr,ssim")]
    metrics: Vec<Metric>,
    /// Fail where a pair has less: METRIC=VALUE, separated by commas
    #[arg(long, value_name = "LIMITS", value_delimiter = ',')]
    min: Vec<Limit>,
    /// Fail where a pair has more: METRIC=VALUE, separated by commas
    #[arg(long, value_name = "LIMITS", value_delimiter = ',')]
    max: Vec<Limit>,
    /// Factor on linear colour before tone mapping
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    exposure: f64,
    /// How range is compressed: none, reinhard_max or aces
    #[arg(long, value_name = "CURVE", default_value = "none", value_parser = tonemap)]
    tonemap: Tonemap,
    /// Write the result as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
    /// Draw where the errors are: DIR/METRIC.png, black to white for good to bad, and its values as .exr; of folders
    /// DIR/METRIC/NAME.png
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
}

fn tonemap(text: &str) -> Result<Tonemap, String> {
    serde_json::from_value(text.into()).map_err(|error| error.to_string())
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    anyhow::ensure!(
        arguments.exposure.is_finite() && arguments.exposure > 0.0,
        "--exposure: must be above 0"
    );
    let mut metrics = arguments.metrics.clone();
    for Limit { metric, .. } in arguments.min.iter().chain(&arguments.max) {
        if !metrics.contains(metric) {
            metrics.push(*metric);
        }
    }
    let criteria = Criteria {
        metrics,
        display: Display {
            exposure: arguments.exposure,
            tonemap: arguments.tonemap,
        },
    };
    let reader = file_reader(Backend::Auto);
    let comparison = compare::compare(&reader, &arguments.reference, &arguments.test, &criteria)?;
    if let Some(target) = &arguments.json {
        target.write(&comparison)?;
    }
    if let Some(folder) = &arguments.maps {
        compare::write_maps(&reader, &arguments.reference, &arguments.test, &criteria, folder)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        print(&show(&comparison, &criteria.metrics));
    }
    let beyond = comparison.beyond(&arguments.min, &arguments.max);
    for line in &beyond {
        complain(line);
    }
    Ok(comparison.non_finite_pixels() == 0 && beyond.is_empty())
}

fn show(comparison: &Comparison, metrics: &[Metric]) -> String {
    let mut header = vec!["image".to_owned()];
    header.extend(metrics.iter().map(|metric| metric.id().to_owned()));
    header.push("non-finite pixels".to_owned());
    let mut table = table::new(header, 1);
    let mut add = |name: &str, scores: &compare::Scores| {
        let mut row = vec![name.to_owned()];
        row.extend(metrics.iter().map(|metric| table::value(scores.metrics[metric.id()])));
        row.push(scores.non_finite_pixels.to_string());
        table.add_row(row);
    };
    match comparison {
        Comparison::Images(scores) => add("", scores),
        Comparison::Folders { frames, summary } => {
            frames.iter().for_each(|frame| add(&frame.name, &frame.scores));
            let mut row = vec!["mean".to_owned()];
            row.extend(metrics.iter().map(|metric| table::value(summary[metric.id()].mean)));
            table.add_row(row);
        }
    }
    format!("{table}\n")
}
