//! Writing what a job produced: every row and the job's `done`, in one transaction.

use super::{Claim, Store, StoreError, Timestamp, value};
use crate::{
    run::report::{AdapterInfo, FrameReport, PresetReport, Report},
    taa::validation::Validation,
};
use sqlx::{Sqlite, Transaction};
use std::collections::BTreeMap;

/// GPU time of one frame, milliseconds: the sum of its passes' medians. `None` where nothing was timed.
fn gpu_time_ms(report: &PresetReport) -> Option<f64> {
    report.times_ms.values().map(|time| time.median).reduce(|a, b| a + b)
}

impl Store {
    /// Stores the reports of every preset and ends the job; gives the reports' numbers, in the order of presets.
    pub async fn finish(&self, claim: &Claim, report: &Report, now: Timestamp) -> Result<Vec<i64>, StoreError> {
        let mut transaction = self.writer.begin().await?;
        let done = sqlx::query(
            "UPDATE jobs SET status = 'done', lease_until = NULL, finished_at = ?1, n_done = ?4, n_total = ?4
             WHERE id = ?2 AND lease = ?3 AND status = 'running'",
        )
        .bind(now)
        .bind(claim.job_id)
        .bind(claim.lease)
        // A short job may end before its progress was ever stored.
        .bind(
            report
                .reports
                .iter()
                .map(|preset| {
                    let validated = preset
                        .validation
                        .as_ref()
                        .map_or(0, |validation| validation.frames.len());
                    (preset.frames.len() + validated) as i64
                })
                .sum::<i64>(),
        )
        .execute(&mut *transaction)
        .await?;
        if done.rows_affected() == 0 {
            return Err(StoreError::ClaimLost(claim.job_id));
        }
        let mut writer = ReportWriter {
            transaction,
            claim,
            report,
            adapter_id: 0,
            names: BTreeMap::new(),
        };
        writer.adapter_id = writer.adapter(&report.adapter).await?;
        let mut ids = Vec::with_capacity(report.reports.len());
        for (preset_index, preset) in report.reports.iter().enumerate() {
            ids.push(writer.preset(preset_index, preset, now).await?);
        }
        writer.transaction.commit().await?;
        Ok(ids)
    }
}

/// The two tables of names that repeat in every row.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Names {
    Metrics,
    Passes,
}

struct ReportWriter<'a> {
    transaction: Transaction<'a, Sqlite>,
    claim: &'a Claim,
    report: &'a Report,
    adapter_id: i64,
    names: BTreeMap<(Names, String), i64>,
}

