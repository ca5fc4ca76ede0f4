//! `POST /jobs`, `GET /jobs`, `GET` and `DELETE /jobs/{id}`.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared,
    answers::LASTING_FROM_STORE,
    blobs,
    extract::ApiJson,
    origin::{EnvironmentRequest, Origin, check_name, invalid, settings, with_origin},
    page::{self, Cursor},
    sequences,
};
use crate::{
    hex::hex,
    metrics::Metric,
    run::{self, MAX_REPEAT, MetricsOn, PresetSpec, RunSpec, Until, Validate},
    sequence::Sequence,
    store::{Cancelled, Images, Job, JobFilter, JobSpec, NewJob, Outputs, Report, ReportFilter, Status, Timestamp},
    taa::{Precision, Preset, Skip},
    worker::{JobEvent, operating_system},
};
use axum::{
    Json,
    extract::State,
    http::{StatusCode, header},
    response::IntoResponse,
};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, de};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::{collections::BTreeMap, fmt, sync::Arc, time::Duration};

with_origin! {
/// The body of `POST /jobs`: presets to run, or images rendered elsewhere to compare.
pub struct JobRequest {
    /// Hash or name.
    #[schemars(length(min = 1, max = 100), regex(pattern = "^[A-Za-z0-9_.-]+$"))]
    sequence: String,
    /// Preset ids, or objects with `preset` and `parameters`.
    #[serde(default)]
    #[schemars(length(max = 64))]
    presets: Vec<PresetRequest>,
    /// Images of another system, instead of presets.
    #[serde(default)]
    outputs: Option<OutputsRequest>,
    /// What to measure.
    #[serde(default = "default_metrics")]
    #[schemars(length(max = 200))]
    metrics: Vec<Metric>,
    /// How history is stored.
    #[serde(default)]
    history: Precision,
    /// Which work may be left out.
    #[serde(default)]
    skip: Skip,
    /// Ends the run early: `psnr±0.05`.
    until: Option<Until>,
    /// How often each pass of a frame is timed.
    #[serde(default = "default_repeat")]
    #[schemars(range(min = 1, max = 100))]
    repeat: u32,
    /// Only the first so many.
    #[serde(default)]
    #[schemars(range(min = 1))]
    frames: Option<usize>,
    /// Run it even where the same was run before.
    #[serde(default)]
    force: bool,
    /// Hold the adapter against the twin.
    #[serde(default)]
    validate: bool,
    /// And find the pass that is wrong, if any.
    #[serde(default)]
    bisect: bool,
    /// Which output images to keep.
    #[serde(default)]
    images: Images,
}
}

/// Images of a system elsewhere.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutputsRequest {
    /// The system's name.
    #[schemars(length(min = 1, max = 100), regex(pattern = "^[A-Za-z0-9_.-]+$"))]
    system: String,
    /// Its settings; other settings are another line.
    #[serde(default)]
    parameters: serde_json::Map<String, Value>,
    /// What rendered them.
    #[serde(default)]
    environment: EnvironmentRequest,
    /// SHA-256 of the blob with each frame's image, by frame index. EXR is linear RGB; other formats are read as the
    /// sequence's reference is.
    images: BTreeMap<String, String>,
}

fn default_metrics() -> Vec<Metric> {
    vec![Metric::PSNR, Metric::SSIM]
}

fn default_repeat() -> u32 {
    1
}

const MAX_PRESETS: usize = 64;

/// A preset by its id, or with overrides.
#[derive(Clone, Debug)]
struct PresetRequest(PresetSpec);

impl JsonSchema for PresetRequest {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "PresetRequest".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let spec = generator.subschema_for::<PresetSpec>();
        schemars::json_schema!({
            "description": "A preset's id, or an object with `preset` and `parameters`.",
            "anyOf": [{"type": "string"}, spec],
        })
    }
}

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
#[derive(Serialize, JsonSchema)]
pub struct JobWithReports {
    #[serde(flatten)]
    job: Arc<Job>,
    /// Asked for again: the reports are those of the first time. Only in the answer to `POST /jobs`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    #[serde(default)]
    answered_from_store: bool,
    /// In the order of its presets.
    reports: Vec<Arc<Report>>,
}

