//! `GET /reports`, `GET /reports/{id}`, its per-frame rows, and metrics over time: `GET /series` and what is below it.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared,
    answers::{FROM_STORE, FromStore, LASTING_FROM_STORE},
    export::{Column, Format, Table},
    page::{self, Cursor},
};
use crate::{
    metrics::Metric,
    run::report::FrameReport,
    store::{GPU_TIME, Point, Report, ReportFilter, Series, SeriesFilter, Timestamp, TrendFilter, downsample},
    taa::validation::Validation,
};
use axum::{
    Extension, Json,
    extract::State,
    http::{HeaderMap, StatusCode},
    response::{IntoResponse, Response},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeSet, str::FromStr as _, sync::Arc};

/// The report that a path names.
pub async fn find(service: &Service, id: i64) -> Result<Arc<Report>, ApiError> {
    let found = service.store.report(id).await?;
    found.ok_or_else(|| ApiError::not_found(format!("there is no report {id}")))
}

/// How long what is said of a report holds: once it is complete, nobody adds to it.
fn kept_as(report: &Report) -> Extension<FromStore> {
    if report.complete {
        LASTING_FROM_STORE
    } else {
        FROM_STORE
    }
}

/// Query of `GET /reports`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReportQuery {
    /// Only of this project.
    project: Option<String>,
    /// Only of this sequence: hash or name.
    sequence: Option<String>,
    /// Only of this preset or external system.
    preset: Option<String>,
    /// Only of this branch.
    branch: Option<String>,
    /// Only of this commit.
    commit: Option<String>,
    /// Only of this series.
    series: Option<i64>,
    /// Only the newest of each series.
    latest: Option<bool>,
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of reports.
#[derive(Serialize, JsonSchema)]
pub struct ReportPage {
    /// Newest first.
    reports: Vec<Arc<Report>>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// Reports, newest first.
pub async fn list(
    State(service): Shared,
    ApiQuery(query): ApiQuery<ReportQuery>,
) -> Result<impl IntoResponse, ApiError> {
    let limit = page::limit(query.limit)?;
    let filter = ReportFilter {
        project: query.project,
        sequence: subject(&service, query.sequence).await?,
        preset: query.preset,
        branch: query.branch,
        commit: query.commit,
        series_id: query.series,
        job_id: None,
        latest_only: query.latest.unwrap_or(false),
        before: query.cursor.map(|cursor| cursor.0),
        limit,
    };
    let reports = service.store.reports(&filter).await?;
    let next_cursor = page::next(&reports, limit, |report| report.id);
    Ok((FROM_STORE, Json(ReportPage { reports, next_cursor })))
}

/// What filters call a sequence: the hash of one that is stored, the name of one that is not.
async fn subject(service: &Service, sequence: Option<String>) -> Result<Option<String>, ApiError> {
    let Some(name) = sequence else { return Ok(None) };
    let stored = service.store.sequence_ids(&name).await?;
    Ok(Some(stored.map_or(name, |(_, hash)| hash)))
}

/// One report without its frames.
pub async fn get(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<impl IntoResponse, ApiError> {
    let report = find(&service, id).await?;
    Ok((kept_as(&report), Json(report)))
}

/// How far the adapter is from the twin, with every pass of every frame.
pub async fn validation(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Json<Validation>, ApiError> {
    find(&service, id).await?;
    let found = service.store.validation(id).await?;
    let absent = || {
        ApiError::not_found(format!(
            "report {id} was not validated; a job with \"validate\": true is"
        ))
    };
    found.map(Json).ok_or_else(absent)
}

/// Query of `GET /reports/{id}/frames`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RowsQuery {
    /// JSON unless this or the header `accept` asks for another.
    format: Option<Format>,
}

/// Every frame of a report.
#[derive(Serialize, JsonSchema)]
pub struct FrameList {
    /// In order.
    frames: Vec<FrameReport>,
}

/// Every frame's metrics and times.
pub async fn rows(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<RowsQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let report = find(&service, id).await?;
    let frames = service.store.frames(id).await?;
    match Format::of(query.format, &headers) {
        Format::Json => Ok((kept_as(&report), Json(FrameList { frames })).into_response()),
        format => frame_table(&frames).respond(format, &format!("report-{id}")),
    }
}

/// Columns of a table of frames beside metrics and passes.
pub const FRAME_COLUMNS: [&str; 5] = ["frame", "reset", "warmup", "repaired_texels", "non_finite_pixels"];

/// A row a frame: metrics by their ids, times as `<pass>_ms`.
fn frame_table(frames: &[FrameReport]) -> Table {
    let metrics: BTreeSet<&String> = frames.iter().flat_map(|frame| frame.metrics.keys()).collect();
    let passes: BTreeSet<&String> = frames.iter().flat_map(|frame| frame.times_ms.keys()).collect();
    let integers = |value: fn(&FrameReport) -> u64| {
        Column::Integers(frames.iter().map(|frame| i64::try_from(value(frame)).ok()).collect())
    };
    let mut table = Table::default()
        .with("frame", integers(|frame| frame.index as u64))
        .with("reset", Column::Flags(frames.iter().map(|frame| frame.reset).collect()))
        .with(
            "warmup",
            Column::Flags(frames.iter().map(|frame| frame.warmup).collect()),
        )
        .with("repaired_texels", integers(|frame| frame.repaired_texels))
        .with("non_finite_pixels", integers(|frame| frame.non_finite_pixels));
    for metric in metrics {
        let value = |frame: &FrameReport| frame.metrics.get(metric).map(|value| value.0);
        table = table.with(metric, Column::Numbers(frames.iter().map(value).collect()));
    }
    for pass in passes {
        let time = |frame: &FrameReport| frame.times_ms.get(pass).copied();
        table = table.with(format!("{pass}_ms"), Column::Numbers(frames.iter().map(time).collect()));
    }
    table
}

/// Query of `GET /series`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SeriesQuery {
    /// A metric's id, or `gpu_time_ms`.
    #[schemars(length(min = 1, max = 100))]
    metric: String,
    /// Only of this project.
    project: Option<String>,
    /// Only of this sequence: hash or name.
    sequence: Option<String>,
    /// Only of this preset or external system.
    preset: Option<String>,
    /// Only on adapters of this name.
    adapter: Option<String>,
    /// Only of this branch, and of its parent up to where it left.
    branch: Option<String>,
    /// The newest so many of each series, 1 to 1000; 200 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// One line of a trend.
#[derive(Serialize, JsonSchema)]
pub struct Trend {
    /// What its points have in common.
    #[serde(flatten)]
    series: Series,
    /// Oldest first.
    points: Vec<Point>,
}

/// Lines of one metric.
#[derive(Serialize, JsonSchema)]
pub struct TrendList {
    /// The metric's id.
    metric: String,
    /// One for each combination of sequence, recipe and environment that has points.
    series: Vec<Trend>,
}

/// A metric over time.
pub async fn series(
    State(service): Shared,
    ApiQuery(query): ApiQuery<SeriesQuery>,
) -> Result<impl IntoResponse, ApiError> {
    check_metric(&service, &query.metric).await?;
    let filter = SeriesFilter {
        project: query.project,
        sequence: subject(&service, query.sequence).await?,
        preset: query.preset,
        adapter: query.adapter,
        id: None,
    };
    let limit = page::limit(Some(query.limit.unwrap_or(200)))? as usize;
    let mut lines = Vec::new();
    for series in service.store.series(&filter).await? {
        let points = service
            .store
            .points(&series, &query.metric, query.branch.as_deref(), limit)
            .await?;
        if !points.is_empty() {
            lines.push(Trend { series, points });
        }
    }
    let list = TrendList {
        metric: query.metric,
        series: lines,
    };
    Ok((FROM_STORE, Json(list)))
}

pub(super) async fn find_series(service: &Service, id: i64) -> Result<Series, ApiError> {
    let filter = SeriesFilter {
        id: Some(id),
        ..SeriesFilter::default()
    };
    let found = service.store.series(&filter).await?.pop();
    found.ok_or_else(|| ApiError::not_found(format!("there is no series {id}")))
}

/// One series: what its points have in common.
pub async fn one_series(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Json<Series>, ApiError> {
    find_series(&service, id).await.map(Json)
}

/// Query of `GET /series/{series}/points`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointQuery {
    /// A metric's id, or `gpu_time_ms`.
    #[schemars(length(min = 1, max = 100))]
    metric: String,
    /// Only of this branch, and of its parent up to where it left.
    branch: Option<String>,
    /// Not before: milliseconds since 1970.
    since_ms: Option<i64>,
    /// Not after: milliseconds since 1970.
    until_ms: Option<i64>,
    /// The newest so many, 1 to 1000000; 100000 where left out.
    #[schemars(range(min = 1, max = 1_000_000))]
    limit: Option<usize>,
    /// Thin them to at most so many, 4 to 100000, that keep every peak; none are left out without it.
    #[schemars(range(min = 4, max = 100_000))]
    max_points: Option<usize>,
    /// JSON unless this or the header `accept` asks for another.
    format: Option<Format>,
}

/// Points of a series.
#[derive(Serialize, JsonSchema)]
pub struct PointList {
    /// How many there were before thinning.
    n_points: usize,
    /// Oldest first.
    points: Vec<Point>,
}

/// A metric of one series over time, whole or thinned, as JSON, CSV or Parquet.
pub async fn points(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<PointQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let bad = |field: &str, detail: &str| Err(ApiError::new(StatusCode::BAD_REQUEST, "bad_query", detail).field(field));
    if query.limit.is_some_and(|limit| !(1..=1_000_000).contains(&limit)) {
        return bad("limit", "`limit` must be 1 to 1000000");
    }
    if query.max_points.is_some_and(|max| !(4..=100_000).contains(&max)) {
        return bad("max_points", "`max_points` must be 4 to 100000");
    }
    check_metric(&service, &query.metric).await?;
    let path = match &query.branch {
        None => None,
        Some(branch) => {
            let series = find_series(&service, id).await?;
            let path = service.store.branch_path(&series.project, branch).await?;
            Some(path.unwrap_or_default())
        }
    };
    let filter = TrendFilter {
        path,
        since: Timestamp(query.since_ms.unwrap_or(i64::MIN)),
        until: Timestamp(query.until_ms.unwrap_or(i64::MAX)),
        limit: query.limit.unwrap_or(100_000),
    };
    let all = service.store.trend(id, &query.metric, &filter).await?;
    if all.is_empty() {
        // Nothing of a series, or no such series.
        find_series(&service, id).await?;
    }
    let n_points = all.len();
    let kept = match query.max_points {
        Some(max) => downsample(&all, max),
        None => all,
    };
    let points = service.store.describe(&kept).await?;
    match Format::of(query.format, &headers) {
        Format::Json => Ok((FROM_STORE, Json(PointList { n_points, points })).into_response()),
        format => point_table(points).respond(format, &format!("series-{id}-{}", query.metric)),
    }
}

fn point_table(points: Vec<Point>) -> Table {
    let integers = |value: fn(&Point) -> Option<i64>| Column::Integers(points.iter().map(value).collect());
    let texts = |value: fn(&Point) -> Option<String>| Column::Texts(points.iter().map(value).collect());
    Table::default()
        .with("report", integers(|point| Some(point.report_id)))
        .with("job", integers(|point| point.job_id))
        .with(
            "created_at",
            Column::Times(points.iter().map(|point| point.created_at).collect()),
        )
        .with("branch", texts(|point| point.branch.clone()))
        .with("commit", texts(|point| point.commit.clone()))
        .with(
            "metric_version",
            integers(|point| Some(i64::from(point.metric_version))),
        )
        .with(
            "value",
            Column::Numbers(points.iter().map(|point| Some(point.value.0)).collect()),
        )
}

/// Refuses what no report has: neither a metric of this program nor one that was posted.
pub(super) async fn check_metric(service: &Service, id: &str) -> Result<(), ApiError> {
    let known = Metric::from_str(id);
    if id == GPU_TIME || known.is_ok() || service.store.metric_names().await?.iter().any(|name| name == id) {
        return Ok(());
    }
    let detail = known.err().map(|error| error.to_string()).unwrap_or_default();
    Err(ApiError::invalid("unknown_metric", detail).field("metric"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics;
    use std::collections::BTreeMap;

    #[test]
    fn csv_has_a_column_for_whatever_any_frame_has() {
        let frame = |index, metrics: &[(&str, f64)], times: &[(&str, f64)]| FrameReport {
            index,
            reset: index == 0,
            warmup: false,
            repaired_texels: 3,
            non_finite_pixels: 0,
            metrics: metrics
                .iter()
                .map(|&(id, value)| (id.to_owned(), metrics::Value(value)))
                .collect(),
            times_ms: times
                .iter()
                .map(|&(pass, ms)| (pass.to_owned(), ms))
                .collect::<BTreeMap<_, _>>(),
        };
        let frames = [
            frame(0, &[("psnr", f64::INFINITY), ("ssim", 1.0)], &[]),
            frame(1, &[("psnr", 31.5)], &[("resolve", 0.25)]),
        ];
        let expected = "frame,reset,warmup,repaired_texels,non_finite_pixels,psnr,ssim,resolve_ms\n\
                        0,true,false,3,0,inf,1,\n1,false,false,3,0,31.5,,0.25\n";
        assert_eq!(frame_table(&frames).csv(), expected);
    }
}
