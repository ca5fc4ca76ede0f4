//! Results measured elsewhere: finished numbers with `POST /reports`, frame by frame with `POST /reports/{id}/frames`, and
//! Bencher's metric JSON. Images to be compared here are a job: `POST /jobs` with `outputs`.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared,
    extract::{ApiJson, by_name},
    idempotency::Keyed,
    judging::{self, Judgement},
    origin::{AdapterRequest, EnvironmentRequest, check_name, invalid, is_name, is_plain, settings, with_origin},
    reports::FRAME_COLUMNS,
};
use crate::{
    hex::hex,
    metrics::{Summary, Value},
    run::report::FrameReport,
    store::{GPU_TIME, MetricSummary, NewReport, Subject, System, SystemKind, condense, known_version},
    verdict::Rules,
};
use axum::{
    Json,
    extract::State,
    http::{StatusCode, header},
    response::IntoResponse,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Map;
use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet};

const MAX_FRAMES: usize = 100_000;
const MAX_FRAME_INDEX: usize = 10_000_000;
const MAX_NAMES: usize = 200;

/// One frame's numbers.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameRequest {
    /// Position in the sequence, from 0.
    #[schemars(range(max = 10_000_000))]
    pub index: usize,
    /// History was dropped before this frame.
    #[serde(default)]
    pub reset: bool,
    /// The frame is kept but not summarised.
    #[serde(default)]
    pub warmup: bool,
    /// Pixels with a component that is not finite.
    #[serde(default)]
    pub non_finite_pixels: u32,
    /// By metric.
    #[serde(default, deserialize_with = "by_name")]
    pub metrics: BTreeMap<String, Value>,
    /// GPU time by pass, milliseconds.
    #[serde(default, deserialize_with = "by_name")]
    pub times_ms: BTreeMap<String, f64>,
}

with_origin! {
/// The body of `POST /reports`.
pub struct ReportRequest {
    /// Hash or name; a name that was never put is kept as a name.
    #[schemars(length(min = 1, max = 100), regex(pattern = "^[A-Za-z0-9_.-]+$"))]
    pub sequence: String,
    /// Who measured: the name of the engine or its resolve.
    #[schemars(length(min = 1, max = 100), regex(pattern = "^[A-Za-z0-9_.-]+$"))]
    pub system: String,
    /// Its settings; other settings are another line.
    #[serde(default)]
    pub parameters: Map<String, serde_json::Value>,
    /// What measured.
    #[serde(default)]
    pub environment: EnvironmentRequest,
    /// Version of metrics that are not known here; only equal versions are compared.
    #[serde(default, deserialize_with = "by_name")]
    pub metric_versions: BTreeMap<String, u32>,
    /// Every frame, in any order.
    #[serde(default)]
    pub frames: Vec<FrameRequest>,
    /// One number a metric, where there are no frames.
    #[serde(default, deserialize_with = "by_name")]
    pub values: BTreeMap<String, Value>,
    /// What a reader must know to trust the numbers.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Frames will follow, and then `POST /reports/{report}/close`.
    #[serde(default)]
    pub open: bool,
    /// Judge the report by these, and keep them as its line's on the branch.
    #[serde(default)]
    pub rules: Option<Rules>,
}
}

/// A stored report.
#[derive(Serialize, JsonSchema)]
pub struct Posted {
    /// Its number.
    pub id: i64,
    /// Whether it is whole.
    pub complete: bool,
    /// What its rules say, if any were sent.
    pub judgement: Option<Judgement>,
}

/// Reports of one post.
#[derive(Serialize, JsonSchema)]
pub struct PostedAll {
    /// Their numbers.
    pub ids: Vec<i64>,
}

/// Metrics and passes are named by ids that need no quoting anywhere.
fn check_id(field: &str, name: &str) -> Result<(), ApiError> {
    match is_name(&name.replace(':', "-")) {
        true => Ok(()),
        false => Err(invalid(
            field,
            format!("`{name}` is no id: 1 to 100 letters, digits, `-`, `_`, `.` or `:`, and not only dots"),
        )),
    }
}

