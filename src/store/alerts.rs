//! Alerts: faults that were found, until they are made good, approved or dismissed.

use super::{LineRules, Series, SeriesFilter, Store, StoreError, Timestamp, reading::json};
use crate::verdict::{Check, Finding, Kind, Outcome};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sqlx::{Connection as _, FromRow, Row, sqlite::SqliteRow};
use std::{
    collections::{BTreeMap, HashMap},
    time::Duration,
};

/// Results of fewer days on a branch that left another are a change under work, which ends, not a nightly.
const MIN_DAYS: i64 = 5;

/// Where an alert stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, sqlx::Type)]
#[serde(rename_all = "snake_case")]
#[sqlx(rename_all = "snake_case")]
pub enum AlertStatus {
    /// The fault is there.
    Open,
    /// A later result was good, the result was approved, or its rule was removed.
    Resolved,
    /// Someone said that it does not matter.
    Dismissed,
}

/// A fault that was found.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Alert {
    /// Number, rising with time.
    pub id: i64,
    /// Project.
    pub project: String,
    /// Branch that was judged; empty for none.
    pub branch: String,
    /// The line.
    pub series: Series,
    /// The metric's id; empty where no data came at all.
    pub metric: String,
    /// What kind of check failed.
    pub kind: Kind,
    /// Where it stands.
    pub status: AlertStatus,
    /// The first bad report, or the last one before silence.
    pub report_id: Option<i64>,
    /// Its job, if it came from one.
    pub job_id: Option<i64>,
    /// Its place in the job.
    pub preset_index: Option<i64>,
    /// In words.
    pub detail: String,
    /// In numbers.
    pub finding: Finding,
    /// Why it is closed.
    pub closed_why: Option<String>,
    /// Who closed it.
    pub closed_by: Option<String>,
    /// When it was found.
    pub opened_at: Timestamp,
    /// When it was last found again.
    pub updated_at: Timestamp,
    /// When it was closed.
    pub closed_at: Option<Timestamp>,
}

#[derive(Serialize, Deserialize)]
struct StoredFinding {
    detail: String,
    finding: Finding,
}

/// Which alerts to list, newest first.
#[derive(Clone, Debug, Default)]
pub struct AlertFilter {
    /// Only of this project.
    pub project: Option<String>,
    /// Only of this status.
    pub status: Option<AlertStatus>,
    /// Only of this branch.
    pub branch: Option<String>,
    /// Only the one with this number.
    pub id: Option<i64>,
    /// Only those whose first bad report is this one or a later one.
    pub since_report: Option<i64>,
    /// Only those with smaller numbers.
    pub before: Option<i64>,
    /// At most so many.
    pub limit: u32,
}

/// As the store writes it.
pub(super) fn kind(id: &str) -> Kind {
    match id {
        "limit" => Kind::Limit,
        "baseline" => Kind::Baseline,
        "change" => Kind::Change,
        _ => Kind::NoData,
    }
}

/// What an alert's row alone says.
fn alert(row: &SqliteRow, series: Series) -> Result<Alert, sqlx::Error> {
    let found: StoredFinding = json(row, "finding")?;
    Ok(Alert {
        id: row.try_get("id")?,
        project: series.project.clone(),
        branch: row.try_get("branch")?,
        series,
        metric: row.try_get("metric")?,
        kind: kind(row.try_get("kind")?),
        status: row.try_get("status")?,
        report_id: row.try_get("report_id")?,
        job_id: row.try_get("job_id")?,
        preset_index: row.try_get("preset_index")?,
        detail: found.detail,
        finding: found.finding,
        closed_why: row.try_get("closed_why")?,
        closed_by: row.try_get("closed_by")?,
        opened_at: row.try_get("opened_at")?,
        updated_at: row.try_get("updated_at")?,
        closed_at: row.try_get("closed_at")?,
    })
}

