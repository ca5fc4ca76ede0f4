//! What the convention check found in stored sequences, and which it has still to look at.

use super::{Store, StoreError, Timestamp};
use crate::sequence::check;
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::Row;

/// A sequence that waits for its check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unchecked {
    /// Content hash of the sequence.
    pub hash: String,
    id: i64,
}

/// Where the check of a sequence stands.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Check {
    /// It has not been its turn.
    Pending,
    /// There is a report.
    Done {
        /// What was found.
        #[serde(flatten)]
        report: check::Report,
        /// How many findings are warnings.
        n_warnings: i64,
        /// How long it took, in milliseconds.
        time_ms: f64,
        /// When.
        checked_at: Timestamp,
    },
    /// It could not be checked.
    Failed {
        /// Why.
        error: String,
        /// When.
        checked_at: Timestamp,
    },
}

impl Store {
    /// The sequence that has waited longest for the check of this version.
    pub async fn next_unchecked(&self) -> Result<Option<Unchecked>, StoreError> {
        let row = sqlx::query(
            "SELECT id, hash FROM sequences
             WHERE NOT EXISTS (SELECT 1 FROM sequence_checks WHERE sequence_id = sequences.id AND version = ?)
             ORDER BY id LIMIT 1",
        )
        .bind(check::VERSION)
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else { return Ok(None) };
        Ok(Some(Unchecked {
            id: row.try_get("id")?,
            hash: row.try_get("hash")?,
        }))
    }

    /// Stores how a check ended.
    pub async fn put_check(
        &self,
        sequence: &Unchecked,
        outcome: &Result<check::Report, String>,
        time_ms: f64,
        now: Timestamp,
    ) -> Result<(), StoreError> {
        let report = outcome.as_ref().ok().map(serde_json::to_string).transpose()?;
        let n_warnings = outcome.as_ref().map_or(0, |report| report.warnings().count());
        sqlx::query(
            "INSERT INTO sequence_checks (sequence_id, version, report, error, n_warnings, time_ms, checked_at)
             VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
        )
        .bind(sequence.id)
        .bind(check::VERSION)
        .bind(report)
        .bind(outcome.as_ref().err())
        .bind(n_warnings as i64)
        .bind(time_ms)
        .bind(now)
        .execute(&mut *self.writer.acquire().await?)
        .await?;
        Ok(())
    }

    /// Where the check of a sequence stands: the newest that there is.
    pub async fn check(&self, sequence_id: i64) -> Result<Check, StoreError> {
        let row = sqlx::query(
            "SELECT report, error, n_warnings, time_ms, checked_at FROM sequence_checks
             WHERE sequence_id = ? ORDER BY version DESC LIMIT 1",
        )
        .bind(sequence_id)
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else {
            return Ok(Check::Pending);
        };
        let checked_at = row.try_get("checked_at")?;
        let report: Option<&str> = row.try_get("report")?;
        Ok(match report {
            Some(report) => Check::Done {
                report: serde_json::from_str(report)?,
                n_warnings: row.try_get("n_warnings")?,
                time_ms: row.try_get("time_ms")?,
                checked_at,
            },
            None => Check::Failed {
                error: row.try_get("error")?,
                checked_at,
            },
        })
    }
}