/// Refuses a job where too many wait.
pub async fn check_room(service: &Service) -> Result<(), ApiError> {
    let n_queued = service.store.n_queued().await?;
    if n_queued >= service.config.max_queued_jobs {
        let detail = format!("{n_queued} jobs are waiting already (--max-queued-jobs)");
        return Err(ApiError::busy(detail, Duration::from_secs(30)));
    }
    Ok(())
}

/// Queues a job: 202 and where to watch it. What was asked before is not run again: 200 and the job that answered it.
pub async fn post(
    State(service): Shared,
    ApiJson(mut request): ApiJson<JobRequest>,
) -> Result<impl IntoResponse, ApiError> {
    check_room(&service).await?;
    let origin = request.take_origin();
    let sequence = sequences::named_in_body(&service, &request.sequence).await?;
    let force = request.force;
    let sequence_hash = sequence.hash.clone();
    let mut job = validated(Arc::clone(&service), request, origin, sequence).await?;
    job.result_key = result_key(&service, &job, &sequence_hash);
    let answer = match &job.result_key {
        Some(key) if !force => service.store.answer_to(key).await?,
        _ => None,
    };
    let (status, id) = match answer {
        Some(id) => (StatusCode::OK, id),
        None => {
            let id = service.store.enqueue(&job, Timestamp::now()).await?;
            announce_queued(&service, id);
            (StatusCode::ACCEPTED, id)
        }
    };
    let location = [(header::LOCATION, format!("/api/v1/jobs/{id}"))];
    let job = JobWithReports {
        answered_from_store: answer.is_some(),
        ..load(&service, id).await?
    };
    Ok((status, location, Json(job)))
}

/// Wakes the worker. Its lines of the log have the job's number; this one has the request's, too.
fn announce_queued(service: &Service, job: i64) {
    tracing::info!(job, "job queued");
    service.wake.notify_one();
}

/// Queues a job that is no run: 202, where to watch it, and the job.
pub async fn accept(service: &Service, job: &NewJob) -> Result<impl IntoResponse + use<>, ApiError> {
    let id = service.store.enqueue(job, Timestamp::now()).await?;
    announce_queued(service, id);
    let location = [(header::LOCATION, format!("/api/v1/jobs/{id}"))];
    let job = service.store.job(id).await?;
    let job = job.ok_or_else(|| ApiError::not_found(format!("there is no job {id}")))?;
    Ok((StatusCode::ACCEPTED, location, Json(job)))
}

/// All that the job's reports follow from, as one hash; none where there is no adapter to run it. Provenance is part of it,
/// because trends have a point for each commit.
fn result_key(service: &Service, job: &NewJob, sequence_hash: &str) -> Option<String> {
    let adapter = service.adapter.as_ref().ok()?;
    let parts = serde_json::json!([
        env!("AFTERIMAGE_CODE"),
        sequence_hash,
        job.spec,
        job.project,
        job.provenance,
        adapter,
        operating_system(),
        service.config.clocks,
    ]);
    Some(hex(&Sha256::digest(parts.to_string())))
}

/// Everything that can be known to be wrong before the job runs is refused here.
async fn validated(
    service: Arc<Service>,
    request: JobRequest,
    origin: Origin,
    stored: crate::store::Sequence,
) -> Result<NewJob, ApiError> {
    let n_frames = stored.n_frames as usize;
    request.check(n_frames)?;
    let (project, provenance) = origin.check()?;
    let outputs = match request.outputs {
        None => None,
        Some(outputs) => Some(outputs.check(&service, request.frames.unwrap_or(n_frames))?),
    };
    let run = RunSpec {
        presets: request.presets.into_iter().map(|preset| preset.0).collect(),
        metrics: request.metrics,
        history: request.history,
        n_frames: request.frames.filter(|&frames| frames < n_frames),
        repeat: request.repeat,
        metrics_on: MetricsOn::Auto,
        validate: Validate::asked(request.validate, request.bisect),
        skip: request.skip,
        until: request.until,
    };
    for (index, spec) in run.presets.iter().enumerate() {
        check_preset(index, spec)?;
    }
    let is_comparison = outputs.is_some();
    let run = super::blocking(move || {
        // The manifest was valid when it was put; that it no longer is can only be our fault.
        let folder = service.folder.sequence(&stored.hash);
        let sequence = Sequence::open(&folder, &service.reader).map_err(ApiError::internal)?;
        match is_comparison {
            true => run::validate_comparison(&run.metrics, &sequence)?,
            false => run::validate(&run, &sequence)?,
        }
        Ok::<_, ApiError>(run)
    })
    .await??;
    Ok(NewJob {
        sequence_id: Some(stored.id),
        spec: JobSpec {
            run,
            images: request.images,
            outputs,
            stress: None,
            bench: None,
        },
        project,
        provenance,
        result_key: None,
    })
}

