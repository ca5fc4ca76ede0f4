//! Sequences, jobs and reports in one SQLite file. The only module that names sqlx: one function a query, plain structs
//! in and out. Knows nothing of HTTP, pages, or how a report is made.
//!
//! SQLite allows one writer at a time, so there is exactly one writing connection and writers queue in this process
//! instead of failing with `SQLITE_BUSY`; readers have a pool of their own and, in WAL mode, never wait for the writer.
//! A report becomes visible whole or not at all: [`Store::finish`] writes every row of a job, and the job's `done`, in
//! one transaction. Results measured elsewhere go through [`Ingest`], which commits many at once.

mod alerts;
mod bench;
mod branches;
mod cache;
mod checks;
mod columns;
mod convert;
mod data_folder;
mod ingest;
mod jobs;
mod model;
mod projects;
mod queue;
mod reading;
mod sequences;
mod stress;
mod time;
mod tokens;
mod trend;
mod value;
mod verdicts;
mod webhooks;
mod writer;
mod writing;

pub use alerts::{Alert, AlertFilter, AlertStatus};
pub use bench::{BenchFilter, BenchRun};
pub use checks::{Check, Unchecked};
pub use data_folder::{DataFolder, FolderError};
pub use ingest::{Ingest, Keep, KeptAnswer};
pub use jobs::{Cancelled, Failure, FailureKind, Images, Job, JobFilter, JobSpec, NewJob, Outputs, Status};
pub use model::{
    DEFAULT_PROJECT, Departure, Environment, GPU_TIME, MetricSummary, NewReport, Provenance, Subject, System,
    SystemKind, condense, known_version,
};
pub use projects::Branch;
pub use queue::{Claim, MAX_ATTEMPTS};
pub use reading::{Report, ReportFilter, Series, SeriesFilter};
pub use sequences::{NewSequence, Sequence};
pub use stress::StressRun;
pub use time::Timestamp;
pub use tokens::{NewToken, Scope, Token, random_secret, token_hash};
pub use trend::{BranchPath, Point, TrendFilter, TrendPoint, downsample};
pub use verdicts::{Decision, Judged, LineRules, Verdict};
pub use webhooks::{Delivery, DeliveryStatus, Webhook};
pub use writer::State;

use self::{cache::Cache, trend::Described, writer::WriterPool};
use crate::run::report::FrameReport;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
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
    /// Reports of a job that has no sequence: a worker took a stress run for another job.
    #[error("job {0} has no sequence, so it can have no reports")]
    NoSequence(i64),
    /// Frames for a report that is not there.
    #[error("there is no report {0}")]
    NoReport(i64),
    /// Frames for a report that has ended.
    #[error("report {0} is complete: frames can no longer be added to it, nor can it be closed")]
    Closed(i64),
    /// An end to a report that nothing is in.
    #[error("report {0} has no frames yet; post some before it is closed")]
    NoFrames(i64),
    /// Two rows of one frame in one go.
    #[error("frame {0} is there twice")]
    RepeatedFrame(usize),
    /// A packed column is not as long as its layout says.
    #[error("the frames of report {0} are damaged")]
    Damaged(i64),
    /// The system gives no random numbers.
    #[error("no random numbers: {0}")]
    Random(String),
    /// More posts wait than the disk keeps up with.
    #[error("too many results are being posted at once")]
    Busy,
}

/// Connections to the database file.
#[derive(Clone)]
pub struct Store {
    writer: WriterPool,
    readers: SqlitePool,
    ingest: Ingest,
    known: Arc<Known>,
}

/// What was read before. Only a sequence's name can change under reports and jobs that have ended, so putting one forgets
/// them; which job, branch and commit a report is of never changes.
struct Known {
    reports: Cache<i64, Arc<Report>>,
    jobs: Cache<i64, Arc<Job>>,
    described: Cache<i64, Described>,
    /// Row id and hash by hash or name.
    sequences: Cache<String, Option<(i64, String)>>,
}

impl Known {
    /// A sequence was put.
    fn forget_names(&self) {
        self.reports.clear();
        self.jobs.clear();
        self.sequences.clear();
    }
}

/// As many as the longest page of a list; of the small rows that a chart wants, as many as five of its longest lines have.
const KNOWN_ROWS: usize = 1000;
const DESCRIBED_ROWS: usize = 20_000;

/// Enough for the pages that one dashboard asks for at once; more would only contend for the same disk.
const N_READERS: u32 = 4;

/// A file on this machine does not go away as a server does: asking each connection whether it still answers, before it is used,
/// would cost every statement one more turn of the connection's thread.
fn pool(max_connections: u32) -> SqlitePoolOptions {
    SqlitePoolOptions::new()
        .max_connections(max_connections)
        .test_before_acquire(false)
}

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
            // What a client was told is stored survives a power cut.
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(Duration::from_secs(10));
        let writer = pool(1).connect_with(options.clone()).await.map_err(open_error)?;
        sqlx::migrate!()
            .run(&writer)
            .await
            .map_err(|source| StoreError::Migrate {
                path: path.to_owned(),
                source,
            })?;
        convert::convert(&writer).await?;
        let readers = pool(N_READERS)
            .connect_with(options.read_only(true).create_if_missing(false))
            .await
            .map_err(open_error)?;
        let writer = WriterPool::new(writer);
        let ingest = Ingest::start(writer.clone());
        Ok(Self {
            writer,
            readers,
            ingest,
            known: Arc::new(Known {
                reports: Cache::new(KNOWN_ROWS),
                jobs: Cache::new(KNOWN_ROWS),
                described: Cache::new(DESCRIBED_ROWS),
                sequences: Cache::new(KNOWN_ROWS),
            }),
        })
    }

    /// Where results measured elsewhere are posted.
    pub fn ingest(&self) -> &Ingest {
        &self.ingest
    }

    /// What was read in one state is what anybody reads in it.
    pub fn state(&self) -> State {
        self.writer.state()
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
