//! Lists a page at a time. A cursor names the last row of a page, so that rows that are added meanwhile neither repeat nor
//! hide any; what it says is nobody's business.

use super::ApiError;
use axum::http::StatusCode;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How many rows a list may ask for at once.
pub const MAX_LIMIT: u32 = 1000;
/// How many it gives unless asked.
const LIMIT: u32 = 50;

/// The `next_cursor` of the page before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cursor(pub i64);

impl Serialize for Cursor {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&format_args!("c{:x}", self.0))
    }
}

impl<'de> Deserialize<'de> for Cursor {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let number = text
            .strip_prefix('c')
            .and_then(|digits| i64::from_str_radix(digits, 16).ok());
        let number = number.filter(|number| *number >= 0);
        number
            .map(Self)
            .ok_or_else(|| serde::de::Error::custom("`cursor` must be the `next_cursor` of a page"))
    }
}

impl JsonSchema for Cursor {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Cursor".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({"type": "string", "description": "The `next_cursor` of the page before.", "pattern": "^c[0-7]?[0-9a-f]{1,15}$"})
    }
}

/// How many rows to give.
pub fn limit(asked: Option<u32>) -> Result<u32, ApiError> {
    let limit = asked.unwrap_or(LIMIT);
    if (1..=MAX_LIMIT).contains(&limit) {
        return Ok(limit);
    }
    let detail = format!("`limit` must be 1 to {MAX_LIMIT}");
    Err(ApiError::new(StatusCode::BAD_REQUEST, "bad_query", detail).field("limit"))
}

/// Where the next page begins; none where this one is not full.
pub fn next<T>(rows: &[T], limit: u32, id: impl Fn(&T) -> i64) -> Option<Cursor> {
    let is_full = rows.len() >= limit as usize;
    rows.last().filter(|_| is_full).map(|row| Cursor(id(row)))
}
