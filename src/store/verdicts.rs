//! Rules as they were last sent, and what people approved.

use super::{AlertFilter, AlertStatus, Store, StoreError, Timestamp};
use crate::verdict::{Approved, ChangeState, Kind, KnownChange, Rules};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sqlx::{Connection as _, FromRow};

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

impl Store {
    /// Keeps the rules that a branch's run was sent with, and closes the alerts of checks that they no longer ask for.
    pub async fn put_rules(
        &self,
        project: &str,
        branch: &str,
        rules: &Rules,
        now: Timestamp,
    ) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO rule_sets (project_id, branch, rules, updated_at)
             VALUES ((SELECT id FROM projects WHERE name = ?), ?, ?, ?)
             ON CONFLICT (project_id, branch) DO UPDATE SET rules = excluded.rules, updated_at = excluded.updated_at",
        )
        .bind(project)
        .bind(branch)
        .bind(serde_json::to_string(rules)?)
        .bind(now)
        .execute(&mut *self.writer.acquire().await?)
        .await?;
        let filter = AlertFilter {
            project: Some(project.to_owned()),
            status: Some(AlertStatus::Open),
            branch: Some(branch.to_owned()),
            limit: 10_000,
            ..AlertFilter::default()
        };
        for alert in self.alerts(&filter).await? {
            let asked = rules.checks(&alert.series.sequence_name, &alert.series.preset, &alert.metric);
            let is_asked = match alert.kind {
                Kind::Limit => asked.min.is_some() || asked.max.is_some(),
                Kind::Baseline => asked.baseline.is_some(),
                Kind::Change => asked.change.is_some(),
                Kind::NoData => rules.no_data_nights.is_some(),
            };
            if !is_asked {
                self.close_alert(alert.id, AlertStatus::Resolved, "its rule was removed", None, now)
                    .await?;
            }
        }
        Ok(())
    }

    /// The rules that a branch's run was last sent with.
    pub async fn rules(&self, project: &str, branch: &str) -> Result<Option<Rules>, StoreError> {
        let rules: Option<String> = sqlx::query_scalar(
            "SELECT rules FROM rule_sets JOIN projects ON projects.id = project_id
             WHERE projects.name = ? AND branch = ?",
        )
        .bind(project)
        .bind(branch)
        .fetch_optional(&self.readers)
        .await?;
        Ok(rules.map(|rules| serde_json::from_str(&rules)).transpose()?)
    }

    /// Rules of every branch that has any: project, branch, rules.
    pub async fn rule_sets(&self) -> Result<Vec<(String, String, Rules)>, StoreError> {
        let rows: Vec<(String, String, String)> = sqlx::query_as(
            "SELECT projects.name, branch, rules FROM rule_sets JOIN projects ON projects.id = project_id
             ORDER BY projects.name, branch",
        )
        .fetch_all(&self.readers)
        .await?;
        rows.into_iter()
            .map(|(project, branch, rules)| Ok((project, branch, serde_json::from_str(&rules)?)))
            .collect()
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
