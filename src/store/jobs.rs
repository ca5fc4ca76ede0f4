//! The queue of jobs. A worker claims the oldest with a lease that it keeps renewing; a job whose worker died is taken
//! up again, at most [`MAX_ATTEMPTS`] times, because the job may be what kills it.

use super::{Store, StoreError, Timestamp};
use crate::run::RunSpec;
use serde::{Deserialize, Serialize};
use sqlx::{FromRow, Row, sqlite::SqliteRow};
use std::time::Duration;

/// How often a job is started before it counts as failed.
pub const MAX_ATTEMPTS: i64 = 3;

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, sqlx::Type)]
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobSpec {
    /// What to run.
    #[serde(flatten)]
    pub run: RunSpec,
    /// Which output images to keep.
    pub images: Images,
}

/// A validated job to be queued.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Row id of its sequence.
    pub sequence_id: i64,
    /// What to run.
    pub spec: JobSpec,
    /// Branch the submitter works on.
    pub git_branch: Option<String>,
    /// Commit the submitter works on.
    pub git_commit: Option<String>,
    /// Free text.
    pub label: Option<String>,
}

/// Whose fault a failure is. Only [`FailureKind::Device`] is worth another try.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, sqlx::Type)]
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
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Whose fault.
    pub kind: FailureKind,
    /// Stable id of the cause.
    pub code: String,
    /// For people: names the file, frame or field, and what to do.
    pub message: String,
}

/// A stored job.
#[derive(Clone, Debug, Serialize)]
pub struct Job {
    /// Number, rising with time.
    pub id: i64,
    /// Where it stands.
    pub status: Status,
    /// Content hash of its sequence.
    pub sequence_hash: String,
    /// Name of its sequence.
    pub sequence_name: String,
    /// What to run.
    pub spec: JobSpec,
    /// Branch the submitter gave.
    pub branch: Option<String>,
    /// Commit the submitter gave.
    pub commit: Option<String>,
    /// Free text.
    pub label: Option<String>,
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
            branch: row.try_get("git_branch")?,
            commit: row.try_get("git_commit")?,
            label: row.try_get("label")?,
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

/// A worker's right to write to a job, until its lease runs out or somebody else claims the job.
#[derive(Clone, Debug)]
pub struct Claim {
    /// The job.
    pub job_id: i64,
    /// Content hash of its sequence.
    pub sequence_hash: String,
    /// What to run.
    pub spec: JobSpec,
    /// This is the how manieth start, from 1.
    pub attempt: i64,
    pub(super) sequence_id: i64,
    pub(super) lease: i64,
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
    /// Only jobs with a smaller number: the last one of the page before.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// A job's row with its sequence's names.
macro_rules! select_jobs {
    ($rest:literal) => {
        concat!(
            "SELECT jobs.*, sequences.hash AS sequence_hash, sequences.name AS sequence_name
             FROM jobs JOIN sequences ON sequences.id = jobs.sequence_id ",
            $rest
        )
    };
}

impl Store {
    /// Queues a job and gives its number.
    pub async fn enqueue(&self, job: &NewJob, now: Timestamp) -> Result<i64, StoreError> {
        let id = sqlx::query_scalar(
            "INSERT INTO jobs (sequence_id, spec, git_branch, git_commit, label, status, created_at)
             VALUES (?, ?, ?, ?, ?, 'queued', ?) RETURNING id",
        )
        .bind(job.sequence_id)
        .bind(serde_json::to_string(&job.spec)?)
        .bind(&job.git_branch)
        .bind(&job.git_commit)
        .bind(&job.label)
        .bind(now)
        .fetch_one(&self.writer)
        .await?;
        Ok(id)
    }

    /// The job with this number.
    pub async fn job(&self, id: i64) -> Result<Option<Job>, StoreError> {
        let found = sqlx::query_as(select_jobs!("WHERE jobs.id = ?"))
            .bind(id)
            .fetch_optional(&self.readers)
            .await?;
        Ok(found)
    }

