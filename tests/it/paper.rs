//! `afterimage paper`: its list, its numbers where they are known, its JSON, its page, and that an ordering can fail.

use afterimage::paper::{
    finding::{Entry, Ordering, Trial, Verdict},
    page,
};
use serde_json::Value;
use std::{
    collections::BTreeSet,
    fs,
    path::Path,
    process::{Command, Output},
};

/// Runs the command with a cache of its own.
fn paper(cache: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_afterimage"))
        .env("AFTERIMAGE_CACHE", cache)
        .arg("paper")
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn succeed(cache: &Path, arguments: &[&str]) -> String {
    let output = paper(cache, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

fn entries(values: &[(f64, Option<f64>)]) -> Vec<Entry> {
    let entry = |(index, &(ours, published)): (usize, &(f64, Option<f64>))| Entry {
        system: format!("system {index}"),
        ours,
        published,
    };
    values.iter().enumerate().map(entry).collect()
}

fn ordering(values: &[(f64, Option<f64>)]) -> Ordering {
    Ordering {
        claim: "the order of the table".to_owned(),
        measure: "PSNR, dB",
        higher_is_better: true,
        tie: 0.05,
        entries: entries(values),
        trials: vec![Trial {
            change: "neither is sharpened".to_owned(),
            entries: entries(&[(41.0, Some(40.0)), (36.0, Some(35.0))]),
        }],
        reason: "Sharpening.",
    }
}

#[test]
fn every_subject_of_the_five_publications_is_listed_once() {
    let cache = tempfile::tempdir().unwrap();
    let listed = succeed(cache.path(), &["--list"]);
    let ids: Vec<&str> = listed.lines().collect();
    let unique: BTreeSet<&str> = ids.iter().copied().collect();
    assert_eq!(unique.len(), ids.len(), "{listed}");
    // Tables 4.1, 5.1 and 5.2 to 5.13; table 2 with figures 3 and 4, and figure 5; figures 4, 8, 9, 11 and table 1.
    for (publication, n) in [
        ("thesis.", 14),
        ("phlm.", 3),
        ("survey.", 5),
        ("salvi.", 7),
        ("inside.", 4),
    ] {
        let found = ids.iter().filter(|id| id.starts_with(publication)).count();
        assert_eq!(found, n, "{publication}: {listed}");
    }
    let salvi = succeed(cache.path(), &["--list", "--only", "salvi,inside.clip"]);
    assert_eq!(salvi.lines().count(), 8, "{salvi}");
    assert_eq!(fs::read_dir(cache.path()).unwrap().count(), 0, "a list bakes nothing");
}

#[test]
fn an_unknown_subject_is_refused_before_anything_runs() {
    let cache = tempfile::tempdir().unwrap();
    let output = paper(cache.path(), &["--only", "salvi,thesis.teapot"]);
    assert_eq!(output.status.code(), Some(2));
    let complaint = text(&output.stderr);
    assert!(
        complaint.contains("thesis.teapot") && complaint.contains("--list"),
        "{complaint}"
    );
    assert!(output.stdout.is_empty() && fs::read_dir(cache.path()).unwrap().count() == 0);
}

#[test]
fn a_planted_wrong_order_does_not_hold() {
    let right = ordering(&[(40.0, Some(47.0)), (38.0, Some(46.0)), (30.0, Some(36.0))]);
    assert_eq!(right.verdict(), Verdict::Holds);
    let sentence = page::sentence(&right);
    assert!(
        sentence.starts_with("**holds**") && !sentence.contains("Sharpening"),
        "{sentence}"
    );
    let wrong = ordering(&[(30.0, Some(47.0)), (38.0, Some(46.0)), (40.0, Some(36.0))]);
    assert_eq!(wrong.verdict(), Verdict::Fails);
    let sentence = page::sentence(&wrong);
    for part in [
        "**does not hold**",
        "system 2 is ahead of system 0",
        "3 of 3 pairs",
        "neither is sharpened; then it holds",
        "Sharpening.",
    ] {
        assert!(sentence.contains(part), "`{part}` is not in: {sentence}");
    }
}

#[test]
fn effective_samples_are_those_of_the_formula_in_json_and_on_the_page() {
    let (cache, pages) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let folder = pages.path().to_str().unwrap();
    let json = succeed(
        cache.path(),
        &[
            "--quick",
            "--only",
            "survey.effective_samples",
            "--json",
            "-",
            "--pages",
            folder,
        ],
    );
    let findings: Value = serde_json::from_str(&json).unwrap();
    let finding = &findings[0];
    assert_eq!(finding["id"], "survey.effective_samples");
    // One over the sum of squared weights; the text prints 2.2, 5.1, 9.8, and 19 for ever.
    let rows = finding["tables"][0]["rows"].as_array().unwrap();
    let known = [(2.1724, 2.2), (5.1330, 5.1), (9.7843, 9.8), (18.995, 19.0)];
    assert_eq!(rows.len(), known.len());
    for (row, (analytic, published)) in rows.iter().zip(known) {
        let (formula, measured) = (&row[1][0], &row[1][1]);
        assert!((formula["ours"].as_f64().unwrap() - analytic).abs() < 6e-3, "{row}");
        assert_eq!(formula["published"], published, "{row}");
        // 49152 values of noise: the ratio of variances is good to two hundredths.
        assert!(
            (measured["ours"].as_f64().unwrap() / analytic - 1.0).abs() < 0.02,
            "{row}"
        );
    }
    for ordering in finding["orderings"].as_array().unwrap() {
        assert_eq!(ordering["verdict"], "holds", "{ordering}");
        for key in [
            "claim",
            "measure",
            "higher_is_better",
            "tie",
            "entries",
            "trials",
            "reason",
        ] {
            assert!(ordering.get(key).is_some(), "no `{key}` in {ordering}");
        }
    }
    let page = fs::read_to_string(pages.path().join("reproduction.md")).unwrap();
    for part in [
        "# Published results",
        "afterimage paper --quick",
        "Adapter: ",
        "## survey.effective_samples",
        "(2.2)",
    ] {
        assert!(page.contains(part), "`{part}` is not on the page");
    }
    let chart = fs::read_to_string(pages.path().join("reproduction/survey_effective_samples.svg")).unwrap();
    assert_eq!(chart.matches("<polyline").count(), 8);
}

#[test]
fn a_small_contest_shows_its_pictures_and_keeps_its_scene() {
    let (cache, pages) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let folder = pages.path().to_str().unwrap();
    let shown = succeed(
        cache.path(),
        &["--quick", "--only", "inside.closest", "--pages", folder],
    );
    assert!(
        shown.contains("closest of 3×3") && shown.contains("orderings: "),
        "{shown}"
    );
    let page = fs::read_to_string(pages.path().join("reproduction.md")).unwrap();
    for line in page.lines().filter(|line| line.starts_with("![")) {
        let target = line.split("](").nth(1).unwrap().trim_end_matches(')');
        assert!(pages.path().join(target).is_file(), "{line}");
    }
    assert!(page.contains("](reproduction/inside.closest.png)"), "{page}");
    assert_eq!(
        fs::read_dir(cache.path()).unwrap().count(),
        2,
        "two scenes, each baked once"
    );
}
