//! The queue as a worker sees it. It claims the oldest job with a lease that it keeps renewing; a job whose worker died
//! is taken up again, at most [`MAX_ATTEMPTS`] times, because the job may be what kills it.

use super::{Failure, FailureKind, JobSpec, Provenance, Status, Store, StoreError, Timestamp};
use sqlx::{Row, SqliteConnection};
use std::time::Duration;

/// How often a job is started before it counts as failed.
pub const MAX_ATTEMPTS: i64 = 3;

/// A worker's right to write to a job, until its lease runs out or somebody else claims the job.
#[derive(Clone, Debug)]
pub struct Claim {
    /// The job.
    pub job_id: i64,
    /// Content hash of its sequence; empty for a stress run.
    pub sequence_hash: String,
    /// What to run.
    pub spec: JobSpec,
    /// Which start this is, from 1.
    pub attempt: i64,
    pub(super) project: String,
    pub(super) provenance: Provenance,
    /// None for a stress run.
    pub(super) sequence_id: Option<i64>,
    pub(super) lease: i64,
}

impl Claim {
    /// Ends the job as part of a transaction that stores what it produced, of which there are `n_done`.
    pub(super) async fn end(
        &self,
        connection: &mut SqliteConnection,
        n_done: usize,
        now: Timestamp,
    ) -> Result<(), StoreError> {
        // A short job may end before its progress was ever stored.
        let done = sqlx::query(
            "UPDATE jobs SET status = 'done', lease_until = NULL, finished_at = ?1, n_done = ?4, n_total = ?4
             WHERE id = ?2 AND lease = ?3 AND status = 'running'",
        )
        .bind(now)
        .bind(self.job_id)
        .bind(self.lease)
        .bind(n_done as i64)
        .execute(connection)
        .await?;
        match done.rows_affected() {
            0 => Err(StoreError::ClaimLost(self.job_id)),
            _ => Ok(()),
        }
    }
}

impl Store {
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
        .fetch_all(&mut *self.writer.acquire().await?)
        .await?;
        Ok(recovered)
    }

    /// Claims the oldest queued job for `lease`.
    pub async fn claim(&self, lease: Duration, now: Timestamp) -> Result<Option<Claim>, StoreError> {
        let row = sqlx::query(
            "UPDATE jobs SET status = 'running', attempts = attempts + 1, lease = lease + 1, lease_until = ?1,
                             started_at = coalesce(started_at, ?2), n_done = 0
             WHERE id = (SELECT id FROM jobs WHERE status = 'queued' ORDER BY id LIMIT 1)
             RETURNING id, sequence_id, coalesce((SELECT hash FROM sequences WHERE id = sequence_id), '') AS hash, spec, attempts,
                       lease, project, provenance",
        )
        .bind(now + lease)
        .bind(now)
        .fetch_optional(&mut *self.writer.acquire().await?)
        .await?;
        let Some(row) = row else { return Ok(None) };
        Ok(Some(Claim {
            job_id: row.try_get("id")?,
            sequence_hash: row.try_get("hash")?,
            spec: serde_json::from_str(row.try_get("spec")?)?,
            attempt: row.try_get("attempts")?,
            project: row.try_get("project")?,
            provenance: serde_json::from_str(row.try_get("provenance")?)?,
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
        .fetch_optional(&mut *self.writer.acquire().await?)
        .await?
        .ok_or(StoreError::ClaimLost(claim.job_id))
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
        match query.execute(&mut *self.writer.acquire().await?).await?.rows_affected() {
            0 => Err(StoreError::ClaimLost(claim.job_id)),
            _ => Ok(()),
        }
    }
}
