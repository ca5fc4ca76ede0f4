//! `POST /jobs`, `GET /jobs`, `GET` and `DELETE /jobs/{id}`.

use super::{ApiError, ApiPath, ApiQuery, Service, Shared, extract::ApiJson, sequences};
use crate::{
    metrics::Metric,
    run::{self, MetricsOn, PresetSpec, RunSpec, Validate},
    sequence::Sequence,
    store::{Cancelled, Images, Job, JobFilter, JobSpec, NewJob, Report, ReportFilter, Status, Timestamp},
    taa::{Precision, Preset},
    worker::JobEvent,
};
use axum::{
    Json,
    extract::State,
    http::{StatusCode, header},
    response::IntoResponse,
};
use serde::{Deserialize, Deserializer, Serialize, de};
use serde_json::{Value, json};
use std::{fmt, sync::Arc};

/// The body of `POST /jobs`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobRequest {
    /// Hash or name.
    sequence: String,
    /// Preset ids, or objects with `preset` and `parameters`.
    presets: Vec<PresetRequest>,
    #[serde(default = "default_metrics")]
    metrics: Vec<Metric>,
    #[serde(default)]
    history: Precision,
    /// How often each pass of a frame is timed.
    #[serde(default = "default_repeat")]
    repeat: u32,
    /// Only the first so many.
    frames: Option<usize>,
    /// Hold the adapter against the twin.
    #[serde(default)]
    validate: bool,
    /// And find the pass that is wrong, if any.
    #[serde(default)]
    bisect: bool,
    #[serde(default)]
    images: Images,
    branch: Option<String>,
    commit: Option<String>,
    label: Option<String>,
}

fn default_metrics() -> Vec<Metric> {
    vec![Metric::PSNR, Metric::SSIM]
}

fn default_repeat() -> u32 {
    1
}

const MAX_REPEAT: u32 = 100;
const MAX_PRESETS: usize = 64;
const MAX_TEXT_BYTES: usize = 200;

/// A preset by its id, or with overrides.
struct PresetRequest(PresetSpec);

impl<'de> Deserialize<'de> for PresetRequest {
    // By hand, because an untagged enum would answer "did not match any variant" to every mistake.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;

        impl<'de> de::Visitor<'de> for Visitor {
            type Value = PresetRequest;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a preset's id, or an object with `preset` and `parameters`")
            }

            fn visit_str<E: de::Error>(self, id: &str) -> Result<PresetRequest, E> {
                Ok(PresetRequest(PresetSpec {
                    preset: id.to_owned(),
                    parameters: serde_json::Map::new(),
                }))
            }

            fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<PresetRequest, A::Error> {
                PresetSpec::deserialize(de::value::MapAccessDeserializer::new(map)).map(PresetRequest)
            }
        }

        deserializer.deserialize_any(Visitor)
    }
}

/// A job and, once it is done, its reports.
#[derive(Serialize)]
pub struct JobWithReports {
    #[serde(flatten)]
    job: Job,
    reports: Vec<Report>,
}

/// Queues a job: 202 and where to watch it.
pub async fn post(
    State(service): Shared,
    ApiJson(request): ApiJson<JobRequest>,
) -> Result<impl IntoResponse, ApiError> {
    let sequence = sequences::find(&service, &request.sequence).await;
    let sequence = sequence.map_err(|error| match error.status() {
        StatusCode::NOT_FOUND => ApiError::invalid("unknown_sequence", error.detail()).field("sequence"),
        _ => error,
    })?;
    let job = validated(Arc::clone(&service), request, sequence).await?;
    let id = service.store.enqueue(&job, Timestamp::now()).await?;
    service.wake.notify_one();
    let location = [(header::LOCATION, format!("/api/v1/jobs/{id}"))];
    Ok((StatusCode::ACCEPTED, location, Json(load(&service, id).await?)))
}

/// Everything that can be known to be wrong before the job runs is refused here.
async fn validated(
    service: Arc<Service>,
    request: JobRequest,
    stored: crate::store::Sequence,
) -> Result<NewJob, ApiError> {
    request.check(stored.n_frames as usize)?;
    let run = RunSpec {
        presets: request.presets.into_iter().map(|preset| preset.0).collect(),
        metrics: request.metrics,
        history: request.history,
        n_frames: request.frames,
        repeat: request.repeat,
        metrics_on: MetricsOn::Auto,
        validate: Validate::asked(request.validate, request.bisect),
    };
    for (index, spec) in run.presets.iter().enumerate() {
        check_preset(index, spec)?;
    }
    let run = tokio::task::spawn_blocking(move || {
        // The manifest was valid when it was put; that it no longer is can only be our fault.
        let folder = service.folder.sequence(&stored.hash);
        let sequence = Sequence::open(&folder, &service.reader).map_err(ApiError::internal)?;
        run::validate(&run, &sequence)?;
        Ok::<_, ApiError>(run)
    })
    .await
    .map_err(ApiError::internal)??;
    Ok(NewJob {
        sequence_id: stored.id,
        spec: JobSpec {
            run,
            images: request.images,
        },
        git_branch: request.branch,
        git_commit: request.commit,
        label: request.label,
    })
}

