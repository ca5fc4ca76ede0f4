//! `POST /stress`, `GET /stress`, `GET /stress/{job}` and the pictures of its cells. Progress and end are the job's.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared,
    extract::ApiJson,
    origin::with_origin,
    page::{self, Cursor},
};
use crate::{
    store::{JobSpec, NewJob, StressRun},
    stress::{self, StressSpec, report::Cell},
};
use axum::{Json, extract::State, http::header, response::IntoResponse};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

with_origin! {
/// The body of `POST /stress`.
pub struct StressRequest {
    /// Which cells.
    #[serde(default)]
    stress: StressSpec,
}
}

/// Queues a matrix: 202 and the job to watch.
pub async fn post(
    State(service): Shared,
    ApiJson(mut request): ApiJson<StressRequest>,
) -> Result<impl IntoResponse, ApiError> {
    super::jobs::check_room(&service).await?;
    let (project, provenance) = request.take_origin().check()?;
    stress::validate(&request.stress).map_err(|error| ApiError::from(error).within("stress"))?;
    let job = NewJob {
        sequence_id: None,
        spec: JobSpec::stress(request.stress),
        project,
        provenance,
        result_key: None,
    };
    super::jobs::accept(&service, &job).await
}

/// Query of `GET /stress`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StressQuery {
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of matrices.
#[derive(Serialize, JsonSchema)]
pub struct StressPage {
    /// Newest job first, without their cells.
    runs: Vec<StressRun>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// Matrices, newest job first, a page at a time.
pub async fn list(
    State(service): Shared,
    ApiQuery(query): ApiQuery<StressQuery>,
) -> Result<Json<StressPage>, ApiError> {
    let limit = page::limit(query.limit)?;
    let runs = service
        .store
        .stress_runs(query.cursor.map(|cursor| cursor.0), limit)
        .await?;
    let next_cursor = page::next(&runs, limit, |run| run.job_id);
    Ok(Json(StressPage { runs, next_cursor }))
}

/// A matrix with its cells.
#[derive(Serialize, JsonSchema)]
pub struct Matrix {
    #[serde(flatten)]
    run: StressRun,
    /// Hazard by hazard, then recipe by recipe, then by precision.
    cells: Vec<Cell>,
}

/// `GET /stress/{job}`
pub async fn get(State(service): Shared, ApiPath(job_id): ApiPath<i64>) -> Result<Json<Matrix>, ApiError> {
    let (run, cells) = find(&service, job_id).await?;
    Ok(Json(Matrix { run, cells }))
}

/// A job's matrix.
pub async fn find(service: &Service, job_id: i64) -> Result<(StressRun, Vec<Cell>), ApiError> {
    let run = service.store.stress_run(job_id).await?;
    let run = run.ok_or_else(|| ApiError::not_found(format!("job {job_id} has no stress report")))?;
    Ok((run, service.store.stress_cells(job_id).await?))
}

/// `GET /stress/{job}/cells/{picture}`, the index of a cell with `.png`: the adapter, the twin, and their difference, a row a frame of `pictured`.
pub async fn picture(
    State(service): Shared,
    ApiPath((job_id, file)): ApiPath<(i64, String)>,
) -> Result<impl IntoResponse, ApiError> {
    let index = file.strip_suffix(".png").and_then(|index| index.parse::<usize>().ok());
    let missing = || ApiError::not_found(format!("job {job_id} has no picture `{file}` of a cell"));
    let path = service.folder.stress_picture(job_id, index.ok_or_else(missing)?);
    let bytes = tokio::fs::read(path).await.map_err(|_| missing())?;
    Ok(([(header::CONTENT_TYPE, "image/png")], bytes))
}
