//! Stress runs: their jobs, and the cells of their matrices.

use super::{Claim, Store, StoreError, Timestamp, reading::adapter, writing::adapter_id};
use crate::{
    run::report::AdapterInfo,
    stress::report::{Cell, StressReport},
};
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::{Connection as _, FromRow, Row, sqlite::SqliteRow};

/// A stored matrix, without its cells.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct StressRun {
    /// Its job, by which it is asked for.
    pub job_id: i64,
    /// What ran it.
    pub adapter: AdapterInfo,
    /// Revision of the service that ran.
    pub revision: String,
    /// What noise and places were chosen by.
    pub seed: u32,
    /// Cells in all.
    pub n_cells: i64,
    /// Those that failed.
    pub n_failed: i64,
    /// When it was stored.
    pub created_at: Timestamp,
}

impl FromRow<'_, SqliteRow> for StressRun {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            job_id: row.try_get("job_id")?,
            adapter: adapter(row)?,
            revision: row.try_get("revision")?,
            seed: row.try_get("seed")?,
            n_cells: row.try_get("n_cells")?,
            n_failed: row.try_get("n_failed")?,
            created_at: row.try_get("created_at")?,
        })
    }
}

macro_rules! select_runs {
    ($rest:literal) => {
        concat!(
            "SELECT stress_reports.*, adapters.name AS adapter_name, adapters.backend, adapters.kind AS adapter_kind, adapters.driver, adapters.driver_version,
                    (SELECT count(*) FROM stress_cells WHERE report_id = stress_reports.id) AS n_cells,
                    (SELECT count(*) FROM stress_cells WHERE report_id = stress_reports.id AND verdict = 'fails') AS n_failed
             FROM stress_reports JOIN adapters ON adapters.id = stress_reports.adapter_id ",
            $rest
        )
    };
}

impl Store {
    /// Stores a matrix and ends its job, both or neither.
    pub async fn finish_stress(&self, claim: &Claim, report: &StressReport, now: Timestamp) -> Result<(), StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        claim.end(&mut transaction, report.cells.len(), now).await?;
        let adapter_id = adapter_id(&mut transaction, &report.adapter).await?;
        let report_id: i64 = sqlx::query_scalar(
            "INSERT INTO stress_reports (job_id, adapter_id, revision, seed, created_at) VALUES (?, ?, ?, ?, ?) RETURNING id",
        )
        .bind(claim.job_id)
        .bind(adapter_id)
        .bind(&report.revision)
        .bind(report.seed)
        .bind(now)
        .fetch_one(&mut *transaction)
        .await?;
        for (index, cell) in report.cells.iter().enumerate() {
            sqlx::query(
                "INSERT INTO stress_cells (report_id, cell_index, hazard, recipe, verdict, cell) VALUES (?, ?, ?, ?, ?, ?)",
            )
            .bind(report_id)
            .bind(index as i64)
            .bind(&cell.hazard)
            .bind(&cell.recipe)
            .bind(cell.verdict.id())
            .bind(serde_json::to_string(cell)?)
            .execute(&mut *transaction)
            .await?;
        }
        transaction.commit().await?;
        Ok(())
    }

    /// Matrices, newest job first, of jobs with a smaller number than `before`.
    pub async fn stress_runs(&self, before: Option<i64>, limit: u32) -> Result<Vec<StressRun>, StoreError> {
        let found = sqlx::query_as(select_runs!(
            "WHERE ?1 IS NULL OR stress_reports.job_id < ?1 ORDER BY stress_reports.job_id DESC LIMIT +?2"
        ))
        .bind(before)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// The matrix of a job.
    pub async fn stress_run(&self, job_id: i64) -> Result<Option<StressRun>, StoreError> {
        let found = sqlx::query_as(select_runs!("WHERE stress_reports.job_id = ?"))
            .bind(job_id)
            .fetch_optional(&self.readers)
            .await?;
        Ok(found)
    }

    /// The cells of a job's matrix, in its order.
    pub async fn stress_cells(&self, job_id: i64) -> Result<Vec<Cell>, StoreError> {
        let cells: Vec<String> = sqlx::query_scalar(
            "SELECT cell FROM stress_cells JOIN stress_reports ON stress_reports.id = report_id
             WHERE job_id = ? ORDER BY cell_index",
        )
        .bind(job_id)
        .fetch_all(&self.readers)
        .await?;
        Ok(cells
            .iter()
            .map(|cell| serde_json::from_str(cell))
            .collect::<Result<_, _>>()?)
    }
}