fn frames(requests: Vec<FrameRequest>) -> Result<Vec<FrameReport>, ApiError> {
    if requests.len() > MAX_FRAMES {
        return Err(invalid("frames", format!("at most {MAX_FRAMES} frames")));
    }
    let mut frames = Vec::with_capacity(requests.len());
    for (position, request) in requests.into_iter().enumerate() {
        let field = |name: &str| format!("frames[{position}].{name}");
        if request.index > MAX_FRAME_INDEX {
            return Err(invalid(&field("index"), format!("at most {MAX_FRAME_INDEX}")));
        }
        if request.metrics.len() + request.times_ms.len() > MAX_NAMES {
            return Err(invalid(
                &field("metrics"),
                format!("at most {MAX_NAMES} metrics and passes"),
            ));
        }
        request
            .metrics
            .keys()
            .try_for_each(|name| check_id(&field("metrics"), name))?;
        request
            .times_ms
            .keys()
            .try_for_each(|name| check_id(&field("times_ms"), name))?;
        if request.times_ms.values().any(|ms| !(*ms >= 0.0 && ms.is_finite())) {
            return Err(invalid(&field("times_ms"), "times are at least 0".to_owned()));
        }
        frames.push(FrameReport {
            reset: request.reset,
            warmup: request.warmup,
            non_finite_pixels: u64::from(request.non_finite_pixels),
            metrics: request.metrics,
            times_ms: request.times_ms,
            ..FrameReport::empty(request.index)
        });
    }
    stay_columns(&frames)?;
    let mut indices: Vec<usize> = frames.iter().map(|frame| frame.index).collect();
    indices.sort_unstable();
    if let Some(pair) = indices.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(invalid("frames", format!("frame {} is there twice", pair[0])));
    }
    Ok(frames)
}

/// Refuses metrics that tables would have a second column of.
fn stay_columns(frames: &[FrameReport]) -> Result<(), ApiError> {
    let metrics: BTreeSet<&str> = frames
        .iter()
        .flat_map(|frame| frame.metrics.keys())
        .map(String::as_str)
        .collect();
    let passes: BTreeSet<&str> = frames
        .iter()
        .flat_map(|frame| frame.times_ms.keys())
        .map(String::as_str)
        .collect();
    let is_taken = |metric: &&str| {
        FRAME_COLUMNS.contains(metric)
            || metric.strip_suffix("_ms").is_some_and(|pass| passes.contains(pass))
            || *metric == GPU_TIME && !passes.is_empty()
    };
    match metrics.into_iter().find(is_taken) {
        None => Ok(()),
        Some(metric) => Err(invalid(
            "frames",
            format!(
                "`{metric}` is no metric here: frames and their `times_ms` have it already; leave it out or rename it"
            ),
        )),
    }
}

/// What a name or a hash stands for: the stored sequence, else the bare name.
async fn subject(service: &Service, sequence: &str) -> Result<Subject, ApiError> {
    if let Some((id, _)) = service.store.sequence_ids(sequence).await? {
        return Ok(Subject::Sequence(id));
    }
    check_name("sequence", sequence)?;
    if sequence.len() == 64 && sequence.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        let detail = format!("there is no sequence with the hash `{sequence}`; put it, or name it");
        return Err(ApiError::invalid("unknown_sequence", detail).field("sequence"));
    }
    Ok(Subject::Named(sequence.to_owned()))
}

impl ReportRequest {
    async fn report(mut self, service: &Service) -> Result<NewReport, ApiError> {
        check_name("system", &self.system)?;
        let (project, provenance) = self.take_origin().check()?;
        if self.values.len() + self.metric_versions.len() > MAX_NAMES {
            return Err(invalid("values", format!("at most {MAX_NAMES} metrics")));
        }
        self.values.keys().try_for_each(|name| check_id("values", name))?;
        self.metric_versions
            .keys()
            .try_for_each(|name| check_id("metric_versions", name))?;
        if self.notes.len() > 50 || self.notes.iter().any(|note| note.len() > 2000) {
            return Err(invalid("notes", "at most 50 notes of at most 2000 bytes".to_owned()));
        }
        let has_numbers = |frame: &FrameRequest| !(frame.metrics.is_empty() && frame.times_ms.is_empty());
        if !self.frames.iter().any(has_numbers) && self.values.is_empty() && !self.open {
            return Err(invalid(
                "frames",
                "the report has no numbers; give `frames`, `values` or `open: true`".to_owned(),
            ));
        }
        if !self.values.is_empty() && (self.open || !self.frames.is_empty()) {
            return Err(invalid(
                "values",
                "are computed from frames; give `values` only without frames".to_owned(),
            ));
        }
        let frames = frames(self.frames)?;
        let (mut metrics, times_ms) = condense(&frames, &self.metric_versions);
        for (metric, value) in self.values {
            let version = self
                .metric_versions
                .get(&metric)
                .copied()
                .unwrap_or_else(|| known_version(&metric));
            let summary = Summary::of(&metric, [value]);
            metrics.insert(metric, MetricSummary { version, summary });
        }
        if self.open {
            metrics.clear();
        }
        let parameters = serde_json::Value::Object(settings(self.parameters));
        Ok(NewReport {
            job: None,
            project,
            subject: subject(service, &self.sequence).await?,
            system: System {
                kind: SystemKind::External,
                name: self.system,
                history: None,
                skip: None,
                n_frames: None,
                overrides: parameters.clone(),
                parameters,
            },
            environment: self.environment.check()?,
            provenance,
            revision: String::new(),
            notes: self.notes,
            stages_ms: BTreeMap::new(),
            metrics,
            times_ms: if self.open { BTreeMap::new() } else { times_ms },
            frames,
            validation: None,
            complete: !self.open,
        })
    }
}

