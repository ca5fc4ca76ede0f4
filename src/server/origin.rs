//! What requests say of where a result came from. Two requests say it beside their other fields; serde's `flatten` would
//! read those fields twice and let no unknown one be refused, so a macro writes them out.

use super::ApiError;
use crate::{
    run::report::AdapterInfo,
    store::{DEFAULT_PROJECT, Departure, Environment, Provenance},
};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// What a text field may hold, in bytes.
pub const MAX_TEXT_BYTES: usize = 200;

/// Which state of the submitter's code was measured.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// Project; made at its first report. `default` where left out.
    pub project: Option<String>,
    /// Branch.
    pub branch: Option<String>,
    /// Where the branch left another; only its first report needs to say so.
    pub from: Option<Departure>,
    /// Commit.
    pub commit: Option<String>,
    /// The commit before.
    pub parent: Option<String>,
    /// Number or address of the pull request.
    pub pull_request: Option<String>,
    /// Version of the engine that rendered.
    pub engine_version: Option<String>,
    /// Free text.
    pub label: Option<String>,
    /// Free names and values, at most 50.
    pub labels: BTreeMap<String, String>,
}

/// A request with the fields of [`Origin`] beside its own.
macro_rules! with_origin {
    ($(#[$meta:meta])* pub struct $name:ident { $($own:tt)* }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($own)*
            /// Project; made at its first report. `default` where left out.
            #[schemars(length(max = 100))]
            #[serde(default)]
            pub project: Option<String>,
            /// Branch.
            #[schemars(length(max = 200))]
            #[serde(default)]
            pub branch: Option<String>,
            /// Where the branch left another; only its first report needs to say so.
            #[serde(default)]
            pub from: Option<crate::store::Departure>,
            /// Commit.
            #[schemars(length(max = 200))]
            #[serde(default)]
            pub commit: Option<String>,
            /// The commit before.
            #[schemars(length(max = 200))]
            #[serde(default)]
            pub parent: Option<String>,
            /// Number or address of the pull request.
            #[schemars(length(max = 200))]
            #[serde(default)]
            pub pull_request: Option<String>,
            /// Version of the engine that rendered.
            #[schemars(length(max = 200))]
            #[serde(default)]
            pub engine_version: Option<String>,
            /// Free text.
            #[schemars(length(max = 200))]
            #[serde(default)]
            pub label: Option<String>,
            /// Free names and values, at most 50.
            #[serde(default, deserialize_with = "crate::server::extract::by_name")]
            pub labels: std::collections::BTreeMap<String, String>,
        }

        impl $name {
            /// Takes what it says of its origin.
            pub fn take_origin(&mut self) -> crate::server::origin::Origin {
                crate::server::origin::Origin {
                    project: self.project.take(),
                    branch: self.branch.take(),
                    from: self.from.take(),
                    commit: self.commit.take(),
                    parent: self.parent.take(),
                    pull_request: self.pull_request.take(),
                    engine_version: self.engine_version.take(),
                    label: self.label.take(),
                    labels: std::mem::take(&mut self.labels),
                }
            }
        }
    };
}
pub(super) use with_origin;

impl Origin {
    /// Refuses what is too long or no name. What is empty, as a script's variable that is not set, was not given.
    pub fn check(mut self) -> Result<(String, Provenance), ApiError> {
        for text in [
            &mut self.project,
            &mut self.branch,
            &mut self.commit,
            &mut self.parent,
            &mut self.pull_request,
            &mut self.engine_version,
            &mut self.label,
        ] {
            text.take_if(|text| text.is_empty());
        }
        self.from.take_if(|from| from.branch.is_empty());
        if let Some(from) = &mut self.from {
            from.commit.take_if(|commit| commit.is_empty());
        }
        let from = self.from.as_ref();
        for (field, text) in [
            ("branch", &self.branch),
            ("commit", &self.commit),
            ("parent", &self.parent),
            ("pull_request", &self.pull_request),
            ("engine_version", &self.engine_version),
            ("label", &self.label),
            ("from.branch", &from.map(|from| from.branch.clone())),
            ("from.commit", &from.and_then(|from| from.commit.clone())),
        ] {
            if text.as_ref().is_some_and(|text| text.len() > MAX_TEXT_BYTES) {
                return Err(invalid(
                    field,
                    format!("`{field}` may have at most {MAX_TEXT_BYTES} bytes"),
                ));
            }
        }
        if self.labels.len() > 50
            || self
                .labels
                .iter()
                .any(|(name, text)| name.len() + text.len() > 2 * MAX_TEXT_BYTES)
        {
            return Err(invalid(
                "labels",
                "at most 50 labels of at most 400 bytes each".to_owned(),
            ));
        }
        let project = self.project.unwrap_or_else(|| DEFAULT_PROJECT.to_owned());
        check_name("project", &project)?;
        let provenance = Provenance {
            branch: self.branch,
            from: self.from,
            commit: self.commit,
            parent: self.parent,
            pull_request: self.pull_request,
            engine_version: self.engine_version,
            label: self.label,
            labels: self.labels,
        };
        Ok((project, provenance))
    }
}

