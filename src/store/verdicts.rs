//! Rules as they were last sent, and what people approved.

use super::{AlertStatus, Store, StoreError, Timestamp, alerts};
use crate::verdict::{Approved, ChangeState, Kind, KnownChange, Rules};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sqlx::{Connection as _, FromRow, QueryBuilder, SqliteConnection};
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
    /// Keeps the rules that lines of a branch were run with, and closes the alerts of checks that they do not ask for.
    pub async fn put_rules(
        &self,
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
        for alert in unasked(&mut transaction, branch, lines, rules).await? {
            sqlx::query(
                "UPDATE alerts SET status = 'resolved', closed_why = 'its rule was removed', closed_at = ? WHERE id = ?",
            )
            .bind(now)
            .bind(alert)
            .execute(&mut *transaction)
            .await?;
        }
        sqlx::query(
            "DELETE FROM rule_sets WHERE NOT EXISTS (SELECT 1 FROM line_rules WHERE rule_set_id = rule_sets.id)",
        )
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(())
    }

    /// The rules of lines, on a branch or all: each with what its last verdict could not tell.
    pub async fn line_rules(&self, branch: Option<&str>) -> Result<Vec<LineRules>, StoreError> {
        let mut sql = QueryBuilder::new(
            "SELECT projects.name, series_id, branch, rule_set_id, unknown
             FROM line_rules JOIN series ON series.id = series_id JOIN projects ON projects.id = project_id",
        );
        if let Some(branch) = branch {
            sql.push(" WHERE branch = ").push_bind(branch);
        }
        sql.push(" ORDER BY projects.name, branch, series_id");
        let rows: Vec<(String, i64, String, i64, String)> = sql.build_query_as().fetch_all(&self.readers).await?;
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
    pub async fn rules(&self, series_id: i64, branch: &str) -> Result<Option<Rules>, StoreError> {
        let rules: Option<String> = sqlx::query_scalar(
            "SELECT rules FROM line_rules JOIN rule_sets ON rule_sets.id = rule_set_id WHERE series_id = ? AND branch = ?",
        )
        .bind(series_id)
        .bind(branch)
        .fetch_optional(&self.readers)
        .await?;
        Ok(rules.map(|rules| serde_json::from_str(&rules)).transpose()?)
    }

    /// Notes what someone said of a report, and resolves the alerts that it answers.
    pub async fn decide(
        &self,
        report_id: i64,
        verdict: Verdict,
        (who, why): (&str, &str),
        answered: &[i64],
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
        if decision.is_some() {
            sqlx::query(
                "UPDATE alerts SET status = 'resolved', closed_why = 'approved: ' || ?1, closed_by = ?2, closed_at = ?3
                 WHERE status = 'open' AND id IN (SELECT value FROM json_each(?4))",
            )
            .bind(why)
            .bind(who)
            .bind(now)
            .bind(serde_json::to_string(answered)?)
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
        // Who closed an alert by an approval did so at one moment with it.
        let changes: Vec<(AlertStatus, Option<i64>, i64, Option<f64>)> = sqlx::query_as(
            "SELECT status, (SELECT report_id FROM decisions
                             WHERE decisions.series_id = alerts.series_id AND decision = 'approved'
                               AND decided_at = closed_at AND closed_why LIKE 'approved: %'),
                    report_id, CASE json_type(finding, '$.finding.effect')
                        WHEN 'real' THEN json_extract(finding, '$.finding.effect')
                        WHEN 'integer' THEN CAST(json_extract(finding, '$.finding.effect') AS REAL) END
             FROM alerts
             WHERE series_id = ? AND metric = ? AND kind = 'change' AND branch = ? AND report_id IS NOT NULL",
        )
        .bind(series_id)
        .bind(metric)
        .bind(branch)
        .fetch_all(&self.readers)
        .await?;
        // An approval that was taken back closed nothing.
        let is_approved = |report: i64| rows.iter().any(|row| row.0 == report);
        let known = |(status, approval, report_id, effect): (AlertStatus, Option<i64>, i64, Option<f64>)| KnownChange {
            report_id,
            state: match status {
                AlertStatus::Open => ChangeState::Open,
                AlertStatus::Dismissed => ChangeState::Dismissed,
                AlertStatus::Resolved if approval.is_some_and(is_approved) => ChangeState::Approved,
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

/// Open alerts of these lines that the rules do not ask for.
async fn unasked(
    connection: &mut SqliteConnection,
    branch: &str,
    lines: &[Judged],
    rules: &Rules,
) -> Result<Vec<i64>, StoreError> {
    let series_ids: Vec<i64> = lines.iter().map(|line| line.series_id).collect();
    let open: Vec<(i64, String, String, String, String)> = sqlx::query_as(
        "SELECT alerts.id, coalesce(sequences.name, subjects.name), variants.preset, metric, alerts.kind
         FROM json_each(?2) AS line JOIN alerts ON alerts.series_id = line.value AND alerts.branch = ?1
         JOIN series ON series.id = alerts.series_id
         JOIN subjects ON subjects.id = subject_id LEFT JOIN sequences ON sequences.id = sequence_id
         JOIN variants ON variants.id = variant_id
         WHERE status = 'open'",
    )
    .bind(branch)
    .bind(serde_json::to_string(&series_ids)?)
    .fetch_all(connection)
    .await?;
    let is_unasked = |(_, sequence, recipe, metric, kind): &(i64, String, String, String, String)| {
        let asked = rules.checks(sequence, recipe, metric);
        match alerts::kind(kind) {
            Kind::Limit => asked.min.is_none() && asked.max.is_none(),
            Kind::Baseline => asked.baseline.is_none(),
            Kind::Change => asked.change.is_none(),
            Kind::NoData => rules.no_data_nights.is_none() || !rules.ask_of(sequence, recipe),
        }
    };
    Ok(open.into_iter().filter(is_unasked).map(|alert| alert.0).collect())
}
