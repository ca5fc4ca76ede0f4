//! One file a command. Each returns whether its check said yes.

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "printing is what a command line is for"
)]

pub mod bake;
pub mod bench;
pub mod check;
pub mod ci;
pub mod client;
pub mod compare;
mod lavapipe;
pub mod list;
pub mod openapi;
pub mod paper;
pub mod regressions;
pub mod run;
pub mod serve;
pub mod stress;
pub mod submit;
pub mod table;
pub mod token;
mod validation;

use afterimage::run::Observer;
use anyhow::Context;
use serde::Serialize;
use std::{fmt, fs, io::IsTerminal, path::PathBuf};

/// Where JSON goes.
#[derive(Clone, Debug)]
pub enum JsonTarget {
    Stdout,
    File(PathBuf),
}

impl From<&str> for JsonTarget {
    fn from(text: &str) -> Self {
        if text == "-" {
            Self::Stdout
        } else {
            Self::File(text.into())
        }
    }
}

impl JsonTarget {
    pub fn write(&self, value: &impl Serialize) -> anyhow::Result<()> {
        self.write_text(&(serde_json::to_string_pretty(value)? + "\n"))
    }

    pub fn write_text(&self, text: &str) -> anyhow::Result<()> {
        match self {
            Self::Stdout => print(text),
            Self::File(path) => fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?,
        }
        Ok(())
    }

    /// Whether a table on the screen would be in the JSON's way.
    pub fn takes_stdout(this: Option<&Self>) -> bool {
        matches!(this, Some(Self::Stdout))
    }
}

/// Prints to standard output.
pub fn print(text: &str) {
    print!("{text}");
}

/// Prints what a user should know although all is well.
pub fn note(message: &str) {
    eprintln!("note: {message}");
}

/// Prints an error.
pub fn complain(message: &str) {
    eprintln!("error: {message}");
}

/// Sends the library's log to standard error: warnings, or what `AFTERIMAGE_LOG` asks for; as JSON
/// where `AFTERIMAGE_LOG_FORMAT` is `json`.
pub fn log_to_stderr() {
    let filter = tracing_subscriber::EnvFilter::try_from_env("AFTERIMAGE_LOG")
        .unwrap_or_else(|_| "warn,afterimage=info,wgpu_hal=error".into());
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr);
    // One JSON object a line, for whoever collects logs.
    match std::env::var("AFTERIMAGE_LOG_FORMAT").as_deref() {
        Ok("json") => lines.json().init(),
        _ => lines.with_ansi(std::io::stderr().is_terminal()).init(),
    }
}

/// A progress bar on standard error; nothing where that is not a terminal.
/// Shows a run's progress, keeps no images.
pub struct Bar(pub indicatif::ProgressBar);

impl Observer for Bar {
    fn progress(&self, n_done: usize, n_total: usize) {
        self.0.set_length(n_total as u64);
        self.0.set_position(n_done as u64);
    }
}

pub fn progress_bar(title: &str, n_total: u64) -> indicatif::ProgressBar {
    let style = indicatif::ProgressStyle::with_template("{prefix} [{bar:40}] {pos}/{len} {eta}")
        .expect("a valid template")
        .progress_chars("=> ");
    indicatif::ProgressBar::new(n_total)
        .with_style(style)
        .with_prefix(title.to_owned())
}

/// Text as a part of a query.
pub fn percent_encoded(text: &str) -> impl fmt::Display {
    percent_encoding::utf8_percent_encode(text, percent_encoding::NON_ALPHANUMERIC)
}
