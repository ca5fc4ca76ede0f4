//! Findings as Markdown, with their charts and strips as files beside it.

use super::{
    chart,
    finding::{Cell, Entry, Finding, Ordering, Table, Verdict},
    lab::{Effort, Lab},
};
use std::{fmt::Write as _, fs, io, path::Path};

/// Writes `reproduction.md` and the folder `reproduction` of its pictures into `folder`.
pub fn write(folder: &Path, lab: &Lab<'_>, findings: &[Finding]) -> Result<(), io::Error> {
    let pictures = folder.join("reproduction");
    fs::create_dir_all(&pictures)?;
    for finding in findings {
        for chart in &finding.charts {
            fs::write(pictures.join(format!("{}.svg", chart.name)), chart::svg(chart))?;
        }
        for strip in &finding.strips {
            fs::write(pictures.join(format!("{}.png", strip.name)), &strip.png)?;
        }
    }
    fs::write(folder.join("reproduction.md"), markdown(&preface(lab), findings))
}

fn preface(lab: &Lab<'_>) -> String {
    let info = lab.gpu.info();
    let effort = lab.effort;
    let command = match effort == Effort::FULL {
        true => "afterimage paper --pages docs",
        false => "afterimage paper --quick --pages docs",
    };
    let timestamps = if lab.gpu.is_cpu() { ", which is a CPU" } else { "" };
    format!(
        "Made by `{command}` of version {}: every number of ours is measured by that run; what is said of orderings that do not hold \
         was found out before. Adapter: {} ({} {}){timestamps}.\n\n\
         Scenes are our own and only like those published ([scenes.md](scenes.md)): numbers in parentheses are what was \
         published, and only their order can be compared. Frames are {} where nothing else is said, {} of them where something \
         moves, with references of {} samples a pixel. Presets are as `afterimage list presets` has them: no parameter is \
         tuned, and where a publication's choice is changed, the change is named. An ordering *holds* where every pair that the \
         publication has apart stands as there, by more than a difference that means nothing (0.02 to 0.05 dB, 0.0002 of SSIM, \
         as little of others); it is *too close to call* where none stands the other way round; else it *does not hold*, and \
         what was found out about it stands beside it. Which number decides stands in parentheses.",
        env!("CARGO_PKG_VERSION"),
        info.name,
        info.driver,
        info.driver_version,
        effort.extent,
        effort.n_frames,
        effort.reference_samples,
    )
}

fn markdown(preface: &str, findings: &[Finding]) -> String {
    let mut text = format!(
        "# Published results, beside ours\n\n{preface}\n\n{}\n\n",
        count(findings)
    );
    text += "| experiment | source | orderings |\n|---|---|---|\n";
    for finding in findings {
        let (title, source) = (finding.title, finding.source);
        let _ = writeln!(
            text,
            "| [{title}](#{}) | {source} | {} |",
            anchor(finding),
            tally(finding)
        );
    }
    let failing: Vec<&Finding> = findings
        .iter()
        .filter(|finding| failures(finding).count() > 0)
        .collect();
    if !failing.is_empty() {
        text += "\n## What does not hold\n\n";
    }
    for finding in failing {
        for ordering in failures(finding) {
            let _ = writeln!(
                text,
                "- [{}](#{}): {} ({}). {}",
                finding.id,
                anchor(finding),
                ordering.claim,
                ordering.measure,
                reason(ordering)
            );
        }
    }
    for finding in findings {
        section(&mut text, finding);
    }
    text
}

fn section(text: &mut String, finding: &Finding) {
    let _ = write!(
        text,
        "\n## {}\n\n**{}** ({}). {}\n",
        finding.id, finding.title, finding.source, finding.setup
    );
    for table in &finding.tables {
        let _ = write!(text, "\n{}\n\n{}", table.caption, rows(table));
    }
    for chart in &finding.charts {
        let _ = write!(
            text,
            "\n![{0}](reproduction/{1}.svg)\n\n{0}\n",
            chart.caption, chart.name
        );
    }
    for strip in &finding.strips {
        let (labels, name) = (strip.labels.join(" · "), &strip.name);
        let _ = write!(
            text,
            "\n![{labels}](reproduction/{name}.png)\n\n{labels}. {}\n",
            strip.caption
        );
    }
    if !finding.orderings.is_empty() {
        text.push('\n');
    }
    for ordering in &finding.orderings {
        let _ = writeln!(text, "- {}", sentence(ordering));
    }
}

/// GitHub's name for a section's heading.
fn anchor(finding: &Finding) -> String {
    finding.id.replace('.', "")
}

fn failures(finding: &Finding) -> impl Iterator<Item = &Ordering> {
    let fails = |ordering: &&Ordering| ordering.verdict() == Verdict::Fails;
    finding.orderings.iter().filter(fails)
}

/// How many orderings have which verdict, those that none has left out.
fn tally(finding: &Finding) -> String {
    if finding.orderings.is_empty() {
        return "numbers only".to_owned();
    }
    let count = |wanted| finding.orderings.iter().filter(|it| it.verdict() == wanted).count();
    let parts = [
        (count(Verdict::Holds), "as published"),
        (count(Verdict::Close), "too close to call"),
        (count(Verdict::Fails), "not"),
    ];
    let parts = parts
        .iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, word)| format!("{n} {word}"));
    parts.collect::<Vec<_>>().join(", ")
}

