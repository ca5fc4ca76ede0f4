//! Writing reports. Names and lines are rows of small tables that hardly ever change, so their numbers are remembered
//! between reports; what remains for a report are its own row, one chunk of frames, and a point a metric.

use super::{
    Claim, Environment, NewReport, Store, StoreError, Subject, System, SystemKind, Timestamp, TrendPoint,
    columns::{self, Layout},
    model, trend, value,
};
use crate::{
    metrics::Value,
    run::report::{AdapterInfo, FrameReport, Report},
    taa::validation::Validation,
};
use sqlx::{Connection as _, QueryBuilder, Sqlite, SqliteConnection};
use std::collections::{HashMap, HashSet};

/// How many points of a line and metric are packed into a block. A reader reads half as many rows of points on average,
/// and a row costs it as much as a block.
pub(super) const BLOCK: u32 = 64;

/// How many points one statement inserts: SQLite takes 32 766 values.
const ROWS_AT_ONCE: usize = 1000;

/// More of anything than this, and the memory starts anew.
const MAX_REMEMBERED: usize = 20_000;

/// Row numbers that were looked up before. Only what a committed transaction saw may stay.
#[derive(Default)]
pub(super) struct Memory {
    projects: HashMap<String, i64>,
    /// By project and name; apart those whose departure is settled.
    pub(super) branches: HashMap<(i64, String, bool), i64>,
    metrics: HashMap<String, i64>,
    layouts: HashMap<Layout, i64>,
    series: HashMap<String, i64>,
    /// Points of a line and metric that are in no block yet.
    loose: HashMap<(i64, i64), u32>,
    /// The number of the newest report.
    last_report: Option<i64>,
}

impl Memory {
    fn bound(&mut self) {
        let n = self.branches.len() + self.layouts.len() + self.series.len() + self.loose.len() + self.metrics.len();
        if n > MAX_REMEMBERED {
            *self = Self::default();
        }
    }
}

/// Where a report's points belong.
pub(super) struct Place {
    pub series_id: i64,
    pub report_id: i64,
    pub branch_id: Option<i64>,
    /// Reports with higher numbers may have been before.
    pub late: bool,
}

/// Writes reports within one transaction.
pub(super) struct Writer<'a> {
    pub connection: &'a mut SqliteConnection,
    pub memory: &'a mut Memory,
    pub now: Timestamp,
}

/// The row of a name, made at its first use. The update changes nothing; it makes `RETURNING` speak.
macro_rules! named {
    ($writer:ident, $table:literal, $name:expr) => {
        sqlx::query_scalar(concat!(
            "INSERT INTO ",
            $table,
            " (name) VALUES (?) ON CONFLICT (name) DO UPDATE SET name = name RETURNING id"
        ))
        .bind($name)
        .fetch_one(&mut *$writer.connection)
        .await?
    };
}

