//! Moves what migration 0002 stored row by row into the packed form of 0010. SQL alone cannot: it would print numbers
//! and lose their last bits.

use super::{
    MetricSummary, StoreError, Timestamp, model, value,
    writing::{Memory, Place, Writer},
};
use crate::run::report::{FrameReport, TimeSummary};
use sqlx::{Connection as _, QueryBuilder, Row as _, SqliteConnection, sqlite::SqlitePool};
use std::collections::BTreeMap;

/// Tables of 0002 that 0010 no longer needs, children first.
const OLD_TABLES: [&str; 5] = [
    "pass_times",
    "frame_metrics",
    "frames",
    "report_passes",
    "report_metrics",
];

/// Converts every old report and drops the old tables, in one transaction; does nothing where that was done.
pub(super) async fn convert(writer: &SqlitePool) -> Result<(), StoreError> {
    let mut connection = writer.acquire().await?;
    let n_old: i64 = sqlx::query_scalar("SELECT count(*) FROM sqlite_schema WHERE name = 'report_metrics'")
        .fetch_one(&mut *connection)
        .await?;
    if n_old == 0 {
        return Ok(());
    }
    let mut transaction = connection.begin().await?;
    let ids: Vec<i64> = sqlx::query_scalar("SELECT id FROM reports ORDER BY id")
        .fetch_all(&mut *transaction)
        .await?;
    if !ids.is_empty() {
        tracing::info!(n_reports = ids.len(), "converting the history to its new form");
    }
    let mut memory = Memory::default();
    for id in ids {
        report(&mut transaction, &mut memory, id).await?;
    }
    for table in OLD_TABLES {
        sqlx::query(sqlx::AssertSqlSafe(format!("DROP TABLE {table}")))
            .execute(&mut *transaction)
            .await?;
    }
    transaction.commit().await?;
    Ok(())
}

async fn report(connection: &mut SqliteConnection, memory: &mut Memory, id: i64) -> Result<(), StoreError> {
    let metrics = metrics(connection, id).await?;
    let times_ms = times(connection, id).await?;
    let frames = frames(connection, id).await?;
    let row = sqlx::query(
        "UPDATE reports SET metrics = ?, times_ms = ? WHERE id = ?
         RETURNING series_id, branch_id, gpu_time_ms, created_at",
    )
    .bind(serde_json::to_string(&metrics)?)
    .bind(serde_json::to_string(&times_ms)?)
    .bind(id)
    .fetch_one(&mut *connection)
    .await?;
    let gpu_time_ms: Option<f64> = row.try_get("gpu_time_ms")?;
    let place = Place {
        series_id: row.try_get("series_id")?,
        report_id: id,
        branch_id: row.try_get("branch_id")?,
        late: false,
    };
    let now: Timestamp = row.try_get("created_at")?;
    let mut writer = Writer {
        connection,
        memory,
        now,
    };
    writer.frames(id, &frames).await?;
    let values = model::points(&metrics, gpu_time_ms);
    writer.points(QueryBuilder::new(""), place, values).await
}

async fn metrics(connection: &mut SqliteConnection, id: i64) -> Result<BTreeMap<String, MetricSummary>, StoreError> {
    let rows: Vec<(String, u32, String)> = sqlx::query_as(
        "SELECT metrics.name, version, summary
         FROM report_metrics JOIN metrics ON metrics.id = metric_id WHERE report_id = ?",
    )
    .bind(id)
    .fetch_all(connection)
    .await?;
    rows.into_iter()
        .map(|(metric, version, summary)| {
            let summary = serde_json::from_str(&summary)?;
            Ok((metric, MetricSummary { version, summary }))
        })
        .collect()
}

async fn times(connection: &mut SqliteConnection, id: i64) -> Result<BTreeMap<String, TimeSummary>, StoreError> {
    let rows: Vec<(String, f64, f64, f64, i64)> = sqlx::query_as(
        "SELECT passes.name, median_ms, min_ms, mad_ms, n_samples
         FROM report_passes JOIN passes ON passes.id = pass_id WHERE report_id = ?",
    )
    .bind(id)
    .fetch_all(connection)
    .await?;
    let time = |(pass, median, min, mad, n): (String, f64, f64, f64, i64)| {
        let n = n as usize;
        (pass, TimeSummary { median, min, mad, n })
    };
    Ok(rows.into_iter().map(time).collect())
}

