//! The one connection of this process that writes, and the state that it left: who remembers what was read must know when that
//! may have changed.

use sqlx::{Sqlite, SqliteConnection, pool::PoolConnection, sqlite::SqlitePool};
use std::{
    ops::{Deref, DerefMut},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering::SeqCst},
    },
};

/// A pool of one connection.
#[derive(Clone)]
pub(super) struct WriterPool {
    pool: SqlitePool,
    /// Grows where somebody begins to write, and where he ends: odd between.
    n_turns: Arc<AtomicU64>,
}

impl WriterPool {
    pub fn new(pool: SqlitePool) -> Self {
        Self {
            pool,
            n_turns: Arc::default(),
        }
    }

    /// Waits for the connection. What is written is to be committed before it is given back: whoever has it must not be cut off
    /// in the middle of a commit, which SQLite would make all the same.
    pub async fn acquire(&self) -> Result<WritingConnection, sqlx::Error> {
        let connection = self.pool.acquire().await?;
        self.n_turns.fetch_add(1, SeqCst);
        Ok(WritingConnection {
            connection,
            n_turns: Arc::clone(&self.n_turns),
        })
    }

    /// The number of what readers find; none while somebody writes.
    pub fn state(&self) -> Option<u64> {
        let n_turns = self.n_turns.load(SeqCst);
        n_turns.is_multiple_of(2).then_some(n_turns / 2)
    }

    pub async fn close(&self) {
        self.pool.close().await;
    }
}

/// The connection while somebody writes.
pub(super) struct WritingConnection {
    connection: PoolConnection<Sqlite>,
    n_turns: Arc<AtomicU64>,
}

impl Deref for WritingConnection {
    type Target = SqliteConnection;

    fn deref(&self) -> &SqliteConnection {
        &self.connection
    }
}

impl DerefMut for WritingConnection {
    fn deref_mut(&mut self) -> &mut SqliteConnection {
        &mut self.connection
    }
}

impl Drop for WritingConnection {
    fn drop(&mut self) {
        self.n_turns.fetch_add(1, SeqCst);
    }
}
