//! Group commit: results that many clients post at once are written by one task, as many in a transaction as wait. A
//! commit then costs one sync of the disk for all of them, and nobody is answered before that sync: what a client was told
//! is stored survives a power cut.

use super::{
    FrameReport, MetricSummary, NewReport, Store, StoreError, Timestamp, condense, model,
    reading::read_frames,
    writer::WriterPool,
    writing::{Memory, Place, Writer},
};
use crate::run::report::TimeSummary;
use sqlx::{Connection as _, QueryBuilder, Row as _, SqliteConnection};
use std::{
    collections::{BTreeMap, HashSet},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::SeqCst},
    },
};
use tokio::{
    sync::{mpsc, oneshot},
    time::{Duration, Instant, sleep_until},
};

/// How many posts may wait; beyond, the service is busy and says so.
const MAX_WAITING: usize = 2048;
/// How many posts one transaction takes; readers see nothing of them before it ends.
const MAX_BATCH: usize = 256;
/// How long after a transaction the next begins where they gather posts.
const DISTANCE: Duration = Duration::from_millis(40);

/// An answer kept for a client that asks again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptAnswer {
    /// SHA-256 of what was asked.
    pub fingerprint: [u8; 32],
    /// HTTP status.
    pub status: u16,
    /// Headers worth repeating.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: Vec<u8>,
}

/// The answer to a post, by the numbers of its reports.
type Answer = dyn Fn(&[i64]) -> KeptAnswer + Send + Sync;

/// An answer to keep with the results that it tells of, in their transaction.
pub struct Keep {
    /// Whose key it is.
    pub token_id: i64,
    /// The client's key.
    pub key: String,
    /// What to keep.
    pub answer: Box<Answer>,
}

#[derive(Debug)]
enum Work {
    Reports(Vec<NewReport>),
    Frames(i64, Vec<FrameReport>),
    Close(i64, BTreeMap<String, u32>),
    Keep {
        token_id: i64,
        key: String,
        answer: KeptAnswer,
    },
}

struct Post {
    work: Work,
    keep: Option<Arc<Keep>>,
    reply: oneshot::Sender<Result<Vec<i64>, StoreError>>,
}

impl Post {
    /// Kept for a client whose results wait for this alone.
    fn is_answer(&self) -> bool {
        matches!(self.work, Work::Keep { .. })
    }
}

/// Where results are posted.
#[derive(Clone)]
pub struct Ingest {
    posts: mpsc::Sender<Post>,
    stale: Arc<AtomicBool>,
    gathers: Arc<AtomicBool>,
    keep: Option<Arc<Keep>>,
}

