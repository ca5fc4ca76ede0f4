//! `/sequences/{hash or name}`: what a sequence is, how its engine wrote it, its references, its reports and jobs.

use super::{
    format,
    layout::{Page, PageError, Section, script_data},
    overview, parts,
};
use crate::{
    sequence::check::Severity,
    server::{ApiError, ApiPath, Shared},
    store::{Check, JobFilter, Sequence, Timestamp},
};
use axum::{extract::State, response::Html};
use maud::{Markup, html};
use serde_json::{Value, json};

/// The images a manifest may declare, in the order of its specification.
const IMAGES: [&str; 8] = [
    "color",
    "depth",
    "motion",
    "albedo",
    "object_id",
    "reactive",
    "unjittered_color",
    "reference",
];

/// `GET /sequences/{sequence}`
pub async fn page(State(service): Shared, ApiPath(name): ApiPath<String>) -> Result<Html<String>, PageError> {
    let sequence = service.store.sequence(&name).await?;
    let sequence = sequence.ok_or_else(|| ApiError::not_found(format!("there is no sequence `{name}`")))?;
    let now = Timestamp::now();
    let rows = overview::latest(&service, &sequence.hash).await?;
    let filter = JobFilter {
        status: None,
        sequence_hash: Some(sequence.hash.clone()),
        project: None,
        before: None,
        limit: 10,
    };
    let jobs = service.store.jobs(&filter).await?;
    let check = service.store.check(sequence.id).await?;
    let data = json!({"hash": sequence.hash});
    let content = html! {
        (heading(&sequence, now))
        (warnings(&check))
        @if !rows.is_empty() {
            h2 { "Latest reports" }
            (overview::grid(&rows, now))
            p { a href={ "/trends?sequence=" (sequence.hash) } { "Trends of this sequence" } " · "
                a href={ "/jobs/new?sequence=" (sequence.hash) } { "New job" } }
        } @else {
            h2 { "No reports yet" }
            p { a.button href={ "/jobs/new?sequence=" (sequence.hash) } { "New job" } }
            pre tabindex="0" {
                "curl http://localhost:8080/api/v1/jobs -H 'content-type: application/json' \\\n"
                "     -d '{\"sequence\": \"" (sequence.name) "\", \"presets\": [\"none\", \"karis2014\"]}'"
            }
        }
        @if !jobs.is_empty() { h2 { "Jobs" } (parts::job_table(&jobs, now)) }
        h2 { "Frames" }
        (frames(&sequence))
        h2 { "What its engine wrote" }
        (conventions(&sequence.manifest))
        (verdicts(&check))
        (script_data(&data)?)
    };
    let page = Page {
        title: &sequence.name,
        section: Some(Section::Sequences),
        script: Some("sequence.js"),
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

fn heading(sequence: &Sequence, now: Timestamp) -> Markup {
    let text = |field: &str| sequence.manifest[field].as_str();
    html! {
        h1 { (sequence.name) }
        @if let Some(description) = text("description") { p { (description) } }
        ul.facts {
            li { span.key { "frames " } (sequence.n_frames) }
            li { span.key { "rendered at " } (sequence.render_size) }
            @if sequence.output_size != sequence.render_size { li { span.key { "shown at " } (sequence.output_size) } }
            li { span.key { "on disk " } (format::bytes(sequence.n_bytes)) }
            li { span.key { "content " } (format::short_hash(&sequence.hash)) }
            @if let Some(licence) = text("license") { li { span.key { "licence " } (licence) } }
            li { span.key { "put " } (format::age(sequence.put_at, now)) }
        }
    }
}

/// What the convention check warns of, above all numbers that it puts in doubt.
fn warnings(check: &Check) -> Markup {
    let Check::Done { report, .. } = check else {
        return html! {};
    };
    html! { @for finding in &report.findings {
        div class=(if finding.severity == Severity::Warning { "notice bad" } else { "notice" }) {
            p { b { (finding.id) } " " (finding.message) }
            @for suggestion in &finding.suggestions {
                p.muted { "Set " code { (suggestion.field) } " to " code { (plain(&suggestion.value)) } "." }
            }
        }
    } }
}

/// What the check confirms, and what it cannot tell.
fn verdicts(check: &Check) -> Markup {
    html! { @match check {
        Check::Pending => p.muted { "The pixels have not been held against these conventions yet." },
        Check::Failed { error, .. } => p.muted { "The conventions could not be checked: " (error) },
        Check::Done { report, .. } => {
            @if !report.confirmed.is_empty() { p.muted { "Confirmed by the pixels: " (report.confirmed.join(", ")) "." } }
            @for undecided in &report.undecided {
                p.muted { "Not to be told: " (undecided.field) ": " (undecided.reason) "." }
            }
        }
    } }
}

/// Input and reference of one frame, the first without scripts.
fn frames(sequence: &Sequence) -> Markup {
    let base = format!("/api/v1/sequences/{}/frames/0", sequence.hash);
    let last = sequence.n_frames - 1;
    let images: &[(&str, &str)] = match sequence.manifest["reference"].is_null() {
        true => &[("input", "Input")],
        false => &[("input", "Input"), ("reference", "Reference")],
    };
    html! {
        div.controls.single {
            div.frame {
                button #previous type="button" aria-label="Previous frame" { "←" }
                input #frame type="range" min="0" max=(last) value="0" aria-label="Frame";
                button #next type="button" aria-label="Next frame" { "→" }
                output #frame-text for="frame" { "frame 0 of " (last) }
            }
        }
        div.images.pixelated[sequence.output_size.width <= 320] { @for (id, name) in images {
            figure {
                img #{ "image-" (id) } src={ (base) "/" (id) ".png" } alt={ (name) " of frame 0" };
                figcaption { b { (name) } a #{ "exr-" (id) } href={ (base) "/" (id) ".exr" } { "EXR" } }
            }
        } }
    }
}

/// The manifest's sections as a table: what is there, where, and by which conventions.
fn conventions(manifest: &Value) -> Markup {
    let sections = IMAGES
        .iter()
        .filter_map(|name| Some((*name, manifest.get(*name)?.as_object()?)));
    html! {
        div.scroll tabindex="0" role="group" aria-label="Conventions" { table {
            thead { tr { th { "Image" } th { "Files" } th { "Channels" } th { "Conventions" } } }
            tbody { @for (name, section) in sections {
                tr {
                    th scope="row" { (name) }
                    td { code { (section.get("path").map(plain).unwrap_or_default()) } }
                    td { code { (section.get("channels").or(section.get("channel")).map(plain).unwrap_or_default()) } }
                    td.fill { @for (i, (field, value)) in section.iter().filter(|(field, _)| !is_place(field)).enumerate() {
                        @if i > 0 { ", " } span.muted { (field) } " " (plain(value))
                    } }
                }
            } }
        } }
        @if let Some(preset) = manifest["preset"].as_str() {
            p.muted { "Where a section is silent, the conventions of “" (preset) "” hold." }
        }
    }
}

fn is_place(field: &str) -> bool {
    matches!(field, "path" | "channel" | "channels")
}

/// JSON without its quotes and brackets.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(", "),
        other => other.to_string(),
    }
}
