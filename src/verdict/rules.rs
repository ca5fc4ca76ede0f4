//! The rules file, `afterimage.toml`. It lies in the user's repository and is sent with each run, so that rules have the
//! history of the code they judge; a rule that is gone has no alerts.

use super::{better, change};
use crate::{metrics::Better, words::expected_in_words};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, de};

/// A rules file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rules {
    /// A line without a report for so many nights is an alert; none where left out.
    #[schemars(range(min = 1, max = 365))]
    pub no_data_nights: Option<u32>,
    /// The limits. Every rule that matches counts; a later one replaces the same check of an earlier one.
    #[serde(rename = "rule")]
    #[schemars(length(max = 200))]
    pub rules: Vec<Rule>,
}

/// What must hold of some metrics on some sequences of some recipes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Metrics by id; `*` stands for any text, `?` for one character.
    #[schemars(length(min = 1, max = 200))]
    pub metric: String,
    /// Sequences by name; wildcards as in `metric`.
    #[serde(default = "any")]
    pub sequence: String,
    /// Presets, or systems elsewhere, by name; wildcards as in `metric`.
    #[serde(default = "any")]
    pub recipe: String,
    /// The least that is good enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// The most that is good enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// How much worse than the worst approved result of the same environment it may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Tolerance>,
    /// Watch for a change for the worse in the line's history.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<ChangeRule>,
    /// Which way a metric improves that is not known here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub better: Option<Better>,
}

fn any() -> String {
    "*".to_owned()
}

/// Change-point detection: what counts as a change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ChangeRule {
    /// Smaller steps are not worth anyone's time.
    pub min_effect: Tolerance,
    /// How many results there must be on either side of a change.
    #[schemars(range(min = 2, max = 100))]
    pub min_segment: usize,
    /// The largest probability that chance made the change, by permutation.
    #[schemars(range(min = 0.002, max = 0.5))]
    pub p: f64,
    /// Look at the newest so many results.
    #[schemars(range(min = 4, max = 500))]
    pub window: usize,
}

impl Default for ChangeRule {
    fn default() -> Self {
        Self {
            min_effect: Tolerance::Relative(0.01),
            min_segment: 4,
            p: 0.01,
            window: 200,
        }
    }
}

/// A difference: a number in the metric's unit, or a share such as `"2 %"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// In the metric's unit.
    Absolute(f64),
    /// A share of what is compared with, 0.02 for 2 %.
    Relative(f64),
}

impl Tolerance {
    /// In the metric's unit, where `reference` is what is compared with.
    pub fn of(self, reference: f64) -> f64 {
        match self {
            Self::Absolute(difference) => difference,
            Self::Relative(share) => share * reference.abs(),
        }
    }
}

impl JsonSchema for Tolerance {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Tolerance".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "description": "A difference in the metric's unit, or a share of what is compared with, such as `2 %`.",
            "anyOf": [
                {"type": "number", "minimum": 0, "maximum": 1e300},
                {"type": "string", "pattern": "^[0-9]{1,6}(\\.[0-9]{1,6})? ?%$"},
            ],
        })
    }
}

impl Serialize for Tolerance {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Absolute(difference) => serializer.serialize_f64(*difference),
            Self::Relative(share) => serializer.collect_str(&format_args!("{} %", share * 100.0)),
        }
    }
}

impl<'de> Deserialize<'de> for Tolerance {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;

        impl de::Visitor<'_> for Visitor {
            type Value = Tolerance;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a number of at least 0, or a share such as \"2 %\"")
            }

            fn visit_f64<E: de::Error>(self, number: f64) -> Result<Tolerance, E> {
                match number >= 0.0 && number.is_finite() {
                    true => Ok(Tolerance::Absolute(number)),
                    false => Err(E::invalid_value(de::Unexpected::Float(number), &self)),
                }
            }

            fn visit_i64<E: de::Error>(self, number: i64) -> Result<Tolerance, E> {
                self.visit_f64(number as f64)
            }

            fn visit_u64<E: de::Error>(self, number: u64) -> Result<Tolerance, E> {
                self.visit_f64(number as f64)
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Tolerance, E> {
                let percent = text
                    .strip_suffix('%')
                    .and_then(|number| number.trim().parse::<f64>().ok());
                match percent {
                    Some(percent) if percent >= 0.0 && percent.is_finite() => Ok(Tolerance::Relative(percent / 100.0)),
                    _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
                }
            }
        }

        deserializer.deserialize_any(Visitor)
    }
}

