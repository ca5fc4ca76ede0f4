//! Reading reports: one in full, the rows of its frames, lists, and the series they belong to.

use super::{
    Departure, Environment, MetricSummary, Provenance, Store, StoreError, SystemKind, Timestamp, columns::Layout, value,
};
use crate::{
    metrics::{Summary, Value},
    run::report::{AdapterInfo, FrameReport, TimeSummary},
    taa::{Precision, Skip, validation::Validation},
    verdict::better,
};
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::{Encode, FromRow, QueryBuilder, Row, Sqlite, SqliteConnection, Type, sqlite::SqliteRow};
use std::{collections::BTreeMap, sync::Arc};

/// A stored report without its frames.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Report {
    /// Number, rising with time.
    pub id: i64,
    /// The job it came from, if it was measured here.
    pub job_id: Option<i64>,
    /// Position in that job's list of presets.
    pub preset_index: i64,
    /// What it is comparable with.
    #[serde(flatten)]
    pub series: Series,
    /// Of which code.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// Git revision of the build that ran.
    pub revision: String,
    /// What a reader must know to trust the numbers.
    pub notes: Vec<String>,
    /// Wall time of each stage of the whole job, milliseconds.
    pub stages_ms: BTreeMap<String, f64>,
    /// GPU time of one frame, milliseconds: the sum of its passes' medians, or as it was posted.
    pub gpu_time_ms: Option<f64>,
    /// When it was stored.
    pub created_at: Timestamp,
    /// False while frames are still being added.
    pub complete: bool,
    /// The one number that stands for the sequence, by metric: the mean of its frames after warm-up; NaN if a frame is, and the
    /// infinity on the worse side if a frame is there.
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
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Series {
    /// Row id.
    #[serde(rename = "series_id")]
    pub id: i64,
    /// Project.
    pub project: String,
    /// Content hash of the sequence; none where only its name is known.
    pub sequence_hash: Option<String>,
    /// Name of the sequence.
    pub sequence_name: String,
    /// Whether it ran here or elsewhere.
    pub kind: SystemKind,
    /// Preset id, or the external system's name.
    pub preset: String,
    /// How history was stored; none where unknown.
    pub history: Option<Precision>,
    /// Which work was left out; none where unknown.
    pub skip: Option<Skip>,
    /// Over how many frames, from the first; none for all of them.
    pub n_frames: Option<usize>,
    /// The recipe in full.
    pub parameters: serde_json::Value,
    /// The parameters that the submitter changed.
    pub overrides: serde_json::Map<String, serde_json::Value>,
    /// The machine; equal numbers mean equal environments.
    pub environment_id: i64,
    /// Adapter, driver, operating system, clocks.
    #[serde(flatten)]
    pub environment: Environment,
}

/// Which reports to list, newest first.
#[derive(Clone, Debug, Default)]
pub struct ReportFilter {
    /// Only of this project.
    pub project: Option<String>,
    /// Only of the sequence with this content hash, or of the one known by this name only.
    pub sequence: Option<String>,
    /// Only of this preset or external system.
    pub preset: Option<String>,
    /// Only of this branch.
    pub branch: Option<String>,
    /// Only of this commit.
    pub commit: Option<String>,
    /// Only of this series.
    pub series_id: Option<i64>,
    /// Only of this job.
    pub job_id: Option<i64>,
    /// Only the newest of each series.
    pub latest_only: bool,
    /// Only those with smaller numbers: the last one of the page before.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// Which series to show.
#[derive(Clone, Debug, Default)]
pub struct SeriesFilter {
    /// Only of this project.
    pub project: Option<String>,
    /// Only of the sequence with this content hash, or of the one known by this name only.
    pub sequence: Option<String>,
    /// Only of this preset or external system.
    pub preset: Option<String>,
    /// Only on adapters of this name.
    pub adapter: Option<String>,
    /// Only the one with this number.
    pub id: Option<i64>,
}

/// Parses a JSON column.
pub(super) fn json<T: serde::de::DeserializeOwned>(row: &SqliteRow, column: &str) -> Result<T, sqlx::Error> {
    serde_json::from_str(row.try_get(column)?).map_err(|source| sqlx::Error::Decode(source.into()))
}

/// The adapter of a row that was joined with its own.
pub(super) fn adapter(row: &SqliteRow) -> Result<AdapterInfo, sqlx::Error> {
    Ok(AdapterInfo {
        name: row.try_get("adapter_name")?,
        backend: row.try_get("backend")?,
        kind: row.try_get("adapter_kind")?,
        driver: row.try_get("driver")?,
        driver_version: row.try_get("driver_version")?,
    })
}

impl FromRow<'_, SqliteRow> for Series {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let history: Option<&str> = row.try_get("history")?;
        let skip: Option<&str> = row.try_get("skip")?;
        Ok(Self {
            id: row.try_get("series_id")?,
            project: row.try_get("project")?,
            sequence_hash: row.try_get("hash")?,
            sequence_name: row.try_get("name")?,
            kind: row.try_get("variant_kind")?,
            preset: row.try_get("preset")?,
            history: history.map(value::precision),
            skip: skip.and_then(|skip| skip.parse().ok()),
            n_frames: row.try_get::<Option<i64>, _>("n_frames")?.map(|n| n as usize),
            parameters: json(row, "parameters")?,
            overrides: json::<Option<_>>(row, "overrides")?.unwrap_or_default(),
            environment_id: row.try_get("environment_id")?,
            environment: Environment {
                adapter: adapter(row)?,
                os: row.try_get("os")?,
                clocks: row.try_get("clocks")?,
            },
        })
    }
}

