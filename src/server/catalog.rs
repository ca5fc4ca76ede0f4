//! What this service offers: presets, metrics, the adapter; and whether it is well.

use super::{ApiError, Shared};
use crate::{
    metrics::{Listing, Metric},
    run::report::AdapterInfo,
    taa::{PRESETS, Preset},
};
use axum::{Json, extract::State, http::StatusCode};
use serde_json::{Value, json};

/// `GET /health`: 200 while the database answers. Says nothing of the GPU: a service without one still shows history.
pub async fn health(State(service): Shared) -> Result<Json<Value>, ApiError> {
    service.store.ping().await?;
    Ok(Json(
        json!({"status": "ok", "version": env!("CARGO_PKG_VERSION"), "revision": env!("AFTERIMAGE_REVISION")}),
    ))
}

/// `GET /presets`
pub async fn presets() -> Json<&'static [Preset]> {
    Json(&PRESETS)
}

/// `GET /metrics`
pub async fn metrics() -> Json<Vec<Listing>> {
    Json(Metric::list())
}

/// `GET /adapter`
pub async fn adapter(State(service): Shared) -> Result<Json<AdapterInfo>, ApiError> {
    match &service.adapter {
        Ok(adapter) => Ok(Json(adapter.clone())),
        Err(reason) => Err(ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "no_adapter", reason)),
    }
}
