//! Projects, their branches and commits.

use super::{Store, StoreError, Timestamp};
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::FromRow;

/// A branch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema, FromRow)]
pub struct Branch {
    /// Name.
    pub name: String,
    /// The branch that it left.
    pub parent: Option<String>,
    /// The last commit they share.
    pub departed_commit: Option<String>,
    /// When its first report came.
    pub created_at: Timestamp,
}

impl Store {
    /// Names of all projects.
    pub async fn projects(&self) -> Result<Vec<String>, StoreError> {
        Ok(sqlx::query_scalar("SELECT name FROM projects ORDER BY name")
            .fetch_all(&self.readers)
            .await?)
    }

    /// A project's branches, by name.
    pub async fn branches(&self, project: &str) -> Result<Vec<Branch>, StoreError> {
        let found = sqlx::query_as(
            "SELECT branches.name, parents.name AS parent, branches.departed_commit, branches.created_at
             FROM branches JOIN projects ON projects.id = branches.project_id
             LEFT JOIN branches AS parents ON parents.id = branches.parent_id
             WHERE projects.name = ? ORDER BY branches.name",
        )
        .bind(project)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// The first report of a commit, in a project or any.
    pub async fn first_report(&self, commit: &str, project: Option<&str>) -> Result<Option<i64>, StoreError> {
        let found = sqlx::query_scalar(
            "SELECT min(reports.id) FROM reports JOIN series ON series.id = series_id JOIN projects ON projects.id = project_id
             WHERE git_commit = ?1 AND complete AND (?2 IS NULL OR projects.name = ?2)",
        )
        .bind(commit)
        .bind(project)
        .fetch_one(&self.readers)
        .await?;
        Ok(found)
    }

    /// Whether a project, or any, has a branch of this name; the empty one, that of reports of none, is everywhere.
    pub async fn is_branch(&self, project: Option<&str>, name: &str) -> Result<bool, StoreError> {
        let found = sqlx::query_scalar(
            "SELECT ?2 = '' OR EXISTS (SELECT 1 FROM branches JOIN projects ON projects.id = project_id
                                       WHERE branches.name = ?2 AND (?1 IS NULL OR projects.name = ?1))",
        )
        .bind(project)
        .bind(name)
        .fetch_one(&self.readers)
        .await?;
        Ok(found)
    }
}