impl FromRow<'_, SqliteRow> for Report {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let metrics: BTreeMap<String, MetricSummary> = json(row, "metrics")?;
        let parent: Option<String> = row.try_get("parent_branch")?;
        let departed: Option<String> = row.try_get("departed_commit")?;
        Ok(Self {
            id: row.try_get("id")?,
            job_id: row.try_get("job_id")?,
            preset_index: row.try_get("preset_index")?,
            series: Series::from_row(row)?,
            provenance: Provenance {
                branch: row.try_get("git_branch")?,
                from: parent.map(|branch| Departure {
                    branch,
                    commit: departed,
                }),
                commit: row.try_get("git_commit")?,
                parent: row.try_get("parent_commit")?,
                pull_request: row.try_get("pull_request")?,
                engine_version: row.try_get("engine_version")?,
                label: row.try_get("label")?,
                labels: json(row, "labels")?,
            },
            revision: row.try_get("revision")?,
            notes: json(row, "notes")?,
            stages_ms: json(row, "stages_ms")?,
            gpu_time_ms: row.try_get("gpu_time_ms")?,
            created_at: row.try_get("created_at")?,
            complete: row.try_get("complete")?,
            values: metrics
                .iter()
                .map(|(metric, found)| (metric.clone(), found.summary.headline(better(metric))))
                .collect(),
            metric_versions: metrics
                .iter()
                .map(|(metric, found)| (metric.clone(), found.version))
                .collect(),
            summary: metrics
                .into_iter()
                .map(|(metric, found)| (metric, found.summary))
                .collect(),
            times_ms: json(row, "times_ms")?,
            validation: json(row, "validation")?,
        })
    }
}

/// Everything that names a series.
macro_rules! series_columns {
    () => {
        "series.id AS series_id, projects.name AS project, sequences.hash,
         coalesce(sequences.name, subjects.name) AS name, variants.kind AS variant_kind, variants.preset,
         variants.history, variants.skip, variants.n_frames, variants.parameters, variants.overrides, environments.id AS environment_id,
         environments.os, environments.clocks, adapters.name AS adapter_name, adapters.backend,
         adapters.kind AS adapter_kind, adapters.driver, adapters.driver_version"
    };
}

/// Where that is.
macro_rules! from_series {
    ($from:literal) => {
        concat!(
            " FROM ",
            $from,
            " JOIN projects ON projects.id = series.project_id
             JOIN subjects ON subjects.id = series.subject_id
             LEFT JOIN sequences ON sequences.id = subjects.sequence_id
             JOIN variants ON variants.id = series.variant_id
             JOIN environments ON environments.id = series.environment_id
             JOIN adapters ON adapters.id = environments.adapter_id "
        )
    };
}

/// Reports, their series, and where they came from.
macro_rules! from_reports {
    () => {
        from_series!(
            "reports JOIN series ON series.id = reports.series_id LEFT JOIN branches ON branches.id = reports.branch_id"
        )
    };
}

/// Adds a condition where there is a value for it. One that no row can fail would cost as much to check, and SQLite would
/// compile the statement anew at each call; so it would for a bare number behind `LIMIT`, which it plans by, hence the plus
/// before each.
fn narrow<'t, T>(sql: &mut QueryBuilder<Sqlite>, condition: &'static str, value: Option<T>)
where
    T: Encode<'t, Sqlite> + Type<Sqlite>,
{
    if let Some(value) = value {
        sql.push(" AND ").push(condition).push_bind(value);
    }
}

/// Every frame of a report, in order.
pub(super) async fn read_frames(
    connection: &mut SqliteConnection,
    report_id: i64,
) -> Result<Vec<FrameReport>, StoreError> {
    let chunks: Vec<(String, String, Vec<u8>)> = sqlx::query_as(
        "SELECT metrics, passes, data FROM frame_chunks JOIN frame_layouts ON frame_layouts.id = layout_id
         WHERE report_id = ? ORDER BY frame_chunks.id",
    )
    .bind(report_id)
    .fetch_all(connection)
    .await?;
    let mut frames = BTreeMap::new();
    for (metrics, passes, data) in chunks {
        let layout = Layout {
            metrics: serde_json::from_str(&metrics)?,
            passes: serde_json::from_str(&passes)?,
        };
        layout
            .unpack(&data, &mut frames)
            .ok_or(StoreError::Damaged(report_id))?;
    }
    Ok(frames.into_values().collect())
}

