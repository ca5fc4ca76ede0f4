//! From presets and knobs to settings: every combination that makes sense.

use super::{BenchError, BenchSpec};
use crate::{
    gpu::Workgroup,
    run::{PresetSpec, Unfit, admits},
    sequence::Sequence,
    taa::{
        Options, Precision, Preset, Recipe, Skip,
        recipe::{Choice, Kind, Parameter},
    },
};
use serde_json::{Map, Value};

/// What can be turned beside the parameters of a recipe.
const HISTORY: &str = "history";
const WORKGROUP: &str = "workgroup";
const WORKGROUP_MEMORY: &str = "workgroup_memory";
const SKIP: &str = "skip";

/// The most settings of one benchmark; more would take a day.
pub const MAX_SETTINGS: usize = 512;

/// What can be turned beside the parameters of a recipe, described as those are, with the values worth trying.
pub fn knobs() -> [Parameter; 4] {
    let choices = |name: &str, description: &str, values: &[&str]| {
        let value = |name: &&str| Choice {
            name: (*name).to_owned(),
            description: String::new(),
        };
        Parameter {
            name: name.to_owned(),
            description: description.to_owned(),
            unit: None,
            kind: Kind::Choice {
                values: values.iter().map(value).collect(),
            },
            default: Value::Null,
        }
    };
    let shapes = Workgroup::CANDIDATES.map(|shape| shape.to_string());
    let shapes: Vec<&str> = shapes.iter().map(String::as_str).collect();
    [
        choices(HISTORY, "How history is stored", &["f16", "f32"]),
        choices(SKIP, "Which work may be left out", &["off", "exact"]),
        choices(WORKGROUP, "Invocations of a workgroup, columns by rows", &shapes),
        Parameter {
            kind: Kind::Flag,
            ..choices(
                WORKGROUP_MEMORY,
                "Whether neighbours are shared through workgroup memory",
                &[],
            )
        },
    ]
}

/// One combination, ready to run.
#[derive(Clone, Debug)]
pub struct Setting {
    pub preset: String,
    /// What differs from the preset: overridden parameters and knobs.
    pub parameters: Map<String, Value>,
    /// As a run would write it.
    pub spec: PresetSpec,
    pub recipe: Recipe,
    pub options: Options,
    /// The adapter's own where it is left out.
    pub workgroup: Option<Workgroup>,
    /// As [`crate::gpu::Variant::workgroup_memory`].
    pub workgroup_memory: Option<bool>,
}

impl Setting {
    /// Preset and what differs from it, for people.
    pub fn name(preset: &str, parameters: &Map<String, Value>) -> String {
        let mut name = preset.to_owned();
        for (parameter, value) in parameters {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            name += &format!(" {parameter}={text}");
        }
        name
    }
}

/// The settings of `spec` that can run on `sequence`, and why the others cannot.
pub fn settings(spec: &BenchSpec, sequence: &Sequence) -> Result<(Vec<Setting>, Vec<String>), BenchError> {
    if spec.presets.is_empty() {
        return Err(BenchError::input("presets", "name at least one".to_owned()));
    }
    if let Some((knob, _)) = spec.knobs.iter().find(|(_, values)| values.is_empty()) {
        return Err(BenchError::input(
            "knobs",
            format!("`{knob}` has no values; give at least one"),
        ));
    }
    let (mut settings, mut left_out) = (Vec::new(), Vec::new());
    let n_settings = spec.knobs.values().map(Vec::len).product::<usize>() * spec.presets.len();
    if n_settings > MAX_SETTINGS {
        return Err(BenchError::input(
            "knobs",
            format!("make {n_settings} settings, more than {MAX_SETTINGS}; turn fewer at once"),
        ));
    }
    for preset in &spec.presets {
        for knobs in combinations(&spec.knobs) {
            let mut parameters = preset.parameters.clone();
            parameters.extend(knobs);
            let name = Setting::name(&preset.preset, &parameters);
            match setting(&preset.preset, parameters, spec, sequence)? {
                Ok(setting) => settings.push(setting),
                Err(reason) => left_out.push(format!("{name}: {reason}")),
            }
        }
    }
    match settings.is_empty() {
        true => Err(BenchError::input(
            "presets",
            format!("none can run: {}", left_out.join("; ")),
        )),
        false => Ok((settings, left_out)),
    }
}

