//! What a validation found, on the screen.

use super::table;
use afterimage::{
    run::report::Report,
    taa::validation::{Bisection, Overview, Validation},
};

/// Of every preset; nothing where none was asked for.
pub fn show(report: &Report) -> String {
    let validated = report
        .reports
        .iter()
        .filter_map(|preset| Some((preset.preset.as_str(), preset.validation.as_ref()?)));
    let mut header = ["preset", "what", "verdict"].map(str::to_owned).to_vec();
    header.extend(
        [
            "max |Δ|",
            "mean |Δ|",
            "beyond",
            "undetermined",
            "not finite",
            "frames wrong",
            "first",
            "worst",
        ]
        .map(str::to_owned),
    );
    let mut rows = table::new(header, 3);
    let mut rest = String::new();
    let mut n_validated = 0;
    for (preset, validation) in validated {
        n_validated += 1;
        let shown = if validation.frame_bounds.is_some() {
            "frames"
        } else {
            "frames (measured)"
        };
        for (what, overview) in [(shown, &validation.shown)]
            .into_iter()
            .chain(validation.passes.iter().map(|pass| (pass.name.as_str(), pass)))
        {
            rows.add_row([vec![preset.to_owned(), what.to_owned()], row(overview)].concat());
        }
        rest += &verdict(preset, validation);
    }
    match n_validated {
        0 => String::new(),
        _ => format!("\nAgainst the twin in f64, in shares of the display's range:\n{rows}\n{rest}"),
    }
}

fn row(found: &Overview) -> Vec<String> {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    let worst = found.worst.as_ref().zip(found.worst_frame);
    vec![
        if found.agrees { "agrees" } else { "DISAGREES" }.to_owned(),
        format!("{:.1e}", found.max),
        format!("{:.1e}", found.mean),
        found.n_beyond.to_string(),
        found.n_undetermined.to_string(),
        format!("{}/{}", found.non_finite_gpu, found.non_finite_twin),
        found.n_disagreeing_frames.to_string(),
        or_dash(found.first_disagreeing_frame.map(|frame| frame.to_string())),
        or_dash(worst.map(|(worst, frame)| {
            let [x, y] = worst.pixel;
            format!("frame {frame}, {}({x}, {y})", worst.image)
        })),
    ]
}

fn verdict(preset: &str, validation: &Validation) -> String {
    let bounds = validation.pass_bounds;
    let mut text = match validation.agrees {
        true => format!("{preset}: the adapter agrees with the twin\n"),
        false => format!(
            "{preset}: the adapter DISAGREES: more than {:.0e} in over {} % of a frame's pixels, or {:.0e} on average\n",
            bounds.max,
            bounds.share_beyond * 100.0,
            bounds.mean
        ),
    };
    if validation.frame_bounds.is_none() {
        text += &format!(
            "{preset}: frames are measured, and nothing is promised of them with 16-bit history; `--history f32` is\n"
        );
    }
    if let Some(bisection) = &validation.bisection {
        text += &culprit(preset, bisection);
    }
    text
}

fn culprit(preset: &str, bisection: &Bisection) -> String {
    let mut text = match (&bisection.pass, bisection.frame) {
        (Some(pass), Some(frame)) => format!("{preset}: `{pass}` is wrong, first in frame {frame}\n"),
        _ => format!("{preset}: every pass agrees with its twin; their errors add up over frames\n"),
    };
    for swap in &bisection.swaps {
        let (n, max) = (swap.n_disagreeing_frames, swap.max);
        text += &format!(
            "{preset}: with the twin's `{}`, {n} frames shown disagree, by up to {max:.1e}\n",
            swap.name
        );
    }
    text
}
