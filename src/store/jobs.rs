//! Jobs as their submitters see them: what was asked for, where it stands, how it ended.

use super::{Environment, Provenance, Store, StoreError, Timestamp};
use crate::{
    bench::BenchSpec,
    run::{MetricsOn, PresetSpec, RunSpec, Validate},
    stress::StressSpec,
    taa::{Precision, Skip},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sqlx::{Connection as _, FromRow, Row, sqlite::SqliteRow};
use std::{collections::BTreeMap, sync::Arc};

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, sqlx::Type)]
#[serde(rename_all = "snake_case")]
#[sqlx(rename_all = "snake_case")]
pub enum Status {
    /// Waits for a worker.
    Queued,
    /// A worker holds its lease.
    Running,
    /// Its reports are stored.
    Done,
    /// It gave no report; the error says why.
    Failed,
    /// Someone asked for its end.
    Cancelled,
}

impl Status {
    /// Nothing will change any more.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::Failed | Self::Cancelled)
    }
}

/// Which precision output images are kept in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Images {
    /// No images are kept.
    None,
    /// 16-bit float EXR.
    #[default]
    Half,
    /// 32-bit float EXR.
    Float,
}

/// Everything a worker must know to do a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobSpec {
    /// What to run.
    #[serde(flatten)]
    pub run: RunSpec,
    /// Which output images to keep.
    pub images: Images,
    /// Images rendered elsewhere, to be compared instead of running presets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outputs: Option<Outputs>,
    /// Instead of running anything on a sequence, the matrix to try recipes with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stress: Option<StressSpec>,
    /// Instead of running presets once, the settings to measure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bench: Option<BenchSpec>,
}

impl JobSpec {
    /// A stress run, which needs no sequence.
    pub fn stress(spec: StressSpec) -> Self {
        Self {
            stress: Some(spec.clone()),
            ..Self::no_run(spec.presets)
        }
    }

    /// A benchmark.
    pub fn bench(spec: BenchSpec) -> Self {
        Self {
            bench: Some(spec.clone()),
            ..Self::no_run(spec.presets)
        }
    }

    fn no_run(presets: Vec<PresetSpec>) -> Self {
        Self {
            run: RunSpec {
                presets,
                metrics: Vec::new(),
                history: Precision::default(),
                n_frames: None,
                repeat: 1,
                metrics_on: MetricsOn::Auto,
                validate: Validate::No,
                skip: Skip::Off,
                until: None,
            },
            images: Images::None,
            outputs: None,
            stress: None,
            bench: None,
        }
    }
}

/// Images of a system elsewhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Outputs {
    /// The system's name.
    pub system: String,
    /// Its settings.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// What rendered them.
    pub environment: Environment,
    /// By frame index: SHA-256 of a blob that holds the image.
    pub images: BTreeMap<usize, String>,
}

/// A validated job to be queued.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Row id of its sequence; none for a stress run.
    pub sequence_id: Option<i64>,
    /// What to run.
    pub spec: JobSpec,
    /// Project by name.
    pub project: String,
    /// Which state of the submitter's code is measured.
    pub provenance: Provenance,
    /// SHA-256 of all that its reports follow from; none where they are to be made anew.
    pub result_key: Option<String>,
}

/// Whose fault a failure is. Only [`FailureKind::Device`] is worth another try.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, sqlx::Type)]
#[serde(rename_all = "snake_case")]
#[sqlx(rename_all = "snake_case")]
pub enum FailureKind {
    /// The submitter's.
    Input,
    /// The GPU's or its driver's.
    Device,
    /// The service's or its machine's.
    Internal,
}

/// Why a job failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Failure {
    /// Whose fault.
    pub kind: FailureKind,
    /// Stable id of the cause.
    pub code: String,
    /// For people: names the file, frame or field, and what to do.
    pub message: String,
}

/// A stored job.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Job {
    /// Number, rising with time.
    pub id: i64,
    /// Where it stands.
    pub status: Status,
    /// Content hash of its sequence; empty for a stress run, which makes its own frames.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub sequence_hash: String,
    /// Name of its sequence; empty for a stress run.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub sequence_name: String,
    /// What to run.
    pub spec: JobSpec,
    /// Project.
    pub project: String,
    /// Which state of the submitter's code is measured.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// Started attempts.
    pub attempts: i64,
    /// Frame × preset pairs with metrics.
    pub n_done: i64,
    /// Frame × preset pairs in all; 0 before the first start.
    pub n_total: i64,
    /// Someone asked for its end; a running job stops after its current frame.
    pub cancel_requested: bool,
    /// Why it failed.
    pub error: Option<Failure>,
    /// When it was queued.
    pub created_at: Timestamp,
    /// When a worker first claimed it.
    pub started_at: Option<Timestamp>,
    /// When it became final.
    pub finished_at: Option<Timestamp>,
}

impl FromRow<'_, SqliteRow> for Job {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let spec: &str = row.try_get("spec")?;
        let kind: Option<FailureKind> = row.try_get("error_kind")?;
        let error = match kind {
            None => None,
            Some(kind) => Some(Failure {
                kind,
                code: row.try_get("error_code")?,
                message: row.try_get("error_message")?,
            }),
        };
        Ok(Self {
            id: row.try_get("id")?,
            status: row.try_get("status")?,
            sequence_hash: row.try_get("sequence_hash")?,
            sequence_name: row.try_get("sequence_name")?,
            spec: serde_json::from_str(spec).map_err(|source| sqlx::Error::Decode(source.into()))?,
            project: row.try_get("project")?,
            provenance: Provenance {
                branch: row.try_get("git_branch")?,
                commit: row.try_get("git_commit")?,
                label: row.try_get("label")?,
                ..super::reading::json(row, "provenance")?
            },
            attempts: row.try_get("attempts")?,
            n_done: row.try_get("n_done")?,
            n_total: row.try_get("n_total")?,
            cancel_requested: row.try_get("cancel_requested")?,
            error,
            created_at: row.try_get("created_at")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
        })
    }
}

