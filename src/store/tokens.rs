//! Access tokens. A token is 256 random bits that nobody can guess, so its SHA-256 tells it apart and gives nothing away;
//! a slow hash would only protect secrets that people think up.

use super::{Store, StoreError, Timestamp};
use crate::hex::hex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use sqlx::Row as _;
use std::{collections::BTreeSet, fmt, str::FromStr};
use subtle::ConstantTimeEq as _;

/// What a token allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Look at everything.
    Read,
    /// Put sequences, queue jobs, post results.
    Submit,
    /// Say what is good enough: approve, reject, dismiss.
    Approve,
    /// All of it, and tokens and webhooks.
    Admin,
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Approve => "approve",
            Self::Admin => "admin",
        })
    }
}

impl FromStr for Scope {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Read, Self::Submit, Self::Approve, Self::Admin]
            .into_iter()
            .find(|scope| scope.to_string() == text)
            .ok_or_else(|| format!("there is no scope `{text}`; there are read, submit, approve and admin"))
    }
}

/// A token as it is stored, without anything that would let someone use it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Token {
    /// Number.
    pub id: i64,
    /// For people.
    pub name: String,
    /// The token's first characters, by which its owner tells it from others.
    pub handle: String,
    /// What it allows.
    pub scopes: BTreeSet<Scope>,
    /// Requests a minute; none for no limit.
    pub rate_per_minute: Option<u32>,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it ends by itself.
    pub expires_at: Option<Timestamp>,
    /// When it was revoked.
    pub revoked_at: Option<Timestamp>,
}

impl Token {
    /// Whether it is of use now.
    pub fn is_live(&self, now: Timestamp) -> bool {
        self.revoked_at.is_none() && self.expires_at.is_none_or(|end| now < end)
    }

    /// Whether it allows this.
    pub fn allows(&self, scope: Scope) -> bool {
        self.scopes.contains(&scope) || self.scopes.contains(&Scope::Admin)
    }
}

/// A token to be made.
#[derive(Clone, Debug)]
pub struct NewToken {
    /// For people.
    pub name: String,
    /// What it allows.
    pub scopes: BTreeSet<Scope>,
    /// Requests a minute; none for no limit.
    pub rate_per_minute: Option<u32>,
    /// When it ends by itself.
    pub expires_at: Option<Timestamp>,
}

/// Marks a token for whoever finds one in a log or a repository.
const PREFIX: &str = "aft_";

/// What of a token may be shown: 32 of its 256 bits.
fn handle(text: &str) -> &str {
    text.get(..PREFIX.len() + 8).unwrap_or(text)
}

/// The stored form of a token's text.
pub fn token_hash(text: &str) -> [u8; 32] {
    Sha256::digest(text.as_bytes()).into()
}

/// New random text, 256 bits in hexadecimal behind `prefix`.
pub fn random_secret(prefix: &str) -> Result<String, StoreError> {
    let mut bytes = [0u8; 32];
    getrandom::fill(&mut bytes).map_err(|error| StoreError::Random(error.to_string()))?;
    Ok(format!("{prefix}{}", hex(&bytes)))
}

fn token(row: &sqlx::sqlite::SqliteRow) -> Result<Token, StoreError> {
    Ok(Token {
        id: row.try_get("id")?,
        name: row.try_get("name")?,
        handle: row.try_get("handle")?,
        scopes: serde_json::from_str(row.try_get("scopes")?)?,
        rate_per_minute: row.try_get("rate_per_minute")?,
        created_at: row.try_get("created_at")?,
        expires_at: row.try_get("expires_at")?,
        revoked_at: row.try_get("revoked_at")?,
    })
}

impl Store {
    /// Makes a token; its text, which is nowhere kept, and its row.
    pub async fn create_token(&self, new: &NewToken, now: Timestamp) -> Result<(String, Token), StoreError> {
        let text = random_secret(PREFIX)?;
        let row = sqlx::query(
            "INSERT INTO tokens (name, handle, hash, scopes, rate_per_minute, created_at, expires_at)
             VALUES (?, ?, ?, ?, ?, ?, ?) RETURNING *",
        )
        .bind(&new.name)
        .bind(handle(&text))
        .bind(token_hash(&text).as_slice())
        .bind(serde_json::to_string(&new.scopes)?)
        .bind(new.rate_per_minute)
        .bind(now)
        .bind(new.expires_at)
        .fetch_one(&mut *self.writer.acquire().await?)
        .await?;
        Ok((text, token(&row)?))
    }

    /// The token with this text: found by its first characters, and then compared in constant time.
    pub async fn token(&self, text: &str) -> Result<Option<Token>, StoreError> {
        let row = sqlx::query("SELECT * FROM tokens WHERE handle = ?")
            .bind(handle(text))
            .fetch_optional(&self.readers)
            .await?;
        let Some(row) = row else { return Ok(None) };
        let hash: &[u8] = row.try_get("hash")?;
        match bool::from(hash.ct_eq(&token_hash(text))) {
            true => token(&row).map(Some),
            false => Ok(None),
        }
    }

    /// Every token.
    pub async fn tokens(&self) -> Result<Vec<Token>, StoreError> {
        let rows = sqlx::query("SELECT * FROM tokens ORDER BY id")
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(token).collect()
    }

    /// Revokes a token; whether there was one that was not revoked.
    pub async fn revoke_token(&self, id: i64, now: Timestamp) -> Result<bool, StoreError> {
        let done = sqlx::query("UPDATE tokens SET revoked_at = ? WHERE id = ? AND revoked_at IS NULL")
            .bind(now)
            .bind(id)
            .execute(&mut *self.writer.acquire().await?)
            .await?;
        Ok(done.rows_affected() > 0)
    }
}