/// `POST /reports`
pub async fn post(
    State(service): Shared,
    key: Keyed,
    ApiJson(mut request): ApiJson<ReportRequest>,
) -> Result<impl IntoResponse, ApiError> {
    let rules = request.rules.take();
    if let Some(rules) = &rules {
        rules.validate().map_err(judging::rules_error)?;
        if request.open {
            return Err(invalid(
                "rules",
                "an open report is judged once it is closed: POST /verdicts".to_owned(),
            ));
        }
    }
    let complete = !request.open;
    let address = |id: i64| format!("/api/v1/reports/{id}");
    let id = match key.stored() {
        Some(ids) => ids[0],
        None => {
            let keep = match rules {
                Some(_) => key.keep_stored(),
                None => key.keep(move |ids| {
                    let posted = Posted {
                        id: ids[0],
                        complete,
                        judgement: None,
                    };
                    (StatusCode::CREATED, Some(address(ids[0])), posted)
                }),
            };
            let report = request.report(&service).await?;
            service.store.ingest().keeping(keep).report(report).await?
        }
    };
    let judgement = match rules {
        Some(rules) => Some(judging::judge(&service, &[id], rules).await?),
        None => None,
    };
    Ok((
        StatusCode::CREATED,
        [(header::LOCATION, address(id))],
        Json(Posted {
            id,
            complete,
            judgement,
        }),
    ))
}

/// The body of `POST /reports/{report}/frames`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FramesRequest {
    /// More frames; where a frame is there already, its metrics and times are added to.
    #[schemars(length(min = 1))]
    frames: Vec<FrameRequest>,
}

/// How many frames were taken.
#[derive(Serialize, JsonSchema)]
pub struct FramesPosted {
    /// The report.
    id: i64,
    /// How many.
    n_frames: usize,
}

/// `POST /reports/{report}/frames`
pub async fn post_frames(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    key: Keyed,
    ApiJson(request): ApiJson<FramesRequest>,
) -> Result<Json<FramesPosted>, ApiError> {
    let frames = frames(request.frames)?;
    if frames.is_empty() {
        return Err(invalid("frames", "give at least one frame".to_owned()));
    }
    let n_frames = frames.len();
    let keep = key.keep(move |_| (StatusCode::OK, None, FramesPosted { id, n_frames }));
    service.store.ingest().keeping(keep).frames(id, frames).await?;
    Ok(Json(FramesPosted { id, n_frames }))
}

/// The body of `POST /reports/{report}/close`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[derive(Default)]
pub struct CloseRequest {
    /// Version of metrics that are not known here.
    #[serde(deserialize_with = "by_name")]
    metric_versions: BTreeMap<String, u32>,
    /// Judge the report by these, and keep them as its line's on the branch.
    rules: Option<Rules>,
}

/// `POST /reports/{report}/close`: summarises the frames; from now on the report counts.
pub async fn close(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    key: Keyed,
    ApiJson(request): ApiJson<CloseRequest>,
) -> Result<Json<Posted>, ApiError> {
    if let Some(rules) = &request.rules {
        rules.validate().map_err(judging::rules_error)?;
    }
    let complete = true;
    if key.stored().is_none() {
        let keep = match request.rules {
            Some(_) => key.keep_stored(),
            None => key.keep(move |_| {
                let posted = Posted {
                    id,
                    complete,
                    judgement: None,
                };
                (StatusCode::OK, None, posted)
            }),
        };
        let ingest = service.store.ingest().keeping(keep);
        ingest.close(id, request.metric_versions).await?;
    }
    let judgement = match request.rules {
        Some(rules) => Some(judging::judge(&service, &[id], rules).await?),
        None => None,
    };
    Ok(Json(Posted {
        id,
        complete,
        judgement,
    }))
}