impl Store {
    /// Opens an alert for each failed check, adds to those that are open, and resolves those whose check holds again.
    /// Gives the numbers of the alerts that are new.
    pub async fn note_checks(
        &self,
        project: &str,
        branch: &str,
        checks: &[Check],
        now: Timestamp,
    ) -> Result<Vec<i64>, StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        let mut new = Vec::new();
        for check in checks {
            let Some(series_id) = check.series_id else { continue };
            let key = (branch, series_id, check.metric.as_str(), check.kind.id());
            match check.outcome {
                Outcome::Unknown => {}
                Outcome::Ok => holds_again(&mut transaction, key, now).await?,
                Outcome::Regression => {
                    if let Some(id) = open(&mut transaction, project, key, check, now).await? {
                        new.push(id);
                    }
                }
            }
        }
        transaction.commit().await?;
        Ok(new)
    }

    /// Alerts, newest first.
    pub async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<Alert>, StoreError> {
        let rows = sqlx::query(
            "SELECT alerts.*, reports.job_id, reports.preset_index
             FROM alerts JOIN projects ON projects.id = alerts.project_id LEFT JOIN reports ON reports.id = report_id
             WHERE (?1 IS NULL OR projects.name = ?1) AND (?2 IS NULL OR status = ?2) AND (?3 IS NULL OR branch = ?3)
               AND (?4 IS NULL OR alerts.id = ?4) AND (?5 IS NULL OR alerts.id < ?5)
               AND (?6 IS NULL OR alerts.report_id >= ?6)
             ORDER BY alerts.id DESC LIMIT +?7",
        )
        .bind(&filter.project)
        .bind(filter.status)
        .bind(&filter.branch)
        .bind(filter.id)
        .bind(filter.before)
        .bind(filter.since_report)
        .bind(filter.limit)
        .fetch_all(&self.readers)
        .await?;
        let mut alerts = Vec::with_capacity(rows.len());
        for row in rows {
            let filter = SeriesFilter {
                id: Some(row.try_get("series_id")?),
                ..SeriesFilter::default()
            };
            if let Some(series) = self.series(&filter).await?.pop() {
                alerts.push(alert(&row, series)?);
            }
        }
        Ok(alerts)
    }

    /// How many alerts are open.
    pub async fn n_open_alerts(&self) -> Result<i64, StoreError> {
        let n = sqlx::query_scalar("SELECT count(*) FROM alerts WHERE status = 'open'")
            .fetch_one(&self.readers)
            .await?;
        Ok(n)
    }

    /// Closes an open alert; whether there was one.
    pub async fn close_alert(
        &self,
        id: i64,
        status: AlertStatus,
        why: &str,
        who: Option<&str>,
        now: Timestamp,
    ) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "UPDATE alerts SET status = ?, closed_why = ?, closed_by = ?, closed_at = ? WHERE id = ? AND status = 'open'",
        )
        .bind(status)
        .bind(why)
        .bind(who)
        .bind(now)
        .bind(id)
        .execute(&mut *self.writer.acquire().await?)
        .await?;
        Ok(done.rows_affected() > 0)
    }

    /// Resolves the alerts of lines of a branch that were silent and have had a report since.
    pub async fn note_heard(&self, branch: &str, series_ids: &[i64], now: Timestamp) -> Result<(), StoreError> {
        let silent: bool = sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM alerts WHERE status = 'open' AND kind = 'no_data' AND branch = ?)",
        )
        .bind(branch)
        .fetch_one(&self.readers)
        .await?;
        if !silent {
            return Ok(());
        }
        sqlx::query(
            "UPDATE alerts SET status = 'resolved', closed_why = 'the check holds again', closed_at = ?3
             WHERE status = 'open' AND kind = 'no_data' AND branch = ?1
               AND series_id IN (SELECT value FROM json_each(?2))
               AND EXISTS (SELECT 1 FROM reports JOIN branches ON branches.id = branch_id
                           WHERE reports.series_id = alerts.series_id AND branches.name = ?1 AND complete
                             AND reports.id > alerts.last_good_report_id)",
        )
        .bind(branch)
        .bind(serde_json::to_string(series_ids)?)
        .bind(now)
        .execute(&mut *self.writer.acquire().await?)
        .await?;
        Ok(())
    }

    /// Opens an alert for every line with rules that has been silent for the nights that they allow, and resolves those that
    /// speak again. Gives the new alerts' numbers.
    pub async fn note_silence(&self, now: Timestamp) -> Result<Vec<i64>, StoreError> {
        let mut new = Vec::new();
        for ((project, branch), checks) in self.silence(now).await? {
            new.extend(self.note_checks(&project, &branch, &checks, now).await?);
        }
        Ok(new)
    }

    /// Checks of silence, by project and branch.
    async fn silence(&self, now: Timestamp) -> Result<BTreeMap<(String, String), Vec<Check>>, StoreError> {
        let last: Vec<LastReport> = sqlx::query_as(
            "SELECT line.series_id, line.branch, reports.id AS report_id, git_commit, reports.created_at, pull_request,
                    departed, CASE WHEN departed THEN (
                        SELECT count(DISTINCT created_at / 86400000) FROM reports AS each
                        WHERE each.series_id = line.series_id AND each.branch_id = line.branch_id AND complete) ELSE 0 END AS n_days
             FROM (SELECT line_rules.series_id, line_rules.branch, branches.id AS branch_id, parent_id IS NOT NULL AS departed
                   FROM line_rules JOIN series ON series.id = line_rules.series_id
                   JOIN branches ON branches.project_id = series.project_id AND branches.name = line_rules.branch) AS line
             JOIN reports ON reports.id = (SELECT max(id) FROM reports AS last WHERE last.series_id = line.series_id
                                           AND last.branch_id = line.branch_id AND complete)",
        )
        .fetch_all(&self.readers)
        .await?;
        let rules = self.line_rules(None).await?;
        let mut by_line: HashMap<_, _> = last
            .into_iter()
            .map(|last| ((last.series_id, last.branch.clone()), last))
            .collect();
        let mut lines = Vec::new();
        for rules in rules.into_iter() {
            let filter = SeriesFilter {
                id: Some(rules.series_id),
                ..SeriesFilter::default()
            };
            let last = by_line.remove(&(rules.series_id, rules.branch.clone()));
            let series = self.series(&filter).await?.pop();
            lines.extend(last.zip(series).map(|(last, series)| (rules, last, series)));
        }
        // A sequence that was dumped anew, a setting that was tried once, a new driver: lines end while the nightly goes on.
        let nightly = |rules: &LineRules, series: &Series| {
            let adapter = series.environment.adapter.name.clone();
            let line = (series.sequence_name.clone(), series.preset.clone(), adapter);
            (rules.project.clone(), rules.branch.clone(), line)
        };
        let mut newest = HashMap::new();
        for (rules, last, series) in &lines {
            let heard = newest.entry(nightly(rules, series)).or_insert(last.report_id);
            *heard = last.report_id.max(*heard);
        }
        let mut checks: BTreeMap<_, Vec<Check>> = BTreeMap::new();
        for (rules, last, series) in lines {
            let is_ruled = rules.rules.ask_of(&series.sequence_name, &series.preset);
            let Some(nights) = rules.rules.no_data_nights.filter(|_| is_ruled) else {
                continue;
            };
            let is_newest = newest.get(&nightly(&rules, &series)) == Some(&last.report_id);
            let is_awaited = is_newest && last.is_awaited();
            // Half a night of grace: a nightly that starts late is not silent.
            let allowed = Duration::from_secs(u64::from(nights) * 86_400 + 43_200);
            let silence = now.since(last.created_at);
            let is_silent = is_awaited && silence > allowed;
            checks.entry((rules.project, rules.branch)).or_default().push(Check {
                series_id: Some(last.series_id),
                sequence: series.sequence_name,
                recipe: series.preset,
                metric: String::new(),
                kind: Kind::NoData,
                outcome: if is_silent { Outcome::Regression } else { Outcome::Ok },
                detail: format!(
                    "no report for {} nights; the last one came {}",
                    silence.as_secs() / 86_400,
                    last.created_at
                ),
                finding: Finding {
                    last_good_report: Some(last.report_id),
                    last_good_commit: last.git_commit,
                    ..Finding::default()
                },
            });
        }
        Ok(checks)
    }
}

