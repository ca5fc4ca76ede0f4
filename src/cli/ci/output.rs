//! The outcome for people and for other programs.

use super::{Judging, Measured, Results};
use crate::cli::{JsonTarget, print, table};
use afterimage::verdict::{Check, Outcome};
use anyhow::Context;
use std::{fmt::Write as _, fs, io::Write as _};

/// Says it wherever it was asked for.
pub fn write(results: &Results, judging: &Judging) -> anyhow::Result<()> {
    if let Some(path) = &judging.junit {
        fs::write(path, junit(results)).with_context(|| format!("--junit {}", path.display()))?;
    }
    if let Some(path) = &judging.markdown {
        let file = fs::OpenOptions::new().create(true).append(true).open(path);
        file.and_then(|mut file| file.write_all(markdown(results).as_bytes()))
            .with_context(|| format!("--markdown {}", path.display()))?;
    }
    if let Some(target) = &judging.json {
        target.write(results)?;
    }
    if !JsonTarget::takes_stdout(judging.json.as_ref()) {
        print(&screen(results));
    }
    Ok(())
}

fn word(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Ok => "ok",
        Outcome::Unknown => "could not tell",
        Outcome::Regression => "regression",
    }
}

/// The report that a check speaks of.
fn report<'a>(results: &'a Results, check: &Check) -> Option<&'a Measured> {
    results
        .reports
        .iter()
        .rfind(|report| report.sequence == check.sequence && report.recipe == check.recipe)
}

fn commits(check: &Check) -> String {
    let finding = &check.finding;
    match (&finding.last_good_commit, &finding.first_bad_commit) {
        (Some(good), Some(bad)) => format!("{good}..{bad}"),
        (None, Some(bad)) => bad.clone(),
        _ => String::new(),
    }
}

fn frames(check: &Check) -> String {
    let indices: Vec<String> = check.finding.worst_frames.iter().map(ToString::to_string).collect();
    indices.join(", ")
}

fn screen(results: &Results) -> String {
    let header = [
        "sequence",
        "recipe",
        "metric",
        "check",
        "outcome",
        "what",
        "worst frames",
        "commits",
    ];
    let mut table = table::new(header.map(str::to_owned).to_vec(), 8);
    let mut checks: Vec<&Check> = results.checks.iter().collect();
    checks.sort_by_key(|check| std::cmp::Reverse(check.outcome));
    for check in checks {
        table.add_row(vec![
            check.sequence.clone(),
            check.recipe.clone(),
            check.metric.clone(),
            check.kind.id().to_owned(),
            word(check.outcome).to_owned(),
            check.detail.clone(),
            frames(check),
            commits(check),
        ]);
    }
    let summary = match results.checks.len() {
        0 => "no rule matches any result".to_owned(),
        n => format!("{} of {n} checks", word(results.outcome)),
    };
    let mut text = format!("{table}\n{summary}\n");
    for report in results.reports.iter().filter_map(|report| report.page.as_ref()) {
        let _ = writeln!(text, "{report}");
    }
    text
}

/// Text within XML; characters that XML does not have are left out.
fn xml(text: &str) -> String {
    let is_allowed = |c: &char| !c.is_control() || matches!(c, '\n' | '\t');
    text.chars().filter(is_allowed).fold(String::new(), |mut escaped, c| {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c => escaped.push(c),
        }
        escaped
    })
}

fn junit(results: &Results) -> String {
    let count = |outcome| results.checks.iter().filter(|check| check.outcome == outcome).count();
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        text,
        "<testsuites><testsuite name=\"afterimage\" tests=\"{}\" failures=\"{}\" skipped=\"{}\">",
        results.checks.len(),
        count(Outcome::Regression),
        count(Outcome::Unknown)
    );
    for check in &results.checks {
        let class = format!("{}.{}", check.sequence, check.recipe);
        let _ = write!(
            text,
            "<testcase classname=\"{}\" name=\"{} {}\">",
            xml(&class),
            xml(&check.metric),
            check.kind.id()
        );
        let mut detail = check.detail.clone();
        for (name, value) in [("worst frames", frames(check)), ("commits", commits(check))] {
            if !value.is_empty() {
                let _ = write!(detail, "; {name} {value}");
            }
        }
        let element = match check.outcome {
            Outcome::Ok => None,
            Outcome::Unknown => Some("skipped"),
            Outcome::Regression => Some("failure"),
        };
        if let Some(element) = element {
            let _ = write!(text, "<{element} message=\"{}\"/>", xml(&detail));
        }
        text.push_str("</testcase>\n");
    }
    text.push_str("</testsuite></testsuites>\n");
    text
}

/// Text within a cell.
fn cell(text: &str) -> String {
    text.replace('\\', "\\\\")
        .replace('|', "\\|")
        .replace('<', "&lt;")
        .replace(['\n', '\r'], " ")
}

