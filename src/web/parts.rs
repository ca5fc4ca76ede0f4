//! Pieces that several pages show.

use super::format;
use crate::{
    metrics::Value,
    store::{Job, Point, Provenance, Report, Sequence, Series, Status, Timestamp},
    taa::Precision,
};
use maud::{Markup, html};
use std::fmt::Write as _;

/// A series' recipe in words: preset, what was changed of it, and the history if it is not the usual one.
pub fn recipe(series: &Series) -> String {
    let mut text = series.preset.clone();
    for (name, value) in &series.overrides {
        let _ = write!(text, ", {name} {}", value.to_string().trim_matches('"'));
    }
    if series.history == Some(Precision::F32) {
        text.push_str(", f32");
    }
    text
}

/// Where a job stands.
pub fn status(job: &Job) -> Markup {
    let (class, text) = match job.status {
        Status::Queued => ("queued", "queued"),
        Status::Running if job.cancel_requested => ("running", "stopping"),
        Status::Running => ("running", "running"),
        Status::Done => ("done", "done"),
        Status::Failed => ("failed", "failed"),
        Status::Cancelled => ("cancelled", "cancelled"),
    };
    html! { span class={ "status " (class) } { (text) } }
}

/// Branch and commit as far as the submitter gave them.
pub fn revision(provenance: &Provenance) -> Markup {
    place(provenance.branch.as_deref(), provenance.commit.as_deref())
}

/// A sequence's name, and its page where its images are here.
pub fn sequence(series: &Series) -> Markup {
    html! {
        @match &series.sequence_hash {
            Some(hash) => a href={ "/sequences/" (hash) } { (series.sequence_name) },
            None => (series.sequence_name),
        }
    }
}

/// Where a report can be looked at: in its job, else on its own.
pub fn report_href(id: i64, job: Option<i64>, preset_index: i64) -> String {
    match job {
        Some(job) => format!("/jobs/{job}?preset={preset_index}"),
        None => format!("/reports/{id}"),
    }
}

/// A branch and a commit.
pub fn place(branch: Option<&str>, commit: Option<&str>) -> Markup {
    html! {
        @if let Some(commit) = commit { (format::short_hash(commit)) }
        @if let Some(branch) = branch { " " span.muted { (branch) } }
        @if commit.is_none() && branch.is_none() { span.muted { (format::ABSENT) } }
    }
}

/// What a job is about: its sequence, what it measures there, or the stress that it puts recipes under.
pub fn subject(job: &Job) -> Markup {
    html! {
        @if job.spec.stress.is_some() { a href={ "/stress?job=" (job.id) } { "stress" } }
        @else {
            a href={ "/sequences/" (job.sequence_hash) } { (job.sequence_name) }
            @if job.spec.bench.is_some() { ", " a href={ "/bench?job=" (job.id) } { "time and error" } }
        }
    }
}

/// Jobs, a row each.
pub fn job_table(jobs: &[Job], now: Timestamp) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th { "Job" } th { "Status" } th { "Sequence" } th.wide { "Presets" } th.wide { "Label" }
                th.wide { "Commit" } th.number { "Queued" }
            } }
            tbody { @for job in jobs {
                tr {
                    td { a href={ "/jobs/" (job.id) } { "#" (job.id) } }
                    td { (status(job)) @if job.status == Status::Running && job.n_total > 0 {
                        " " span.muted { (job.n_done * 100 / job.n_total) " %" }
                    } }
                    td { (subject(job)) }
                    td.wide.fill { (job.spec.run.presets.iter().map(|spec| spec.preset.as_str()).collect::<Vec<_>>().join(", ")) }
                    td.wide { (job.provenance.label.as_deref().unwrap_or_default()) }
                    td.wide { (revision(&job.provenance)) }
                    td.number { (format::age(job.created_at, now)) }
                }
            } }
        } }
    }
}

/// Sequences, a row each.
pub fn sequence_table(sequences: &[Sequence], now: Timestamp) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th { "Sequence" } th.number { "Frames" } th.number { "Size" } th.number { "On disk" }
                th.wide { "Content" } th.number { "Put" }
            } }
            tbody { @for sequence in sequences {
                tr {
                    td { a href={ "/sequences/" (sequence.hash) } { (sequence.name) } }
                    td.number { (sequence.n_frames) }
                    td.number { (sequence.output_size) }
                    td.number { (format::bytes(sequence.n_bytes)) }
                    td.wide { (format::short_hash(&sequence.hash)) }
                    td.number { (format::age(sequence.put_at, now)) }
                }
            } }
        } }
    }
}

/// A metric's last values as a line a word high; the newest has a dot. Nothing for fewer than two.
pub fn sparkline(metric: &str, points: &[Point]) -> Markup {
    let finite: Vec<f64> = points
        .iter()
        .map(|point| point.value.0)
        .filter(|value| value.is_finite())
        .collect();
    if finite.len() < 2 {
        return html! {};
    }
    let low = finite.iter().copied().fold(f64::INFINITY, f64::min);
    let high = finite.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Noise in the last digit shown must not look like a landslide.
    let range = (high - low)
        .max(low.abs().max(high.abs()) * 1e-3)
        .max(f64::MIN_POSITIVE);
    let middle = (high + low) / 2.0;
    let place = |i: usize| {
        let x = 94.0 * i as f64 / (finite.len() - 1) as f64;
        (x, 11.0 - 16.0 * (finite[i] - middle) / range)
    };
    let mut path = String::new();
    for i in 0..finite.len() {
        let (x, y) = place(i);
        let _ = write!(path, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
    }
    let (x, y) = place(finite.len() - 1);
    let words = format!(
        "{metric}, last {} reports: {} to {}",
        finite.len(),
        format::value(metric, Some(Value(low))),
        format::value(metric, Some(Value(high)))
    );
    html! {
        svg.spark viewBox="0 0 96 22" role="img" aria-label=(words) {
            title { (words) }
            path d=(path) {}
            circle cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) r="2" {}
        }
    }
}

/// The best value of a metric among reports, to be shown in bold; none where all are alike.
pub fn best<'a>(metric: &str, reports: impl Iterator<Item = &'a Report>) -> Option<f64> {
    let values: Vec<f64> = reports
        .filter_map(|report| report.values.get(metric))
        .map(|value| value.0)
        .collect();
    let best = values.iter().copied().reduce(|a, b| {
        if format::is_better(metric, Value(b), Value(a)) {
            b
        } else {
            a
        }
    })?;
    values.iter().any(|&value| value != best).then_some(best)
}
