//! Controls of the forms. Each has as its name its place in the request's body, such as `bench.n_timed`.

use super::super::parts;
use crate::{
    metrics::Metric,
    store::Sequence,
    taa::{
        PRESETS,
        recipe::{Kind, Parameter},
    },
};
use maud::{Markup, html};
use serde_json::Value;
use std::fmt::Display;

/// What lies at a place of the body; null where nothing does.
pub fn at<'a>(body: &'a Value, place: &str) -> &'a Value {
    place.split('.').fold(body, |value, name| match name.parse::<usize>() {
        Ok(index) => &value[index],
        Err(_) => &value[name],
    })
}

/// Whether the list at a place has one of these names.
pub fn names<'a>(body: &Value, place: &str, names: impl IntoIterator<Item = &'a str>) -> bool {
    names.into_iter().any(|name| has(at(body, place), &name.into()))
}

/// Whether the knobs at a place are one of these parameters.
pub fn turns(body: &Value, place: &str, parameters: &[Parameter]) -> bool {
    parameters
        .iter()
        .any(|parameter| !at(body, place)[&parameter.name].is_null())
}

/// Whether a list has a value.
fn has(list: &Value, value: &Value) -> bool {
    list.as_array().is_some_and(|list| list.contains(value))
}

pub fn sequence(sequences: &[Sequence], body: &Value) -> Markup {
    let wanted = body["sequence"].as_str().unwrap_or_default();
    let chosen = sequences
        .iter()
        .find(|sequence| [&*sequence.hash, &*sequence.name].contains(&wanted));
    let names = sequences.iter().map(|sequence| {
        let hash = sequence.hash.get(..6).unwrap_or(&sequence.hash);
        let words = format!(
            "{} ({hash}), {} frames, {}",
            sequence.name, sequence.n_frames, sequence.output_size
        );
        (sequence.hash.clone(), words)
    });
    html! {
        div.controls { (parts::select("Sequence", "sequence", names, chosen.map_or("", |sequence| &sequence.hash), None)) }
    }
}

/// Presets with the parameters that are changed of them. The script fills in the parameters.
pub fn recipes(place: &str, note: &str) -> Markup {
    html! {
        fieldset #recipes data-place=(place) { legend { "Recipes" }
            @if !note.is_empty() { p.muted { (note) } }
            div.presets { @for preset in &PRESETS {
                div.preset data-preset=(preset.id) {
                    label { input type="checkbox" value=(preset.id) data-tick="preset"; " " b { (preset.id) } " " span.muted { (preset.description) } }
                    details { summary { "Parameters" } div.parameters {} }
                }
            } }
        }
    }
}

/// Members of a list: value, text, and what it means.
pub fn ticks<'a>(body: &Value, place: &str, values: impl IntoIterator<Item = (&'a str, &'a str)>) -> Markup {
    html! { @for (value, about) in values {
        label title=(about) {
            input type="checkbox" name=(place) data-list value=(value) checked[has(at(body, place), &value.into())]; " " (value)
        }
    } }
}

pub fn metrics(body: &Value, place: &str) -> Markup {
    let all = Metric::ALL
        .iter()
        .map(|metric| (metric.id(), metric.info().description));
    html! { fieldset { legend { "Metrics" } div.ticks { (ticks(body, place, all)) } } }
}

/// A short list of values beside other controls.
pub fn several<'a>(
    label: &str,
    body: &Value,
    place: &str,
    values: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Markup {
    html! { div.several role="group" aria-label=(label) { span { (label) } (ticks(body, place, values)) } }
}

pub fn flag(label: &str, body: &Value, place: &str) -> Markup {
    html! { label.tick { input type="checkbox" name=(place) checked[*at(body, place) == true]; " " (label) } }
}

pub fn choice(label: &str, body: &Value, place: &str, values: impl IntoIterator<Item = &'static str>) -> Markup {
    parts::select(
        label,
        place,
        parts::same(values),
        at(body, place).as_str().unwrap_or_default(),
        None,
    )
}

pub fn text(label: &str, body: &Value, place: &str, hint: &str) -> Markup {
    let value = at(body, place).as_str().unwrap_or_default();
    html! { label { (label) input type="text" name=(place) value=(value) placeholder=(hint) autocomplete="off"; } }
}

/// A whole number from `range`, whose `hint` says what an empty one means.
pub fn number(label: &str, body: &Value, place: &str, range: (impl Display, impl Display), hint: &str) -> Markup {
    let (min, max) = range;
    html! { label { (label) input type="number" name=(place) min=(min) max=(max) value=[at(body, place).as_u64()] placeholder=(hint); } }
}

pub fn origin(body: &Value) -> Markup {
    html! {
        fieldset { legend { "Where it belongs" }
            div.controls {
                (text("Project", body, "project", "default")) (text("Branch", body, "branch", "none"))
                (text("Commit", body, "commit", "none")) (text("Label", body, "label", "none"))
            }
        }
    }
}

/// Values to try of a recipe's parameter: ticked where there are few, else written with commas between them.
pub fn knob(body: &Value, place: &str, parameter: &Parameter) -> Markup {
    let chosen = &at(body, place)[&parameter.name];
    let range = match &parameter.kind {
        Kind::Flag => return of_few(parameter, chosen, &[true.into(), false.into()]),
        Kind::Choice { values } => {
            let values: Vec<Value> = values.iter().map(|value| value.name.clone().into()).collect();
            return of_few(parameter, chosen, &values);
        }
        Kind::Integer(range) | Kind::Number(range) => range,
    };
    let written: Vec<String> = chosen.as_array().into_iter().flatten().map(Value::to_string).collect();
    let unit = parameter
        .unit
        .as_ref()
        .map(|unit| format!("{unit}, "))
        .unwrap_or_default();
    html! {
        label.knob title=(parameter.description) data-knob=(parameter.name) {
            code { (parameter.name) }
            input type="text" inputmode="decimal" value=(written.join(", ")) placeholder="none" autocomplete="off";
            span.muted { (unit) (range) }
        }
    }
}

fn of_few(parameter: &Parameter, chosen: &Value, values: &[Value]) -> Markup {
    html! {
        div.knob role="group" aria-label=(parameter.name) title=(parameter.description) data-knob=(parameter.name) {
            code { (parameter.name) }
            div.several { @for value in values {
                label { input type="checkbox" value=(value) checked[has(chosen, value)]; " " (value.as_str().map_or_else(|| value.to_string(), str::to_owned)) }
            } }
        }
    }
}
