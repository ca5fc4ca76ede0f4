//! `afterimage check`

use super::{JsonTarget, print, run::file_reader};
use afterimage::{
    image::files::Backend,
    sequence::{
        Sequence,
        check::{self, Report, Severity},
    },
};
use std::{fmt::Write as _, path::PathBuf};

/// Check from the pixels alone whether a sequence's manifest declares its conventions rightly
#[derive(clap::Args)]
#[command(after_help = "Examples:
  afterimage check dump/
  afterimage check dump.tar --json -

Nothing is changed. What each finding means, and what to change: docs/sequence.md.
Exit status: 0 no warning, 1 warnings, 2 wrong use or bad input.")]
pub struct Arguments {
    /// A folder with manifest.json, a manifest, or a tar, tar.gz or zip
    sequence: PathBuf,
    /// Write the result as JSON to a file, or to standard output for `-`
    #[arg(long, value_name = "FILE")]
    json: Option<JsonTarget>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    let sequence = Sequence::open(&arguments.sequence, &file_reader(Backend::Auto))?;
    let report = check::check(&sequence)?;
    if let Some(target) = &arguments.json {
        target.write(&report)?;
    }
    if !JsonTarget::takes_stdout(arguments.json.as_ref()) {
        print(&show(&report));
    }
    Ok(report.is_clean())
}

fn show(report: &Report) -> String {
    let mut text = String::new();
    for finding in &report.findings {
        let severity = match finding.severity {
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        let _ = writeln!(text, "{severity}: {}: {}", finding.id, finding.message);
        for suggestion in &finding.suggestions {
            let _ = writeln!(text, "    set {} to {}", suggestion.field, suggestion.value);
        }
    }
    if report.is_clean() {
        let _ = writeln!(text, "no warning for `{}`", report.sequence);
    }
    if !report.confirmed.is_empty() {
        let _ = writeln!(text, "confirmed: {}", report.confirmed.join(", "));
    }
    for undecided in &report.undecided {
        let _ = writeln!(text, "cannot tell {}: {}", undecided.field, undecided.reason);
    }
    text
}
