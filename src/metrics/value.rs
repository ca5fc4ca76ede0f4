//! A metric's value, and its form in JSON, which has no infinities.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::{borrow::Cow, collections::BTreeMap, fmt};

/// A metric's value for one frame. JSON has no infinities: they are the strings `"inf"`, `"-inf"` and `"nan"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value(pub f64);

/// The values of one frame, by metric id.
pub type Values = BTreeMap<&'static str, Value>;

impl Value {
    fn tag(self) -> Option<&'static str> {
        match self.0 {
            f64::INFINITY => Some("inf"),
            f64::NEG_INFINITY => Some("-inf"),
            number if number.is_nan() => Some("nan"),
            _ => None,
        }
    }
}

impl JsonSchema for Value {
    fn schema_name() -> Cow<'static, str> {
        "Value".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "description": "A number, or what JSON has none for.",
            "anyOf": [{"type": "number"}, {"type": "string", "enum": ["inf", "-inf", "nan"]}],
        })
    }
}

impl fmt::Display for Value {
    /// For people: `∞`, `−∞`, `NaN`, or the number with the formatter's precision.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.tag() {
            Some("inf") => f.pad("∞"),
            Some("-inf") => f.pad("−∞"),
            Some(_) => f.pad("NaN"),
            None => fmt::Display::fmt(&self.0, f),
        }
    }
}

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.tag() {
            Some(tag) => serializer.serialize_str(tag),
            None => serializer.serialize_f64(self.0),
        }
    }
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ValueVisitor)
    }
}

struct ValueVisitor;

impl de::Visitor<'_> for ValueVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, \"inf\", \"-inf\" or \"nan\"")
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<Value, E> {
        Ok(Value(number))
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<Value, E> {
        Ok(Value(number as f64))
    }

    fn visit_u64<E: de::Error>(self, number: u64) -> Result<Value, E> {
        Ok(Value(number as f64))
    }

    fn visit_str<E: de::Error>(self, tag: &str) -> Result<Value, E> {
        match tag {
            "inf" => Ok(Value(f64::INFINITY)),
            "-inf" => Ok(Value(f64::NEG_INFINITY)),
            "nan" => Ok(Value(f64::NAN)),
            _ => Err(E::invalid_value(de::Unexpected::Str(tag), &self)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_keeps_every_value() {
        for number in [
            0.0,
            -3.5,
            1.0 / 3.0,
            99.81742809602972,
            f64::INFINITY,
            f64::NEG_INFINITY,
        ] {
            let json = serde_json::to_string(&Value(number)).unwrap();
            assert_eq!(serde_json::from_str::<Value>(&json).unwrap(), Value(number), "{json}");
        }
        assert_eq!(serde_json::to_string(&Value(f64::NAN)).unwrap(), "\"nan\"");
        assert!(serde_json::from_str::<Value>("\"nan\"").unwrap().0.is_nan());
        assert_eq!(serde_json::from_str::<Value>("3").unwrap(), Value(3.0));
    }

    #[test]
    fn json_refuses_other_words() {
        let error = serde_json::from_str::<Value>("\"infinite\"").unwrap_err().to_string();
        assert!(error.contains("infinite") && error.contains("\"-inf\""), "{error}");
    }

    #[test]
    fn people_see_symbols() {
        assert_eq!(
            format!("{:.2} {:>4}", Value(1.0 / 3.0), Value(f64::INFINITY)),
            "0.33    ∞"
        );
    }
}
