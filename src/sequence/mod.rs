//! Frame sequences: the manifest declares an engine's conventions, the loader converts once into canonical [`Frame`]s.
//! Nothing after the loader may ask which engine it was. Names no wgpu, SQL or HTTP.

pub mod frame;

pub use frame::{Channels, Frame};

/// An opened, validated sequence.
pub struct Sequence {}
