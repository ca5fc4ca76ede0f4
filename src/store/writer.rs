//! The one connection of this process that writes, and the state that it left: who remembers what was read must know when that
//! may have changed.

use sqlx::{Sqlite, SqliteConnection, pool::PoolConnection, sqlite::SqlitePool};
use std::{
    ops::{Deref, DerefMut},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// Numbers of what readers find, which grow with every write of this process; none while it may be changing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct State {
    /// Of everything.
    pub all: Option<u64>,
    /// Of what posted results leave as it is: jobs, and reports that are complete.
    pub lasting: Option<u64>,
}

/// A pool of one connection.
#[derive(Clone)]
pub(super) struct WriterPool {
    pool: SqlitePool,
    turns: Arc<Turns>,
}

/// What a turn may change.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Changes {
    /// Posted results and what they are part of.
    Posts,
    Anything,
}

/// How many turns there were, and whether there is one now.
#[derive(Default)]
struct Turns(Mutex<Count>);

#[derive(Default)]
struct Count {
    n_posts: u64,
    n_others: u64,
    now: Option<Changes>,
}

impl Turns {
    fn lock(&self) -> MutexGuard<'_, Count> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ends where it is dropped.
pub(super) struct Turn {
    turns: Arc<Turns>,
    changes: Changes,
}

impl Turn {
    fn begin(turns: &Arc<Turns>, changes: Changes) -> Self {
        turns.lock().now = Some(changes);
        Self {
            turns: Arc::clone(turns),
            changes,
        }
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut count = self.turns.lock();
        count.now = None;
        match self.changes {
            Changes::Posts => count.n_posts += 1,
            Changes::Anything => count.n_others += 1,
        }
    }
}

impl WriterPool {
    pub fn new(pool: SqlitePool) -> Self {
        Self {
            pool,
            turns: Arc::default(),
        }
    }

    /// Waits for the connection, to change anything. What is written is to be committed before it is given back: whoever has it
    /// must not be cut off in the middle of a commit, which SQLite would make all the same.
    pub async fn acquire(&self) -> Result<WritingConnection, sqlx::Error> {
        let connection = self.pool.acquire().await?;
        Ok(WritingConnection {
            _turn: Turn::begin(&self.turns, Changes::Anything),
            connection,
        })
    }

    /// Waits for the connection, for one transaction of posted results, whose commit is [a turn](Self::posts) of its own.
    pub async fn acquire_for_posts(&self) -> Result<PoolConnection<Sqlite>, sqlx::Error> {
        self.pool.acquire().await
    }

    /// Lasts while posted results are committed; readers see nothing of them before.
    pub fn posts(&self) -> Turn {
        Turn::begin(&self.turns, Changes::Posts)
    }

    /// What readers find.
    pub fn state(&self) -> State {
        let count = self.turns.lock();
        State {
            all: count.now.is_none().then_some(count.n_posts + count.n_others),
            lasting: (count.now != Some(Changes::Anything)).then_some(count.n_others),
        }
    }

    pub async fn close(&self) {
        self.pool.close().await;
    }
}

/// The connection while somebody writes; the turn ends before others can have it.
pub(super) struct WritingConnection {
    _turn: Turn,
    connection: PoolConnection<Sqlite>,
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
