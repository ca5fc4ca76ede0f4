//! The thread that holds every new sequence's conventions against its pixels, one sequence at a time. It computes on one
//! core, so that neither an upload nor a running job waits for it, and finds what is to be done in the store: what a
//! stopped service left comes first when it starts again.

use crate::{
    image::files::FileReader,
    sequence::{
        Sequence,
        check::{self, Report},
    },
    store::{DataFolder, Store, StoreError, Timestamp},
    worker::give_way,
};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::{
    io,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};
use tokio::{runtime::Handle, sync::Notify, time::timeout};
use tokio_util::sync::CancellationToken;

/// How long the store is left alone without being told of a new sequence.
const IDLE: Duration = Duration::from_secs(30);

/// What the checker's thread needs.
pub struct Checker {
    /// What is to be checked, and what was found.
    pub store: Store,
    /// The sequences.
    pub folder: DataFolder,
    /// Reads their images.
    pub reader: FileReader,
    /// Told of new sequences.
    pub wake: Arc<Notify>,
    /// Told to stop after the current sequence.
    pub shutdown: CancellationToken,
    /// Runs the store's queries.
    pub runtime: Handle,
}

impl Checker {
    /// Checks until told to stop.
    pub fn spawn(self) -> io::Result<thread::JoinHandle<()>> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(1)
            .start_handler(|_| give_way())
            .build()
            .map_err(io::Error::other)?;
        thread::Builder::new().name("checker".to_owned()).spawn(move || {
            while !self.shutdown.is_cancelled() {
                match self.step(&pool) {
                    Ok(true) => {}
                    Ok(false) => self.pause(),
                    Err(error) => {
                        tracing::error!(%error, "cannot check a sequence");
                        self.pause();
                    }
                }
            }
        })
    }

    /// Checks the sequence that has waited longest. `false` where none waits.
    fn step(&self, pool: &ThreadPool) -> Result<bool, StoreError> {
        let Some(waiting) = self.runtime.block_on(self.store.next_unchecked())? else {
            return Ok(false);
        };
        let start = Instant::now();
        let folder = self.folder.sequence(&waiting.hash);
        // A panic is that sequence's failure, not the service's.
        let outcome = catch_unwind(AssertUnwindSafe(|| pool.install(|| self.check(&folder))))
            .unwrap_or_else(|_| Err("the check failed; the service's log has the cause".to_owned()));
        let time_ms = start.elapsed().as_secs_f64() * 1000.0;
        match &outcome {
            Ok(report) => tracing::info!(
                hash = waiting.hash,
                warnings = report.warnings().count(),
                time_ms,
                "checked"
            ),
            Err(error) => tracing::warn!(hash = waiting.hash, error, "sequence cannot be checked"),
        }
        let stored = self.store.put_check(&waiting, &outcome, time_ms, Timestamp::now());
        self.runtime.block_on(stored)?;
        Ok(true)
    }

    fn check(&self, folder: &Path) -> Result<Report, String> {
        let prefix = format!("{}/", folder.display());
        Sequence::open(folder, &self.reader)
            .and_then(|sequence| check::check(&sequence))
            .map_err(|error| error.to_string().replace(&prefix, ""))
    }

    fn pause(&self) {
        self.runtime.block_on(async {
            tokio::select! {
                () = self.shutdown.cancelled() => {}
                _ = timeout(IDLE, self.wake.notified()) => {}
            }
        });
    }
}
