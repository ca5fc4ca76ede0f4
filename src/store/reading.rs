//! Reading reports: one in full, the rows of its frames, the latest of every series, and a metric over time.

use super::{Store, StoreError, Timestamp, value};
use crate::{
    metrics::{Summary, Value},
    run::report::{AdapterInfo, FrameReport, TimeSummary},
    taa::{Precision, validation::Validation},
};
use serde::Serialize;
use sqlx::{FromRow, Row, sqlite::SqliteRow};
use std::collections::BTreeMap;

/// The id under which a series of GPU times is asked for, beside the metrics' own.
pub const GPU_TIME: &str = "gpu_time_ms";

/// A stored report without its frames.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Number, rising with time.
    pub id: i64,
    /// The job it came from.
    pub job_id: i64,
    /// Position in that job's list of presets.
    pub preset_index: i64,
    /// What it is comparable with.
    #[serde(flatten)]
    pub series: Series,
    /// Branch the submitter gave.
    pub branch: Option<String>,
    /// Commit the submitter gave.
    pub commit: Option<String>,
    /// The submitter's free text.
    pub label: Option<String>,
    /// Git revision of the build that ran.
    pub revision: String,
    /// What a reader must know to trust the numbers.
    pub notes: Vec<String>,
    /// Wall time of each stage of the whole job, milliseconds.
    pub stages_ms: BTreeMap<String, f64>,
    /// GPU time of one frame, milliseconds: the sum of its passes' medians.
    pub gpu_time_ms: Option<f64>,
    /// When it was stored.
    pub created_at: Timestamp,
    /// The one number that stands for the sequence, by metric: the mean of its frames after warm-up.
    pub values: BTreeMap<String, Value>,
    /// By metric.
    pub summary: BTreeMap<String, Summary>,
    /// Version of each metric.
    pub metric_versions: BTreeMap<String, u32>,
    /// By pass, milliseconds.
    pub times_ms: BTreeMap<String, TimeSummary>,
    /// How far the adapter is from the twin, without its frames; none where that was not asked.
    pub validation: Option<Validation>,
}

/// What two reports must share to be comparable.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// Row id.
    #[serde(rename = "series_id")]
    pub id: i64,
    /// Content hash of the sequence.
    pub sequence_hash: String,
    /// Name of the sequence.
    pub sequence_name: String,
    /// Preset id.
    pub preset: String,
    /// How history was stored.
    pub history: Precision,
    /// The recipe in full.
    pub parameters: serde_json::Value,
    /// The parameters that the submitter changed.
    pub overrides: serde_json::Map<String, serde_json::Value>,
    /// What ran it.
    pub adapter: AdapterInfo,
}

/// Which reports to list, newest first.
#[derive(Clone, Debug, Default)]
pub struct ReportFilter {
    /// Only of the sequence with this content hash.
    pub sequence_hash: Option<String>,
    /// Only of this preset.
    pub preset: Option<String>,
    /// Only of this job.
    pub job_id: Option<i64>,
    /// Only the newest of each series.
    pub latest_only: bool,
    /// At most so many.
    pub limit: u32,
}

/// Which series to show.
#[derive(Clone, Debug, Default)]
pub struct SeriesFilter {
    /// Only of the sequence with this content hash.
    pub sequence_hash: Option<String>,
    /// Only of this preset.
    pub preset: Option<String>,
    /// Only on adapters of this name.
    pub adapter: Option<String>,
}

/// A metric at one point in time.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// The report it stands for.
    pub report_id: i64,
    /// The job of that report.
    pub job_id: i64,
    /// Branch the submitter gave.
    pub branch: Option<String>,
    /// Commit the submitter gave.
    pub commit: Option<String>,
    /// When it was stored.
    pub created_at: Timestamp,
    /// The value.
    pub value: Value,
    /// Version of the metric; only equal ones compare. 0 for times.
    pub metric_version: u32,
}

/// Parses a JSON column.
fn json<T: serde::de::DeserializeOwned>(row: &SqliteRow, column: &str) -> Result<T, sqlx::Error> {
    serde_json::from_str(row.try_get(column)?).map_err(|source| sqlx::Error::Decode(source.into()))
}

impl FromRow<'_, SqliteRow> for Series {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("series_id")?,
            sequence_hash: row.try_get("hash")?,
            sequence_name: row.try_get("name")?,
            preset: row.try_get("preset")?,
            history: value::precision(row.try_get("history")?),
            parameters: json(row, "parameters")?,
            overrides: json(row, "overrides")?,
            adapter: AdapterInfo {
                name: row.try_get("adapter_name")?,
                backend: row.try_get("backend")?,
                kind: row.try_get("kind")?,
                driver: row.try_get("driver")?,
                driver_version: row.try_get("driver_version")?,
            },
        })
    }
}

