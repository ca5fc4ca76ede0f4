//! Afterimage validates temporal anti-aliasing (TAA) and temporal upscaling: it runs published systems on the GPU over
//! frame sequences that engines dumped, compares them with references, and keeps the history of every metric.
//!
//! `ARCHITECTURE.md` has the map. In short: [`sequence`] loads frames in one canonical form, [`taa`] resolves them on
//! the GPU or by its CPU twin, [`metrics`] compares, [`run`] ties the three together, [`store`] keeps reports,
//! [`server`] and [`web`] show them, [`worker`] feeds queued jobs to [`run`].
#![forbid(unsafe_code)]

mod axis;
pub mod bench;
pub mod checker;
pub mod compare;
pub mod config;
pub mod gpu;
mod hex;
pub mod image;
pub mod metrics;
pub mod paper;
pub mod random;
pub mod run;
pub mod scene;
pub mod sequence;
pub mod server;
pub mod statistics;
pub mod store;
pub mod stress;
pub mod taa;
pub mod verdict;
pub mod web;
mod words;
pub mod worker;
