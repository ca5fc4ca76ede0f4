//! Whom to tell of verdicts, and what is still to be told.

use super::{Store, StoreError, Timestamp};
use schemars::JsonSchema;
use serde::Serialize;
use sqlx::{Connection as _, FromRow};
use std::{collections::BTreeSet, time::Duration};

/// An address that hears of verdicts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema, FromRow)]
pub struct Webhook {
    /// Number.
    pub id: i64,
    /// Project whose verdicts it hears of.
    pub project: String,
    /// Where to.
    pub url: String,
    /// When it was made.
    pub created_at: Timestamp,
}

/// Something to be sent.
#[derive(Clone, Debug, FromRow)]
pub struct Delivery {
    /// Number; the same at every attempt.
    pub id: i64,
    /// Whom to.
    pub webhook_id: i64,
    /// Attempts so far.
    pub attempts: i64,
    /// Name of the event.
    pub event: String,
    /// JSON.
    pub payload: String,
    /// Where to.
    pub url: String,
    /// Signs it.
    pub secret: String,
}

/// A delivery as the API shows it.
#[derive(Clone, Debug, Serialize, JsonSchema, FromRow)]
pub struct DeliveryStatus {
    /// Number.
    pub id: i64,
    /// Name of the event.
    pub event: String,
    /// `waiting`, `delivered` or `given_up`.
    pub status: String,
    /// Attempts so far.
    pub attempts: i64,
    /// What went wrong last.
    pub last_error: Option<String>,
    /// When it was queued.
    pub created_at: Timestamp,
}

/// After so many attempts, a day later, a delivery is given up.
const MAX_DELIVERIES: i64 = 9;

impl Store {
    /// Adds a webhook.
    pub async fn create_webhook(
        &self,
        project: &str,
        url: &str,
        secret: &str,
        now: Timestamp,
    ) -> Result<Webhook, StoreError> {
        let mut writing = self.writer.acquire().await?;
        let mut transaction = writing.begin().await?;
        sqlx::query("INSERT INTO projects (name, created_at) VALUES (?, ?) ON CONFLICT DO NOTHING")
            .bind(project)
            .bind(now)
            .execute(&mut *transaction)
            .await?;
        let webhook = sqlx::query_as(
            "INSERT INTO webhooks (project_id, url, secret, created_at)
             VALUES ((SELECT id FROM projects WHERE name = ?1), ?2, ?3, ?4) RETURNING id, ?1 AS project, url, created_at",
        )
        .bind(project)
        .bind(url)
        .bind(secret)
        .bind(now)
        .fetch_one(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(webhook)
    }

    /// Every webhook, without secrets.
    pub async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError> {
        let found = sqlx::query_as(
            "SELECT webhooks.id, projects.name AS project, url, webhooks.created_at
             FROM webhooks JOIN projects ON projects.id = project_id ORDER BY webhooks.id",
        )
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// Removes a webhook with what was still to be sent; whether there was one.
    pub async fn delete_webhook(&self, id: i64) -> Result<bool, StoreError> {
        let done = sqlx::query("DELETE FROM webhooks WHERE id = ?")
            .bind(id)
            .execute(&mut *self.writer.acquire().await?)
            .await?;
        Ok(done.rows_affected() > 0)
    }

    /// Queues an event for every webhook of a project; for how many.
    pub async fn announce(
        &self,
        project: &str,
        event: &str,
        payload: &serde_json::Value,
        now: Timestamp,
    ) -> Result<u64, StoreError> {
        let done = sqlx::query(
            "INSERT INTO deliveries (webhook_id, event, payload, next_at, created_at)
             SELECT webhooks.id, ?2, ?3, ?4, ?4 FROM webhooks JOIN projects ON projects.id = project_id
             WHERE projects.name = ?1",
        )
        .bind(project)
        .bind(event)
        .bind(payload.to_string())
        .bind(now)
        .execute(&mut *self.writer.acquire().await?)
        .await?;
        Ok(done.rows_affected())
    }

    /// The oldest delivery whose time has come of each webhook but these.
    pub async fn due_deliveries(
        &self,
        now: Timestamp,
        but: &BTreeSet<i64>,
        limit: usize,
    ) -> Result<Vec<Delivery>, StoreError> {
        let found = sqlx::query_as(
            "SELECT deliveries.id, webhook_id, attempts, event, payload, url, secret
             FROM (SELECT id AS due_id, row_number() OVER (PARTITION BY webhook_id ORDER BY next_at, id) AS place
                   FROM deliveries
                   WHERE next_at <= ?1 AND webhook_id NOT IN (SELECT value FROM json_each(?2)))
             JOIN deliveries ON deliveries.id = due_id JOIN webhooks ON webhooks.id = webhook_id
             WHERE place = 1 ORDER BY next_at, deliveries.id LIMIT ?3",
        )
        .bind(now)
        .bind(serde_json::to_string(but)?)
        .bind(limit as i64)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }

    /// Notes how an attempt ended: delivered, or to be tried again after 10 s, 40 s, 160 s and so on, at most 6 h.
    pub async fn note_delivery(
        &self,
        delivery: &Delivery,
        error: Option<&str>,
        now: Timestamp,
    ) -> Result<(), StoreError> {
        let attempts = delivery.attempts + 1;
        let (status, next_at) = match error {
            None => ("delivered", None),
            Some(_) if attempts >= MAX_DELIVERIES => ("given_up", None),
            Some(_) => {
                let wait_s = (10u64 << (2 * (attempts - 1)).min(20)).min(21_600);
                ("waiting", Some(now + Duration::from_secs(wait_s)))
            }
        };
        sqlx::query("UPDATE deliveries SET attempts = ?, status = ?, next_at = ?, last_error = ? WHERE id = ?")
            .bind(attempts)
            .bind(status)
            .bind(next_at)
            .bind(error)
            .bind(delivery.id)
            .execute(&mut *self.writer.acquire().await?)
            .await?;
        Ok(())
    }

    /// The last deliveries of a webhook, newest first.
    pub async fn deliveries(&self, webhook_id: i64) -> Result<Vec<DeliveryStatus>, StoreError> {
        let found = sqlx::query_as(
            "SELECT id, event, status, attempts, last_error, created_at
             FROM deliveries WHERE webhook_id = ? ORDER BY id DESC LIMIT 100",
        )
        .bind(webhook_id)
        .fetch_all(&self.readers)
        .await?;
        Ok(found)
    }
}
