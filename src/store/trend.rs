//! A metric over time. Long lines are read as blocks of packed points, what came since as rows; a line of 100 000 points
//! is then 1600 rows. A branch's past is its parent's up to where it departed.

use super::{Series, Store, StoreError, Timestamp, columns, writing::BLOCK};
use crate::metrics::Value;
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::{Row, SqliteConnection, sqlite::SqliteRow};

/// How many blocks are read in one go: 16 000 points.
const BLOCKS_AT_ONCE: i64 = 256;

/// Job, branch, commit and parent commit of a report.
pub(super) type Described = (Option<i64>, Option<String>, Option<String>, Option<String>);

/// A point as verdicts and charts walk it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrendPoint {
    /// The report it stands for.
    pub report_id: i64,
    /// The report's branch; 0 for none.
    pub branch_id: i64,
    /// When it was stored.
    pub created_at: Timestamp,
    /// The value.
    pub value: Value,
    /// Version of the metric; only equal ones compare. 0 for times.
    pub metric_version: u32,
}

/// A metric at one point in time.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Point {
    /// The report it stands for.
    pub report_id: i64,
    /// The job of that report, if it came from one.
    pub job_id: Option<i64>,
    /// Branch the submitter gave.
    pub branch: Option<String>,
    /// Commit the submitter gave.
    pub commit: Option<String>,
    /// The commit before, as the submitter gave it.
    pub parent: Option<String>,
    /// When it was stored.
    pub created_at: Timestamp,
    /// The value.
    pub value: Value,
    /// Version of the metric; only equal ones compare. 0 for times.
    pub metric_version: u32,
}

/// Whose points are wanted: those of a branch, of its parent up to where it left, and so on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BranchPath(Vec<(i64, i64)>);

impl BranchPath {
    fn has(&self, point: &TrendPoint) -> bool {
        self.0
            .iter()
            .any(|&(branch_id, until)| point.branch_id == branch_id && point.report_id <= until)
    }
}

/// Which points of a line are wanted.
#[derive(Clone, Debug)]
pub struct TrendFilter {
    /// Of which branch and its past; all where none.
    pub path: Option<BranchPath>,
    /// Not before.
    pub since: Timestamp,
    /// Not after.
    pub until: Timestamp,
    /// The newest so many.
    pub limit: usize,
}

impl TrendFilter {
    /// The newest `limit` points of all branches.
    pub fn newest(limit: usize) -> Self {
        Self {
            path: None,
            since: Timestamp(i64::MIN),
            until: Timestamp::MAX,
            limit,
        }
    }

    fn admits_all(&self) -> bool {
        self.path.is_none() && self.since == Timestamp(i64::MIN) && self.until >= Timestamp::MAX
    }

    fn admits(&self, point: &TrendPoint) -> bool {
        (self.since..=self.until).contains(&point.created_at) && self.path.as_ref().is_none_or(|path| path.has(point))
    }
}

/// The points of a line and metric that are in no block. The subqueries name nothing of the row, so each runs once.
macro_rules! loose_points {
    () => {
        "FROM points WHERE series_id = ?1 AND metric_id = (SELECT id FROM metrics WHERE name = ?2)
           AND report_id > coalesce((SELECT max(last_report_id) FROM point_blocks WHERE series_id = ?1
                                     AND metric_id = (SELECT id FROM metrics WHERE name = ?2)), 0)"
    };
}

/// How many they are.
pub(super) async fn count_loose(
    connection: &mut SqliteConnection,
    series_id: i64,
    metric: &str,
) -> Result<u32, StoreError> {
    let n = sqlx::query_scalar(concat!("SELECT count(*) ", loose_points!()))
        .bind(series_id)
        .bind(metric)
        .fetch_one(connection)
        .await?;
    Ok(n)
}