impl Ingest {
    pub(super) fn start(writer: WriterPool) -> Self {
        let (posts, waiting) = mpsc::channel(MAX_WAITING);
        let (stale, gathers) = <(Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        tokio::spawn(run(writer, waiting, Arc::clone(&stale), Arc::clone(&gathers)));
        Self {
            posts,
            stale,
            gathers,
            keep: None,
        }
    }

    /// The same, for one post whose answer is kept.
    pub fn keeping(&self, keep: Option<Keep>) -> Self {
        Self {
            keep: keep.map(Arc::new),
            ..self.clone()
        }
    }

    /// Someone else wrote reports.
    pub(super) fn forget(&self) {
        self.stale.store(true, SeqCst);
    }

    /// Whether commits keep a distance, so that each has more posts: for the time of a job, which wants the cores.
    pub fn gather(&self, gathers: bool) {
        self.gathers.store(gathers, SeqCst);
    }

    /// Stores a report; its number.
    pub async fn report(&self, report: NewReport) -> Result<i64, StoreError> {
        Ok(self.reports(vec![report]).await?.remove(0))
    }

    /// Stores reports, all or none; their numbers.
    pub async fn reports(&self, reports: Vec<NewReport>) -> Result<Vec<i64>, StoreError> {
        self.post(Work::Reports(reports)).await
    }

    /// Adds frames to a report that is not complete.
    pub async fn frames(&self, report_id: i64, frames: Vec<FrameReport>) -> Result<(), StoreError> {
        self.post(Work::Frames(report_id, frames)).await.map(drop)
    }

    /// Summarises a report's frames and makes it complete. `versions` are of metrics that are not known here.
    pub async fn close(&self, report_id: i64, versions: BTreeMap<String, u32>) -> Result<(), StoreError> {
        self.post(Work::Close(report_id, versions)).await.map(drop)
    }

    /// Keeps an answer under a client's key.
    pub async fn keep(&self, token_id: i64, key: String, answer: KeptAnswer) -> Result<(), StoreError> {
        let (post, kept) = self.ready(Work::Keep { token_id, key, answer });
        // What it tells of is done, so that it must not be refused.
        self.posts.send(post).await.map_err(|_| StoreError::Busy)?;
        kept.await.map_err(|_| StoreError::Busy)?.map(drop)
    }

    /// How many posts wait.
    pub fn n_waiting(&self) -> usize {
        MAX_WAITING - self.posts.capacity()
    }

    async fn post(&self, work: Work) -> Result<Vec<i64>, StoreError> {
        let (post, written) = self.ready(work);
        self.posts.try_send(post).map_err(|_| StoreError::Busy)?;
        written.await.map_err(|_| StoreError::Busy)?
    }

    fn ready(&self, work: Work) -> (Post, oneshot::Receiver<Result<Vec<i64>, StoreError>>) {
        let (reply, written) = oneshot::channel();
        let keep = self.keep.clone();
        (Post { work, keep, reply }, written)
    }
}

async fn run(writer: WriterPool, mut waiting: mpsc::Receiver<Post>, stale: Arc<AtomicBool>, gathers: Arc<AtomicBool>) {
    let mut desk = Desk::default();
    let mut batch = Vec::with_capacity(MAX_BATCH);
    let mut ended = None;
    while waiting.recv_many(&mut batch, MAX_BATCH).await > 0 {
        let may_wait = gathers.load(SeqCst) && batch.len() < MAX_BATCH && !batch.iter().all(Post::is_answer);
        if let Some(ended) = ended.filter(|_| may_wait) {
            sleep_until(ended + DISTANCE).await;
            while batch.len() < MAX_BATCH
                && let Ok(post) = waiting.try_recv()
            {
                batch.push(post);
            }
        }
        match desk.write(&writer, &batch, &stale).await {
            Ok(results) => {
                for (post, result) in batch.drain(..).zip(results) {
                    let _ = post.reply.send(result);
                }
            }
            // One post spoils a transaction for all: each gets its own.
            Err(_) => {
                for post in batch.drain(..) {
                    let result = desk.write(&writer, std::slice::from_ref(&post), &stale).await;
                    let _ = post.reply.send(result.and_then(|mut results| results.remove(0)));
                }
            }
        }
        ended = Some(Instant::now());
    }
}

/// What the task remembers between transactions.
#[derive(Default)]
struct Desk {
    memory: Memory,
    /// Reports that are known to take frames.
    open: HashSet<i64>,
}

impl Desk {
    /// One transaction. The outer result is the transaction's; inner ones refuse a post without harm to the others.
    async fn write(
        &mut self,
        writer: &WriterPool,
        batch: &[Post],
        stale: &AtomicBool,
    ) -> Result<Vec<Result<Vec<i64>, StoreError>>, StoreError> {
        let mut connection = writer.acquire_for_posts().await?;
        if stale.swap(false, SeqCst) {
            *self = Self::default();
        }
        let written = self.transaction(writer, &mut connection, batch).await;
        if written.is_err() {
            *self = Self::default();
        }
        written
    }

    async fn transaction(
        &mut self,
        writer: &WriterPool,
        connection: &mut SqliteConnection,
        batch: &[Post],
    ) -> Result<Vec<Result<Vec<i64>, StoreError>>, StoreError> {
        let mut transaction = connection.begin().await?;
        let now = Timestamp::now();
        let mut results = Vec::with_capacity(batch.len());
        for post in batch {
            let result = match self.one(&mut transaction, &post.work, now).await {
                Err(error @ (StoreError::NoReport(_) | StoreError::Closed(_) | StoreError::NoFrames(_))) => Err(error),
                other => Ok(other?),
            };
            if let (Some(it), Ok(ids)) = (&post.keep, &result) {
                keep(&mut transaction, it.token_id, &it.key, &(it.answer)(ids), now).await?;
            }
            results.push(result);
        }
        let _turn = writer.posts();
        transaction.commit().await?;
        Ok(results)
    }

    fn writer<'a>(&'a mut self, connection: &'a mut SqliteConnection, now: Timestamp) -> Writer<'a> {
        Writer {
            connection,
            memory: &mut self.memory,
            now,
        }
    }