/// Bencher's metric JSON: by benchmark, by measure.
#[derive(Deserialize, JsonSchema)]
#[serde(transparent)]
#[schemars(extend("minProperties" = 1, "maxProperties" = 1000))]
pub struct BencherRequest(#[serde(deserialize_with = "by_name")] BTreeMap<String, BencherMeasures>);

/// A benchmark's measures.
#[derive(Deserialize, JsonSchema)]
#[serde(transparent)]
#[schemars(inline)]
pub struct BencherMeasures(#[serde(deserialize_with = "by_name")] BTreeMap<String, BencherMetric>);

/// One measure of a benchmark.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BencherMetric {
    /// The value.
    value: f64,
    /// Lower end of its spread.
    #[serde(default)]
    lower_value: Option<f64>,
    /// Upper end of its spread.
    #[serde(default)]
    upper_value: Option<f64>,
}

/// Where Bencher's results belong; its JSON does not say.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BencherQuery {
    /// Project.
    project: Option<String>,
    /// Branch.
    branch: Option<String>,
    /// Commit.
    commit: Option<String>,
    /// The machine's name.
    testbed: Option<String>,
    /// What measured; `bencher` where left out.
    system: Option<String>,
}

/// `POST /reports/bencher`: a report a benchmark. A benchmark is a sequence, its measures are metrics.
pub async fn post_bencher(
    State(service): Shared,
    ApiQuery(query): ApiQuery<BencherQuery>,
    key: Keyed,
    ApiJson(BencherRequest(benchmarks)): ApiJson<BencherRequest>,
) -> Result<impl IntoResponse, ApiError> {
    if benchmarks.is_empty() || benchmarks.len() > 1000 {
        return Err(ApiError::invalid("invalid_field", "give 1 to 1000 benchmarks"));
    }
    stay_distinct(benchmarks.keys())?;
    let mut reports = Vec::with_capacity(benchmarks.len());
    for (benchmark, BencherMeasures(measures)) in benchmarks {
        stay_distinct(measures.keys())?;
        let mut notes = Vec::new();
        let mut values = BTreeMap::new();
        for (measure, metric) in measures {
            if let (Some(low), Some(high)) = (metric.lower_value, metric.upper_value) {
                notes.push(format!("{measure}: {low} to {high}"));
            }
            values.insert(plain(&measure), Value(metric.value));
        }
        let request = ReportRequest {
            sequence: plain(&benchmark),
            system: query.system.clone().unwrap_or_else(|| "bencher".to_owned()),
            parameters: Map::new(),
            environment: EnvironmentRequest {
                adapter: AdapterRequest {
                    name: query.testbed.clone().unwrap_or_default(),
                    ..AdapterRequest::default()
                },
                ..EnvironmentRequest::default()
            },
            project: query.project.clone(),
            branch: query.branch.clone(),
            commit: query.commit.clone(),
            from: None,
            parent: None,
            pull_request: None,
            engine_version: None,
            label: None,
            labels: BTreeMap::new(),
            metric_versions: BTreeMap::new(),
            frames: Vec::new(),
            values,
            notes,
            open: false,
            rules: None,
        };
        reports.push(request.report(&service).await?);
    }
    let keep = key.keep(|ids| (StatusCode::CREATED, None, PostedAll { ids: ids.to_vec() }));
    let ids = service.store.ingest().keeping(keep).reports(reports).await?;
    Ok((StatusCode::CREATED, Json(PostedAll { ids })))
}

/// Refuses names of which two would become one.
fn stay_distinct<'a>(names: impl Iterator<Item = &'a String>) -> Result<(), ApiError> {
    let mut seen = BTreeMap::new();
    for name in names {
        if let Some(other) = seen.insert(plain(name), name) {
            let detail = format!(
                "`{other}` and `{name}` would both be called `{}`; rename one",
                plain(name)
            );
            return Err(ApiError::invalid("invalid_name", detail));
        }
    }
    Ok(())
}

/// Benchmarks are named by paths and types; what is no letter or digit becomes a dash. Of a long one, its hash keeps it apart.
fn plain(name: &str) -> String {
    let plain: String = name.chars().map(|c| if is_plain(c) { c } else { '-' }).collect();
    match plain.len() {
        0..=100 => plain,
        _ => format!("{}-{}", &plain[..83], &hex(&Sha256::digest(name))[..16]),
    }
}
