//! Branches as reports tell of them, and where they left another.

use super::{Departure, Provenance, StoreError, writing::Writer};

impl Writer<'_> {
    /// The row of a report's branch, made at its first report. The first that names a branch known here as where it left
    /// settles that.
    pub(super) async fn branch(&mut self, project_id: i64, origin: &Provenance) -> Result<Option<i64>, StoreError> {
        let Some(name) = &origin.branch else { return Ok(None) };
        let key = (project_id, name.clone(), origin.from.is_some());
        if let Some(&id) = self.memory.branches.get(&key) {
            return Ok(Some(id));
        }
        let id = sqlx::query_scalar(
            "INSERT INTO branches (project_id, name, created_at) VALUES (?, ?, ?)
             ON CONFLICT (project_id, name) DO UPDATE SET name = name RETURNING id",
        )
        .bind(project_id)
        .bind(name)
        .bind(self.now)
        .fetch_one(&mut *self.connection)
        .await?;
        let is_settled = match &origin.from {
            None => true,
            Some(from) => self.depart(project_id, id, from, origin.parent.as_deref()).await?,
        };
        if is_settled {
            self.memory.branches.insert(key, id);
        }
        Ok(Some(id))
    }

    /// Notes where a branch left another, unless that is known; whether it is known now.
    async fn depart(
        &mut self,
        project_id: i64,
        id: i64,
        from: &Departure,
        parent: Option<&str>,
    ) -> Result<bool, StoreError> {
        // Whose parent was measured on the other branch left it there, unless the commit that is given was measured, too.
        let commit: Option<String> = sqlx::query_scalar(
            "SELECT coalesce((SELECT git_commit FROM reports JOIN branches ON branches.id = branch_id
                              WHERE git_commit IN (?3, ?4) AND project_id = ?1 AND name = ?2
                              ORDER BY git_commit IS ?4 DESC LIMIT 1), ?4)",
        )
        .bind(project_id)
        .bind(&from.branch)
        .bind(parent)
        .bind(&from.commit)
        .fetch_one(&mut *self.connection)
        .await?;
        // They part where the commit was measured first, not where it was measured again; without one that is known here,
        // before this branch's own first report.
        sqlx::query(
            "UPDATE branches SET parent_id = parent.id, departed_commit = ?4, departed_report_id = coalesce(
                 (SELECT max(id) FROM reports WHERE git_commit = ?4 AND branch_id = parent.id AND id < coalesce(
                      (SELECT min(other.id) FROM reports AS other
                       WHERE other.branch_id = parent.id AND other.git_commit IS NOT ?4
                         AND other.id > (SELECT min(id) FROM reports WHERE git_commit = ?4 AND branch_id = parent.id)),
                      9223372036854775807)),
                 (SELECT min(id) - 1 FROM reports WHERE branch_id = ?2), (SELECT max(id) FROM reports), 0)
             FROM (SELECT id FROM branches WHERE project_id = ?1 AND name = ?3) AS parent
             WHERE branches.id = ?2 AND branches.parent_id IS NULL AND parent.id <> ?2",
        )
        .bind(project_id)
        .bind(id)
        .bind(&from.branch)
        .bind(&commit)
        .execute(&mut *self.connection)
        .await?;
        let is_known = sqlx::query_scalar("SELECT parent_id IS NOT NULL FROM branches WHERE id = ?")
            .bind(id)
            .fetch_one(&mut *self.connection)
            .await?;
        Ok(is_known)
    }
}