/// Why a rules file was refused.
#[derive(Debug, thiserror::Error)]
pub enum RulesError {
    /// Not TOML, or not of this form.
    #[error("{0}")]
    Form(String),
    /// A rule that makes no sense.
    #[error("rule[{index}].{field}: {message}")]
    Rule {
        /// Which rule, from 0.
        index: usize,
        /// Its field.
        field: &'static str,
        /// What would be right.
        message: String,
    },
    /// A value beside the rules.
    #[error("{field}: {message}")]
    Field {
        /// Which.
        field: &'static str,
        /// What would be right.
        message: &'static str,
    },
}

/// All checks of one metric of one line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Checks {
    /// See [`Rule::min`].
    pub min: Option<f64>,
    /// See [`Rule::max`].
    pub max: Option<f64>,
    /// See [`Rule::baseline`].
    pub baseline: Option<Tolerance>,
    /// See [`Rule::change`].
    pub change: Option<ChangeRule>,
    /// See [`Rule::better`].
    pub better: Option<Better>,
}

impl Rules {
    /// Reads a rules file.
    pub fn parse(text: &str) -> Result<Self, RulesError> {
        let rules: Self = toml::from_str(text)
            .map_err(|error: toml::de::Error| RulesError::Form(expected_in_words(&error.to_string(), "a table")))?;
        rules.validate()?;
        Ok(rules)
    }

    /// Checks what a type cannot say.
    pub fn validate(&self) -> Result<(), RulesError> {
        if self.no_data_nights.is_some_and(|nights| !(1..=365).contains(&nights)) {
            let message = "must be 1 to 365";
            return Err(RulesError::Field {
                field: "no_data_nights",
                message,
            });
        }
        if self.rules.len() > 200 {
            let message = "at most 200 rules; use wildcards";
            return Err(RulesError::Field { field: "rule", message });
        }
        for (index, rule) in self.rules.iter().enumerate() {
            rule.validate().map_err(|(field, message)| RulesError::Rule {
                index,
                field,
                message: message.to_owned(),
            })?;
        }
        Ok(())
    }

    /// Whether any rule is about a line.
    pub fn ask_of(&self, sequence: &str, recipe: &str) -> bool {
        let is_about = |rule: &Rule| matches(&rule.sequence, sequence) && matches(&rule.recipe, recipe);
        self.rules.iter().any(is_about)
    }

    /// What is asked of a metric of a line.
    pub fn checks(&self, sequence: &str, recipe: &str, metric: &str) -> Checks {
        let matching = self.rules.iter().filter(|rule| {
            matches(&rule.metric, metric) && matches(&rule.sequence, sequence) && matches(&rule.recipe, recipe)
        });
        matching.fold(Checks::default(), |checks, rule| Checks {
            min: rule.min.or(checks.min),
            max: rule.max.or(checks.max),
            baseline: rule.baseline.or(checks.baseline),
            change: rule.change.or(checks.change),
            better: rule.better.or(checks.better),
        })
    }
}

impl Rule {
    fn validate(&self) -> Result<(), (&'static str, &'static str)> {
        let finite = |value: Option<f64>| value.is_none_or(f64::is_finite);
        if self.metric.is_empty() || self.metric.len() > 200 {
            return Err(("metric", "must be a metric's id or a pattern"));
        }
        if !finite(self.min) {
            return Err(("min", "must be a finite number"));
        }
        if !finite(self.max) {
            return Err(("max", "must be a finite number"));
        }
        if let (Some(min), Some(max)) = (self.min, self.max)
            && min > max
        {
            return Err(("min", "is above max: nothing could ever pass"));
        }
        if self.min.is_none() && self.max.is_none() && self.baseline.is_none() && self.change.is_none() {
            return Err(("metric", "the rule asks for nothing; give min, max, baseline or change"));
        }
        if let (Some(better), Some(known)) = (self.better, better(&self.metric))
            && better != known
        {
            return Err((
                "better",
                "which way this metric improves is known, and it is the other; leave `better` out",
            ));
        }
        let Some(change) = &self.change else { return Ok(()) };
        if !(2..=100).contains(&change.min_segment) {
            return Err(("change.min_segment", "must be 2 to 100"));
        }
        if !(0.002..=0.5).contains(&change.p) {
            return Err(("change.p", "must be 0.002 to 0.5"));
        }
        if !(2 * change.min_segment..=500).contains(&change.window) {
            return Err(("change.window", "must be at least twice min_segment, at most 500"));
        }
        if change.window < change::fewest(change) {
            return Err((
                "change.window",
                "is too short for `p`: nothing in so few results is so improbable",
            ));
        }
        Ok(())
    }
}

