//! `GET /sequences`, `GET /sequences/{hash or name}`.

use super::{ApiError, ApiPath, Service, Shared};
use crate::store::Sequence;
use axum::{Json, extract::State};
use serde_json::{Value, json};

/// The sequence that a path or a field names.
pub async fn find(service: &Service, hash_or_name: &str) -> Result<Sequence, ApiError> {
    let found = service.store.sequence(hash_or_name).await?;
    found.ok_or_else(|| {
        ApiError::not_found(format!(
            "there is no sequence `{hash_or_name}`; put it under /api/v1/sequences/<name>, or see /api/v1/sequences"
        ))
    })
}

/// Every sequence, without manifests.
pub async fn list(State(service): Shared) -> Result<Json<Value>, ApiError> {
    Ok(Json(json!({"sequences": service.store.sequences().await?})))
}

/// One sequence with its manifest.
pub async fn get(State(service): Shared, ApiPath(name): ApiPath<String>) -> Result<Json<Sequence>, ApiError> {
    find(&service, &name).await.map(Json)
}
