//! `/jobs/new`: forms for what can be queued, made of the lists that the API checks requests against: recipes with their
//! parameters' units and ranges, metrics, knobs, hazards. A control's name is its place in the request, so that one script
//! serves every form and keeps the equivalent request beside it. `?kind=` chooses the form, `?from=` takes over a job.

mod fields;
mod forms;

use super::{
    layout::{Page, PageError, Section, script_data},
    query::{Query, href},
};
use crate::{
    run::Validate,
    server::{ApiError, Shared},
    store::{Job, JobSpec, Provenance},
    stress::StressSpec,
};
use axum::{
    extract::{RawQuery, State},
    response::Html,
};
use maud::{Markup, html};
use serde_json::{Value, json};

/// What can be queued.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Run,
    Bench,
    Stress,
    Comparison,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Run, Self::Bench, Self::Stress, Self::Comparison];

    fn of(spec: &JobSpec) -> Self {
        match spec {
            JobSpec { stress: Some(_), .. } => Self::Stress,
            JobSpec { bench: Some(_), .. } => Self::Bench,
            JobSpec { outputs: Some(_), .. } => Self::Comparison,
            _ => Self::Run,
        }
    }

    /// As the address has it.
    fn id(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Bench => "bench",
            Self::Stress => "stress",
            Self::Comparison => "comparison",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Run => "Recipes on a sequence",
            Self::Bench => "Time and error",
            Self::Stress => "Stability",
            Self::Comparison => "Images from elsewhere",
        }
    }

    /// Where the request goes.
    fn path(self) -> &'static str {
        match self {
            Self::Run | Self::Comparison => "/jobs",
            Self::Bench => "/bench",
            Self::Stress => "/stress",
        }
    }

    /// What the request means where it says nothing, so that it need not be said.
    fn usual(self) -> Value {
        match self {
            Self::Run => {
                json!({"history": "f16", "images": "half", "repeat": 1, "skip": "off", "project": "default"})
            }
            Self::Bench => json!({"bench": {"history": "f16", "n_timed": 20, "knobs": {}}, "project": "default"}),
            Self::Stress => json!({"stress": StressSpec::default(), "project": "default"}),
            Self::Comparison => json!({}),
        }
    }

    /// What an empty form holds.
    fn blank(self) -> Value {
        match self {
            Self::Run => json!({"metrics": ["psnr", "ssim", "flip"]}),
            Self::Bench => json!({"bench": {"metrics": ["psnr"], "metric": "psnr", "n_timed": 20}}),
            Self::Stress => json!({"stress": StressSpec { quick: true, ..StressSpec::default() }}),
            Self::Comparison => json!({
                "sequence": "", "metrics": ["psnr", "ssim", "flip"],
                "outputs": {"system": "ours", "images": {"0": "<SHA-256 of frame 0's file>"}},
            }),
        }
    }
}

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
    let asked = Kind::ALL.into_iter().find(|kind| query.one("kind") == Some(kind.id()));
    let kind = match &from {
        Some(job) => Kind::of(&job.spec),
        None => asked.unwrap_or(Kind::Run),
    };
    let mut body = from.as_deref().map_or_else(|| kind.blank(), request);
    if let (Some(sequence), Some(body)) = (query.one("sequence"), body.as_object_mut()) {
        body.insert("sequence".to_owned(), sequence.into());
    }
    let sequences = service.store.sequences().await?;
    let content = html! {
        h1 { "New job" }
        (kinds(kind, query.one("sequence")))
        @if let Some(job) = &from { p.muted { "As " a href={ "/jobs/" (job.id) } { "job " (job.id) } " was." } }
        noscript { div.notice { p { "Without scripts this form cannot be sent; the request below can." } } }
        div #trouble.notice.bad role="alert" hidden {}
        (forms::form(kind, &sequences, &body))
        h2 { "The same request" }
        pre #curl tabindex="0" { (curl(kind.path(), &body)) }
        (script_data(&json!({"body": body, "path": kind.path(), "usual": kind.usual()}))?)
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

fn kinds(chosen: Kind, sequence: Option<&str>) -> Markup {
    html! {
        nav.kinds aria-label="Kinds of jobs" { @for kind in Kind::ALL {
            a href=(href("/jobs/new", [("kind", Some(kind.id().to_owned())), ("sequence", sequence.map(str::to_owned))]))
                aria-current=[(kind == chosen).then_some("page")] { (kind.name()) }
        } }
    }
}

/// The body that would queue a job again.
fn request(job: &Job) -> Value {
    let (spec, run) = (&job.spec, &job.spec.run);
    let sequence = &job.sequence_hash;
    let mut body = match Kind::of(spec) {
        Kind::Stress => json!({"stress": spec.stress}),
        Kind::Bench => json!({"sequence": sequence, "bench": spec.bench}),
        Kind::Run | Kind::Comparison => json!({
            "sequence": sequence, "metrics": run.metrics, "history": run.history, "repeat": run.repeat,
            "frames": run.n_frames, "images": spec.images, "skip": run.skip, "until": run.until, "force": true,
            "validate": run.validate != Validate::No, "bisect": run.validate == Validate::Bisect,
        }),
    };
    match (&spec.outputs, Kind::of(spec)) {
        (Some(outputs), _) => body["outputs"] = json!(outputs),
        (None, Kind::Run) => body["presets"] = json!(run.presets),
        _ => {}
    }
    let Provenance {
        branch, commit, label, ..
    } = &job.provenance;
    body["project"] = json!(job.project);
    for (name, value) in [("branch", branch), ("commit", commit), ("label", label)] {
        body[name] = json!(value);
    }
    without_nothing(&mut body);
    body
}

/// Removes what says nothing: null, and what is not ticked.
fn without_nothing(value: &mut Value) {
    if let Value::Object(fields) = value {
        fields.retain(|_, value| !value.is_null() && *value != false);
        fields.values_mut().for_each(without_nothing);
    }
}

fn curl(path: &str, body: &Value) -> String {
    let body = serde_json::to_string_pretty(body)
        .unwrap_or_default()
        .replace('\'', "'\\''");
    format!("curl http://localhost:8080/api/v1{path} -H 'content-type: application/json' -d '{body}'")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::BenchSpec;

    #[test]
    fn quotes_in_a_request_do_not_end_the_shells() {
        let text = curl("/jobs", &json!({"label": "it's"}));
        assert!(text.contains("it'\\''s"), "{text}");
    }

    #[test]
    fn what_is_called_usual_is_what_requests_mean() {
        let bench = json!({"presets": [], "metrics": ["psnr"], "metric": "psnr"});
        let bench: BenchSpec = serde_json::from_value(bench).unwrap();
        let bench = serde_json::to_value(bench).unwrap();
        for (name, value) in Kind::Bench.usual()["bench"].as_object().unwrap() {
            assert_eq!(&bench[name], value, "{name}");
        }
    }
}
