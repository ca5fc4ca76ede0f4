//! `/jobs/new`: a form for `POST /jobs`, made of the same lists that the API gives: presets with their parameters' units and
//! ranges, metrics, precisions. The script keeps the equivalent request beside it. `?from=` takes over an earlier job.

use super::{
    layout::{Page, PageError, Section, script_data},
    parts,
    query::Query,
};
use crate::{
    metrics::Metric,
    run::Validate,
    server::{ApiError, Shared},
    store::{Job, Sequence},
    taa::PRESETS,
};
use axum::{
    extract::{RawQuery, State},
    response::Html,
};
use maud::{Markup, html};
use serde_json::{Value, json};

const MAX_REPEAT: u32 = 100;

/// `GET /jobs/new`
pub async fn page(State(service): Shared, RawQuery(query): RawQuery) -> Result<Html<String>, PageError> {
    let query = Query::parse(query.as_deref());
    let from = match query.number::<i64>("from") {
        Some(id) => {
            let job = service.store.job(id).await?;
            Some(job.ok_or_else(|| ApiError::not_found(format!("there is no job {id}")))?)
        }
        None => None,
    };
    let mut body = from.as_ref().map_or_else(|| json!({}), request);
    if let (Some(sequence), Some(body)) = (query.one("sequence"), body.as_object_mut()) {
        body.insert("sequence".to_owned(), sequence.into());
    }
    let spec = from.as_ref().map(|job| &job.spec);
    let is_plain = spec.is_none_or(|spec| spec.stress.is_none() && spec.outputs.is_none() && spec.bench.is_none());
    let sequences = service.store.sequences().await?;
    let path = match spec {
        Some(spec) if spec.stress.is_some() => "/stress",
        Some(spec) if spec.bench.is_some() => "/bench",
        _ => "/jobs",
    };
    let content = html! {
        h1 { "New job" }
        @if let Some(job) = &from { p.muted { "As " a href={ "/jobs/" (job.id) } { "job " (job.id) } " was." } }
        noscript { div.notice { p { "Without scripts this form cannot be sent; the request below can." } } }
        div #trouble.notice.bad role="alert" hidden {}
        @if is_plain { (form(&sequences, &body)) } @else { (raw(&body)) }
        h2 { "The same request" }
        pre #curl tabindex="0" { (curl(path, &body)) }
        (script_data(&json!({"body": body, "path": path, "plain": is_plain}))?)
    };
    let page = Page {
        title: "New job",
        section: Some(Section::Jobs),
        script: Some("new_job.js"),
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

/// The body that would queue a job again.
pub fn request(job: &Job) -> Value {
    let (spec, run) = (&job.spec, &job.spec.run);
    if let Some(stress) = &spec.stress {
        return json!({"stress": stress, "project": job.project});
    }
    let (provenance, sequence) = (&job.provenance, &job.sequence_hash);
    if let Some(bench) = &spec.bench {
        return json!({"sequence": sequence, "bench": bench, "project": job.project});
    }
    let mut body = json!({
        "sequence": sequence, "metrics": run.metrics, "history": run.history, "repeat": run.repeat,
        "images": spec.images, "project": job.project, "skip": run.skip, "force": true,
    });
    let optional = [
        ("frames", json!(run.n_frames)),
        ("branch", json!(provenance.branch)),
        ("commit", json!(provenance.commit)),
        ("label", json!(provenance.label)),
        ("until", json!(run.until)),
    ];
    for (name, value) in optional {
        if !value.is_null() {
            body[name] = value;
        }
    }
    if run.validate != Validate::No {
        body["validate"] = json!(true);
        body["bisect"] = json!(run.validate == Validate::Bisect);
    }
    match &spec.outputs {
        Some(outputs) => body["outputs"] = json!(outputs),
        None => body["presets"] = json!(run.presets),
    }
    body
}

fn curl(path: &str, body: &Value) -> String {
    let body = serde_json::to_string_pretty(body)
        .unwrap_or_default()
        .replace('\'', "'\\''");
    format!("curl http://localhost:8080/api/v1{path} -H 'content-type: application/json' -d '{body}'")
}

/// A request that the form has no fields for.
fn raw(body: &Value) -> Markup {
    html! {
        form #job {
            label { "Request" textarea name="body" rows="16" spellcheck="false" { (serde_json::to_string_pretty(body).unwrap_or_default()) } }
            button { "Start" }
        }
    }
}

fn form(sequences: &[Sequence], body: &Value) -> Markup {
    let text = |name: &str| body[name].as_str().unwrap_or_default().to_owned();
    let chosen = sequences
        .iter()
        .find(|sequence| [&sequence.hash, &sequence.name].contains(&&text("sequence")));
    let names = sequences.iter().map(|sequence| {
        let hash = sequence.hash.get(..6).unwrap_or(&sequence.hash);
        let words = format!(
            "{} ({hash}), {} frames, {}",
            sequence.name, sequence.n_frames, sequence.output_size
        );
        (sequence.hash.clone(), words)
    });
    let metrics: Vec<&str> = match body["metrics"].as_array() {
        Some(metrics) => metrics.iter().filter_map(Value::as_str).collect(),
        None => vec!["psnr", "ssim", "flip"],
    };
    let field = |label: &str, name: &str, hint: &str| {
        html! { label { (label) input type="text" name=(name) value=(text(name)) placeholder=(hint) autocomplete="off"; } }
    };
    html! {
        form #job {
            div.controls { (parts::select("Sequence", "sequence", names, chosen.map_or("", |sequence| &sequence.hash), None)) }
            fieldset { legend { "Recipes" }
                div.presets { @for preset in &PRESETS {
                    div.preset data-preset=(preset.id) {
                        label { input type="checkbox" name="preset" value=(preset.id); " " b { (preset.id) } " " span.muted { (preset.description) } }
                        details { summary { "Parameters" } div.parameters {} }
                    }
                } }
            }
            fieldset { legend { "Metrics" }
                div.ticks { @for metric in Metric::ALL {
                    label title=(metric.info().description) { input type="checkbox" name="metric" value=(metric.id()) checked[metrics.contains(&metric.id())]; " " (metric.id()) }
                } }
            }
            fieldset { legend { "How" }
                div.controls {
                    (parts::select("History", "history", parts::same(["f16", "f32"]), if text("history") == "f32" { "f32" } else { "f16" }, None))
                    (parts::select("Images kept", "images", parts::same(["half", "float", "none"]), &text("images"), None))
                    label { "Each pass timed" input type="number" name="repeat" min="1" max=(MAX_REPEAT) value=(body["repeat"].as_u64().unwrap_or(1)); }
                    label { "Only the first frames" input type="number" name="frames" min="1" value=[body["frames"].as_u64()] placeholder="all"; }
                    label.tick { input type="checkbox" name="validate" checked[body["validate"] == true]; " hold against the twin" }
                    label.tick { input type="checkbox" name="bisect" checked[body["bisect"] == true]; " and find the pass that is wrong" }
                }
            }
            fieldset { legend { "Where it belongs" }
                div.controls {
                    (field("Project", "project", "default")) (field("Branch", "branch", "none"))
                    (field("Commit", "commit", "none")) (field("Label", "label", "none"))
                }
            }
            button.main { "Start" }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_in_a_request_do_not_end_the_shells() {
        let text = curl("/jobs", &json!({"label": "it's"}));
        assert!(text.contains("it'\\''s"), "{text}");
    }
}