/// The last report of a line on a branch.
#[derive(FromRow)]
struct LastReport {
    series_id: i64,
    branch: String,
    report_id: i64,
    git_commit: Option<String>,
    created_at: Timestamp,
    pull_request: Option<String>,
    departed: bool,
    n_days: i64,
}

impl LastReport {
    /// Whether another should follow: pull requests and branches that left another end, unless those went on for long.
    fn is_awaited(&self) -> bool {
        self.pull_request.is_none() && (!self.departed || self.n_days >= MIN_DAYS)
    }
}

/// Resolves the alert of a check that is good.
async fn holds_again(
    connection: &mut sqlx::SqliteConnection,
    (branch, series_id, metric, kind): (&str, i64, &str, &str),
    now: Timestamp,
) -> Result<(), StoreError> {
    sqlx::query(
        "UPDATE alerts SET status = 'resolved', closed_why = 'the check holds again', closed_at = ?5
         WHERE status = 'open' AND branch = ?1 AND series_id = ?2 AND metric = ?3 AND kind = ?4",
    )
    .bind(branch)
    .bind(series_id)
    .bind(metric)
    .bind(kind)
    .bind(now)
    .execute(connection)
    .await?;
    Ok(())
}

/// Opens an alert, or adds to the one that is open already; its number if it is new.
async fn open(
    connection: &mut sqlx::SqliteConnection,
    project: &str,
    (branch, series_id, metric, kind): (&str, i64, &str, &str),
    check: &Check,
    now: Timestamp,
) -> Result<Option<i64>, StoreError> {
    let found = serde_json::to_string(&StoredFinding {
        detail: check.detail.clone(),
        finding: check.finding.clone(),
    })?;
    let first_bad = check.finding.first_bad_report.or(check.finding.last_good_report);
    // What was dismissed stays so while it is the same fault, and is no other that is open.
    let is_dismissed: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM alerts WHERE status = 'dismissed' AND branch = ? AND series_id = ?
                        AND metric = ? AND kind = ? AND report_id IS ?)",
    )
    .bind(branch)
    .bind(series_id)
    .bind(metric)
    .bind(kind)
    .bind(first_bad)
    .fetch_one(&mut *connection)
    .await?;
    if is_dismissed {
        holds_again(connection, (branch, series_id, metric, kind), now).await?;
        return Ok(None);
    }
    // Where it began is known better with each result.
    let known = sqlx::query(
        "UPDATE alerts SET finding = ?5, updated_at = ?6, report_id = ?7, last_good_report_id = ?8
         WHERE status = 'open' AND branch = ?1 AND series_id = ?2 AND metric = ?3 AND kind = ?4",
    )
    .bind(branch)
    .bind(series_id)
    .bind(metric)
    .bind(kind)
    .bind(&found)
    .bind(now)
    .bind(first_bad)
    .bind(check.finding.last_good_report)
    .execute(&mut *connection)
    .await?;
    if known.rows_affected() > 0 {
        return Ok(None);
    }
    let id = sqlx::query_scalar(
        "INSERT INTO alerts (project_id, branch, series_id, metric, kind, status, report_id, last_good_report_id,
                             finding, opened_at, updated_at)
         VALUES ((SELECT id FROM projects WHERE name = ?1), ?2, ?3, ?4, ?5, 'open', ?6, ?7, ?8, ?9, ?9) RETURNING id",
    )
    .bind(project)
    .bind(branch)
    .bind(series_id)
    .bind(metric)
    .bind(kind)
    .bind(first_bad)
    .bind(check.finding.last_good_report)
    .bind(&found)
    .bind(now)
    .fetch_one(&mut *connection)
    .await?;
    Ok(Some(id))
}
