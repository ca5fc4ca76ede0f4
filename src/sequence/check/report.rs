//! What the check says: findings, and what it confirmed or could not tell.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// What the check found in a sequence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Report {
    /// The sequence's name.
    pub sequence: String,
    /// Frames that were followed from one to the next; empty where it did not come to that.
    pub frames: Vec<usize>,
    /// What is wrong, or worth knowing; warnings first.
    pub findings: Vec<Finding>,
    /// Conventions that the pixels confirm: every other reading fits worse.
    pub confirmed: Vec<String>,
    /// Conventions that the pixels cannot tell, and why.
    pub undecided: Vec<Undecided>,
}

impl Report {
    /// Whether there is no warning.
    pub fn is_clean(&self) -> bool {
        self.warnings().next().is_none()
    }

    /// The findings that are warnings.
    pub fn warnings(&self) -> impl Iterator<Item = &Finding> {
        self.findings
            .iter()
            .filter(|finding| finding.severity == Severity::Warning)
    }
}

/// Something that looks wrong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Finding {
    /// Stable name, such as `motion.y`.
    pub id: String,
    /// How much it matters.
    pub severity: Severity,
    /// One sentence with the numbers that matter.
    pub message: String,
    /// The numbers.
    pub evidence: BTreeMap<String, f64>,
    /// What to change in the manifest, where that can mend it.
    pub suggestions: Vec<Suggestion>,
}

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Results will be wrong.
    Warning,
    /// Perhaps as meant.
    Note,
}

/// A field of the manifest and the value that fits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Suggestion {
    /// Such as `motion.y`.
    pub field: String,
    /// Such as `"down"`.
    pub value: Value,
}

/// A convention that the pixels do not tell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Undecided {
    /// Such as `motion.y`.
    pub field: String,
    /// Why not.
    pub reason: String,
}

impl Finding {
    /// A warning.
    pub(super) fn warning(id: &str, message: String) -> Self {
        Self {
            id: id.to_owned(),
            severity: Severity::Warning,
            message,
            evidence: BTreeMap::new(),
            suggestions: Vec::new(),
        }
    }

    /// Something that may be as meant.
    pub(super) fn note(id: &str, message: String) -> Self {
        Self {
            severity: Severity::Note,
            ..Self::warning(id, message)
        }
    }

    /// With a number that it rests on.
    pub(super) fn with(mut self, name: &str, value: f64) -> Self {
        // JSON has no infinity and no NaN.
        if value.is_finite() {
            self.evidence.insert(name.to_owned(), value);
        }
        self
    }

    /// With what to change.
    pub(super) fn suggest(mut self, field: impl Into<String>, value: impl Into<Value>) -> Self {
        self.suggestions.push(Suggestion {
            field: field.into(),
            value: value.into(),
        });
        self
    }
}

impl Report {
    pub(super) fn confirm(&mut self, field: &str) {
        self.confirmed.push(field.to_owned());
    }

    pub(super) fn cannot_tell(&mut self, field: &str, reason: impl Into<String>) {
        self.undecided.push(Undecided {
            field: field.to_owned(),
            reason: reason.into(),
        });
    }
}