/// What became of a request to cancel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cancelled {
    /// It had not started and never will.
    AtOnce,
    /// It is running and ends after its current frame.
    Soon,
    /// It was final already; nothing changed.
    TooLate,
    /// There is no such job.
    Unknown,
}

/// Which jobs to list, newest first.
#[derive(Clone, Debug)]
pub struct JobFilter {
    /// Only these.
    pub status: Option<Status>,
    /// Only those of the sequence with this hash.
    pub sequence_hash: Option<String>,
    /// Only of this project.
    pub project: Option<String>,
    /// Only jobs with a smaller number: the last one of the page before.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

impl Store {
    /// Queues a job and gives its number.
    pub async fn enqueue(&self, job: &NewJob, now: Timestamp) -> Result<i64, StoreError> {
        let id = sqlx::query_scalar(
            "INSERT INTO jobs (sequence_id, spec, git_branch, git_commit, label, project, provenance, result_key, status, created_at)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, 'queued', ?) RETURNING id",
        )
        .bind(job.sequence_id)
        .bind(serde_json::to_string(&job.spec)?)
        .bind(&job.provenance.branch)
        .bind(&job.provenance.commit)
        .bind(&job.provenance.label)
        .bind(&job.project)
        .bind(serde_json::to_string(&job.provenance)?)
        .bind(&job.result_key)
        .bind(now)
        .fetch_one(&mut *self.writer.acquire().await?)
        .await?;
        Ok(id)
    }

    /// The newest finished job with this key.
    pub async fn answer_to(&self, result_key: &str) -> Result<Option<i64>, StoreError> {
        let found = sqlx::query_scalar("SELECT max(id) FROM jobs WHERE result_key = ? AND status = 'done'")
            .bind(result_key)
            .fetch_one(&self.readers)
            .await?;
        Ok(found)
    }

    /// The job with this number.
    pub async fn job(&self, id: i64) -> Result<Option<Arc<Job>>, StoreError> {
        Ok(self.jobs_of(&[id]).await?.pop())
    }

    async fn jobs_of(&self, ids: &[i64]) -> Result<Vec<Arc<Job>>, StoreError> {
        let load = async |ids: &[i64]| {
            let rows: Vec<Job> = sqlx::query_as(
                "SELECT jobs.*, coalesce(sequences.hash, '') AS sequence_hash,
                        coalesce(sequences.name, '') AS sequence_name
                 FROM jobs LEFT JOIN sequences ON sequences.id = jobs.sequence_id
                 WHERE jobs.id IN (SELECT value FROM json_each(?))",
            )
            .bind(serde_json::to_string(ids)?)
            .fetch_all(&self.readers)
            .await?;
            Ok(rows.into_iter().map(|job| (job.id, Arc::new(job))).collect())
        };
        let found = self.known.jobs.get(ids, |job| job.status.is_final(), load).await?;
        Ok(ids.iter().filter_map(|id| found.get(id).cloned()).collect())
    }

    /// Jobs, newest first. Each is as it was when it was read, which is a moment after the list was made.
    pub async fn jobs(&self, filter: &JobFilter) -> Result<Vec<Arc<Job>>, StoreError> {
        let ids: Vec<i64> = sqlx::query_scalar(
            "SELECT jobs.id FROM jobs LEFT JOIN sequences ON sequences.id = jobs.sequence_id
             WHERE (?1 IS NULL OR jobs.status = ?1) AND (?2 IS NULL OR sequences.hash = ?2)
               AND (?3 IS NULL OR jobs.id < ?3) AND (?5 IS NULL OR jobs.project = ?5)
             ORDER BY jobs.id DESC LIMIT +?4",
        )
        .bind(filter.status)
        .bind(&filter.sequence_hash)
        .bind(filter.before)
        .bind(filter.limit)
        .bind(&filter.project)
        .fetch_all(&self.readers)
        .await?;
        self.jobs_of(&ids).await
    }

    /// How many jobs wait.
    pub async fn n_queued(&self) -> Result<u64, StoreError> {
        let n: i64 = sqlx::query_scalar("SELECT count(*) FROM jobs WHERE status = 'queued'")
            .fetch_one(&self.readers)
            .await?;
        Ok(n as u64)
    }

    /// How many jobs there are of each status.
    pub async fn job_counts(&self) -> Result<Vec<(Status, i64)>, StoreError> {
        let counts = sqlx::query_as("SELECT status, count(*) FROM jobs GROUP BY status")
            .fetch_all(&self.readers)
            .await?;
        Ok(counts)
    }

    /// Asks for a job's end.
    pub async fn cancel(&self, id: i64, now: Timestamp) -> Result<Cancelled, StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        let status: Option<Status> = sqlx::query_scalar("SELECT status FROM jobs WHERE id = ?")
            .bind(id)
            .fetch_optional(&mut *transaction)
            .await?;
        sqlx::query(
            "UPDATE jobs SET cancel_requested = 1,
                             status = CASE status WHEN 'queued' THEN 'cancelled' ELSE status END,
                             finished_at = CASE status WHEN 'queued' THEN ?1 END
             WHERE id = ?2 AND status IN ('queued', 'running')",
        )
        .bind(now)
        .bind(id)
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(match status {
            None => Cancelled::Unknown,
            Some(Status::Queued) => Cancelled::AtOnce,
            Some(Status::Running) => Cancelled::Soon,
            Some(_) => Cancelled::TooLate,
        })
    }
}
