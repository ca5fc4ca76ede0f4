//! Benchmarks: their jobs, and the points they measured.

use super::{Claim, Store, StoreError, Timestamp, reading::json, writing::adapter_id};
use crate::bench::BenchReport;
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::{Connection as _, FromRow, Row, sqlite::SqliteRow};

/// A stored benchmark.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct BenchRun {
    /// Its job, by which it is asked for.
    pub job_id: i64,
    /// Content hash of the sequence.
    pub sequence_hash: String,
    /// When it was stored.
    pub created_at: Timestamp,
    /// What was measured.
    #[serde(flatten)]
    pub report: BenchReport,
}

impl FromRow<'_, SqliteRow> for BenchRun {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            job_id: row.try_get("job_id")?,
            sequence_hash: row.try_get("sequence_hash")?,
            created_at: row.try_get("created_at")?,
            report: json(row, "report")?,
        })
    }
}

/// Which benchmarks to list, newest job first.
#[derive(Clone, Debug, Default)]
pub struct BenchFilter {
    /// Only those of the sequence with this hash or, whatever its content was, this name.
    pub sequence: Option<String>,
    /// Only jobs with a smaller number: the last one of the page before.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

macro_rules! select_runs {
    ($rest:literal) => {
        concat!(
            "SELECT bench_reports.*, sequences.hash AS sequence_hash
             FROM bench_reports JOIN sequences ON sequences.id = bench_reports.sequence_id ",
            $rest
        )
    };
}

impl Store {
    /// Stores a benchmark and ends its job, both or neither.
    pub async fn finish_bench(&self, claim: &Claim, report: &BenchReport, now: Timestamp) -> Result<(), StoreError> {
        let sequence_id = claim.sequence_id.ok_or(StoreError::NoSequence(claim.job_id))?;
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        claim.end(&mut transaction, report.points.len(), now).await?;
        let adapter_id = adapter_id(&mut transaction, &report.adapter).await?;
        sqlx::query(
            "INSERT INTO bench_reports (job_id, sequence_id, adapter_id, revision, report, created_at) VALUES (?, ?, ?, ?, ?, ?)",
        )
        .bind(claim.job_id)
        .bind(sequence_id)
        .bind(adapter_id)
        .bind(&report.revision)
        .bind(serde_json::to_string(report)?)
        .bind(now)
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(())
    }

    /// Benchmarks, newest job first.
    pub async fn bench_runs(&self, filter: &BenchFilter) -> Result<Vec<BenchRun>, StoreError> {
        let found = sqlx::query_as(select_runs!(
            "WHERE (?1 IS NULL OR sequences.hash = ?1
                    OR sequences.id = (SELECT sequence_id FROM sequence_names WHERE name = ?1))
               AND (?2 IS NULL OR bench_reports.job_id < ?2)
             ORDER BY bench_reports.job_id DESC LIMIT +?3"
        ))
        .bind(&filter.sequence)
        .bind(filter.before)
        .bind(filter.limit)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// The benchmark of a job.
    pub async fn bench_run(&self, job_id: i64) -> Result<Option<BenchRun>, StoreError> {
        let found = sqlx::query_as(select_runs!("WHERE bench_reports.job_id = ?"))
            .bind(job_id)
            .fetch_optional(&self.readers)
            .await?;
        Ok(found)
    }
}
