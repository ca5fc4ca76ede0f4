//! The dashboard. Pages are rendered here with their data in them, so that they can be read, searched and tested
//! without scripts; the scripts only draw charts, follow a running job and turn over images. Everything is embedded.

mod alerts;
mod assets;
mod bench;
mod embed;
mod format;
mod job;
mod jobs;
mod layout;
mod lines;
mod new_job;
mod overview;
mod parts;
mod query;
mod reference;
mod report;
mod sequence;
mod sequences;
mod standing;
mod stress;
mod trends;
mod viewer;

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
        .route("/chart.svg", get(embed::chart))
        .route("/badge.svg", get(embed::badge))
        .route("/reports/{report}", get(report::page))
        .route("/reports/{report}/frames/{frame}", get(viewer::page))
        .route("/jobs", get(jobs::page))
        .route("/jobs/new", get(new_job::page))
        .route("/jobs/{job}", get(job::page))
        .route("/sequences", get(sequences::page))
        .route("/sequences/{sequence}", get(sequence::page))
        .route("/bench", get(bench::page))
        .route("/stress", get(stress::page))
        .route("/stress/{job}/cells/{index}", get(stress::cell))
        .route("/assets/{version}/{file}", get(assets::serve))
        .fallback(layout::unknown_page)
}
