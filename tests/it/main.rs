//! The one integration-test binary (each binary links wgpu): a module a subject.
#![allow(clippy::unwrap_used, reason = "helpers outside #[test] functions fail as tests do")]

mod access;
mod api;
mod bad_input;
mod bake;
mod blobs;
mod check;
mod checkerboard;
mod ci;
mod cli;
mod documentation;
mod gltf;
mod golden;
mod gpu_sequences;
mod gpu_vs_reference;
mod images;
mod masks;
mod negative_controls;
mod openapi;
mod posting;
mod presets;
mod properties;
mod run;
mod sequence;
mod several;
mod shaders;
mod spatial;
mod store;
mod support;
mod temporal;
mod tidy;
mod upsampling;
mod validation;
mod verdicts;
mod web;