impl OutputsRequest {
    fn check(self, service: &Service, n_frames: usize) -> Result<Outputs, ApiError> {
        check_name("outputs.system", &self.system)?;
        let mut images = BTreeMap::new();
        for (frame, hash) in self.images {
            let index = frame.parse::<usize>().ok().filter(|index| *index < n_frames);
            let Some(index) = index else {
                let detail = format!("`{frame}` is none of the frames 0 to {}", n_frames - 1);
                return Err(invalid("outputs.images", detail));
            };
            blobs::check_hash(&hash)?;
            images.insert(index, hash);
        }
        if images.len() != n_frames {
            let detail = format!(
                "{} of the frames 0 to {} have no image; to compare the first frames alone, say how many in `frames`",
                n_frames - images.len(),
                n_frames - 1
            );
            return Err(invalid("outputs.images", detail));
        }
        let missing: Vec<String> = images
            .values()
            .filter(|hash| !service.folder.blob(hash).is_file())
            .cloned()
            .collect();
        if !missing.is_empty() {
            let detail = format!(
                "{} blobs are not here; put them under /api/v1/blobs/<sha256> first",
                missing.len()
            );
            return Err(ApiError::invalid("missing_blobs", detail)
                .field("outputs.images")
                .missing(missing));
        }
        Ok(Outputs {
            system: self.system,
            parameters: settings(self.parameters),
            environment: self.environment.check()?,
            images,
        })
    }
}

impl JobRequest {
    fn check(&self, n_frames: usize) -> Result<(), ApiError> {
        let invalid = |field: &str, detail: String| Err(invalid(field, detail));
        match (&self.outputs, self.presets.len()) {
            (Some(_), 0) | (None, 1..=MAX_PRESETS) => {}
            (Some(_), _) => return invalid("presets", "give `presets` or `outputs`, not both".to_owned()),
            (None, _) => {
                let detail = format!("give 1 to {MAX_PRESETS} presets (/api/v1/presets lists them), or `outputs`");
                return invalid("presets", detail);
            }
        }
        if self.outputs.is_some() && (self.validate || self.bisect) {
            let detail = "only presets have a twin to be held against; leave it out with `outputs`";
            return invalid("validate", detail.to_owned());
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
    Ok(JobWithReports {
        job,
        answered_from_store: false,
        reports,
    })
}

/// One job with its reports.
pub async fn get(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<impl IntoResponse, ApiError> {
    Ok((LASTING_FROM_STORE, Json(load(&service, id).await?)))
}

/// Query of `GET /jobs`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JobQuery {
    /// Only of this status.
    status: Option<Status>,
    /// Only of this sequence: hash or name.
    sequence: Option<String>,
    /// Only of this project.
    project: Option<String>,
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of jobs.
#[derive(Serialize, JsonSchema)]
pub struct JobPage {
    /// Newest first.
    jobs: Vec<Arc<Job>>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// Jobs, newest first, a page at a time.
pub async fn list(State(service): Shared, ApiQuery(query): ApiQuery<JobQuery>) -> Result<impl IntoResponse, ApiError> {
    let limit = page::limit(query.limit)?;
    let sequence_hash = match &query.sequence {
        Some(name) => Some(sequences::find(&service, name).await?.hash),
        None => None,
    };
    let filter = JobFilter {
        status: query.status,
        sequence_hash,
        project: query.project,
        before: query.cursor.map(|cursor| cursor.0),
        limit,
    };
    let jobs = service.store.jobs(&filter).await?;
    let next_cursor = page::next(&jobs, limit, |job| job.id);
    Ok((LASTING_FROM_STORE, Json(JobPage { jobs, next_cursor })))
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