/// A field with a value that does not do.
pub fn invalid(field: &str, detail: String) -> ApiError {
    ApiError::invalid("invalid_field", detail).field(field)
}

/// What names are made of.
pub fn is_plain(c: char) -> bool {
    c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.')
}

/// Names appear in addresses and tables, and must not be taken for folders above.
pub fn is_name(name: &str) -> bool {
    (1..=100).contains(&name.len()) && name.chars().all(is_plain) && name.bytes().any(|byte| byte != b'.')
}

/// Refuses what is no name.
pub fn check_name(field: &str, name: &str) -> Result<(), ApiError> {
    match is_name(name) {
        true => Ok(()),
        false => Err(invalid(
            field,
            format!("`{field}` must be 1 to 100 letters, digits, `-`, `_` or `.`, and not only dots"),
        )),
    }
}

/// Settings with whole numbers written as such: 1 and 1.0 are one setting, whatever wrote them.
pub fn settings(parameters: Map<String, Value>) -> Map<String, Value> {
    let plain = |(name, value)| (name, plain_number(value));
    parameters.into_iter().map(plain).collect()
}

fn plain_number(value: Value) -> Value {
    /// Up to here every whole number has a float of its own.
    const MAX: f64 = (1_i64 << 53) as f64;
    match value {
        Value::Array(values) => values.into_iter().map(plain_number).collect(),
        Value::Object(values) => Value::Object(settings(values)),
        Value::Number(number) => match number.as_f64() {
            Some(float) if number.is_f64() && float.fract() == 0.0 && float.abs() <= MAX => Value::from(float as i64),
            _ => Value::Number(number),
        },
        value => value,
    }
}

/// What measured, as far as it is known.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EnvironmentRequest {
    /// The adapter: its name, and what else is known of it.
    pub adapter: AdapterRequest,
    /// Operating system and its version, such as `windows 11 24H2`.
    #[schemars(length(max = 200))]
    pub os: String,
    /// How clocks are held, such as `locked 1410 MHz`.
    #[schemars(length(max = 200))]
    pub clocks: String,
}

/// An adapter's fingerprint.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AdapterRequest {
    /// Name as the driver gives it.
    #[schemars(length(max = 200))]
    pub name: String,
    /// `Vulkan`, `D3D12`, …
    #[schemars(length(max = 200))]
    pub backend: String,
    /// `DiscreteGpu`, …
    #[schemars(length(max = 200))]
    pub kind: String,
    /// Driver's name.
    #[schemars(length(max = 200))]
    pub driver: String,
    /// Driver's version.
    #[schemars(length(max = 200))]
    pub driver_version: String,
}

impl EnvironmentRequest {
    /// Refuses what is too long.
    pub fn check(self) -> Result<Environment, ApiError> {
        let adapter = self.adapter;
        let texts = [
            &adapter.name,
            &adapter.backend,
            &adapter.kind,
            &adapter.driver,
            &adapter.driver_version,
            &self.os,
            &self.clocks,
        ];
        if texts.iter().any(|text| text.len() > MAX_TEXT_BYTES) {
            return Err(invalid(
                "environment",
                format!("its texts may have at most {MAX_TEXT_BYTES} bytes each"),
            ));
        }
        Ok(Environment {
            adapter: AdapterInfo {
                name: adapter.name,
                backend: adapter.backend,
                kind: adapter.kind,
                driver: adapter.driver,
                driver_version: adapter.driver_version,
            },
            os: self.os,
            clocks: self.clocks,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn equal_numbers_are_one_setting() {
        let plain = |value| plain_number(value).to_string();
        assert_eq!(
            plain(json!({"a": 1.0, "b": [-2.0, 0.5]})),
            plain(json!({"a": 1, "b": [-2, 0.5]}))
        );
        assert_eq!(plain(json!([1e300, "1.0", null])), "[1e+300,\"1.0\",null]");
    }
}