/// Themselves, newest first, and only so many of them.
pub(super) async fn loose(
    connection: &mut SqliteConnection,
    series_id: i64,
    metric: &str,
    limit: usize,
) -> Result<Vec<TrendPoint>, StoreError> {
    let rows = sqlx::query(concat!(
        "SELECT report_id, branch_id, created_at, value, version ",
        loose_points!(),
        " ORDER BY report_id DESC LIMIT +?3"
    ))
    .bind(series_id)
    .bind(metric)
    .bind(i64::try_from(limit).unwrap_or(i64::MAX))
    .fetch_all(connection)
    .await?;
    let points: Result<Vec<_>, sqlx::Error> = rows.iter().map(point).collect();
    Ok(points?)
}

fn point(row: &SqliteRow) -> Result<TrendPoint, sqlx::Error> {
    let value: Option<f64> = row.try_get(3)?;
    Ok(TrendPoint {
        report_id: row.try_get(0)?,
        branch_id: row.try_get(1)?,
        created_at: row.try_get(2)?,
        value: Value(value.unwrap_or(f64::NAN)),
        metric_version: row.try_get(4)?,
    })
}

/// Adds what the blocks that end before a report have, newest first, until there is enough.
async fn older(
    connection: &mut SqliteConnection,
    series_id: i64,
    metric: &str,
    mut before: i64,
    filter: &TrendFilter,
    newest_first: &mut Vec<TrendPoint>,
) -> Result<(), StoreError> {
    let mut block = Vec::new();
    loop {
        let n_missing = filter.limit - newest_first.len();
        let n_blocks = (n_missing.div_ceil(BLOCK as usize) as i64).min(BLOCKS_AT_ONCE);
        let blocks: Vec<(i64, Vec<u8>)> = sqlx::query_as(
            "SELECT last_report_id, data FROM point_blocks
             WHERE series_id = ? AND metric_id = (SELECT id FROM metrics WHERE name = ?) AND last_report_id < ?
             ORDER BY last_report_id DESC LIMIT +?",
        )
        .bind(series_id)
        .bind(metric)
        .bind(before)
        .bind(n_blocks)
        .fetch_all(&mut *connection)
        .await?;
        let Some((last, _)) = blocks.last() else { return Ok(()) };
        before = *last;
        for (_, data) in &blocks {
            block.clear();
            columns::unpack_points(data, &mut block);
            let is_past = block.first().is_some_and(|point| point.created_at < filter.since);
            newest_first.extend(block.iter().rev().filter(|point| filter.admits(point)));
            if is_past || newest_first.len() >= filter.limit {
                return Ok(());
            }
        }
    }
}