/// How many orderings of all findings have which verdict.
pub fn count(findings: &[Finding]) -> String {
    let verdicts = || {
        findings
            .iter()
            .flat_map(|finding| &finding.orderings)
            .map(Ordering::verdict)
    };
    let of = |wanted: Verdict| verdicts().filter(|verdict| *verdict == wanted).count();
    format!(
        "{} orderings: {} hold, {} are too close to call, {} do not hold.",
        verdicts().count(),
        of(Verdict::Holds),
        of(Verdict::Close),
        of(Verdict::Fails)
    )
}

/// An ordering, its numbers and its verdict in one paragraph.
pub fn sentence(ordering: &Ordering) -> String {
    let verdict = ordering.verdict();
    let mut text = format!(
        "**{}**: {} ({}): {}.",
        word(verdict),
        ordering.claim,
        ordering.measure,
        listed(&ordering.entries, true)
    );
    if verdict != Verdict::Fails {
        return text;
    }
    let reversed = ordering.reversed(&ordering.entries);
    let n_claimed = ordering.n_claimed();
    let names = reversed.iter().map(|&(a, b)| {
        let name = |index: usize| &ordering.entries[index].system;
        format!("{} is ahead of {}", name(b), name(a))
    });
    let _ = write!(text, " Here {}", names.collect::<Vec<_>>().join(", "));
    if n_claimed > 1 {
        let _ = write!(text, " ({} of {n_claimed} pairs)", reversed.len());
    }
    text.push('.');
    for trial in &ordering.trials {
        let verdict = word(ordering.verdict_of(&trial.entries));
        let _ = write!(
            text,
            " Tried: {}; then it {verdict}: {}.",
            trial.change,
            listed(&trial.entries, false)
        );
    }
    let _ = write!(text, " {}", reason(ordering));
    text
}

fn reason(ordering: &Ordering) -> &str {
    match ordering.reason {
        "" => "Why was not found out.",
        reason => reason,
    }
}

/// Systems and their numbers, best first as published.
fn listed(entries: &[Entry], with_published: bool) -> String {
    let entry = |entry: &Entry| match entry.published.filter(|_| with_published) {
        Some(published) => format!("{} {} ({published})", entry.system, number(entry.ours)),
        None => format!("{} {}", entry.system, number(entry.ours)),
    };
    entries.iter().map(entry).collect::<Vec<_>>().join(", ")
}

/// The verdict as a reader sees it.
pub fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::Close => "is too close to call",
        Verdict::Fails => "does not hold",
    }
}

fn rows(table: &Table) -> String {
    let mut text = format!(
        "| | {} |\n|---|{}\n",
        table.columns.join(" | "),
        "---:|".repeat(table.columns.len())
    );
    for (name, cells) in &table.rows {
        let cells: Vec<String> = cells.iter().map(|cell| cell.to_string()).collect();
        let _ = writeln!(text, "| {name} | {} |", cells.join(" | "));
    }
    text
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.ours, self.published) {
            (Some(ours), Some(published)) => write!(f, "{} ({published})", number(ours)),
            (Some(ours), None) => f.write_str(&number(ours)),
            (None, Some(published)) => write!(f, "({published})"),
            (None, None) => f.write_str("–"),
        }
    }
}

/// Four significant digits, never fewer than those before the point.
fn number(value: f64) -> String {
    if !value.is_finite() {
        return if value.is_nan() {
            "NaN"
        } else if value > 0.0 {
            "∞"
        } else {
            "−∞"
        }
        .to_owned();
    }
    let n_before = if value == 0.0 {
        1.0
    } else {
        libm::log10(value.abs()).floor() + 1.0
    };
    let n_decimals = (4.0 - n_before).clamp(0.0, 6.0) as usize;
    format!("{value:.n_decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::finding::Trial;

    fn entries(values: [f64; 2]) -> Vec<Entry> {
        let named = [("a", 2.0), ("b", 1.0)].into_iter().zip(values);
        let entry = |((system, published), ours): ((&str, f64), f64)| Entry {
            system: system.to_owned(),
            ours,
            published: Some(published),
        };
        named.map(entry).collect()
    }

    fn ordering(values: [f64; 2]) -> Ordering {
        Ordering {
            claim: "a over b".to_owned(),
            measure: "dB",
            higher_is_better: true,
            tie: 0.0,
            entries: entries(values),
            trials: vec![Trial {
                change: "another light".to_owned(),
                entries: entries([8.0, 7.0]),
            }],
            reason: "The light.",
        }
    }

    #[test]
    fn a_planted_wrong_order_says_so_with_what_was_tried_and_why() {
        let text = sentence(&ordering([1.0, 3.0]));
        assert_eq!(
            text,
            "**does not hold**: a over b (dB): a 1.000 (2), b 3.000 (1). Here b is ahead of a. \
             Tried: another light; then it holds: a 8.000, b 7.000. The light."
        );
        let text = sentence(&ordering([3.0, 1.0]));
        assert_eq!(text, "**holds**: a over b (dB): a 3.000 (2), b 1.000 (1).");
    }

    #[test]
    fn what_was_not_found_out_is_said() {
        let it = Ordering {
            reason: "",
            ..ordering([1.0, 3.0])
        };
        assert!(sentence(&it).ends_with("Why was not found out."));
    }

    #[test]
    fn numbers_have_four_digits() {
        let shown = [0.0, 0.01234567, 1.0, 21.34567, 1387.4, f64::INFINITY, f64::NAN].map(number);
        assert_eq!(shown, ["0.000", "0.01235", "1.000", "21.35", "1387", "∞", "NaN"]);
    }
}