/// Every way to choose a value for each knob, the last knob turning fastest.
fn combinations(knobs: &std::collections::BTreeMap<String, Vec<Value>>) -> Vec<Map<String, Value>> {
    knobs.iter().fold(vec![Map::new()], |all, (knob, values)| {
        let with = |so_far: &Map<String, Value>, value: &Value| {
            let mut more = so_far.clone();
            more.insert(knob.clone(), value.clone());
            more
        };
        all.iter()
            .flat_map(|so_far| values.iter().map(move |value| with(so_far, value)))
            .collect()
    })
}

/// A setting; inside, why it makes no sense; outside, what is wrong with the request.
fn setting(
    preset: &str,
    parameters: Map<String, Value>,
    spec: &BenchSpec,
    sequence: &Sequence,
) -> Result<Result<Setting, String>, BenchError> {
    let mut of_recipe = parameters.clone();
    let precision = knob::<Precision>(&mut of_recipe, HISTORY)?.unwrap_or(spec.history);
    let workgroup = knob::<Workgroup>(&mut of_recipe, WORKGROUP)?;
    let workgroup_memory = knob::<bool>(&mut of_recipe, WORKGROUP_MEMORY)?;
    let skip = knob::<Skip>(&mut of_recipe, SKIP)?.unwrap_or_default();
    let base = &Preset::find(preset)
        .map_err(|error| BenchError::input("presets", error.to_string()))?
        .recipe;
    let known = base.to_json();
    if let Some(unknown) = of_recipe.keys().find(|name| known.get(name.as_str()).is_none()) {
        let others = knobs().map(|knob| format!("`{}`", knob.name)).join(", ");
        let message = format!("`{unknown}` is no knob: there are {others}, and the parameters of a recipe");
        return Err(BenchError::input("knobs", message));
    }
    let recipe = match base
        .with(&of_recipe)
        .and_then(|recipe| recipe.check_gpu().map(|()| recipe))
    {
        Ok(recipe) => recipe,
        Err(reason) => return Ok(Err(reason.to_string())),
    };
    Ok(admits(sequence, &recipe)
        .map(|()| Setting {
            preset: preset.to_owned(),
            spec: PresetSpec {
                preset: preset.to_owned(),
                parameters: of_recipe,
            },
            parameters,
            recipe,
            options: Options { precision, skip },
            workgroup,
            workgroup_memory,
        })
        .map_err(|reason: Unfit| format!("{preset} {reason}")))
}

/// Takes a knob that is no parameter of a recipe.
fn knob<T: serde::de::DeserializeOwned>(
    parameters: &mut Map<String, Value>,
    name: &str,
) -> Result<Option<T>, BenchError> {
    let value = parameters.remove(name);
    value
        .map(|value| serde_json::from_value(value).map_err(|error| BenchError::input(name, error.to_string())))
        .transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knobs_combine_with_each_other() {
        let knobs = [
            ("a", vec![1.into(), 2.into()]),
            ("b", vec!["x".into(), "y".into(), "z".into()]),
        ];
        let knobs = knobs.map(|(name, values)| (name.to_owned(), values)).into();
        let all = combinations(&knobs);
        assert_eq!(all.len(), 6);
        let names: Vec<_> = all.iter().map(|one| Setting::name("ema", one)).collect();
        assert_eq!(names[1], "ema a=1 b=y");
        assert_eq!(names[5], "ema a=2 b=z");
    }
}