impl FromRow<'_, SqliteRow> for Report {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job_id: row.try_get("job_id")?,
            preset_index: row.try_get("preset_index")?,
            series: Series::from_row(row)?,
            branch: row.try_get("git_branch")?,
            commit: row.try_get("git_commit")?,
            label: row.try_get("label")?,
            revision: row.try_get("revision")?,
            notes: json(row, "notes")?,
            stages_ms: json(row, "stages_ms")?,
            gpu_time_ms: row.try_get("gpu_time_ms")?,
            created_at: row.try_get("created_at")?,
            values: BTreeMap::new(),
            summary: BTreeMap::new(),
            metric_versions: BTreeMap::new(),
            times_ms: BTreeMap::new(),
            validation: None,
        })
    }
}

/// A series with everything that names it.
macro_rules! select_series {
    ($columns:literal, $from:literal, $rest:literal) => {
        concat!(
            "SELECT ",
            $columns,
            " series.id AS series_id, sequences.hash, sequences.name, variants.preset, variants.history,
             variants.parameters, variants.overrides, adapters.name AS adapter_name, adapters.backend, adapters.kind,
             adapters.driver, adapters.driver_version FROM ",
            $from,
            " JOIN sequences ON sequences.id = series.sequence_id
             JOIN variants ON variants.id = series.variant_id
             JOIN adapters ON adapters.id = series.adapter_id ",
            $rest
        )
    };
}

/// A report with its series and what its job's submitter said.
macro_rules! select_reports {
    ($rest:literal) => {
        select_series!(
            "reports.id, reports.job_id, reports.preset_index, reports.revision, reports.notes, reports.stages_ms,
             reports.gpu_time_ms, reports.created_at, jobs.git_branch, jobs.git_commit, jobs.label,",
            "reports JOIN jobs ON jobs.id = reports.job_id JOIN series ON series.id = reports.series_id",
            $rest
        )
    };
}

impl Store {
    /// The report with this number.
    pub async fn report(&self, id: i64) -> Result<Option<Report>, StoreError> {
        let found = sqlx::query_as(select_reports!("WHERE reports.id = ?"))
            .bind(id)
            .fetch_optional(&self.readers)
            .await?;
        match found {
            Some(report) => Ok(Some(self.with_summaries(report).await?)),
            None => Ok(None),
        }
    }

    /// Reports, newest first; of one job, in the order of its presets.
    pub async fn reports(&self, filter: &ReportFilter) -> Result<Vec<Report>, StoreError> {
        let sql = if filter.job_id.is_some() {
            select_reports!(
                "WHERE reports.job_id = ?3 AND ?1 IS NULL AND ?2 IS NULL ORDER BY reports.preset_index LIMIT ?4"
            )
        } else if filter.latest_only {
            select_reports!(
                "WHERE reports.id IN (SELECT latest_report_id FROM series) AND (?1 IS NULL OR sequences.hash = ?1)
                   AND (?2 IS NULL OR variants.preset = ?2) AND ?3 IS NULL
                 ORDER BY reports.id DESC LIMIT ?4"
            )
        } else {
            select_reports!(
                "WHERE (?1 IS NULL OR sequences.hash = ?1) AND (?2 IS NULL OR variants.preset = ?2) AND ?3 IS NULL
                 ORDER BY reports.id DESC LIMIT ?4"
            )
        };
        let found: Vec<Report> = sqlx::query_as(sql)
            .bind(&filter.sequence_hash)
            .bind(&filter.preset)
            .bind(filter.job_id)
            .bind(filter.limit)
            .fetch_all(&self.readers)
            .await?;
        let mut reports = Vec::with_capacity(found.len());
        for report in found {
            reports.push(self.with_summaries(report).await?);
        }
        Ok(reports)
    }

    /// Adds what the report's child tables hold.
    async fn with_summaries(&self, mut report: Report) -> Result<Report, StoreError> {
        let metrics = sqlx::query(
            "SELECT metrics.name, version, value, special, summary
             FROM report_metrics JOIN metrics ON metrics.id = metric_id WHERE report_id = ?",
        )
        .bind(report.id)
        .fetch_all(&self.readers)
        .await?;
        for row in metrics {
            let metric: String = row.try_get("name")?;
            let mean = value::value(row.try_get("value")?, row.try_get("special")?);
            report.values.insert(metric.clone(), mean);
            report.summary.insert(metric.clone(), json(&row, "summary")?);
            report.metric_versions.insert(metric, row.try_get("version")?);
        }
        let passes: Vec<(String, f64, f64, f64, i64)> = sqlx::query_as(
            "SELECT passes.name, median_ms, min_ms, mad_ms, n_samples
             FROM report_passes JOIN passes ON passes.id = pass_id WHERE report_id = ?",
        )
        .bind(report.id)
        .fetch_all(&self.readers)
        .await?;
        for (pass, median, min, mad, n) in passes {
            let n = n as usize;
            report.times_ms.insert(pass, TimeSummary { median, min, mad, n });
        }
        let validation: Option<String> = sqlx::query_scalar("SELECT summary FROM validations WHERE report_id = ?")
            .bind(report.id)
            .fetch_optional(&self.readers)
            .await?;
        report.validation = validation.map(|json| serde_json::from_str(&json)).transpose()?;
        Ok(report)
    }

