//! The one connection that writes, and how often it was used: who remembers what was read must know when that may have changed.

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
    n_writes: Arc<AtomicU64>,
}

impl WriterPool {
    pub fn new(pool: SqlitePool) -> Self {
        Self {
            pool,
            n_writes: Arc::default(),
        }
    }

    /// Waits for the connection. What is written is to be committed before it is given back.
    pub async fn acquire(&self) -> Result<Writing, sqlx::Error> {
        Ok(Writing {
            connection: self.pool.acquire().await?,
            n_writes: Arc::clone(&self.n_writes),
        })
    }

    /// How often the connection was given back.
    pub fn n_writes(&self) -> u64 {
        self.n_writes.load(SeqCst)
    }

    pub async fn close(&self) {
        self.pool.close().await;
    }
}

/// The connection while somebody writes.
pub(super) struct Writing {
    connection: PoolConnection<Sqlite>,
    n_writes: Arc<AtomicU64>,
}

impl Deref for Writing {
    type Target = SqliteConnection;

    fn deref(&self) -> &SqliteConnection {
        &self.connection
    }
}

impl DerefMut for Writing {
    fn deref_mut(&mut self) -> &mut SqliteConnection {
        &mut self.connection
    }
}

impl Drop for Writing {
    fn drop(&mut self) {
        self.n_writes.fetch_add(1, SeqCst);
    }
}
