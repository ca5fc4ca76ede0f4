//! How values that SQLite lacks are kept.

use crate::{metrics::Value, taa::Precision};

/// A value as migration 0002 kept it.
pub(super) fn value(value: Option<f64>, special: Option<&str>) -> Value {
    Value(match (value, special) {
        (Some(x), _) => x,
        (None, Some("inf")) => f64::INFINITY,
        (None, Some("-inf")) => f64::NEG_INFINITY,
        (None, _) => f64::NAN,
    })
}

/// The stored id of a history precision.
pub(super) fn precision_id(precision: Precision) -> &'static str {
    match precision {
        Precision::F16 => "f16",
        Precision::F32 => "f32",
    }
}

/// The inverse of [`precision_id`].
pub(super) fn precision(id: &str) -> Precision {
    match id {
        "f32" => Precision::F32,
        _ => Precision::F16,
    }
}