    async fn one(
        &mut self,
        connection: &mut SqliteConnection,
        work: &Work,
        now: Timestamp,
    ) -> Result<Vec<i64>, StoreError> {
        match work {
            Work::Reports(reports) => {
                let mut ids = Vec::with_capacity(reports.len());
                for report in reports {
                    let id = self.writer(connection, now).report(report).await?;
                    if !report.complete {
                        self.open.insert(id);
                    }
                    ids.push(id);
                }
                Ok(ids)
            }
            Work::Frames(report_id, frames) => {
                if !self.open.contains(report_id) {
                    must_be_open(connection, *report_id).await?;
                    self.open.insert(*report_id);
                }
                self.writer(connection, now).frames(*report_id, frames).await?;
                Ok(vec![*report_id])
            }
            Work::Close(report_id, versions) => {
                must_be_open(connection, *report_id).await?;
                self.close(connection, *report_id, versions, now).await?;
                self.open.remove(report_id);
                Ok(vec![*report_id])
            }
            Work::Keep { token_id, key, answer } => {
                keep(connection, *token_id, key, answer, now).await?;
                Ok(Vec::new())
            }
        }
    }

    async fn close(
        &mut self,
        connection: &mut SqliteConnection,
        report_id: i64,
        versions: &BTreeMap<String, u32>,
        now: Timestamp,
    ) -> Result<(), StoreError> {
        let frames = read_frames(connection, report_id).await?;
        if frames.is_empty() {
            return Err(StoreError::NoFrames(report_id));
        }
        let (metrics, times_ms): (BTreeMap<String, MetricSummary>, BTreeMap<String, TimeSummary>) =
            condense(&frames, versions);
        let gpu_time_ms = model::gpu_time_ms(&metrics, &times_ms);
        let row = sqlx::query(
            "UPDATE reports SET complete = 1, metrics = ?, times_ms = ?, gpu_time_ms = ? WHERE id = ?
             RETURNING series_id, branch_id",
        )
        .bind(serde_json::to_string(&metrics)?)
        .bind(serde_json::to_string(&times_ms)?)
        .bind(gpu_time_ms)
        .bind(report_id)
        .fetch_one(&mut *connection)
        .await?;
        let place = Place {
            series_id: row.try_get("series_id")?,
            report_id,
            branch_id: row.try_get("branch_id")?,
            late: true,
        };
        self.writer(connection, now)
            .points(QueryBuilder::new(""), place, model::points(&metrics, gpu_time_ms))
            .await
    }
}

async fn must_be_open(connection: &mut SqliteConnection, report_id: i64) -> Result<(), StoreError> {
    let complete: Option<bool> = sqlx::query_scalar("SELECT complete FROM reports WHERE id = ?")
        .bind(report_id)
        .fetch_optional(connection)
        .await?;
    match complete {
        None => Err(StoreError::NoReport(report_id)),
        Some(true) => Err(StoreError::Closed(report_id)),
        Some(false) => Ok(()),
    }
}

async fn keep(
    connection: &mut SqliteConnection,
    token_id: i64,
    key: &str,
    answer: &KeptAnswer,
    now: Timestamp,
) -> Result<(), StoreError> {
    sqlx::query(
        "INSERT INTO idempotency_keys (token_id, key, fingerprint, status, headers, body, created_at)
         VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (token_id, key) DO UPDATE
         SET status = excluded.status, headers = excluded.headers, body = excluded.body",
    )
    .bind(token_id)
    .bind(key)
    .bind(answer.fingerprint.as_slice())
    .bind(answer.status)
    .bind(serde_json::to_string(&answer.headers)?)
    .bind(answer.body.as_slice())
    .bind(now)
    .execute(connection)
    .await?;
    Ok(())
}

impl Store {
    /// The answer kept under a client's key.
    pub async fn kept_answer(&self, token_id: i64, key: &str) -> Result<Option<KeptAnswer>, StoreError> {
        let row = sqlx::query(
            "SELECT fingerprint, status, headers, body FROM idempotency_keys WHERE token_id = ? AND key = ?",
        )
        .bind(token_id)
        .bind(key)
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let fingerprint: Vec<u8> = row.try_get("fingerprint")?;
        Ok(Some(KeptAnswer {
            fingerprint: fingerprint.try_into().unwrap_or([0; 32]),
            status: row.try_get("status")?,
            headers: serde_json::from_str(row.try_get("headers")?)?,
            body: row.try_get("body")?,
        }))
    }

    /// Forgets answers kept before `deadline`, and reports left incomplete since then with their frames.
    pub async fn forget_before(&self, deadline: Timestamp) -> Result<(), StoreError> {
        sqlx::query("DELETE FROM idempotency_keys WHERE created_at < ?")
            .bind(deadline)
            .execute(&mut *self.writer.acquire().await?)
            .await?;
        sqlx::query("DELETE FROM reports WHERE NOT complete AND created_at < ?")
            .bind(deadline)
            .execute(&mut *self.writer.acquire().await?)
            .await?;
        self.ingest.forget();
        Ok(())
    }
}
