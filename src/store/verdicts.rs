//! Rules as they were last sent, and what people approved.

use super::{AlertStatus, Store, StoreError, Timestamp, alerts};
use crate::verdict::{Approved, ChangeState, Kind, KnownChange, Rules};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sqlx::{Connection as _, FromRow, SqliteConnection};
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};

/// What someone said of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, sqlx::Type)]
#[serde(rename_all = "snake_case")]
#[sqlx(rename_all = "snake_case")]
pub enum Verdict {
    /// It belongs to the baseline.
    Approved,
    /// It does not.
    Rejected,
}

/// A decision about a report.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema, FromRow)]
pub struct Decision {
    /// Number, rising with time.
    pub id: i64,
    /// The report.
    pub report_id: i64,
    /// Its series.
    pub series_id: i64,
    /// What was decided.
    pub decision: Verdict,
    /// By whom.
    pub who: String,
    /// Why.
    pub why: String,
    /// When.
    pub decided_at: Timestamp,
}

/// An approved report, its branch and commit, its value and the metric's version.
type ApprovedRow = (i64, Option<String>, Option<String>, Option<f64>, Option<i64>);

/// A line that was judged.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The line.
    pub series_id: i64,
    /// What could not be told: why, by metric.
    pub unknown: BTreeMap<String, String>,
}

/// The rules of a line on a branch.
#[derive(Clone, Debug)]
pub struct LineRules {
    /// Project.
    pub project: String,
    /// The line.
    pub series_id: i64,
    /// Branch; empty for none.
    pub branch: String,
    /// What its last run was sent with.
    pub rules: Arc<Rules>,
    /// What its last verdict could not tell: why, by metric.
    pub unknown: BTreeMap<String, String>,
}