impl JobRequest {
    fn check(&self, n_frames: usize) -> Result<(), ApiError> {
        let invalid = |field: &str, detail: String| Err(ApiError::invalid("invalid_field", detail).field(field));
        if !(1..=MAX_PRESETS).contains(&self.presets.len()) {
            return invalid(
                "presets",
                format!("give 1 to {MAX_PRESETS} presets; /api/v1/presets lists them"),
            );
        }
        if !(1..=MAX_REPEAT).contains(&self.repeat) {
            return invalid("repeat", format!("`repeat` must be 1 to {MAX_REPEAT}"));
        }
        if let Some(frames) = self.frames
            && !(1..=n_frames).contains(&frames)
        {
            return invalid(
                "frames",
                format!("`frames` must be 1 to {n_frames}, the sequence's number of frames"),
            );
        }
        for (field, text) in [
            ("branch", &self.branch),
            ("commit", &self.commit),
            ("label", &self.label),
        ] {
            if text.as_ref().is_some_and(|text| text.len() > MAX_TEXT_BYTES) {
                return invalid(field, format!("`{field}` may have at most {MAX_TEXT_BYTES} bytes"));
            }
        }
        Ok(())
    }
}

/// Names the preset or parameter that does not exist or has a wrong value.
fn check_preset(index: usize, spec: &PresetSpec) -> Result<(), ApiError> {
    let preset = Preset::find(&spec.preset).map_err(|error| {
        ApiError::invalid("unknown_preset", error.to_string()).field(format!("presets[{index}].preset"))
    })?;
    preset.recipe.with(&spec.parameters).map_err(|error| {
        let field = format!("presets[{index}].parameters.{}", error.field);
        ApiError::invalid("invalid_parameter", error.to_string()).field(field)
    })?;
    Ok(())
}

async fn load(service: &Service, id: i64) -> Result<JobWithReports, ApiError> {
    let job = service.store.job(id).await?;
    let job = job.ok_or_else(|| ApiError::not_found(format!("there is no job {id}")))?;
    let filter = ReportFilter {
        job_id: Some(id),
        limit: MAX_PRESETS as u32,
        ..ReportFilter::default()
    };
    let reports = service.store.reports(&filter).await?;
    Ok(JobWithReports { job, reports })
}

/// One job with its reports.
pub async fn get(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Json<JobWithReports>, ApiError> {
    load(&service, id).await.map(Json)
}

/// Query of `GET /jobs`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobQuery {
    status: Option<Status>,
    /// Hash or name.
    sequence: Option<String>,
    /// The `next_before` of the page before.
    before: Option<i64>,
    limit: Option<u32>,
}

/// How many rows a list may ask for at once.
pub const MAX_LIMIT: u32 = 1000;

/// Jobs, newest first, a page at a time.
pub async fn list(State(service): Shared, ApiQuery(query): ApiQuery<JobQuery>) -> Result<Json<Value>, ApiError> {
    let limit = query.limit.unwrap_or(50).clamp(1, MAX_LIMIT);
    let sequence_hash = match &query.sequence {
        Some(name) => Some(sequences::find(&service, name).await?.hash),
        None => None,
    };
    let filter = JobFilter {
        status: query.status,
        sequence_hash,
        before: query.before,
        limit,
    };
    let jobs = service.store.jobs(&filter).await?;
    let is_full = jobs.len() == limit as usize;
    let next_before = jobs.last().filter(|_| is_full).map(|job| job.id);
    Ok(Json(json!({"jobs": jobs, "next_before": next_before})))
}

/// Cancels a job: 200 if it will never run, 202 if it ends after its current frame.
pub async fn cancel(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<impl IntoResponse, ApiError> {
    let status = match service.store.cancel(id, Timestamp::now()).await? {
        Cancelled::AtOnce => {
            // No worker will ever speak of this job, so its watchers hear of it here.
            let event = JobEvent {
                job_id: id,
                status: Status::Cancelled,
                n_done: 0,
                n_total: 0,
            };
            let _ = service.events.send(event);
            StatusCode::OK
        }
        Cancelled::Soon => StatusCode::ACCEPTED,
        Cancelled::TooLate => {
            let detail = format!("job {id} has ended already");
            return Err(ApiError::new(StatusCode::CONFLICT, "job_ended", detail));
        }
        Cancelled::Unknown => return Err(ApiError::not_found(format!("there is no job {id}"))),
    };
    Ok((status, Json(load(&service, id).await?)))
}