impl Writer<'_> {
    /// Stores a report; its number.
    pub async fn report(&mut self, report: &NewReport) -> Result<i64, StoreError> {
        self.memory.bound();
        let project_id = self.project(&report.project).await?;
        let branch_id = self.branch(project_id, &report.provenance).await?;
        let series_id = self.series(project_id, report).await?;
        let report_id = self.next_report().await?;
        // The report and its rows in one go, because each statement costs a turn of the connection's thread.
        let mut sql = QueryBuilder::new(
            "INSERT INTO reports (id, job_id, preset_index, series_id, branch_id, git_commit, parent_commit, pull_request,
                                  engine_version, label, labels, revision, notes, stages_ms, metrics, times_ms,
                                  gpu_time_ms, complete, created_at) VALUES (",
        );
        let origin = &report.provenance;
        let mut row = sql.separated(", ");
        row.push_bind(report_id)
            .push_bind(report.job.map(|(job_id, _)| job_id))
            .push_bind(report.job.map_or(0, |(_, index)| index as i64))
            .push_bind(series_id)
            .push_bind(branch_id)
            .push_bind(&origin.commit)
            .push_bind(&origin.parent)
            .push_bind(&origin.pull_request)
            .push_bind(&origin.engine_version)
            .push_bind(&origin.label)
            .push_bind(serde_json::to_string(&origin.labels)?)
            .push_bind(&report.revision)
            .push_bind(serde_json::to_string(&report.notes)?)
            .push_bind(serde_json::to_string(&report.stages_ms)?)
            .push_bind(serde_json::to_string(&report.metrics)?)
            .push_bind(serde_json::to_string(&report.times_ms)?)
            .push_bind(report.gpu_time_ms())
            .push_bind(report.complete)
            .push_bind(self.now);
        sql.push("); ");
        if !report.frames.is_empty() {
            self.push_frames(&mut sql, report_id, &report.frames).await?;
        }
        if report.complete {
            let values = model::points(&report.metrics, report.gpu_time_ms());
            let place = Place {
                series_id,
                report_id,
                branch_id,
                late: false,
            };
            self.points(sql, place, values).await?;
        } else {
            sql.build().execute(&mut *self.connection).await?;
        }
        if let Some(validation) = &report.validation {
            self.validation(report_id, validation).await?;
        }
        Ok(report_id)
    }

    /// The number of the report that is written next; there is no other writer.
    async fn next_report(&mut self) -> Result<i64, StoreError> {
        let id = match self.memory.last_report {
            Some(last) => last + 1,
            None => {
                sqlx::query_scalar("SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'reports'), 0) + 1")
                    .fetch_one(&mut *self.connection)
                    .await?
            }
        };
        self.memory.last_report = Some(id);
        Ok(id)
    }

    /// Adds frames to a report.
    pub async fn frames(&mut self, report_id: i64, frames: &[FrameReport]) -> Result<(), StoreError> {
        if frames.is_empty() {
            return Ok(());
        }
        let mut sql = QueryBuilder::new("");
        self.push_frames(&mut sql, report_id, frames).await?;
        sql.build().execute(&mut *self.connection).await?;
        Ok(())
    }

    /// Frames as one chunk, as a statement behind others.
    async fn push_frames(
        &mut self,
        sql: &mut QueryBuilder<Sqlite>,
        report_id: i64,
        frames: &[FrameReport],
    ) -> Result<(), StoreError> {
        let mut seen = HashSet::with_capacity(frames.len());
        if let Some(frame) = frames.iter().find(|frame| !seen.insert(frame.index)) {
            return Err(StoreError::RepeatedFrame(frame.index));
        }
        let layout = Layout::of(frames);
        let data = layout.pack(frames);
        sql.push("INSERT INTO frame_chunks (report_id, layout_id, data) VALUES (");
        sql.separated(", ")
            .push_bind(report_id)
            .push_bind(self.layout(layout).await?)
            .push_bind(data);
        sql.push("); ");
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
            .execute(&mut *self.connection)
            .await?;
        Ok(())
    }

    /// The numbers that stand for a complete report, written behind the statements that are in `sql` already.
    pub async fn points(
        &mut self,
        mut sql: QueryBuilder<Sqlite>,
        place: Place,
        values: impl Iterator<Item = (&str, Value, u32)>,
    ) -> Result<(), StoreError> {
        let Place {
            series_id,
            report_id,
            branch_id,
            late,
        } = place;
        let mut points = Vec::new();
        for (metric, value, metric_version) in values {
            let point = TrendPoint {
                report_id,
                branch_id: branch_id.unwrap_or(0),
                created_at: self.now,
                value,
                metric_version,
            };
            points.push((metric, self.metric(metric).await?, point));
        }
        sql.push("UPDATE series SET latest_report_id = max(ifnull(latest_report_id, 0), ")
            .push_bind(report_id)
            .push(") WHERE id = ")
            .push_bind(series_id)
            .push("; ");
        let mut rest = points.as_slice();
        loop {
            let (some, others) = rest.split_at(rest.len().min(ROWS_AT_ONCE));
            if !some.is_empty() {
                sql.push(
                    "INSERT INTO points (series_id, metric_id, report_id, branch_id, created_at, version, value) ",
                );
                sql.push_values(some, |mut row, (_, metric_id, point)| {
                    row.push_bind(series_id)
                        .push_bind(*metric_id)
                        .push_bind(point.report_id)
                        .push_bind(point.branch_id)
                        .push_bind(point.created_at)
                        .push_bind(point.metric_version)
                        .push_bind(Some(point.value.0).filter(|value| !value.is_nan()));
                });
            }
            sql.build().execute(&mut *self.connection).await?;
            if others.is_empty() {
                break;
            }
            (rest, sql) = (others, QueryBuilder::new(""));
        }
        for (metric, metric_id, point) in points {
            if !(late && self.late_point(series_id, metric_id, point).await?) {
                self.count(series_id, metric, metric_id).await?;
            }
        }
        Ok(())
    }

    /// Adds a point to the block that its report's number falls into, where frames came one by one while other reports
    /// went past. Gives whether there is such a block.
    async fn late_point(&mut self, series_id: i64, metric_id: i64, point: TrendPoint) -> Result<bool, StoreError> {
        let block: Option<(i64, Vec<u8>)> = sqlx::query_as(
            "SELECT last_report_id, data FROM point_blocks
             WHERE series_id = ? AND metric_id = ? AND last_report_id > ? ORDER BY last_report_id LIMIT 1",
        )
        .bind(series_id)
        .bind(metric_id)
        .bind(point.report_id)
        .fetch_optional(&mut *self.connection)
        .await?;
        let Some((last_report_id, data)) = block else {
            return Ok(false);
        };
        let mut points = Vec::new();
        columns::unpack_points(&data, &mut points);
        let place = points.partition_point(|other| other.report_id < point.report_id);
        points.insert(place, point);
        sqlx::query("UPDATE point_blocks SET data = ? WHERE series_id = ? AND metric_id = ? AND last_report_id = ?")
            .bind(columns::pack_points(&points))
            .bind(series_id)
            .bind(metric_id)
            .bind(last_report_id)
            .execute(&mut *self.connection)
            .await?;
        Ok(true)
    }

    /// Packs the loose points of a line once they fill a block.
    async fn count(&mut self, series_id: i64, metric: &str, metric_id: i64) -> Result<(), StoreError> {
        let key = (series_id, metric_id);
        let n_loose = match self.memory.loose.get(&key) {
            Some(n_loose) => n_loose + 1,
            None => trend::count_loose(self.connection, series_id, metric).await?,
        };
        if n_loose < BLOCK {
            self.memory.loose.insert(key, n_loose);
            return Ok(());
        }
        self.memory.loose.remove(&key);
        let mut points: Vec<TrendPoint> = trend::loose(self.connection, series_id, metric, usize::MAX).await?;
        points.reverse();
        let Some(last) = points.last() else { return Ok(()) };
        sqlx::query("INSERT INTO point_blocks (series_id, metric_id, last_report_id, data) VALUES (?, ?, ?, ?)")
            .bind(series_id)
            .bind(metric_id)
            .bind(last.report_id)
            .bind(columns::pack_points(&points))
            .execute(&mut *self.connection)
            .await?;
        Ok(())
    }

    /// The row of a project, made at its first use.
    pub async fn project(&mut self, name: &str) -> Result<i64, StoreError> {
        if let Some(&id) = self.memory.projects.get(name) {
            return Ok(id);
        }
        let id = sqlx::query_scalar(
            "INSERT INTO projects (name, created_at) VALUES (?, ?)
             ON CONFLICT (name) DO UPDATE SET name = name RETURNING id",
        )
        .bind(name)
        .bind(self.now)
        .fetch_one(&mut *self.connection)
        .await?;
        self.memory.projects.insert(name.to_owned(), id);
        Ok(id)
    }

    async fn metric(&mut self, name: &str) -> Result<i64, StoreError> {
        if let Some(&id) = self.memory.metrics.get(name) {
            return Ok(id);
        }
        let id = named!(self, "metrics", name);
        self.memory.metrics.insert(name.to_owned(), id);
        Ok(id)
    }

    async fn layout(&mut self, layout: Layout) -> Result<i64, StoreError> {
        if let Some(&id) = self.memory.layouts.get(&layout) {
            return Ok(id);
        }
        let id = sqlx::query_scalar(
            "INSERT INTO frame_layouts (metrics, passes) VALUES (?, ?)
             ON CONFLICT (metrics, passes) DO UPDATE SET passes = passes RETURNING id",
        )
        .bind(serde_json::to_string(&layout.metrics)?)
        .bind(serde_json::to_string(&layout.passes)?)
        .fetch_one(&mut *self.connection)
        .await?;
        self.memory.layouts.insert(layout, id);
        Ok(id)
    }

    /// The line that a report belongs to, made at its first report.
    async fn series(&mut self, project_id: i64, report: &NewReport) -> Result<i64, StoreError> {
        let (system, environment) = (&report.system, &report.environment);
        let key = serde_json::to_string(&(
            project_id,
            format!("{:?}", report.subject),
            (
                system.kind,
                &system.name,
                system.history,
                system.skip,
                system.n_frames,
                &system.parameters,
            ),
            environment,
        ))?;
        if let Some(&id) = self.memory.series.get(&key) {
            return Ok(id);
        }
        let subject_id = self.subject(&report.subject).await?;
        let variant_id = self.variant(system).await?;
        let environment_id = self.environment(environment).await?;
        let id = sqlx::query_scalar(
            "INSERT INTO series (project_id, subject_id, variant_id, environment_id) VALUES (?, ?, ?, ?)
             ON CONFLICT DO UPDATE SET project_id = project_id RETURNING id",
        )
        .bind(project_id)
        .bind(subject_id)
        .bind(variant_id)
        .bind(environment_id)
        .fetch_one(&mut *self.connection)
        .await?;
        self.memory.series.insert(key, id);
        Ok(id)
    }

    async fn subject(&mut self, subject: &Subject) -> Result<i64, StoreError> {
        let id = match subject {
            Subject::Sequence(sequence_id) => {
                sqlx::query_scalar(
                    "INSERT INTO subjects (sequence_id) VALUES (?)
                     ON CONFLICT (sequence_id) DO UPDATE SET sequence_id = sequence_id RETURNING id",
                )
                .bind(sequence_id)
                .fetch_one(&mut *self.connection)
                .await?
            }
            Subject::Named(name) => named!(self, "subjects", name),
        };
        Ok(id)
    }

    async fn variant(&mut self, system: &System) -> Result<i64, StoreError> {
        let history = system.history.map(value::precision_id);
        let id = sqlx::query_scalar(
            "INSERT INTO variants (kind, preset, history, skip, n_frames, parameters, overrides)
             VALUES (?, ?, ?, ?, ?, ?, ?)
             ON CONFLICT (kind, preset, ifnull(history, ''), ifnull(skip, ''), ifnull(n_frames, 0), parameters)
             DO UPDATE SET preset = preset RETURNING id",
        )
        .bind(system.kind)
        .bind(&system.name)
        .bind(history)
        .bind(system.skip.map(|skip| skip.to_string()))
        .bind(system.n_frames.map(|n| n as i64))
        .bind(system.parameters.to_string())
        .bind(system.overrides.to_string())
        .fetch_one(&mut *self.connection)
        .await?;
        Ok(id)
    }

    async fn environment(&mut self, environment: &Environment) -> Result<i64, StoreError> {
        let adapter_id = adapter_id(self.connection, &environment.adapter).await?;
        let id = sqlx::query_scalar(
            "INSERT INTO environments (adapter_id, os, clocks) VALUES (?, ?, ?)
             ON CONFLICT DO UPDATE SET os = os RETURNING id",
        )
        .bind(adapter_id)
        .bind(&environment.os)
        .bind(&environment.clocks)
        .fetch_one(&mut *self.connection)
        .await?;
        Ok(id)
    }
}