/// Whether `text` fits `pattern`, in which `*` stands for any text and `?` for one character.
pub fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) = (pattern.chars().collect(), text.chars().collect());
    // Where the last star was met, and how much of the text it has taken so far.
    let (mut p, mut t, mut star) = (0, 0, None);
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(&c) if c == '?' || c == text[t] => (p, t) = (p + 1, t + 1),
            _ => match star {
                Some((at, taken)) => {
                    star = Some((at, taken + 1));
                    (p, t) = (at + 1, taken + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        no_data_nights = 2
        [[rule]]
        metric = "psnr*"
        min = 30
        baseline = 0.1
        [[rule]]
        metric = "psnr"
        sequence = "ship*"
        min = 34.5
        [[rule]]
        metric = "gpu_time_ms"
        change = { min_effect = "3 %" }
    "#;

    #[test]
    fn later_rules_replace_the_same_check_of_earlier_ones() {
        let rules = Rules::parse(FILE).unwrap();
        assert_eq!(rules.no_data_nights, Some(2));
        let ship = rules.checks("ship-night", "ema", "psnr");
        assert_eq!((ship.min, ship.baseline), (Some(34.5), Some(Tolerance::Absolute(0.1))));
        assert_eq!(rules.checks("bistro", "ema", "psnr.moving").min, Some(30.0));
        assert_eq!(rules.checks("bistro", "ema", "ssim"), Checks::default());
        let change = rules.checks("bistro", "ema", "gpu_time_ms").change.unwrap();
        assert_eq!((change.min_effect, change.min_segment), (Tolerance::Relative(0.03), 4));
        let json = serde_json::to_string(&rules).unwrap();
        assert_eq!(serde_json::from_str::<Rules>(&json).unwrap(), rules, "{json}");
    }

    #[test]
    fn mistakes_are_named() {
        for (text, words) in [
            ("rule = 3", "rule"),
            ("[[rule]]\nmetric = 'psnr'\nmim = 3", "mim"),
            ("[[rule]]\nmetric = 'psnr'", "asks for nothing"),
            (
                "[[rule]]\nmetric = 'psnr'\nmin = 3\nmax = 2",
                "rule[0].min: is above max",
            ),
            ("[[rule]]\nmetric = 'psnr'\nbaseline = '2'", "2 %"),
            ("[[rule]]\nmetric = 'psnr'\nchange = { p = 2 }", "rule[0].change.p"),
            (
                "[[rule]]\nmetric = 'psnr'\nchange = { window = 9 }",
                "too short for `p`",
            ),
            (
                "[[rule]]\nmetric = 'psnr'\nmin = 3\nbetter = 'lower'",
                "rule[0].better: which way",
            ),
            ("rule = { metric = 'psnr', min = 3 }", "expected an array"),
            ("no_data_nights = 0", "no_data_nights: must be 1"),
        ] {
            let error = Rules::parse(text).unwrap_err().to_string();
            assert!(error.contains(words), "`{error}` does not say `{words}`");
        }
    }

    #[test]
    fn wildcards() {
        for (pattern, text, fits) in [
            ("*", "", true),
            ("a*c", "abbc", true),
            ("a*c", "abcd", false),
            ("?b*", "abc", true),
            ("*a*b", "xaxbxab", true),
            ("psnr", "psnr.y", false),
            ("", "a", false),
        ] {
            assert_eq!(matches(pattern, text), fits, "{pattern} {text}");
        }
    }
}