    /// Jobs, newest first.
    pub async fn jobs(&self, filter: &JobFilter) -> Result<Vec<Job>, StoreError> {
        let found = sqlx::query_as(select_jobs!(
            "WHERE (?1 IS NULL OR jobs.status = ?1) AND (?2 IS NULL OR sequences.hash = ?2)
               AND (?3 IS NULL OR jobs.id < ?3)
             ORDER BY jobs.id DESC LIMIT ?4"
        ))
        .bind(filter.status)
        .bind(&filter.sequence_hash)
        .bind(filter.before)
        .bind(filter.limit)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// Puts running jobs whose lease ends before `deadline` back into the queue, or fails them when they had their
    /// attempts; gives their numbers. A service that has just started owns no job yet and passes [`Timestamp::MAX`].
    pub async fn recover(&self, deadline: Timestamp, now: Timestamp) -> Result<Vec<i64>, StoreError> {
        let recovered = sqlx::query_scalar(
            "UPDATE jobs SET
                 status = CASE WHEN cancel_requested THEN 'cancelled' WHEN attempts >= ?1 THEN 'failed' ELSE 'queued' END,
                 error_kind = CASE WHEN NOT cancel_requested AND attempts >= ?1 THEN 'internal' END,
                 error_code = CASE WHEN NOT cancel_requested AND attempts >= ?1 THEN 'interrupted' END,
                 error_message = CASE WHEN NOT cancel_requested AND attempts >= ?1 THEN
                     'the service ended ' || attempts || ' times while it ran this job; see its log' END,
                 finished_at = CASE WHEN cancel_requested OR attempts >= ?1 THEN ?2 END,
                 lease_until = NULL, n_done = 0
             WHERE status = 'running' AND lease_until < ?3
             RETURNING id",
        )
        .bind(MAX_ATTEMPTS)
        .bind(now)
        .bind(deadline)
        .fetch_all(&self.writer)
        .await?;
        Ok(recovered)
    }

    /// Claims the oldest queued job for `lease`.
    pub async fn claim(&self, lease: Duration, now: Timestamp) -> Result<Option<Claim>, StoreError> {
        let row = sqlx::query(
            "UPDATE jobs SET status = 'running', attempts = attempts + 1, lease = lease + 1, lease_until = ?1,
                             started_at = coalesce(started_at, ?2), n_done = 0
             WHERE id = (SELECT id FROM jobs WHERE status = 'queued' ORDER BY id LIMIT 1)
             RETURNING id, sequence_id, (SELECT hash FROM sequences WHERE id = sequence_id) AS hash, spec, attempts,
                       lease",
        )
        .bind(now + lease)
        .bind(now)
        .fetch_optional(&self.writer)
        .await?;
        let Some(row) = row else { return Ok(None) };
        Ok(Some(Claim {
            job_id: row.try_get("id")?,
            sequence_hash: row.try_get("hash")?,
            spec: serde_json::from_str(row.try_get("spec")?)?,
            attempt: row.try_get("attempts")?,
            sequence_id: row.try_get("sequence_id")?,
            lease: row.try_get("lease")?,
        }))
    }

    /// Renews the claim and notes how far the job is. `true` means that someone asked for its end.
    pub async fn heartbeat(
        &self,
        claim: &Claim,
        n_done: usize,
        n_total: usize,
        lease_until: Timestamp,
    ) -> Result<bool, StoreError> {
        sqlx::query_scalar(
            "UPDATE jobs SET lease_until = ?1, n_done = ?2, n_total = ?3
             WHERE id = ?4 AND lease = ?5 AND status = 'running' RETURNING cancel_requested",
        )
        .bind(lease_until)
        .bind(n_done as i64)
        .bind(n_total as i64)
        .bind(claim.job_id)
        .bind(claim.lease)
        .fetch_optional(&self.writer)
        .await?
        .ok_or(StoreError::ClaimLost(claim.job_id))
    }

    /// Asks for a job's end.
    pub async fn cancel(&self, id: i64, now: Timestamp) -> Result<Cancelled, StoreError> {
        let mut transaction = self.writer.begin().await?;
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

    /// Gives the job back as if it had never been started: the service is shutting down.
    pub async fn hand_back(&self, claim: &Claim) -> Result<(), StoreError> {
        let query = sqlx::query(
            "UPDATE jobs SET status = 'queued', attempts = attempts - 1, lease_until = NULL, n_done = 0
             WHERE id = ? AND lease = ? AND status = 'running'",
        );
        self.end(claim, query.bind(claim.job_id).bind(claim.lease)).await
    }

    /// Ends a job that noticed its cancellation.
    pub async fn finish_cancelled(&self, claim: &Claim, now: Timestamp) -> Result<(), StoreError> {
        let query = sqlx::query(
            "UPDATE jobs SET status = 'cancelled', lease_until = NULL, finished_at = ?
             WHERE id = ? AND lease = ? AND status = 'running'",
        );
        self.end(claim, query.bind(now).bind(claim.job_id).bind(claim.lease))
            .await
    }

    /// Notes a failed attempt: back into the queue where another may help, else failed for good. Gives the status.
    pub async fn fail(&self, claim: &Claim, failure: &Failure, now: Timestamp) -> Result<Status, StoreError> {
        if failure.kind == FailureKind::Device && claim.attempt < MAX_ATTEMPTS {
            let query = sqlx::query(
                "UPDATE jobs SET status = 'queued', lease_until = NULL, n_done = 0
                 WHERE id = ? AND lease = ? AND status = 'running'",
            );
            self.end(claim, query.bind(claim.job_id).bind(claim.lease)).await?;
            return Ok(Status::Queued);
        }
        let query = sqlx::query(
            "UPDATE jobs SET status = 'failed', lease_until = NULL, finished_at = ?, error_kind = ?, error_code = ?,
                             error_message = ?
             WHERE id = ? AND lease = ? AND status = 'running'",
        )
        .bind(now)
        .bind(failure.kind)
        .bind(failure.code.as_str())
        .bind(failure.message.as_str());
        self.end(claim, query.bind(claim.job_id).bind(claim.lease)).await?;
        Ok(Status::Failed)
    }

    /// Runs an update that must hit the claimed job.
    async fn end(
        &self,
        claim: &Claim,
        query: sqlx::query::Query<'_, sqlx::Sqlite, sqlx::sqlite::SqliteArguments>,
    ) -> Result<(), StoreError> {
        match query.execute(&self.writer).await?.rows_affected() {
            0 => Err(StoreError::ClaimLost(claim.job_id)),
            _ => Ok(()),
        }
    }
}
