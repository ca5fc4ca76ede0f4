//! `docs/stability.md`: what was asked of every recipe, and what became of it. It has no date and no time, so that the same
//! build on the same adapter writes the same file.

use super::{
    growth::Trend,
    hazards,
    report::{Cell, StressReport, Verdict},
};
use crate::taa::recipe::Guards;
use std::fmt::Write as _;

const INTRODUCTION: &str = "What a cell is and how it is judged is said in [stress.md](stress.md).

`✓` passes, `~` degrades (finite, bounded and recovered, but beyond what is promised), `✗` fails, `·` was not run. Where history
as f16 and as f32 differ, f16 stands first. Errors are in display units: 1 is the range of a display.
";

/// The document, which names the `command` that made it.
pub fn markdown(reports: &[StressReport], command: &str) -> String {
    let mut text = format!("# Numerical stability\n\nMade by `{command}`; do not edit. {INTRODUCTION}");
    for report in reports {
        let adapter = &report.adapter;
        let _ = write!(
            text,
            "\n## {} ({} {})\n\nSeed {}, {} cells: {}.\n",
            adapter.name,
            adapter.driver,
            adapter.driver_version,
            report.seed,
            report.cells.len(),
            counts(&report.cells)
        );
        for (guards, title, words) in [
            (Guards::On, "The matrix", ""),
            (
                Guards::Off,
                "Without guards",
                "The literal formulas (`--guards off`), to show what the guards are for. `✗` is what the publication's formula \
                 does by itself on this adapter.\n\n",
            ),
        ] {
            let cells: Vec<_> = report.cells.iter().filter(|cell| cell.guards == guards).collect();
            if !cells.is_empty() {
                let _ = write!(text, "\n### {title}\n\n{words}{}", matrix(&cells));
                let _ = write!(text, "\n{}", reasons(&cells));
            }
        }
        let guarded: Vec<_> = report.cells.iter().filter(|cell| cell.guards == Guards::On).collect();
        text += &long_runs(&guarded);
    }
    text += &list();
    text
}

fn counts(cells: &[Cell]) -> String {
    let of = |verdict| cells.iter().filter(|cell| cell.verdict == verdict).count();
    let words = [
        (Verdict::Pass, "pass"),
        (Verdict::Degrades, "degrade"),
        (Verdict::Fails, "fail"),
        (Verdict::NotRun, "were not run"),
    ];
    words
        .map(|(verdict, word)| format!("{} {word}", of(verdict)))
        .join(", ")
}

fn mark(verdict: Verdict) -> char {
    match verdict {
        Verdict::Pass => '✓',
        Verdict::Degrades => '~',
        Verdict::Fails => '✗',
        Verdict::NotRun => '·',
    }
}

/// The names in the order of their first use.
fn distinct<'a>(cells: &[&'a Cell], name: impl Fn(&'a Cell) -> &'a str) -> Vec<&'a str> {
    let mut names = Vec::new();
    for cell in cells {
        if !names.contains(&name(cell)) {
            names.push(name(cell));
        }
    }
    names
}

/// Hazards by recipes.
fn matrix(cells: &[&Cell]) -> String {
    let recipes = distinct(cells, |cell| &cell.recipe);
    let mut text = String::from("| |");
    for recipe in &recipes {
        let _ = write!(text, " `{recipe}` |");
    }
    text += "\n|---|";
    text += &"---|".repeat(recipes.len());
    text.push('\n');
    for hazard in distinct(cells, |cell| &cell.hazard) {
        let _ = write!(text, "| `{hazard}` |");
        for recipe in &recipes {
            let of_both = cells
                .iter()
                .filter(|cell| cell.hazard == hazard && cell.recipe == *recipe);
            let mut marks: Vec<char> = of_both.map(|cell| mark(cell.verdict)).collect();
            marks.dedup();
            let _ = write!(text, " {} |", String::from_iter(marks));
        }
        text.push('\n');
    }
    text
}

/// Why cells did not pass: a line for all that have the same reason but for their numbers.
fn reasons(cells: &[&Cell]) -> String {
    let mut text = String::new();
    for hazard in distinct(cells, |cell| &cell.hazard) {
        let of_hazard = cells.iter().filter(|cell| cell.hazard == hazard);
        for cell in of_hazard.filter(|cell| cell.verdict != Verdict::Pass) {
            let _ = writeln!(
                text,
                "- {} `{hazard}` `{}` {}: {}",
                mark(cell.verdict),
                cell.recipe,
                cell.precision.id(),
                cell.reason
            );
        }
    }
    text
}

/// Growth and bounds of what ran long.
fn long_runs(cells: &[&Cell]) -> String {
    let long = cells
        .iter()
        .filter(|cell| cell.bound.is_some() || cell.hazard.starts_with("feedback") && cell.verdict != Verdict::NotRun);
    let mut text = String::from(
        "\n### Growth of error, and what theory allows\n\n| hazard | recipe | history | frames | largest error | steps | trend | \
         measured | bound |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for cell in long {
        let trend = match cell.growth.map(|growth| (growth.trend, growth.rate)) {
            None => "–".to_owned(),
            Some((Trend::Bounded, _)) => "bounded".to_owned(),
            Some((Trend::Linear, rate)) => format!("linear, {rate:.1e} a frame"),
            Some((Trend::Exponential, rate)) => format!("exponential, e^{rate:.1e} a frame"),
        };
        let [measured, bound] = match &cell.bound {
            None => ["–", "–"].map(str::to_owned),
            Some(bound) => [
                format!("{:.1e}", bound.measured),
                format!("{} = {:.1e}", bound.formula, bound.value),
            ],
        };
        let _ = writeln!(
            text,
            "| `{}` | `{}` | {} | {} | {:.1e} | {:.1} | {trend} | {measured} | {bound} |",
            cell.hazard,
            cell.recipe,
            cell.precision.id(),
            cell.n_frames,
            cell.max_error.0,
            cell.max_error_ulps.0,
        );
    }
    text
}

fn list() -> String {
    let mut text = String::from("\n## The hazards\n\n| hazard | what happens | `--quick` |\n|---|---|---|\n");
    for hazard in hazards::all() {
        let quick = if hazard.quick { "yes" } else { "" };
        let _ = writeln!(text, "| `{}` | {} | {quick} |", hazard.id, hazard.about);
    }
    text
}
