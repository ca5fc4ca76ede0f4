//! How values that SQLite lacks are kept. Metric values take two columns: SQLite turns NaN into NULL without a word and JSON has no infinity, so a number that
//! is not finite is stored as NULL in `value` and its name in `special`.

use crate::{metrics::Value, taa::Precision};

/// The `value` and `special` columns of `value`.
pub(super) fn columns(value: Value) -> (Option<f64>, Option<&'static str>) {
    match value.0 {
        x if x.is_nan() => (None, Some("nan")),
        f64::INFINITY => (None, Some("inf")),
        f64::NEG_INFINITY => (None, Some("-inf")),
        x => (Some(x), None),
    }
}

/// The inverse of [`columns`].
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_number_comes_back() {
        for x in [
            0.0,
            -0.0,
            31.25,
            f64::MAX,
            f64::MIN_POSITIVE,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
        ] {
            let (number, special) = columns(Value(x));
            assert_eq!(value(number, special).0.to_bits(), x.to_bits());
        }
    }
}
