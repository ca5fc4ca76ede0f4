//! `POST /bench`, `GET /bench`, `GET /bench/{job}` and its front as a picture. Progress and end are the job's.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared,
    extract::ApiJson,
    origin::with_origin,
    page::{self, Cursor},
    sequences,
};
use crate::{
    bench::{self, BenchReport, BenchSpec},
    metrics::Metric,
    sequence::Sequence,
    store::{BenchFilter, BenchRun, JobSpec, NewJob},
};
use axum::{Json, extract::State, http::header, response::IntoResponse};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

with_origin! {
/// The body of `POST /bench`.
pub struct BenchRequest {
    /// Hash or name.
    #[schemars(length(min = 1, max = 100), regex(pattern = "^[A-Za-z0-9_.-]+$"))]
    sequence: String,
    /// Which settings, and how they are measured.
    bench: BenchSpec,
}
}

/// Queues a benchmark: 202 and the job to watch.
pub async fn post(
    State(service): Shared,
    ApiJson(mut request): ApiJson<BenchRequest>,
) -> Result<impl IntoResponse, ApiError> {
    super::jobs::check_room(&service).await?;
    let (project, provenance) = request.take_origin().check()?;
    let sequence = sequences::named_in_body(&service, &request.sequence).await?;
    let folder = service.folder.sequence(&sequence.hash);
    let checked = Arc::clone(&service);
    let spec = super::blocking(move || {
        // The manifest was valid when it was put; that it no longer is can only be our fault.
        let sequence = Sequence::open(&folder, &checked.reader).map_err(ApiError::internal)?;
        bench::validate(&request.bench, &sequence)?;
        Ok::<_, ApiError>(request.bench)
    })
    .await??;
    let job = NewJob {
        sequence_id: Some(sequence.id),
        spec: JobSpec::bench(spec),
        project,
        provenance,
        result_key: None,
    };
    super::jobs::accept(&service, &job).await
}

/// Query of `GET /bench`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchQuery {
    /// Only those of this sequence: its hash, or the name that it had.
    sequence: Option<String>,
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of benchmarks.
#[derive(Serialize, JsonSchema)]
pub struct BenchPage {
    /// Newest job first.
    runs: Vec<BenchRun>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// Benchmarks, newest job first, a page at a time.
pub async fn list(State(service): Shared, ApiQuery(query): ApiQuery<BenchQuery>) -> Result<Json<BenchPage>, ApiError> {
    let limit = page::limit(query.limit)?;
    let filter = BenchFilter {
        sequence: query.sequence,
        before: query.cursor.map(|cursor| cursor.0),
        limit,
    };
    let runs = service.store.bench_runs(&filter).await?;
    let next_cursor = page::next(&runs, limit, |run| run.job_id);
    Ok(Json(BenchPage { runs, next_cursor }))
}

/// `GET /bench/{job}`
pub async fn get(State(service): Shared, ApiPath(job_id): ApiPath<i64>) -> Result<Json<BenchRun>, ApiError> {
    Ok(Json(find(&service, job_id).await?))
}

/// A job's benchmark.
pub async fn find(service: &Service, job_id: i64) -> Result<BenchRun, ApiError> {
    let run = service.store.bench_run(job_id).await?;
    run.ok_or_else(|| ApiError::not_found(format!("job {job_id} has no benchmark")))
}

/// Query of `GET /bench/{job}/front.svg` and of `points.csv`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrontQuery {
    /// What the front is drawn on; the benchmark's own metric where left out.
    metric: Option<Metric>,
}

impl FrontQuery {
    async fn report(self, service: &Service, job_id: i64) -> Result<BenchReport, ApiError> {
        let report = find(service, job_id).await?.report;
        Ok(match self.metric {
            Some(metric) => report.on(metric),
            None => report,
        })
    }
}

/// `GET /bench/{job}/front.svg`: time against the metric, with the Pareto front.
pub async fn front(
    State(service): Shared,
    ApiPath(job_id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<FrontQuery>,
) -> Result<impl IntoResponse, ApiError> {
    let report = query.report(&service, job_id).await?;
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], report.svg(&[])))
}

/// `GET /bench/{job}/points.csv`
pub async fn points(
    State(service): Shared,
    ApiPath(job_id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<FrontQuery>,
) -> Result<impl IntoResponse, ApiError> {
    let report = query.report(&service, job_id).await?;
    let text = bench::csv(&report.points.iter().collect::<Vec<_>>());
    Ok(([(header::CONTENT_TYPE, "text/csv; charset=utf-8")], text))
}
