//! Pieces that several pages show.

use super::format;
use crate::{
    metrics::Value,
    store::{Environment, Job, Point, Provenance, Report, Series, Status, Timestamp},
    taa::{Precision, Skip},
};
use maud::{Markup, html};
use std::{fmt::Write as _, sync::Arc};

/// A series' recipe in words: preset, what was changed of it, and what is not usual of its history and of how it ran.
pub fn recipe(series: &Series) -> String {
    let mut text = series.preset.clone();
    for (name, value) in &series.overrides {
        let _ = write!(text, ", {name} {}", value.to_string().trim_matches('"'));
    }
    if series.history == Some(Precision::F32) {
        text.push_str(", f32");
    }
    if series.skip == Some(Skip::Exact) {
        text.push_str(", skipping");
    }
    if let Some(n) = series.n_frames {
        text.push_str(&format!(", first {n} frames"));
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

/// What filters call what was measured: the hash of a stored sequence, else a name.
pub fn subject_of(series: &Series) -> String {
    series.sequence_hash.as_ref().unwrap_or(&series.sequence_name).clone()
}

/// An environment in words.
pub fn environment(environment: &Environment) -> String {
    let adapter = &environment.adapter;
    let driver = format!("{} {}", adapter.driver, adapter.driver_version);
    let all = [
        adapter.name.as_str(),
        driver.trim(),
        &environment.os,
        &environment.clocks,
    ];
    let known: Vec<&str> = all.into_iter().filter(|text| !text.is_empty()).collect();
    if known.is_empty() {
        "an unnamed machine".to_owned()
    } else {
        known.join(", ")
    }
}

/// Options whose text is their value.
pub fn same<T: ToString>(names: impl IntoIterator<Item = T>) -> impl Iterator<Item = (String, String)> {
    names.into_iter().map(|name| (name.to_string(), name.to_string()))
}

/// A labelled choice of a form.
pub fn select(
    label: &str,
    name: &str,
    options: impl IntoIterator<Item = (String, String)>,
    chosen: &str,
    all: Option<&str>,
) -> Markup {
    html! {
        label { (label) select name=(name) {
            @if let Some(all) = all { option value="" { (all) } }
            @for (value, text) in options { option value=(value) selected[value == chosen] { (text) } }
        } }
    }
}

/// The step from the second last value to the last: better or worse in words, because colour alone says nothing to
/// many. Values of different metric versions do not compare.
pub fn change(metric: &str, points: &[Point]) -> Markup {
    let [.., before, after] = points else {
        return html! { span.muted { (format::ABSENT) } };
    };
    if before.metric_version != after.metric_version {
        return html! { span.changed { "metric changed" } };
    }
    let difference = after.value.0 - before.value.0;
    if difference == 0.0 || before.value.0 == after.value.0 {
        return html! { span.changed { "same" } };
    }
    let word = if format::is_better(metric, after.value, before.value) {
        "better"
    } else {
        "worse"
    };
    let sign = if difference > 0.0 { "+" } else { "" };
    html! { (sign) (format::value(metric, Some(Value(difference)))) " " span.changed { (word) } }
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

/// Jobs, a row each. One that waits or runs can be followed and cancelled, any other one run again.
pub fn job_table(jobs: &[Arc<Job>], now: Timestamp) -> Markup {
    html! {
        div.scroll { table.jobs {
            thead { tr {
                th { "Job" } th { "Status" } th { "Sequence" } th.wide { "Presets" } th.wide { "Label" }
                th.wide { "Commit" } th.number { "Queued" } th { span.unseen { "Actions" } }
            } }
            tbody { @for job in jobs {
                tr data-job=(job.id) data-live[!job.status.is_final()] {
                    td { a href={ "/jobs/" (job.id) } { "#" (job.id) } }
                    td.standing { (status(job))
                        @if !job.status.is_final() {
                            progress max=(job.n_total.max(1)) value=(job.n_done) aria-label={ "Job " (job.id) } {}
                            span.done.muted { @if job.n_total > 0 { (job.n_done) " of " (job.n_total) } }
                        }
                        @if let Some(error) = &job.error { div.why { (error.message) } }
                    }
                    td { (subject(job)) }
                    td.wide.fill { (job.spec.run.presets.iter().map(|spec| spec.preset.as_str()).collect::<Vec<_>>().join(", ")) }
                    td.wide { (job.provenance.label.as_deref().unwrap_or_default()) }
                    td.wide { (revision(&job.provenance)) }
                    td.number { (format::age(job.created_at, now)) }
                    td { @if job.status.is_final() { a href={ "/jobs/new?from=" (job.id) } { "Run again" } }
                        @else { button.quiet.small type="button" disabled[job.cancel_requested] aria-label={ "Cancel job " (job.id) } { "Cancel" } } }
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