fn markdown(results: &Results) -> String {
    let title = match results.outcome {
        Outcome::Ok => "✅ Afterimage: no regression",
        Outcome::Unknown => "❔ Afterimage: could not tell",
        Outcome::Regression => "❌ Afterimage: regression",
    };
    let of = |outcome| -> Vec<&Check> {
        let checks = results.checks.iter();
        checks.filter(|check| check.outcome == outcome).collect()
    };
    let mut text = format!("### {title}\n\n");
    let bad = of(Outcome::Regression);
    if !bad.is_empty() {
        text += &rows(results, &bad);
        text.push('\n');
        text += &pictures(results, &bad);
    }
    for (outcome, words) in [(Outcome::Unknown, "could not be told"), (Outcome::Ok, "good")] {
        let checks = of(outcome);
        if !checks.is_empty() {
            // What the title speaks of is not hidden.
            let open = if outcome == results.outcome && outcome != Outcome::Ok {
                " open"
            } else {
                ""
            };
            let _ = write!(
                text,
                "<details{open}><summary>{}: {words}</summary>\n\n{}\n</details>\n\n",
                checks.len(),
                rows(results, &checks)
            );
        }
    }
    text
}

fn rows(results: &Results, checks: &[&Check]) -> String {
    let mut text =
        String::from("| sequence | recipe | metric | outcome | what | commits |\n|---|---|---|---|---|---|\n");
    for check in checks {
        let metric = match report(results, check).and_then(|report| report.page.as_ref()) {
            Some(page) => format!("[{}]({page})", cell(&check.metric)),
            None => cell(&check.metric),
        };
        let _ = writeln!(
            text,
            "| {} | {} | {metric} | {} | {} | {} |",
            cell(&check.sequence),
            cell(&check.recipe),
            word(check.outcome),
            cell(&check.detail),
            cell(&commits(check))
        );
    }
    text
}

/// The worst frame of each report that has a regression, where a service can show it: output and error beside each other.
fn pictures(results: &Results, bad: &[&Check]) -> String {
    let mut text = String::new();
    let mut shown = std::collections::BTreeSet::new();
    for check in bad {
        let found = report(results, check).and_then(|report| report.report);
        let (Some(server), Some(id), Some(frame)) = (&results.server, found, check.finding.worst_frames.first()) else {
            continue;
        };
        if !shown.insert((id, frame)) || shown.len() > 8 {
            continue;
        }
        let base = format!("{server}/api/v1/reports/{id}/frames/{frame}");
        let page = format!("{server}/reports/{id}/frames/{frame}");
        let _ = writeln!(
            text,
            "{}, {}, frame {frame}:\n\n[![output]({base}/output.png)]({page}) [![error]({base}/error.png)]({page})\n",
            cell(&check.sequence),
            cell(&check.recipe)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use afterimage::{
        run::report::AdapterInfo,
        verdict::{Finding, Kind},
    };
    use std::collections::BTreeMap;

    fn results() -> Results {
        let check = |metric: &str, outcome| Check {
            series_id: Some(3),
            sequence: "ship <night>".to_owned(),
            recipe: "ema|x".to_owned(),
            metric: metric.to_owned(),
            kind: Kind::Limit,
            outcome,
            detail: "29 is below 30 & bad".to_owned(),
            finding: Finding {
                worst_frames: vec![7, 3],
                first_bad_commit: Some("bad".to_owned()),
                last_good_commit: Some("good".to_owned()),
                ..Finding::default()
            },
        };
        let text = String::new;
        Results {
            outcome: Outcome::Regression,
            checks: vec![check("psnr", Outcome::Regression), check("ssim", Outcome::Unknown)],
            reports: vec![Measured {
                sequence: "ship <night>".to_owned(),
                recipe: "ema|x".to_owned(),
                settings: super::super::Settings::default(),
                adapter: AdapterInfo {
                    name: text(),
                    backend: text(),
                    kind: text(),
                    driver: text(),
                    driver_version: text(),
                },
                values: BTreeMap::new(),
                metric_versions: BTreeMap::new(),
                page: Some("http://h/jobs/1?preset=0".to_owned()),
                report: Some(5),
            }],
            server: Some("http://h".to_owned()),
        }
    }

    #[test]
    fn junit_is_well_formed_and_counts() {
        let text = junit(&results());
        assert!(text.contains("tests=\"2\" failures=\"1\" skipped=\"1\""), "{text}");
        assert!(text.contains("classname=\"ship &lt;night&gt;.ema|x\""), "{text}");
        assert!(
            text.contains("<failure message=\"29 is below 30 &amp; bad; worst frames 7, 3; commits good..bad\"/>"),
            "{text}"
        );
    }

    #[test]
    fn markdown_opens_on_the_worst_frame() {
        let text = markdown(&results());
        assert!(text.starts_with("### ❌"), "{text}");
        assert!(
            text.contains("| ship &lt;night> | ema\\|x | [psnr](http://h/jobs/1?preset=0) | regression |"),
            "{text}"
        );
        assert!(text.contains("http://h/api/v1/reports/5/frames/7/error.png"), "{text}");
        assert!(
            text.contains("<details><summary>1: could not be told</summary>"),
            "{text}"
        );

        let told = markdown(&Results {
            outcome: Outcome::Unknown,
            ..results()
        });
        assert!(
            told.contains("<details open><summary>1: could not be told</summary>"),
            "{told}"
        );
    }
}
