//! `GET /reports`, `GET /reports/{id}`, its per-frame rows as JSON or CSV, and a metric over time: `GET /series`.

use super::{ApiError, ApiPath, ApiQuery, Service, Shared, jobs::MAX_LIMIT, sequences};
use crate::{
    metrics::Metric,
    run::report::FrameReport,
    store::{GPU_TIME, Point, Report, ReportFilter, Series, SeriesFilter},
    taa::validation::Validation,
};
use axum::{
    Json,
    extract::State,
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{collections::BTreeSet, fmt::Write as _, str::FromStr as _};

/// The report that a path names.
pub async fn find(service: &Service, id: i64) -> Result<Report, ApiError> {
    let found = service.store.report(id).await?;
    found.ok_or_else(|| ApiError::not_found(format!("there is no report {id}")))
}

/// Query of `GET /reports`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReportQuery {
    /// Hash or name.
    sequence: Option<String>,
    preset: Option<String>,
    limit: Option<u32>,
}

/// Reports, newest first.
pub async fn list(State(service): Shared, ApiQuery(query): ApiQuery<ReportQuery>) -> Result<Json<Value>, ApiError> {
    let filter = ReportFilter {
        sequence_hash: hash_of(&service, query.sequence.as_deref()).await?,
        preset: query.preset,
        limit: query.limit.unwrap_or(50).clamp(1, MAX_LIMIT),
        ..ReportFilter::default()
    };
    Ok(Json(json!({"reports": service.store.reports(&filter).await?})))
}

/// The content hash of the sequence that a filter names, if it names one.
async fn hash_of(service: &Service, sequence: Option<&str>) -> Result<Option<String>, ApiError> {
    match sequence {
        Some(name) => Ok(Some(sequences::find(service, name).await?.hash)),
        None => Ok(None),
    }
}

/// One report without its frames.
pub async fn get(State(service): Shared, ApiPath(id): ApiPath<i64>) -> Result<Json<Report>, ApiError> {
    find(&service, id).await.map(Json)
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
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowsQuery {
    format: Option<Format>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Format {
    Json,
    Csv,
}

/// Every frame's metrics and times; CSV where the query or the header `accept` asks for it.
pub async fn rows(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    ApiQuery(query): ApiQuery<RowsQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    find(&service, id).await?;
    let frames = service.store.frames(id).await?;
    let accepted = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok());
    let accepts_csv = accepted.is_some_and(|accepted| accepted.contains("text/csv"));
    let wants_csv = query.format.map_or(accepts_csv, |format| format == Format::Csv);
    if !wants_csv {
        return Ok(Json(json!({"frames": frames})).into_response());
    }
    let headers = [
        (header::CONTENT_TYPE, "text/csv; charset=utf-8".to_owned()),
        (
            header::CONTENT_DISPOSITION,
            format!("inline; filename=\"report-{id}.csv\""),
        ),
    ];
    Ok((headers, csv(&frames)).into_response())
}

/// A header, then a row a frame: metrics by their ids, times as `<pass>_ms`. Ids hold neither commas nor quotes.
fn csv(frames: &[FrameReport]) -> String {
    let metrics: BTreeSet<&String> = frames.iter().flat_map(|frame| frame.metrics.keys()).collect();
    let passes: BTreeSet<&String> = frames.iter().flat_map(|frame| frame.times_ms.keys()).collect();
    let mut text = String::from("frame,reset,warmup,repaired_texels,non_finite_pixels");
    for metric in &metrics {
        let _ = write!(text, ",{metric}");
    }
    for pass in &passes {
        let _ = write!(text, ",{pass}_ms");
    }
    text.push('\n');
    for frame in frames {
        let (index, repaired, non_finite) = (frame.index, frame.repaired_texels, frame.non_finite_pixels);
        let _ = write!(text, "{index},{},{},{repaired},{non_finite}", frame.reset, frame.warmup);
        for &metric in &metrics {
            text.push(',');
            // Rust writes `inf`, `-inf` and `NaN`; the API's names are lower case throughout.
            if let Some(value) = frame.metrics.get(metric) {
                text.push_str(&value.0.to_string().to_lowercase());
            }
        }
        for &pass in &passes {
            text.push(',');
            if let Some(time_ms) = frame.times_ms.get(pass) {
                let _ = write!(text, "{time_ms}");
            }
        }
        text.push('\n');
    }
    text
}

/// Query of `GET /series`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesQuery {
    /// A metric's id, or `gpu_time_ms`.
    metric: String,
    /// Hash or name.
    sequence: Option<String>,
    preset: Option<String>,
    adapter: Option<String>,
    branch: Option<String>,
    /// Of each series.
    limit: Option<u32>,
}

/// One line of a trend.
#[derive(Serialize)]
pub struct Line {
    #[serde(flatten)]
    series: Series,
    points: Vec<Point>,
}

/// A metric over time, a line for each combination of sequence, recipe and adapter, oldest point first.
pub async fn series(State(service): Shared, ApiQuery(query): ApiQuery<SeriesQuery>) -> Result<Json<Value>, ApiError> {
    check_metric(&query.metric)?;
    let filter = SeriesFilter {
        sequence_hash: hash_of(&service, query.sequence.as_deref()).await?,
        preset: query.preset,
        adapter: query.adapter,
    };
    let limit = query.limit.unwrap_or(200).clamp(1, MAX_LIMIT);
    let mut lines = Vec::new();
    for series in service.store.series(&filter).await? {
        let points = service
            .store
            .points(series.id, &query.metric, query.branch.as_deref(), limit)
            .await?;
        if !points.is_empty() {
            lines.push(Line { series, points });
        }
    }
    Ok(Json(json!({"metric": query.metric, "series": lines})))
}

/// Refuses what no report can have.
fn check_metric(id: &str) -> Result<(), ApiError> {
    if id == GPU_TIME {
        return Ok(());
    }
    let known = Metric::from_str(id);
    known
        .map(drop)
        .map_err(|error| ApiError::invalid("unknown_metric", error.to_string()).field("metric"))
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
        assert_eq!(csv(&frames), expected);
    }
}
