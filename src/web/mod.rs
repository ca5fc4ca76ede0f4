//! The dashboard. Pages are rendered here with their data in them, so that they can be read, searched and tested
//! without scripts; the scripts only draw charts, follow a running job and turn over images. Everything is embedded.

mod alerts;
mod assets;
mod bench;
mod format;
mod job;
mod jobs;
mod layout;
mod overview;
mod parts;
mod reference;
mod report;
mod sequence;
mod stress;
mod trends;

use crate::server::Service;
use axum::{Router, routing::get};
use std::sync::Arc;

/// Every page.
pub fn routes() -> Router<Arc<Service>> {
    Router::new()
        .route("/", get(overview::page))
        .route("/trends", get(trends::page))
        .route("/alerts", get(alerts::page))
        .route("/api", get(reference::page))
        .route("/reports/{report}", get(report::page))
        .route("/jobs", get(jobs::page))
        .route("/jobs/{job}", get(job::page))
        .route("/sequences/{sequence}", get(sequence::page))
        .route("/bench", get(bench::page))
        .route("/stress", get(stress::page))
        .route("/stress/{job}/cells/{index}", get(stress::cell))
        .route("/assets/{version}/{file}", get(assets::serve))
        .fallback(layout::unknown_page)
}