impl Store {
    /// The report with this number.
    pub async fn report(&self, id: i64) -> Result<Option<Arc<Report>>, StoreError> {
        Ok(self.reports_of(&[id]).await?.pop())
    }

    async fn reports_of(&self, ids: &[i64]) -> Result<Vec<Arc<Report>>, StoreError> {
        let load = async |ids: &[i64]| {
            let rows: Vec<Report> = sqlx::query_as(concat!(
                "SELECT reports.id, reports.job_id, reports.preset_index, reports.revision, reports.notes,
                 reports.stages_ms, reports.gpu_time_ms, reports.created_at, reports.complete, reports.metrics,
                 reports.times_ms, reports.git_commit, reports.parent_commit, reports.pull_request,
                 reports.engine_version, reports.label, reports.labels,
                 ifnull((SELECT summary FROM validations WHERE report_id = reports.id), 'null') AS validation,
                 branches.name AS git_branch, branches.departed_commit,
                 (SELECT name FROM branches AS parents WHERE parents.id = branches.parent_id) AS parent_branch, ",
                series_columns!(),
                from_reports!(),
                "WHERE reports.id IN (SELECT value FROM json_each(?))"
            ))
            .bind(serde_json::to_string(ids)?)
            .fetch_all(&self.readers)
            .await?;
            Ok(rows.into_iter().map(|report| (report.id, Arc::new(report))).collect())
        };
        let found = self.known.reports.get(ids, |report| report.complete, load).await?;
        Ok(ids.iter().filter_map(|id| found.get(id).cloned()).collect())
    }

    /// Complete reports, newest first; of one job, in the order of its presets.
    pub async fn reports(&self, filter: &ReportFilter) -> Result<Vec<Arc<Report>>, StoreError> {
        let mut sql = QueryBuilder::new(concat!("SELECT reports.id", from_reports!(), "WHERE reports.complete"));
        narrow(&mut sql, "reports.job_id = ", filter.job_id);
        narrow(&mut sql, "reports.series_id = ", filter.series_id);
        narrow(&mut sql, "reports.git_commit = ", filter.commit.as_ref());
        if filter.latest_only {
            sql.push(" AND reports.id IN (SELECT latest_report_id FROM series)");
        }
        narrow(&mut sql, "reports.id < ", filter.before);
        // A plus keeps these from being the way in: all reports of a project would be read to find its newest.
        narrow(&mut sql, "+projects.name = ", filter.project.as_ref());
        narrow(
            &mut sql,
            "coalesce(sequences.hash, subjects.name) = ",
            filter.sequence.as_ref(),
        );
        narrow(&mut sql, "+variants.preset = ", filter.preset.as_ref());
        narrow(&mut sql, "+branches.name = ", filter.branch.as_ref());
        sql.push(match filter.job_id {
            Some(_) => " ORDER BY reports.preset_index LIMIT +",
            None => " ORDER BY reports.id DESC LIMIT +",
        });
        sql.push_bind(filter.limit);
        let ids: Vec<i64> = sql.build_query_scalar().fetch_all(&self.readers).await?;
        self.reports_of(&ids).await
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
        let mut connection = self.readers.acquire().await?;
        read_frames(&mut connection, report_id).await
    }

    /// The series that have complete reports, by sequence, preset and environment.
    pub async fn series(&self, filter: &SeriesFilter) -> Result<Vec<Series>, StoreError> {
        let mut sql = QueryBuilder::new(concat!(
            "SELECT ",
            series_columns!(),
            from_series!("series"),
            "WHERE series.latest_report_id IS NOT NULL"
        ));
        narrow(&mut sql, "series.id = ", filter.id);
        narrow(
            &mut sql,
            "coalesce(sequences.hash, subjects.name) = ",
            filter.sequence.as_ref(),
        );
        narrow(&mut sql, "variants.preset = ", filter.preset.as_ref());
        narrow(&mut sql, "adapters.name = ", filter.adapter.as_ref());
        narrow(&mut sql, "projects.name = ", filter.project.as_ref());
        sql.push(
            " ORDER BY coalesce(sequences.name, subjects.name), sequences.put_at DESC, variants.preset, variants.id,
              environments.id",
        );
        Ok(sql.build_query_as().fetch_all(&self.readers).await?)
    }

    /// Ids of every metric that any report has had.
    pub async fn metric_names(&self) -> Result<Vec<String>, StoreError> {
        Ok(sqlx::query_scalar("SELECT name FROM metrics ORDER BY name")
            .fetch_all(&self.readers)
            .await?)
    }
}