/// The row of an adapter, made at its first use.
pub(super) async fn adapter_id(connection: &mut SqliteConnection, adapter: &AdapterInfo) -> Result<i64, StoreError> {
    let id = sqlx::query_scalar(
        "INSERT INTO adapters (name, backend, kind, driver, driver_version) VALUES (?, ?, ?, ?, ?)
         ON CONFLICT DO UPDATE SET name = name RETURNING id",
    )
    .bind(&adapter.name)
    .bind(&adapter.backend)
    .bind(&adapter.kind)
    .bind(&adapter.driver)
    .bind(&adapter.driver_version)
    .fetch_one(connection)
    .await?;
    Ok(id)
}

impl Store {
    /// Stores the reports of every preset and ends the job; gives the reports' numbers, in the order of presets.
    pub async fn finish(
        &self,
        claim: &Claim,
        report: &Report,
        environment: &Environment,
        now: Timestamp,
    ) -> Result<Vec<i64>, StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        let n_frames = report.reports.iter().map(|preset| {
            let validated = preset
                .validation
                .as_ref()
                .map_or(0, |validation| validation.frames.len());
            preset.frames.len() + validated
        });
        claim.end(&mut transaction, n_frames.sum(), now).await?;
        let mut memory = Memory::default();
        let mut writer = Writer {
            connection: &mut transaction,
            memory: &mut memory,
            now,
        };
        let mut ids = Vec::with_capacity(report.reports.len());
        for index in 0..report.reports.len() {
            ids.push(writer.report(&of_job(claim, report, index, environment)?).await?);
        }
        // The ingest counts loose points on its own and must not miss these; said while the connection is still ours.
        self.ingest.forget();
        transaction.commit().await?;
        Ok(ids)
    }
}

