//! What every parameter of a recipe may be: read from the recipe's own definition, so that what is listed is what is
//! enforced.

use super::Recipe;
use crate::taa::preset::BASE;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use std::{fmt, sync::LazyLock};

/// A parameter of a recipe.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Parameter {
    /// As jobs write it, and as shaders do.
    pub name: String,
    /// What it is.
    pub description: String,
    /// Of its values, where they have one.
    pub unit: Option<String>,
    /// What values it takes.
    #[serde(flatten)]
    pub kind: Kind,
    /// What it is in a preset that does not say.
    pub default: Value,
}

/// What values a parameter takes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Kind {
    /// `true` or `false`.
    Flag,
    /// One of some names.
    Choice {
        /// All of them.
        values: Vec<Choice>,
    },
    /// A whole number.
    Integer(Range),
    /// A real number.
    Number(Range),
}

/// A name that a parameter can have.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Choice {
    /// As jobs write it.
    pub name: String,
    /// What it means.
    pub description: String,
}

/// What numbers are allowed.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Range {
    /// The smallest, or what all must be above.
    pub min: f64,
    /// The smallest is itself too small.
    pub excludes_min: bool,
    /// The largest.
    pub max: f64,
    /// Only odd ones.
    pub odd: bool,
}

impl Range {
    fn contains(self, value: f64) -> bool {
        let is_above = if self.excludes_min {
            value > self.min
        } else {
            value >= self.min
        };
        is_above && value <= self.max && (!self.odd || value % 2.0 == 1.0)
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.odd {
            f.write_str("odd, ")?;
        }
        match self.excludes_min {
            true => write!(f, "above {}, at most {}", self.min, self.max),
            false => write!(f, "{} to {}", self.min, self.max),
        }
    }
}

impl Parameter {
    /// Says what would be right, where `value`, which is of the parameter's type, is out of range.
    pub(super) fn check(&self, value: &Value) -> Result<(), String> {
        match (&self.kind, value.as_f64()) {
            (Kind::Integer(range) | Kind::Number(range), Some(value)) if !range.contains(value) => {
                Err(format!("must be {range}"))
            }
            // What is no number in JSON is not finite.
            (Kind::Integer(range) | Kind::Number(range), None) => Err(format!("must be {range}")),
            _ => Ok(()),
        }
    }

    /// From its place in the recipe's schema.
    fn new(name: &str, schema: &Value, definitions: &Value, default: &Value) -> Self {
        let named = schema["$ref"].as_str().and_then(|path| path.rsplit('/').next());
        let definition = named.map_or(schema, |named| &definitions[named]);
        Self {
            name: name.to_owned(),
            description: text(&schema["description"]),
            unit: schema["unit"].as_str().map(str::to_owned),
            kind: Kind::new(definition),
            default: default.clone(),
        }
    }
}

impl Kind {
    fn new(schema: &Value) -> Self {
        if let Some(variants) = schema["oneOf"].as_array() {
            let choice = |variant: &Value| Choice {
                name: text(&variant["const"]),
                description: text(&variant["description"]),
            };
            let values = variants.iter().map(choice).collect();
            return Self::Choice { values };
        }
        let number = |key: &str| schema[key].as_f64();
        let range = || Range {
            min: number("exclusiveMinimum")
                .or(number("minimum"))
                .expect("every number of a recipe says its smallest"),
            excludes_min: schema.get("exclusiveMinimum").is_some(),
            max: number("maximum").expect("every number of a recipe says its largest"),
            odd: schema["odd"] == true,
        };
        match schema["type"].as_str() {
            Some("boolean") => Self::Flag,
            Some("integer") => Self::Integer(range()),
            Some("number") => Self::Number(range()),
            _ => unreachable!("a recipe has flags, numbers and choices that say what each means"),
        }
    }
}

/// On one line, without the brackets that make links of names.
fn text(value: &Value) -> String {
    let words: Vec<_> = value.as_str().unwrap_or_default().split_whitespace().collect();
    words.join(" ").replace("[`", "`").replace("`]", "`")
}

/// Every parameter, in the order of the recipe.
pub fn parameters() -> &'static [Parameter] {
    static ALL: LazyLock<Vec<Parameter>> = LazyLock::new(|| {
        let schema = schemars::schema_for!(Recipe).to_value();
        let defaults = BASE.to_json();
        let Some(properties) = schema["properties"].as_object() else {
            unreachable!("a recipe is an object");
        };
        let parameter =
            |(name, property): (&String, _)| Parameter::new(name, property, &schema["$defs"], &defaults[name]);
        properties.iter().map(parameter).collect()
    });
    &ALL
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::taa::RecipeError;

    /// What a recipe says of one parameter changed. Rules of parameters together may come after its range, and name others.
    fn changed(name: &str, value: Value) -> Result<Recipe, RecipeError> {
        let overrides = serde_json::Map::from_iter([(name.to_owned(), value)]);
        BASE.with(&overrides)
    }

    #[test]
    fn what_is_listed_is_what_is_enforced() {
        let mut n_numbers = 0;
        for parameter in parameters() {
            let name = &parameter.name;
            assert!(!parameter.description.is_empty(), "{name}");
            assert!(changed(name, parameter.default.clone()).is_ok(), "{name}");
            let is_refused = |value: Value| {
                let refused = changed(name, value.clone()).err();
                refused.is_some_and(|error| error.field == *name && error.message.starts_with("must be"))
            };
            match &parameter.kind {
                Kind::Flag => assert!(changed(name, "yes".into()).is_err(), "{name}"),
                Kind::Choice { values } => {
                    assert!(
                        values.len() > 1 && values.iter().all(|value| !value.description.is_empty()),
                        "{name}"
                    );
                    assert!(changed(name, "nonsense".into()).is_err(), "{name}");
                    // Some need another parameter beside them; none is unknown.
                    for value in values {
                        if let Err(error) = changed(name, value.name.clone().into()) {
                            assert!(!error.message.contains("unknown"), "{name}: {error}");
                        }
                    }
                }
                Kind::Integer(range) => {
                    n_numbers += 1;
                    let whole = |value: f64| Value::from(value as u32);
                    assert!(!is_refused(whole(range.min)) && !is_refused(whole(range.max)), "{name}");
                    let step = if range.odd { 2.0 } else { 1.0 };
                    assert!(
                        is_refused(whole(range.min - step)) && is_refused(whole(range.max + step)),
                        "{name}"
                    );
                    assert_eq!(is_refused(whole(range.min + 1.0)), range.odd, "{name}");
                }
                Kind::Number(range) => {
                    n_numbers += 1;
                    let step = 1e-9 * range.max;
                    assert_eq!(is_refused(range.min.into()), range.excludes_min, "{name}");
                    assert!(
                        is_refused((range.min - step).into()) && is_refused((range.max + step).into()),
                        "{name}"
                    );
                }
            }
        }
        assert!(n_numbers >= 9, "{n_numbers}");
        let fields = BASE.to_json();
        let listed: Vec<_> = parameters().iter().map(|parameter| parameter.name.as_str()).collect();
        assert_eq!(fields.as_object().unwrap().len(), listed.len());
        assert!(listed.iter().all(|name| fields.get(name).is_some()), "{listed:?}");
    }
}