impl Store {
    /// The path of a project's branch; `None` where there is no such branch.
    pub async fn branch_path(&self, project: &str, branch: &str) -> Result<Option<BranchPath>, StoreError> {
        let steps: Vec<(i64, i64)> = sqlx::query_as(
            "WITH RECURSIVE path (id, until, parent_id, departed, depth) AS (
                 SELECT branches.id, 9223372036854775807, parent_id, departed_report_id, 0
                 FROM branches JOIN projects ON projects.id = project_id
                 WHERE projects.name = ?1 AND branches.name = ?2
                 UNION ALL
                 SELECT branches.id, min(path.until, path.departed), branches.parent_id, branches.departed_report_id,
                        depth + 1
                 FROM path JOIN branches ON branches.id = path.parent_id WHERE depth < 16)
             SELECT id, until FROM path ORDER BY depth",
        )
        .bind(project)
        .bind(branch)
        .fetch_all(&self.readers)
        .await?;
        Ok((!steps.is_empty()).then_some(BranchPath(steps)))
    }

    /// A line's points, oldest first.
    pub async fn trend(
        &self,
        series_id: i64,
        metric: &str,
        filter: &TrendFilter,
    ) -> Result<Vec<TrendPoint>, StoreError> {
        let mut connection = self.readers.acquire().await?;
        // What the filter leaves out must not count.
        let limit = if filter.admits_all() { filter.limit } else { usize::MAX };
        let mut newest_first = loose(&mut connection, series_id, metric, limit).await?;
        // What was loose a moment ago may be in a block by now: those that end here or later have nothing else.
        let before = newest_first.last().map_or(i64::MAX, |oldest| oldest.report_id);
        newest_first.retain(|point| filter.admits(point));
        if newest_first.len() < filter.limit {
            older(&mut connection, series_id, metric, before, filter, &mut newest_first).await?;
        }
        newest_first.truncate(filter.limit);
        newest_first.reverse();
        Ok(newest_first)
    }

    /// The last `limit` values of `metric` in a series, oldest first, optionally of one branch and its past.
    pub async fn points(
        &self,
        series: &Series,
        metric: &str,
        branch: Option<&str>,
        limit: usize,
    ) -> Result<Vec<Point>, StoreError> {
        let path = match branch {
            None => None,
            Some(branch) => Some(self.branch_path(&series.project, branch).await?.unwrap_or_default()),
        };
        let filter = TrendFilter {
            path,
            ..TrendFilter::newest(limit)
        };
        let points = self.trend(series.id, metric, &filter).await?;
        self.describe(&points).await
    }

    /// What a reader of a chart wants to know of its points.
    pub async fn describe(&self, points: &[TrendPoint]) -> Result<Vec<Point>, StoreError> {
        let ids: Vec<i64> = points.iter().map(|point| point.report_id).collect();
        let load = async |ids: &[i64]| {
            // One row of JSON: thousands of rows would each wait for the database's thread.
            let rows: String = sqlx::query_scalar(
                "SELECT json_group_array(json_array(reports.id, json_array(job_id, branches.name, git_commit,
                                                                             parent_commit)))
                 FROM json_each(?) AS wanted CROSS JOIN reports ON reports.id = wanted.value
                 LEFT JOIN branches ON branches.id = branch_id",
            )
            .bind(serde_json::to_string(ids)?)
            .fetch_one(&self.readers)
            .await?;
            Ok(serde_json::from_str(&rows)?)
        };
        let mut described = self.known.described.get(&ids, |_| true, load).await?;
        Ok(points
            .iter()
            .map(|point| {
                let (job_id, branch, commit, parent) = described.remove(&point.report_id).unwrap_or_default();
                Point {
                    report_id: point.report_id,
                    job_id,
                    branch,
                    commit,
                    parent,
                    created_at: point.created_at,
                    value: point.value,
                    metric_version: point.metric_version,
                }
            })
            .collect())
    }
}

/// At most `max` of `points` that keep every peak: of each run of neighbours the smallest and the largest, in order. The
/// first and the last always stay.
pub fn downsample(points: &[TrendPoint], max: usize) -> Vec<TrendPoint> {
    if points.len() <= max || max < 4 {
        return points.to_vec();
    }
    let n_runs = (max - 2) / 2;
    let (first, inner, last) = (points[0], &points[1..points.len() - 1], points[points.len() - 1]);
    let mut kept = Vec::with_capacity(max);
    kept.push(first);
    for run in 0..n_runs {
        let run = &inner[run * inner.len() / n_runs..(run + 1) * inner.len() / n_runs];
        let by_value = |a: &&TrendPoint, b: &&TrendPoint| a.value.0.total_cmp(&b.value.0);
        if let (Some(&low), Some(&high)) = (run.iter().min_by(by_value), run.iter().max_by(by_value)) {
            let (a, b) = if low.report_id <= high.report_id {
                (low, high)
            } else {
                (high, low)
            };
            kept.push(a);
            if a.report_id != b.report_id {
                kept.push(b);
            }
        }
    }
    kept.push(last);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn downsampling_keeps_ends_peaks_and_order() {
        let points: Vec<_> = (0..10_000)
            .map(|i| TrendPoint {
                report_id: i,
                branch_id: 1,
                created_at: Timestamp(i),
                value: Value(match i {
                    4321 => 99.0,
                    7000 => -99.0,
                    _ => (i % 7) as f64,
                }),
                metric_version: 1,
            })
            .collect();
        let kept = downsample(&points, 400);
        assert!(kept.len() <= 400 && kept.len() > 300, "{}", kept.len());
        assert!(kept.is_sorted_by_key(|point| point.report_id));
        for id in [0, 4321, 7000, 9999] {
            assert!(kept.iter().any(|point| point.report_id == id), "{id}");
        }
        assert_eq!(downsample(&points[..100], 400), points[..100]);
    }
}