impl Store {
    /// Keeps the rules that lines of a branch were run with, in place of those that they had, whichever lines those were of:
    /// a file that changed is the same file. Closes the alerts of checks that are no longer asked for.
    pub async fn put_rules(
        &self,
        project: &str,
        branch: &str,
        lines: &[Judged],
        rules: &Rules,
        now: Timestamp,
    ) -> Result<(), StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        let set: i64 = sqlx::query_scalar(
            "INSERT INTO rule_sets (rules) VALUES (?) ON CONFLICT (rules) DO UPDATE SET rules = rules RETURNING id",
        )
        .bind(serde_json::to_string(rules)?)
        .fetch_one(&mut *transaction)
        .await?;
        let series_ids: Vec<i64> = lines.iter().map(|line| line.series_id).collect();
        let replaced = sqlx::query(
            "UPDATE line_rules SET rule_set_id = ?1
             WHERE branch = ?2 AND rule_set_id IN (
                   SELECT rule_set_id FROM line_rules
                   WHERE branch = ?2 AND rule_set_id <> ?1 AND series_id IN (SELECT value FROM json_each(?3)))
               AND series_id IN (SELECT series.id FROM series JOIN projects ON projects.id = project_id WHERE name = ?4)",
        )
        .bind(set)
        .bind(branch)
        .bind(serde_json::to_string(&series_ids)?)
        .bind(project)
        .execute(&mut *transaction)
        .await?;
        for line in lines {
            sqlx::query(
                "INSERT INTO line_rules (series_id, branch, rule_set_id, unknown) VALUES (?, ?, ?, ?)
                 ON CONFLICT (series_id, branch) DO UPDATE SET rule_set_id = excluded.rule_set_id, unknown = excluded.unknown",
            )
            .bind(line.series_id)
            .bind(branch)
            .bind(set)
            .bind(serde_json::to_string(&line.unknown)?)
            .execute(&mut *transaction)
            .await?;
        }
        let unasked = match replaced.rows_affected() {
            0 => Vec::new(),
            _ => unasked(&mut transaction, branch, set, rules).await?,
        };
        for alert in unasked {
            sqlx::query(
                "UPDATE alerts SET status = 'resolved', closed_why = 'its rule was removed', closed_at = ? WHERE id = ?",
            )
            .bind(now)
            .bind(alert)
            .execute(&mut *transaction)
            .await?;
        }
        if replaced.rows_affected() > 0 {
            sqlx::query("DELETE FROM rule_sets WHERE id NOT IN (SELECT rule_set_id FROM line_rules)")
                .execute(&mut *transaction)
                .await?;
        }
        transaction.commit().await?;
        Ok(())
    }

    /// The rules of lines, of one or all: each with what its last verdict could not tell.
    pub async fn line_rules(&self, series_id: Option<i64>, branch: Option<&str>) -> Result<Vec<LineRules>, StoreError> {
        let rows: Vec<(String, i64, String, i64, String)> = sqlx::query_as(
            "SELECT projects.name, series_id, branch, rule_set_id, unknown
             FROM line_rules JOIN series ON series.id = series_id JOIN projects ON projects.id = project_id
             WHERE (?1 IS NULL OR series_id = ?1) AND (?2 IS NULL OR branch = ?2) ORDER BY projects.name, branch, series_id",
        )
        .bind(series_id)
        .bind(branch)
        .fetch_all(&self.readers)
        .await?;
        let wanted: BTreeSet<i64> = rows.iter().map(|row| row.3).collect();
        let sets: Vec<(i64, String)> =
            sqlx::query_as("SELECT id, rules FROM rule_sets WHERE id IN (SELECT value FROM json_each(?))")
                .bind(serde_json::to_string(&wanted)?)
                .fetch_all(&self.readers)
                .await?;
        let sets: HashMap<i64, Arc<Rules>> = sets
            .into_iter()
            .map(|(id, rules)| Ok((id, Arc::new(serde_json::from_str(&rules)?))))
            .collect::<Result<_, StoreError>>()?;
        let mut lines = Vec::with_capacity(rows.len());
        for (project, series_id, branch, set, unknown) in rows {
            // Between the two statements a set may have been replaced.
            let Some(rules) = sets.get(&set) else { continue };
            lines.push(LineRules {
                project,
                series_id,
                branch,
                rules: Arc::clone(rules),
                unknown: serde_json::from_str(&unknown)?,
            });
        }
        Ok(lines)
    }

    /// The rules of one line on a branch.
    pub async fn rules(&self, series_id: i64, branch: &str) -> Result<Option<Arc<Rules>>, StoreError> {
        let found = self.line_rules(Some(series_id), Some(branch)).await?;
        Ok(found.into_iter().next().map(|line| line.rules))
    }

    /// Notes what someone said of a report, and resolves the alerts of its branch that an approval answers.
    pub async fn decide(
        &self,
        report_id: i64,
        verdict: Verdict,
        who: &str,
        why: &str,
        now: Timestamp,
    ) -> Result<Option<Decision>, StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        let decision: Option<Decision> = sqlx::query_as(
            "INSERT INTO decisions (report_id, series_id, decision, who, why, decided_at)
             SELECT id, series_id, ?2, ?3, ?4, ?5 FROM reports WHERE id = ?1 AND complete RETURNING *",
        )
        .bind(report_id)
        .bind(verdict)
        .bind(who)
        .bind(why)
        .bind(now)
        .fetch_optional(&mut *transaction)
        .await?;
        if let (Some(decision), Verdict::Approved) = (&decision, verdict) {
            sqlx::query(
                "UPDATE alerts SET status = 'resolved', closed_why = 'approved: ' || ?1, closed_by = ?2, closed_at = ?3
                 WHERE status = 'open' AND series_id = ?4 AND kind IN ('baseline', 'change')
                   -- Verdicts put a commit where it was measured first.
                   AND report_id <= (SELECT min(first.id) FROM reports JOIN reports AS first
                                     ON first.series_id = reports.series_id AND first.branch_id IS reports.branch_id
                                        AND first.complete AND (first.id = reports.id OR first.git_commit = reports.git_commit)
                                     WHERE reports.id = ?5)
                   AND branch = coalesce((SELECT name FROM branches JOIN reports ON branch_id = branches.id
                                          WHERE reports.id = ?5), '')",
            )
            .bind(why)
            .bind(who)
            .bind(now)
            .bind(decision.series_id)
            .bind(report_id)
            .execute(&mut *transaction)
            .await?;
        }
        transaction.commit().await?;
        Ok(decision)
    }

    /// Decisions about a series or a report, newest first.
    pub async fn decisions(
        &self,
        series_id: Option<i64>,
        report_id: Option<i64>,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Decision>, StoreError> {
        let found = sqlx::query_as(
            "SELECT * FROM decisions WHERE (?1 IS NULL OR series_id = ?1) AND (?2 IS NULL OR report_id = ?2)
               AND (?3 IS NULL OR id < ?3) ORDER BY id DESC LIMIT +?4",
        )
        .bind(series_id)
        .bind(report_id)
        .bind(before)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// The approved results of a line's metric, a report's last decision counting, and what became of a branch's changes.
    pub async fn approved(
        &self,
        series_id: i64,
        metric: &str,
        version: u32,
        branch: &str,
    ) -> Result<Approved, StoreError> {
        let rows: Vec<ApprovedRow> = sqlx::query_as(
            "SELECT last.report_id, branches.name, git_commit, points.value, points.version
             FROM (SELECT report_id, decision, max(id) FROM decisions WHERE series_id = ?1 GROUP BY report_id) AS last
             JOIN reports ON reports.id = last.report_id LEFT JOIN branches ON branches.id = reports.branch_id
             LEFT JOIN points ON points.series_id = ?1 AND points.report_id = last.report_id
                  AND points.metric_id = (SELECT id FROM metrics WHERE name = ?2)
             WHERE last.decision = 'approved'",
        )
        .bind(series_id)
        .bind(metric)
        .fetch_all(&self.readers)
        .await?;
        let elsewhere = match rows.is_empty() {
            false => false,
            true => self.is_approved_elsewhere(series_id).await?,
        };
        let changes: Vec<(AlertStatus, bool, i64, Option<f64>)> = sqlx::query_as(
            "SELECT status, closed_why LIKE 'approved: %' IS TRUE, report_id, CASE json_type(finding, '$.finding.effect')
                        WHEN 'real' THEN json_extract(finding, '$.finding.effect')
                        WHEN 'integer' THEN CAST(json_extract(finding, '$.finding.effect') AS REAL) END
             FROM alerts
             WHERE (status IN ('open', 'dismissed') OR closed_why LIKE 'approved: %' OR closed_why = 'the check holds again')
               AND series_id = ? AND metric = ? AND kind = 'change' AND branch = ? AND report_id IS NOT NULL",
        )
        .bind(series_id)
        .bind(metric)
        .bind(branch)
        .fetch_all(&self.readers)
        .await?;
        // An approval that was taken back closed nothing.
        let of_branch = |row: &&ApprovedRow| row.1.as_deref().unwrap_or_default() == branch;
        let is_approved = |first_bad: i64| rows.iter().filter(of_branch).any(|row| row.0 >= first_bad);
        let known = |(status, by_approval, report_id, effect)| KnownChange {
            report_id,
            state: match status {
                AlertStatus::Open => ChangeState::Open,
                AlertStatus::Dismissed => ChangeState::Dismissed,
                AlertStatus::Resolved if by_approval && is_approved(report_id) => ChangeState::Approved,
                AlertStatus::Resolved => ChangeState::Closed,
            },
            effect,
        };
        Ok(Approved {
            changes: changes.into_iter().map(known).collect(),
            report_ids: rows.iter().map(|row| row.0).collect(),
            commits: rows.iter().filter_map(|row| row.2.clone()).collect(),
            values: rows
                .iter()
                .filter(|row| row.4 == Some(i64::from(version)))
                .map(|row| row.3.unwrap_or(f64::NAN))
                .collect(),
            elsewhere,
        })
    }

    async fn is_approved_elsewhere(&self, series_id: i64) -> Result<bool, StoreError> {
        let found: Option<i64> = sqlx::query_scalar(
            "SELECT 1 FROM series AS this JOIN series AS other
                  ON other.project_id = this.project_id AND other.subject_id = this.subject_id
                     AND other.variant_id = this.variant_id AND other.id <> this.id
             JOIN decisions ON decisions.series_id = other.id AND decision = 'approved'
             WHERE this.id = ? LIMIT 1",
        )
        .bind(series_id)
        .fetch_optional(&self.readers)
        .await?;
        Ok(found.is_some())
    }
}

/// Open alerts of lines with these rules that the rules do not ask for.
async fn unasked(
    connection: &mut SqliteConnection,
    branch: &str,
    set: i64,
    rules: &Rules,
) -> Result<Vec<i64>, StoreError> {
    let open: Vec<(i64, String, String, String, String)> = sqlx::query_as(
        "SELECT alerts.id, coalesce(sequences.name, subjects.name), variants.preset, metric, alerts.kind
         FROM alerts JOIN line_rules ON line_rules.series_id = alerts.series_id AND line_rules.branch = alerts.branch
         JOIN series ON series.id = alerts.series_id
         JOIN subjects ON subjects.id = subject_id LEFT JOIN sequences ON sequences.id = sequence_id
         JOIN variants ON variants.id = variant_id
         WHERE status = 'open' AND alerts.branch = ? AND rule_set_id = ?",
    )
    .bind(branch)
    .bind(set)
    .fetch_all(connection)
    .await?;
    let is_unasked = |(_, sequence, recipe, metric, kind): &(i64, String, String, String, String)| {
        let asked = rules.checks(sequence, recipe, metric);
        match alerts::kind(kind) {
            Kind::Limit => asked.min.is_none() && asked.max.is_none(),
            Kind::Baseline => asked.baseline.is_none(),
            Kind::Change => asked.change.is_none(),
            Kind::NoData => rules.no_data_nights.is_none(),
        }
    };
    Ok(open.into_iter().filter(is_unasked).map(|alert| alert.0).collect())
}
