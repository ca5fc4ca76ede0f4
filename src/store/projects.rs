//! Projects and their branches.

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
}
