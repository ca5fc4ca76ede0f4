//! Submitted sequences.

use super::{Store, StoreError, Timestamp};
use crate::image::Extent;
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::{Connection as _, FromRow, Row, sqlite::SqliteRow};

/// Names that are asked for are kept up to this length, which is the longest that a sequence can have.
const MAX_KEPT_NAME: usize = 100;

/// A sequence whose files already lie in the data folder.
#[derive(Clone, Debug)]
pub struct NewSequence {
    /// Content hash: SHA-256 in hexadecimal.
    pub hash: String,
    /// The name to find it by.
    pub name: String,
    /// The manifest as submitted, in JSON.
    pub manifest: String,
    /// Size of the engine's frames.
    pub render_size: Extent,
    /// Size of the reference.
    pub output_size: Extent,
    /// Number of frames.
    pub n_frames: usize,
    /// Size of its folder in bytes.
    pub n_bytes: u64,
}

/// A stored sequence.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Sequence {
    /// Row id; not shown outside.
    #[serde(skip)]
    pub id: i64,
    /// Content hash: SHA-256 in hexadecimal.
    pub hash: String,
    /// The name it was last put under.
    pub name: String,
    /// Size of the engine's frames.
    pub render_size: Extent,
    /// Size of the reference.
    pub output_size: Extent,
    /// Number of frames.
    pub n_frames: i64,
    /// Size of its folder in bytes.
    pub n_bytes: i64,
    /// When it was last put.
    pub put_at: Timestamp,
    /// The manifest as submitted; left out of lists.
    #[serde(skip_serializing_if = "serde_json::Value::is_null")]
    pub manifest: serde_json::Value,
}

impl FromRow<'_, SqliteRow> for Sequence {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let extent = |width: &str, height: &str| -> Result<Extent, sqlx::Error> {
            Ok(Extent::new(row.try_get(width)?, row.try_get(height)?))
        };
        let manifest: &str = row.try_get("manifest")?;
        Ok(Self {
            id: row.try_get("id")?,
            hash: row.try_get("hash")?,
            name: row.try_get("name")?,
            render_size: extent("render_width", "render_height")?,
            output_size: extent("output_width", "output_height")?,
            n_frames: row.try_get("n_frames")?,
            n_bytes: row.try_get("n_bytes")?,
            put_at: row.try_get("put_at")?,
            manifest: serde_json::from_str(manifest).map_err(|source| sqlx::Error::Decode(source.into()))?,
        })
    }
}

/// The sequence with a hash, else the one last put under that name.
macro_rules! select_called {
    ($columns:literal) => {
        concat!(
            "SELECT ",
            $columns,
            " FROM sequences WHERE hash = ?1 OR id = (SELECT sequence_id FROM sequence_names WHERE name = ?1)
              ORDER BY hash = ?1 DESC LIMIT 1"
        )
    };
}

impl Store {
    /// Stores `sequence`, or gives the one with the same content another name. The flag says whether the content is new.
    pub async fn put_sequence(&self, sequence: &NewSequence, now: Timestamp) -> Result<(Sequence, bool), StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        let known: Option<i64> = sqlx::query_scalar("SELECT id FROM sequences WHERE hash = ?")
            .bind(&sequence.hash)
            .fetch_optional(&mut *transaction)
            .await?;
        let stored: Sequence = sqlx::query_as(
            "INSERT INTO sequences (hash, name, manifest, render_width, render_height, output_width, output_height,
                                    n_frames, n_bytes, put_at)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
             ON CONFLICT (hash) DO UPDATE SET name = excluded.name, put_at = excluded.put_at
             RETURNING *",
        )
        .bind(&sequence.hash)
        .bind(&sequence.name)
        .bind(&sequence.manifest)
        .bind(sequence.render_size.width)
        .bind(sequence.render_size.height)
        .bind(sequence.output_size.width)
        .bind(sequence.output_size.height)
        .bind(sequence.n_frames as i64)
        .bind(sequence.n_bytes as i64)
        .bind(now)
        .fetch_one(&mut *transaction)
        .await?;
        sqlx::query(
            "INSERT INTO sequence_names (name, sequence_id) VALUES (?, ?)
             ON CONFLICT (name) DO UPDATE SET sequence_id = excluded.sequence_id",
        )
        .bind(&sequence.name)
        .bind(stored.id)
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        self.known.forget_names();
        Ok((stored, known.is_none()))
    }

    /// Row id and hash of the sequence with this hash, else of the one last put under this name.
    pub async fn sequence_ids(&self, hash_or_name: &str) -> Result<Option<(i64, String)>, StoreError> {
        let load = async |names: &[String]| {
            let found: Option<(i64, String)> = sqlx::query_as(select_called!("id, hash"))
                .bind(&names[0])
                .fetch_optional(&self.readers)
                .await?;
            Ok(vec![(names[0].clone(), found)])
        };
        let key = [hash_or_name.to_owned()];
        let is_short = |_: &_| hash_or_name.len() <= MAX_KEPT_NAME;
        let mut found = self.known.sequences.get(&key, is_short, load).await?;
        Ok(found.remove(hash_or_name).flatten())
    }

    /// The sequence with this hash, else the one last put under this name.
    pub async fn sequence(&self, hash_or_name: &str) -> Result<Option<Sequence>, StoreError> {
        let found = sqlx::query_as(select_called!("*"))
            .bind(hash_or_name)
            .fetch_optional(&self.readers)
            .await?;
        Ok(found)
    }

    /// Sequences without manifests, newest content first.
    pub async fn sequence_page(&self, before: Option<i64>, limit: u32) -> Result<Vec<Sequence>, StoreError> {
        let found = sqlx::query_as(
            "SELECT id, hash, name, 'null' AS manifest, render_width, render_height, output_width, output_height,
                    n_frames, n_bytes, put_at
             FROM sequences WHERE ?1 IS NULL OR id < ?1 ORDER BY id DESC LIMIT +?2",
        )
        .bind(before)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// Every sequence, by name, without manifests.
    pub async fn sequences(&self) -> Result<Vec<Sequence>, StoreError> {
        let found = sqlx::query_as(
            "SELECT id, hash, name, 'null' AS manifest, render_width, render_height, output_width, output_height,
                    n_frames, n_bytes, put_at
             FROM sequences ORDER BY name, put_at DESC",
        )
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }
}
