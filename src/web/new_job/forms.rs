//! A form for each kind of job.

use super::{Kind, fields};
use crate::{bench, metrics::Metric, run::MAX_REPEAT, store::Sequence, stress, taa::recipe::parameters};
use maud::{Markup, html};
use serde_json::Value;

pub fn form(kind: Kind, sequences: &[Sequence], body: &Value) -> Markup {
    html! {
        form #job {
            @match kind {
                Kind::Run => (run(sequences, body)),
                Kind::Bench => (bench(sequences, body)),
                Kind::Stress => (stress(body)),
                Kind::Comparison => (comparison(body)),
            }
            button.main { "Start" }
        }
    }
}

fn run(sequences: &[Sequence], body: &Value) -> Markup {
    html! {
        (fields::sequence(sequences, body))
        (fields::recipes("presets", ""))
        (fields::metrics(body, "metrics"))
        fieldset { legend { "How" }
            div.controls {
                (fields::choice("History", body, "history", ["f16", "f32"]))
                (fields::choice("Images kept", body, "images", ["half", "float", "none"]))
                (fields::choice("Tiles that repeat", body, "skip", ["off", "exact"]))
                (fields::number("Each pass timed", body, "repeat", (1, MAX_REPEAT), "once"))
                (fields::number("Only the first frames", body, "frames", (1, ""), "all"))
                (fields::text("End when known", body, "until", "psnr±0.05, or never"))
            }
            div.controls {
                (fields::flag("hold against the twin", body, "validate"))
                (fields::flag("and find the pass that is wrong", body, "bisect"))
                (fields::flag("even where the same ran before", body, "force"))
            }
        }
        (fields::origin(body))
    }
}

fn bench(sequences: &[Sequence], body: &Value) -> Markup {
    const KNOBS: &str = "bench.knobs";
    html! {
        (fields::sequence(sequences, body))
        (fields::recipes("bench.presets", ""))
        fieldset #knobs data-place=(KNOBS) { legend { "Knobs" }
            p.muted { "Values to try, several with commas between them; every combination of them is measured with every recipe. Settings that make no sense are left out." }
            div.parameters { @for knob in bench::knobs() { (fields::knob(body, KNOBS, &knob)) } }
            details open[fields::turns(body, KNOBS, parameters())] { summary { "Parameters of recipes" }
                div.parameters { @for parameter in parameters() { (fields::knob(body, KNOBS, parameter)) } }
            }
        }
        (fields::metrics(body, "bench.metrics"))
        fieldset { legend { "How" }
            div.controls {
                (fields::choice("Front drawn on", body, "bench.metric", Metric::ALL.iter().map(|metric| metric.id())))
                (fields::choice("History", body, "bench.history", ["f16", "f32"]))
                (fields::number("Frames timed, at least", body, "bench.n_timed", (bench::LEAST_TIMED, bench::MOST_TIMED), ""))
                (fields::number("Only the first frames", body, "bench.n_frames", (1, ""), "all"))
            }
        }
        (fields::origin(body))
        p { "Makes " output #count { "–" } " settings, of at most " (bench::MAX_SETTINGS) "." }
    }
}

fn stress(body: &Value) -> Markup {
    const HAZARDS: &str = "stress.hazards";
    let mut families: Vec<(&str, Vec<&stress::Hazard>)> = Vec::new();
    for hazard in stress::hazards() {
        let family = hazard.id.split('.').next().unwrap_or(hazard.id);
        match families.last_mut() {
            Some((last, hazards)) if *last == family => hazards.push(hazard),
            _ => families.push((family, vec![hazard])),
        }
    }
    html! {
        (fields::recipes("stress.presets", "Every recipe where none is ticked."))
        fieldset #hazards { legend { "Hazards" }
            p.muted { "All where none is ticked, or with \"quick\" those marked by ·." }
            div.hazards { @for (family, hazards) in &families {
                @let quick = hazards.iter().filter(|hazard| hazard.quick).count();
                details open[fields::names(body, HAZARDS, hazards.iter().map(|hazard| hazard.id))] {
                    summary { (family) span.muted { " " (hazards.len()) } }
                    label { input type="checkbox" name=(HAZARDS) data-list data-family value=(family) checked[fields::names(body, HAZARDS, [*family])] data-n=(hazards.len()) data-quick=(quick); " all of them" }
                    @for hazard in hazards {
                        label { input type="checkbox" name=(HAZARDS) data-list value=(hazard.id) checked[fields::names(body, HAZARDS, [hazard.id])] data-n="1";
                            " " b { (hazard.id) } @if hazard.quick { " ·" } " " span.muted { (hazard.about) } }
                    }
                }
            } }
        }
        fieldset { legend { "How" }
            div.controls {
                (fields::several("History", body, "stress.precisions", [("f16", "rounded to half floats"), ("f32", "single precision")]))
                (fields::several("Guards", body, "stress.guards", [("on", "with what makes recipes stable"), ("off", "the literal formulas")]))
                (fields::flag("quick: fewer hazards, fewer frames", body, "stress.quick"))
                (fields::flag("every frame, even where the state repeats", body, "stress.every_frame"))
            }
            div.controls {
                (fields::number("Width, pixels", body, "stress.size.0", (1, stress::MAX_SIDE), "the hazard's"))
                (fields::number("Height, pixels", body, "stress.size.1", (1, stress::MAX_SIDE), "the hazard's"))
                (fields::number("Frames", body, "stress.n_frames", (1, stress::MAX_FRAMES), "the hazard's"))
                (fields::number("Seed", body, "stress.seed", (0, u32::MAX), ""))
            }
        }
        (fields::origin(body))
        p { "Makes " output #count { "–" } " cells." }
    }
}

/// The request as it is: a form that asked for hashes would help nobody.
fn comparison(body: &Value) -> Markup {
    html! {
        p { "Compares images that another system rendered with a sequence's reference. The files go first, each with a request of its own to "
            a href="/api#putBlob" { "PUT /blobs/<its SHA-256>" } "; the request here then names their hashes, frame by frame. There is no form for it: "
            "what has rendered the images can send them, and knows the hashes." }
        label { "Request" textarea name="" rows="16" spellcheck="false" { (serde_json::to_string_pretty(body).unwrap_or_default()) } }
    }
}
