//! Which work may be left out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Which work may be left out. Written `off` or `exact`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Skip {
    /// None: every pass runs over every pixel.
    #[default]
    Off,
    /// Work that provably gives what is there already: every image is the same, bit by bit.
    Exact,
}

impl fmt::Display for Skip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::Exact => "exact",
        })
    }
}

impl FromStr for Skip {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "off" => Ok(Self::Off),
            "exact" => Ok(Self::Exact),
            _ => Err(format!("`{text}` is neither `off` nor `exact`")),
        }
    }
}