    /// How far the adapter was from the twin in a report, with every frame; none where that was not asked.
    pub async fn validation(&self, report_id: i64) -> Result<Option<Validation>, StoreError> {
        let found: Option<(String, String)> =
            sqlx::query_as("SELECT summary, frames FROM validations WHERE report_id = ?")
                .bind(report_id)
                .fetch_optional(&self.readers)
                .await?;
        let Some((summary, frames)) = found else {
            return Ok(None);
        };
        Ok(Some(Validation {
            frames: serde_json::from_str(&frames)?,
            ..serde_json::from_str(&summary)?
        }))
    }

    /// Every frame of a report, in order.
    pub async fn frames(&self, report_id: i64) -> Result<Vec<FrameReport>, StoreError> {
        let rows: Vec<(i64, bool, bool, i64, i64)> = sqlx::query_as(
            "SELECT frame_index, reset, warmup, repaired_texels, non_finite_pixels
             FROM frames WHERE report_id = ? ORDER BY frame_index",
        )
        .bind(report_id)
        .fetch_all(&self.readers)
        .await?;
        let mut frames: BTreeMap<i64, FrameReport> = BTreeMap::new();
        for (index, reset, warmup, repaired_texels, non_finite_pixels) in rows {
            let frame = FrameReport {
                index: index as usize,
                reset,
                warmup,
                repaired_texels: repaired_texels as u64,
                non_finite_pixels: non_finite_pixels as u64,
                metrics: BTreeMap::new(),
                times_ms: BTreeMap::new(),
            };
            frames.insert(index, frame);
        }
        let scores: Vec<(i64, String, Option<f64>, Option<String>)> = sqlx::query_as(
            "SELECT frame_index, metrics.name, value, special
             FROM frame_metrics JOIN metrics ON metrics.id = metric_id WHERE report_id = ?",
        )
        .bind(report_id)
        .fetch_all(&self.readers)
        .await?;
        for (index, metric, number, special) in scores {
            if let Some(frame) = frames.get_mut(&index) {
                frame.metrics.insert(metric, value::value(number, special.as_deref()));
            }
        }
        let times: Vec<(i64, String, f64)> = sqlx::query_as(
            "SELECT frame_index, passes.name, time_ms
             FROM pass_times JOIN passes ON passes.id = pass_id WHERE report_id = ?",
        )
        .bind(report_id)
        .fetch_all(&self.readers)
        .await?;
        for (index, pass, time_ms) in times {
            if let Some(frame) = frames.get_mut(&index) {
                frame.times_ms.insert(pass, time_ms);
            }
        }
        Ok(frames.into_values().collect())
    }

    /// The series that have reports, by sequence, preset and adapter.
    pub async fn series(&self, filter: &SeriesFilter) -> Result<Vec<Series>, StoreError> {
        let found = sqlx::query_as(select_series!(
            "",
            "series",
            "WHERE (?1 IS NULL OR sequences.hash = ?1) AND (?2 IS NULL OR variants.preset = ?2)
               AND (?3 IS NULL OR adapters.name = ?3)
             ORDER BY sequences.name, sequences.put_at DESC, variants.preset, variants.id, adapters.id"
        ))
        .bind(&filter.sequence_hash)
        .bind(&filter.preset)
        .bind(&filter.adapter)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// The last `limit` values of `metric` (or [`GPU_TIME`]) in a series, oldest first, optionally of one branch.
    pub async fn points(
        &self,
        series_id: i64,
        metric: &str,
        branch: Option<&str>,
        limit: u32,
    ) -> Result<Vec<Point>, StoreError> {
        let sql = if metric == GPU_TIME {
            "SELECT reports.id, job_id, git_branch, git_commit, reports.created_at, gpu_time_ms AS value,
                    NULL AS special, 0 AS version
             FROM reports JOIN jobs ON jobs.id = job_id
             WHERE series_id = ?1 AND ?2 = 'gpu_time_ms' AND gpu_time_ms IS NOT NULL AND (?3 IS NULL OR git_branch = ?3)
             ORDER BY reports.id DESC LIMIT ?4"
        } else {
            "SELECT reports.id, job_id, git_branch, git_commit, reports.created_at, value, special, version
             FROM reports JOIN jobs ON jobs.id = job_id
             JOIN report_metrics ON report_id = reports.id
                  AND metric_id = (SELECT id FROM metrics WHERE name = ?2)
             WHERE series_id = ?1 AND (?3 IS NULL OR git_branch = ?3)
             ORDER BY reports.id DESC LIMIT ?4"
        };
        let rows = sqlx::query(sql)
            .bind(series_id)
            .bind(metric)
            .bind(branch)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        let mut points = rows
            .iter()
            .map(|row| {
                Ok(Point {
                    report_id: row.try_get("id")?,
                    job_id: row.try_get("job_id")?,
                    branch: row.try_get("git_branch")?,
                    commit: row.try_get("git_commit")?,
                    created_at: row.try_get("created_at")?,
                    value: value::value(row.try_get("value")?, row.try_get("special")?),
                    metric_version: row.try_get("version")?,
                })
            })
            .collect::<Result<Vec<_>, sqlx::Error>>()?;
        points.reverse();
        Ok(points)
    }
}
