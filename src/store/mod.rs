//! Sequences, jobs and reports in one SQLite file. The only module that names sqlx: one function a query, plain structs
//! in and out. Knows nothing of HTTP, pages, or how a report is made.
//!
//! SQLite allows one writer at a time, so there is exactly one writing connection and writers queue in this process
//! instead of failing with `SQLITE_BUSY`; readers have a pool of their own and, in WAL mode, never wait for the writer.
//! A report becomes visible whole or not at all: [`Store::finish`] writes every row of a job, and the job's `done`, in
//! one transaction.

mod data_folder;
mod jobs;
mod queue;
mod reading;
mod reports;
mod sequences;
mod time;
mod value;

pub use data_folder::{DataFolder, FolderError};
pub use jobs::{Cancelled, Failure, FailureKind, Images, Job, JobFilter, JobSpec, NewJob, Status};
pub use queue::{Claim, MAX_ATTEMPTS};
pub use reading::{GPU_TIME, Point, Report, ReportFilter, Series, SeriesFilter};
pub use sequences::{NewSequence, Sequence};
pub use time::Timestamp;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous};
use std::{
    path::{Path, PathBuf},
    time::Duration,
};

/// Why the store could not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file cannot be opened, or is not a database.
    #[error("cannot open the database {}: {source}", path.display())]
    Open {
        /// The database file.
        path: PathBuf,
        /// What SQLite said.
        source: sqlx::Error,
    },
    /// The file was written by a newer version, or a migration failed.
    #[error("cannot bring the database {} up to date: {source}", path.display())]
    Migrate {
        /// The database file.
        path: PathBuf,
        /// What the migrator said.
        source: sqlx::migrate::MigrateError,
    },
    /// A query failed: a full disk, a damaged file.
    #[error("database: {0}")]
    Query(#[from] sqlx::Error),
    /// A JSON column does not parse: written by another version.
    #[error("stored JSON does not parse: {0}")]
    Json(#[from] serde_json::Error),
    /// The job was cancelled, or taken over after its lease ran out; nothing was written.
    #[error("job {0} is no longer this worker's")]
    ClaimLost(i64),
}

/// Connections to the database file.
#[derive(Clone)]
pub struct Store {
    writer: SqlitePool,
    readers: SqlitePool,
}

/// Enough for the pages that one dashboard asks for at once; more would only contend for the same disk.
const N_READERS: u32 = 4;

impl Store {
    /// Opens the file at `path`, creating it and bringing its tables up to date where needed.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let open_error = |source| StoreError::Open {
            path: path.to_owned(),
            source,
        };
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .foreign_keys(true)
            .journal_mode(SqliteJournalMode::Wal)
            // With WAL a power cut can then lose the last transactions, never damage the file: a lost report's job is
            // running again and is repeated. `FULL` would sync at every progress mark.
            .synchronous(SqliteSynchronous::Normal)
            .busy_timeout(Duration::from_secs(10));
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .connect_with(options.clone())
            .await
            .map_err(open_error)?;
        sqlx::migrate!()
            .run(&writer)
            .await
            .map_err(|source| StoreError::Migrate {
                path: path.to_owned(),
                source,
            })?;
        let readers = SqlitePoolOptions::new()
            .max_connections(N_READERS)
            .connect_with(options.read_only(true).create_if_missing(false))
            .await
            .map_err(open_error)?;
        Ok(Self { writer, readers })
    }

    /// Whether the database answers.
    pub async fn ping(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT 1").execute(&self.readers).await?;
        Ok(())
    }

    /// Waits for running queries and closes the file, so that no `-wal` file is left beside it.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}