impl ReportWriter<'_> {
    /// The row of `name`, made at its first use. The update changes nothing; it makes `RETURNING` speak.
    async fn name(&mut self, table: Names, name: &str) -> Result<i64, StoreError> {
        if let Some(&id) = self.names.get(&(table, name.to_owned())) {
            return Ok(id);
        }
        let sql = match table {
            Names::Metrics => {
                "INSERT INTO metrics (name) VALUES (?) ON CONFLICT (name) DO UPDATE SET name = name RETURNING id"
            }
            Names::Passes => {
                "INSERT INTO passes (name) VALUES (?) ON CONFLICT (name) DO UPDATE SET name = name RETURNING id"
            }
        };
        let id = sqlx::query_scalar(sql)
            .bind(name)
            .fetch_one(&mut *self.transaction)
            .await?;
        self.names.insert((table, name.to_owned()), id);
        Ok(id)
    }

    async fn adapter(&mut self, adapter: &AdapterInfo) -> Result<i64, StoreError> {
        let id = sqlx::query_scalar(
            "INSERT INTO adapters (name, backend, kind, driver, driver_version) VALUES (?, ?, ?, ?, ?)
             ON CONFLICT DO UPDATE SET name = name RETURNING id",
        )
        .bind(&adapter.name)
        .bind(&adapter.backend)
        .bind(&adapter.kind)
        .bind(&adapter.driver)
        .bind(&adapter.driver_version)
        .fetch_one(&mut *self.transaction)
        .await?;
        Ok(id)
    }

    async fn preset(&mut self, preset_index: usize, preset: &PresetReport, now: Timestamp) -> Result<i64, StoreError> {
        let series_id = self.series(preset_index, preset).await?;
        let report_id: i64 = sqlx::query_scalar(
            "INSERT INTO reports (job_id, preset_index, series_id, revision, notes, stages_ms, gpu_time_ms, created_at)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?) RETURNING id",
        )
        .bind(self.claim.job_id)
        .bind(preset_index as i64)
        .bind(series_id)
        .bind(&self.report.revision)
        .bind(serde_json::to_string(&preset.notes)?)
        .bind(serde_json::to_string(&self.report.stages_ms)?)
        .bind(gpu_time_ms(preset))
        .bind(now)
        .fetch_one(&mut *self.transaction)
        .await?;
        sqlx::query("UPDATE series SET latest_report_id = ? WHERE id = ?")
            .bind(report_id)
            .bind(series_id)
            .execute(&mut *self.transaction)
            .await?;
        self.summaries(report_id, preset).await?;
        for frame in &preset.frames {
            self.frame(report_id, frame).await?;
        }
        if let Some(validation) = &preset.validation {
            self.validation(report_id, validation).await?;
        }
        Ok(report_id)
    }

    /// The series that this preset's reports belong to, made at its first report.
    async fn series(&mut self, preset_index: usize, preset: &PresetReport) -> Result<i64, StoreError> {
        let run = &self.claim.spec.run;
        let overrides = run.presets.get(preset_index).map(|spec| &spec.parameters);
        let variant_id: i64 = sqlx::query_scalar(
            "INSERT INTO variants (preset, history, parameters, overrides) VALUES (?, ?, ?, ?)
             ON CONFLICT (preset, history, parameters) DO UPDATE SET preset = preset RETURNING id",
        )
        .bind(&preset.preset)
        .bind(value::precision_id(run.history))
        .bind(preset.parameters.to_string())
        .bind(serde_json::to_string(&overrides)?)
        .fetch_one(&mut *self.transaction)
        .await?;
        let series_id = sqlx::query_scalar(
            "INSERT INTO series (sequence_id, variant_id, adapter_id) VALUES (?, ?, ?)
             ON CONFLICT DO UPDATE SET sequence_id = sequence_id RETURNING id",
        )
        .bind(self.claim.sequence_id)
        .bind(variant_id)
        .bind(self.adapter_id)
        .fetch_one(&mut *self.transaction)
        .await?;
        Ok(series_id)
    }

    async fn summaries(&mut self, report_id: i64, preset: &PresetReport) -> Result<(), StoreError> {
        for (metric, summary) in &preset.summary {
            let metric_id = self.name(Names::Metrics, metric).await?;
            let (number, special) = value::columns(summary.mean);
            sqlx::query(
                "INSERT INTO report_metrics (report_id, metric_id, version, value, special, summary)
                 VALUES (?, ?, ?, ?, ?, ?)",
            )
            .bind(report_id)
            .bind(metric_id)
            .bind(self.report.metric_versions.get(metric).copied().unwrap_or(0))
            .bind(number)
            .bind(special)
            .bind(serde_json::to_string(summary)?)
            .execute(&mut *self.transaction)
            .await?;
        }
        for (pass, time) in &preset.times_ms {
            let pass_id = self.name(Names::Passes, pass).await?;
            sqlx::query(
                "INSERT INTO report_passes (report_id, pass_id, median_ms, min_ms, mad_ms, n_samples)
                 VALUES (?, ?, ?, ?, ?, ?)",
            )
            .bind(report_id)
            .bind(pass_id)
            .bind(time.median)
            .bind(time.min)
            .bind(time.mad)
            .bind(time.n as i64)
            .execute(&mut *self.transaction)
            .await?;
        }
        Ok(())
    }

    async fn validation(&mut self, report_id: i64, validation: &Validation) -> Result<(), StoreError> {
        let mut summary = validation.clone();
        let frames = std::mem::take(&mut summary.frames);
        sqlx::query("INSERT INTO validations (report_id, agrees, summary, frames) VALUES (?, ?, ?, ?)")
            .bind(report_id)
            .bind(validation.agrees)
            .bind(serde_json::to_string(&summary)?)
            .bind(serde_json::to_string(&frames)?)
            .execute(&mut *self.transaction)
            .await?;
        Ok(())
    }

    async fn frame(&mut self, report_id: i64, frame: &FrameReport) -> Result<(), StoreError> {
        let frame_index = frame.index as i64;
        sqlx::query(
            "INSERT INTO frames (report_id, frame_index, reset, warmup, repaired_texels, non_finite_pixels)
             VALUES (?, ?, ?, ?, ?, ?)",
        )
        .bind(report_id)
        .bind(frame_index)
        .bind(frame.reset)
        .bind(frame.warmup)
        .bind(frame.repaired_texels as i64)
        .bind(frame.non_finite_pixels as i64)
        .execute(&mut *self.transaction)
        .await?;
        for (metric, &score) in &frame.metrics {
            let metric_id = self.name(Names::Metrics, metric).await?;
            let (number, special) = value::columns(score);
            sqlx::query(
                "INSERT INTO frame_metrics (report_id, frame_index, metric_id, value, special) VALUES (?, ?, ?, ?, ?)",
            )
            .bind(report_id)
            .bind(frame_index)
            .bind(metric_id)
            .bind(number)
            .bind(special)
            .execute(&mut *self.transaction)
            .await?;
        }
        for (pass, &time_ms) in &frame.times_ms {
            let pass_id = self.name(Names::Passes, pass).await?;
            sqlx::query("INSERT INTO pass_times (report_id, frame_index, pass_id, time_ms) VALUES (?, ?, ?, ?)")
                .bind(report_id)
                .bind(frame_index)
                .bind(pass_id)
                .bind(time_ms)
                .execute(&mut *self.transaction)
                .await?;
        }
        Ok(())
    }
}