async fn frames(connection: &mut SqliteConnection, id: i64) -> Result<Vec<FrameReport>, StoreError> {
    let rows: Vec<(i64, bool, bool, i64, i64)> = sqlx::query_as(
        "SELECT frame_index, reset, warmup, repaired_texels, non_finite_pixels FROM frames WHERE report_id = ?",
    )
    .bind(id)
    .fetch_all(&mut *connection)
    .await?;
    let mut frames = BTreeMap::new();
    for (index, reset, warmup, repaired_texels, non_finite_pixels) in rows {
        let frame = FrameReport {
            reset,
            warmup,
            repaired_texels: repaired_texels as u64,
            non_finite_pixels: non_finite_pixels as u64,
            ..FrameReport::empty(index as usize)
        };
        frames.insert(index, frame);
    }
    let scores: Vec<(i64, String, Option<f64>, Option<String>)> = sqlx::query_as(
        "SELECT frame_index, metrics.name, value, special
         FROM frame_metrics JOIN metrics ON metrics.id = metric_id WHERE report_id = ?",
    )
    .bind(id)
    .fetch_all(&mut *connection)
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
    .bind(id)
    .fetch_all(&mut *connection)
    .await?;
    for (index, pass, time_ms) in times {
        if let Some(frame) = frames.get_mut(&index) {
            frame.times_ms.insert(pass, time_ms);
        }
    }
    Ok(frames.into_values().collect())
}

#[cfg(test)]
mod tests {
    use super::super::{GPU_TIME, ReportFilter, SeriesFilter, Store, TrendFilter};
    use crate::taa::Skip;
    use sqlx::{Connection as _, SqliteConnection};

    /// A history as version 0.1 wrote it, with numbers that decimal digits would spoil.
    const OLD_HISTORY: &str = "
        INSERT INTO sequences VALUES (1, 'aa', 'ship', '{}', 64, 48, 64, 48, 2, 10, 5);
        INSERT INTO jobs (id, sequence_id, spec, git_branch, git_commit, label, status, created_at)
            VALUES (7, 1, '{}', 'main', 'c0ffee', 'first', 'done', 5), (8, 1, '{}', NULL, NULL, NULL, 'done', 6);
        INSERT INTO adapters VALUES (3, 'llvmpipe', 'Vulkan', 'Cpu', 'Mesa', '25');
        INSERT INTO variants VALUES (4, 'ema', 'f16', '{\"current_weight\":0.1}', 'null');
        INSERT INTO series VALUES (5, 1, 4, 3, NULL);
        INSERT INTO reports VALUES (11, 7, 0, 5, 'rev', '[\"note\"]', '{\"total\":1.5}', 0.25, 100);
        INSERT INTO reports VALUES (12, 8, 0, 5, 'rev', '[]', '{}', NULL, 200);
        UPDATE series SET latest_report_id = 12;
        INSERT INTO metrics VALUES (1, 'psnr');
        INSERT INTO passes VALUES (1, 'resolve');
        INSERT INTO report_metrics VALUES (11, 1, 1, 0.1, NULL,
            '{\"mean\":24.980085622375846,\"min\":1.0,\"p5\":\"inf\",\"infinite\":1,\"nan\":0}');
        INSERT INTO report_passes VALUES (11, 1, 0.25, 0.1, 0.0, 3);
        INSERT INTO frames VALUES (11, 0, 1, 1, 3, 4), (11, 1, 0, 0, 0, 0);
        INSERT INTO frame_metrics VALUES (11, 0, 1, NULL, 'inf'), (11, 1, 1, 24.980085622375846, NULL);
        INSERT INTO pass_times VALUES (11, 1, 1, 0.1);";

    #[tokio::test]
    async fn an_old_history_comes_back_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("old.sqlite");
        let mut old = SqliteConnection::connect(&format!("sqlite:{}?mode=rwc", path.display()))
            .await
            .unwrap();
        sqlx::migrate!().run_to(2, &mut old).await.unwrap();
        sqlx::raw_sql(OLD_HISTORY).execute(&mut old).await.unwrap();
        old.close().await.unwrap();

        for _ in 0..2 {
            let store = Store::open(&path).await.unwrap();
            let report = store.report(11).await.unwrap().unwrap();
            assert_eq!(report.values["psnr"].0, 24.980_085_622_375_846);
            assert_eq!((report.metric_versions["psnr"], report.times_ms["resolve"].n), (1, 3));
            assert_eq!(report.provenance.branch.as_deref(), Some("main"));
            assert_eq!(report.series.environment.adapter.driver_version, "25");
            assert_eq!(report.series.skip, Some(Skip::Off));
            assert_eq!(store.sequence("ship").await.unwrap().unwrap().hash, "aa");
            let frames = store.frames(11).await.unwrap();
            assert_eq!(frames[0].metrics["psnr"].0, f64::INFINITY);
            assert_eq!(frames[1].metrics["psnr"].0, 24.980_085_622_375_846);
            assert_eq!(
                (
                    frames[0].repaired_texels,
                    frames[0].warmup,
                    frames[1].times_ms["resolve"]
                ),
                (3, true, 0.1)
            );
            let all = ReportFilter {
                limit: 9,
                ..ReportFilter::default()
            };
            assert_eq!(store.reports(&all).await.unwrap().len(), 2);
            let series = store.series(&SeriesFilter::default()).await.unwrap();
            let times = store
                .trend(series[0].id, GPU_TIME, &TrendFilter::newest(9))
                .await
                .unwrap();
            assert_eq!(times.iter().map(|point| point.value.0).collect::<Vec<_>>(), [0.25]);
            store.close().await;
        }
    }
}
