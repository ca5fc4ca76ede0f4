//! Temporal resolve: recipes, presets, the GPU resolver, and under `reference` its plain CPU twin.

use serde::{Deserialize, Serialize};

/// How history is stored between frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 16-bit float, as engines do.
    #[default]
    F16,
    /// 32-bit float.
    F32,
}