/// One preset of a job as a report.
fn of_job(claim: &Claim, report: &Report, index: usize, environment: &Environment) -> Result<NewReport, StoreError> {
    let preset = &report.reports[index];
    let run = &claim.spec.run;
    let overrides = run.presets.get(index).map(|spec| &spec.parameters);
    let version = |metric: &String| report.metric_versions.get(metric).copied().unwrap_or(0);
    let (kind, history, skip) = match &claim.spec.outputs {
        None => (SystemKind::Recipe, Some(run.history), Some(run.skip)),
        Some(_) => (SystemKind::External, None, None),
    };
    let sequence_id = claim.sequence_id.ok_or(StoreError::NoSequence(claim.job_id))?;
    Ok(NewReport {
        job: Some((claim.job_id, index)),
        project: claim.project.clone(),
        subject: Subject::Sequence(sequence_id),
        system: System {
            kind,
            name: preset.preset.clone(),
            history,
            skip,
            n_frames: run.n_frames,
            parameters: preset.parameters.clone(),
            overrides: serde_json::to_value(overrides)?,
        },
        environment: match &claim.spec.outputs {
            None => environment.clone(),
            Some(outputs) => outputs.environment.clone(),
        },
        provenance: claim.provenance.clone(),
        revision: report.revision.clone(),
        notes: preset.notes.clone(),
        stages_ms: report.stages_ms.clone(),
        metrics: preset
            .summary
            .iter()
            .map(|(metric, &summary)| {
                let version = version(metric);
                (metric.clone(), super::MetricSummary { version, summary })
            })
            .collect(),
        times_ms: preset.times_ms.clone(),
        frames: preset.frames.clone(),
        validation: preset.validation.clone(),
        complete: true,
    })
}
