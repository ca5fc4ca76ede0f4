//! A verdict on one metric of a line: what it holds and what it names.

use super::*;
use crate::random::Random;

fn history(values: &[f64]) -> Vec<Past> {
    let past = |(i, &value): (usize, &f64)| Past {
        report_ids: vec![i as i64 + 1],
        commit: Some(format!("c{i}")),
        branch: None,
        value,
        version: 1,
    };
    values.iter().enumerate().map(past).collect()
}

fn judge(rules: &str, metric: &str, values: &[f64], history: &[Past], approved: &Approved) -> Vec<Check> {
    let line = Line {
        series_id: 1,
        sequence: "ship",
        recipe: "ema",
        metric,
        values,
        version: 1,
        report_id: None,
        branch: None,
        history,
        approved,
    };
    Rules::parse(rules).unwrap().judge(&line)
}

fn approved(values: &[f64]) -> Approved {
    Approved {
        values: values.to_vec(),
        ..Approved::default()
    }
}

fn known(report_id: i64, state: ChangeState) -> KnownChange {
    KnownChange {
        report_id,
        state,
        effect: None,
    }
}

#[test]
fn limits_hold_for_the_median_and_name_the_first_bad_commit() {
    let rules = "[[rule]]\nmetric = 'psnr'\nmin = 30";
    let past = history(&[31.0, 32.0, 29.0, 29.5]);
    let found = judge(rules, "psnr", &[29.5], &past, &Approved::default());
    assert_eq!(found[0].outcome, Outcome::Regression);
    let finding = &found[0].finding;
    assert_eq!(
        (finding.first_bad_commit.as_deref(), finding.last_good_report),
        (Some("c2"), Some(2))
    );
    let outcome = |values: &[f64]| judge(rules, "psnr", values, &past, &Approved::default())[0].outcome;
    assert_eq!(outcome(&[10.0, 31.0, 32.0]), Outcome::Ok, "one of three repeats");
    assert_eq!(outcome(&[30.0]), Outcome::Ok);
    assert_eq!(
        outcome(&[f64::NAN]),
        Outcome::Regression,
        "not a number is not good enough"
    );
    assert_eq!(outcome(&[f64::INFINITY]), Outcome::Ok);
    assert!(judge(rules, "ssim", &[0.1], &[], &Approved::default()).is_empty());
}

#[test]
fn a_baseline_is_a_set_in_one_environment() {
    let rules = "[[rule]]\nmetric = '*'\nbaseline = '1 %'";
    let outcome = |metric, value, approved: &Approved| judge(rules, metric, &[value], &[], approved)[0].outcome;
    assert_eq!(outcome("psnr", 40.0, &Approved::default()), Outcome::Unknown);
    let set = approved(&[40.0, 38.0]);
    assert_eq!(
        outcome("psnr", 37.7, &set),
        Outcome::Ok,
        "1 % below the worst of the set"
    );
    assert_eq!(outcome("psnr", 37.5, &set), Outcome::Regression);
    assert_eq!(outcome("flip", 40.3, &set), Outcome::Ok, "lower is better");
    assert_eq!(outcome("flip", 40.5, &set), Outcome::Regression);
    assert_eq!(outcome("frobs", 40.0, &set), Outcome::Unknown, "an unknown direction");
    assert_eq!(outcome("psnr", f64::INFINITY, &approved(&[f64::INFINITY])), Outcome::Ok);
    assert_eq!(outcome("psnr", 99.0, &approved(&[f64::INFINITY])), Outcome::Regression);
    let elsewhere = Approved {
        elsewhere: true,
        ..Approved::default()
    };
    let check = &judge(rules, "psnr", &[40.0], &[], &elsewhere)[0];
    assert!(
        check.outcome == Outcome::Unknown && check.detail.starts_with("environment differs"),
        "{check:?}"
    );
}

#[test]
fn a_change_counts_until_it_is_approved_and_only_for_the_worse() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let mut values: Vec<f64> = (0..12).map(|i| 1.0 + 0.001 * f64::from(i % 3)).collect();
    values.extend((0..6).map(|i| 1.2 + 0.001 * f64::from(i % 3)));
    let past = history(&values);
    let found = judge(rules, "gpu_time_ms", &[1.2], &past, &Approved::default()).remove(0);
    assert_eq!(found.outcome, Outcome::Regression, "{found:?}");
    assert_eq!(
        (
            found.finding.first_bad_commit.as_deref(),
            found.finding.last_good_commit.as_deref()
        ),
        (Some("c12"), Some("c11"))
    );
    assert!(found.finding.effect_low.unwrap().0 > 0.19 && found.finding.effect_high.unwrap().0 < 0.21);
    let accepted = Approved {
        report_ids: vec![15],
        ..Approved::default()
    };
    assert_eq!(
        judge(rules, "gpu_time_ms", &[1.2], &past, &accepted)[0].outcome,
        Outcome::Ok
    );
    values.reverse();
    assert_eq!(
        judge(rules, "gpu_time_ms", &[1.0], &history(&values), &Approved::default())[0].outcome,
        Outcome::Ok
    );
    let short = judge(rules, "gpu_time_ms", &[1.2], &past[..5], &Approved::default()).remove(0);
    assert_eq!(short.outcome, Outcome::Unknown, "{short:?}");
}

#[test]
fn a_change_that_was_not_made_good_outlasts_the_next() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let verdict = |levels: [f64; 3]| {
        let level = |value: f64| (0..8).map(move |i| value + 0.001 * f64::from(i % 3));
        let values: Vec<f64> = levels.into_iter().flat_map(level).collect();
        judge(
            rules,
            "gpu_time_ms",
            &values[23..],
            &history(&values),
            &Approved::default(),
        )
        .remove(0)
    };
    for (levels, first_bad, effect) in [
        ([1.0, 1.3, 1.15], "c8", 0.15),
        ([1.0, 1.15, 1.3], "c8", 0.3),
        ([1.3, 1.0, 1.15], "c16", 0.15),
    ] {
        let found = verdict(levels);
        assert_eq!(found.outcome, Outcome::Regression, "{found:?}");
        assert_eq!(found.finding.first_bad_commit.as_deref(), Some(first_bad));
        assert!((found.finding.effect.unwrap().0 - effect).abs() < 0.01, "{found:?}");
    }
    for levels in [[1.0, 1.3, 1.0], [1.0, 1.3, 0.9], [1.3, 1.0, 0.8]] {
        assert_eq!(verdict(levels).outcome, Outcome::Ok, "{levels:?}");
    }
}

#[test]
fn what_came_back_exactly_is_good_again() {
    for (metric, step) in [("psnr", -1.0), ("gpu_time_ms", 1.0)] {
        let rules = format!("[[rule]]\nmetric = '{metric}'\nchange = {{ min_segment = 4, min_effect = 0 }}");
        let levels = |last: f64| {
            [30.0, 30.0 + step, last]
                .into_iter()
                .flat_map(|level| [level; 8])
                .collect::<Vec<_>>()
        };
        let outcome = |last: f64| {
            let past = history(&levels(last));
            judge(&rules, metric, &[last], &past, &Approved::default())[0].outcome
        };
        assert_eq!(outcome(30.0), Outcome::Ok, "{metric}");
        assert_eq!(outcome(30.0 + 0.5 * step), Outcome::Regression, "{metric}");
    }
}

#[test]
fn a_dismissed_change_hides_no_other() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let values: Vec<f64> = [1.0, 1.3, 2.0].into_iter().flat_map(|level| [level; 8]).collect();
    let first_bad = |n: usize, dismissed: &[i64]| {
        let dismissed = dismissed.iter().map(|&id| known(id, ChangeState::Dismissed));
        let approved = Approved {
            changes: dismissed.collect(),
            ..Approved::default()
        };
        let found = judge(
            rules,
            "gpu_time_ms",
            &values[n - 1..n],
            &history(&values[..n]),
            &approved,
        )
        .remove(0);
        assert_eq!(found.outcome, Outcome::Regression);
        found.finding.first_bad_report.unwrap()
    };
    let first = first_bad(16, &[]);
    assert_eq!((first_bad(24, &[]), first_bad(16, &[first])), (first, first));
    assert_eq!(first_bad(24, &[first]), first + 8);
}

#[test]
fn a_fall_from_infinity_is_measured_within_the_window() {
    let rules = "[[rule]]\nmetric = 'psnr'\nchange = { min_segment = 4 }";
    let values: Vec<f64> = [f64::INFINITY, 31.0, 29.0]
        .into_iter()
        .flat_map(|level| [level; 8])
        .collect();
    let found = judge(rules, "psnr", &[29.0], &history(&values), &Approved::default()).remove(0);
    assert_eq!(found.outcome, Outcome::Regression);
    let finding = &found.finding;
    assert_eq!(
        (finding.first_bad_commit.as_deref(), finding.effect, finding.effect_low),
        (Some("c8"), Some(Value(f64::NEG_INFINITY)), None)
    );
    assert!(found.detail.contains("from ∞ to 29"), "{}", found.detail);
}

#[test]
fn what_is_not_a_number_is_worse_than_anything() {
    let (nan, inf) = (f64::NAN, f64::INFINITY);
    let limit = "[[rule]]\nmetric = 'psnr'\nmin = 30";
    let repeats = judge(limit, "psnr", &[34.0, nan, 34.1], &[], &Approved::default()).remove(0);
    assert_eq!(repeats.outcome, Outcome::Regression, "one repeat is none");
    assert!(repeats.detail.contains("not a number"), "{}", repeats.detail);

    let baseline = "[[rule]]\nmetric = 'psnr'\nbaseline = 0.1";
    let outcome = |value, set: &[f64]| judge(baseline, "psnr", &[value], &[], &approved(set))[0].outcome;
    assert_eq!(outcome(50.0, &[nan]), Outcome::Unknown);
    assert_eq!(
        (outcome(34.0, &[nan, 34.0]), outcome(nan, &[34.0])),
        (Outcome::Ok, Outcome::Regression)
    );

    for (metric, from, to, words) in [
        ("psnr", 34.0, nan, "from 34.0000 to NaN"),
        ("psnr", 34.0, -inf, "from 34.0000 to −∞"),
        ("psnr", inf, 60.0, "from ∞ to 60.0000"),
        ("psnr", inf, nan, "from ∞ to NaN"),
        ("flip", 0.1, inf, "from 0.1000 to ∞"),
        ("flip", 0.1, nan, "from 0.1000 to NaN"),
    ] {
        let rules = format!("[[rule]]\nmetric = '{metric}'\nchange = {{ min_segment = 4 }}");
        let values: Vec<f64> = [from, to].into_iter().flat_map(|level| [level; 8]).collect();
        let check =
            |values: &[f64]| judge(&rules, metric, &values[15..], &history(values), &Approved::default()).remove(0);
        let found = check(&values);
        assert_eq!(
            found.outcome,
            Outcome::Regression,
            "{metric}: {from} to {to}: {found:?}"
        );
        assert_eq!(found.finding.first_bad_commit.as_deref(), Some("c8"));
        assert!(found.detail.contains(words), "{}", found.detail);
        let back: Vec<f64> = values.into_iter().rev().collect();
        let mend = check(&back);
        assert_eq!(
            (mend.outcome, mend.finding.first_bad_commit),
            (Outcome::Ok, None),
            "{metric}: {to} to {from}"
        );
    }
}

/// Judges each of the values in turn from `first` on, with the alerts that the ones before opened and closed.
fn nights(rules: &str, values: &[f64], first: usize, approved: &Approved) -> Vec<(Outcome, Option<String>)> {
    let past = history(values);
    let mut approved = approved.clone();
    let mut outcomes = Vec::new();
    for n in first..=values.len() {
        let found = judge(rules, "gpu_time_ms", &values[n - 1..n], &past[..n], &approved).remove(0);
        match found.finding.first_bad_report {
            Some(first_bad) => {
                approved.changes.retain(|known| known.state != ChangeState::Open);
                approved.changes.push(known(first_bad, ChangeState::Open));
            }
            None => approved
                .changes
                .iter_mut()
                .for_each(|known| known.state = ChangeState::Closed),
        }
        outcomes.push((found.outcome, found.finding.first_bad_commit));
    }
    outcomes
}

/// Values around a level, with a triangle of noise as wide as `noise` on either side.
fn noisy(random: &mut Random, level: f64, noise: f64, n: usize) -> Vec<f64> {
    let mut one = || (random.below(1000) as f64 + random.below(1000) as f64 - 999.0) / 999.0;
    (0..n).map(|_| level * (1.0 + noise * one())).collect()
}

#[test]
fn the_first_night_of_a_change_names_its_commit() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let mut random = Random::new(9);
    let values = [noisy(&mut random, 1.0, 0.01, 12), noisy(&mut random, 1.2, 0.01, 6)].concat();
    let named: Vec<_> = nights(rules, &values, 13, &Approved::default())
        .into_iter()
        .filter_map(|(_, commit)| commit)
        .collect();
    // With three bad results, a level of four has to have a good one.
    assert_eq!(named, vec!["c12"; 4]);
}

/// At the far end of what is looked at, the level before a change wears away.
#[test]
fn a_change_without_a_level_before_it_is_left_to_people() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    for (n_before, outcome) in [(4, Outcome::Regression), (3, Outcome::Unknown), (1, Outcome::Unknown)] {
        let past = history(&[vec![1.0; n_before], vec![1.3; 60]].concat());
        let approved = Approved {
            changes: vec![known(n_before as i64 + 1, ChangeState::Open)],
            ..Approved::default()
        };
        let found = judge(rules, "gpu_time_ms", &[1.3], &past, &approved).remove(0);
        assert_eq!(found.outcome, outcome, "{n_before}: {}", found.detail);
    }
}

#[test]
fn a_dismissed_change_that_also_closed_hides_no_other() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let values = [[1.0; 8], [1.3; 8], [2.0; 8]].concat();
    let approved = Approved {
        changes: vec![known(9, ChangeState::Closed), known(9, ChangeState::Dismissed)],
        ..Approved::default()
    };
    let found = judge(rules, "gpu_time_ms", &[2.0], &history(&values), &approved).remove(0);
    assert_eq!(found.finding.first_bad_commit.as_deref(), Some("c16"));
}

#[test]
fn a_change_in_another_version_is_left_to_people() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let mut past = history(&[[1.0; 8], [1.3; 8], [1.3; 8]].concat());
    past[..16].iter_mut().for_each(|past| past.version = 0);
    let approved = Approved {
        changes: vec![known(9, ChangeState::Open)],
        ..Approved::default()
    };
    let found = judge(rules, "gpu_time_ms", &[1.3], &past, &approved).remove(0);
    assert_eq!(found.outcome, Outcome::Unknown, "{}", found.detail);
}

#[test]
fn a_branch_does_not_answer_for_what_it_came_with() {
    let mut past = history(&[[1.0; 8], [1.2; 8], [1.2; 8], [1.5; 8]].concat());
    for (place, past) in past.iter_mut().enumerate() {
        past.branch = Some(if place < 16 { "main" } else { "work" }.to_owned());
    }
    let approved = Approved::default();
    let rules = Rules::parse("[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }").unwrap();
    let judge = |branch: &str, n: usize| {
        let line = Line {
            series_id: 1,
            sequence: "ship",
            recipe: "ema",
            metric: "gpu_time_ms",
            values: &[past[n - 1].value],
            version: 1,
            report_id: Some(past[n - 1].report_id()),
            branch: Some(branch),
            history: &past[..n],
            approved: &approved,
        };
        let found = rules.judge(&line).remove(0);
        (found.outcome, found.finding.first_bad_commit)
    };
    assert_eq!(judge("main", 16), (Outcome::Regression, Some("c8".to_owned())));
    assert_eq!(judge("work", 24), (Outcome::Ok, None));
    assert_eq!(judge("work", 32), (Outcome::Regression, Some("c24".to_owned())));
}

#[test]
fn a_change_is_no_regression_of_a_commit_before_it() {
    let past = history(&[[1.0; 10], [1.2; 10]].concat());
    let approved = Approved::default();
    let judge = |place: usize| {
        let line = Line {
            series_id: 1,
            sequence: "ship",
            recipe: "ema",
            metric: "gpu_time_ms",
            values: &[past[place].value],
            version: 1,
            report_id: Some(past[place].report_id()),
            branch: None,
            history: &past,
            approved: &approved,
        };
        let rules = Rules::parse("[[rule]]\nmetric = 'gpu_time_ms'\nchange = {}").unwrap();
        rules.judge(&line).remove(0)
    };
    let good = judge(9);
    assert_eq!(good.outcome, Outcome::Ok);
    assert!(
        good.detail.contains("later one for the worse is at commit c10"),
        "{}",
        good.detail
    );
    assert_eq!(judge(10).outcome, Outcome::Regression);
}

#[test]
fn a_change_for_the_worse_outlasts_the_window() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4, window = 40, min_effect = '2 %' }";
    let mut random = Random::new(5);
    let worse = [noisy(&mut random, 1.0, 0.025, 60), noisy(&mut random, 1.06, 0.025, 200)].concat();
    let outcomes = nights(rules, &worse, 80, &Approved::default());
    for (n, (outcome, first_bad)) in (80..).zip(&outcomes) {
        assert_eq!(*outcome, Outcome::Regression, "after {n} results");
        assert!(
            ["c59", "c60", "c61"].contains(&first_bad.as_deref().unwrap()),
            "{first_bad:?}"
        );
    }
    // Longer ago than the window, too, it may be made good, and half of it may.
    let mut last = |level: f64| {
        let values = [worse.clone(), noisy(&mut random, level, 0.025, 12)].concat();
        nights(rules, &values, 80, &Approved::default()).pop().unwrap().0
    };
    assert_eq!([1.0, 1.03].map(&mut last), [Outcome::Ok, Outcome::Regression]);
}

#[test]
fn what_was_found_once_is_not_lost_in_noise() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4, window = 20 }";
    let (mut n_found, mut n_half, mut n_half_bad) = (0, 0, 0);
    for seed in 0..12 {
        // A step of 5 % in noise of 2 %, of which half is mended later.
        let mut random = Random::new(seed);
        let levels = [(40, 1.0), (60, 1.05), (60, 1.025)];
        let values = levels.map(|(n, level)| noisy(&mut random, level, 0.049, n)).concat();
        let outcomes = nights(rules, &values, 41, &Approved::default());
        let Some(found) = outcomes.iter().position(|one| one.0 == Outcome::Regression) else {
            continue;
        };
        n_found += 1;
        let lost = outcomes[found..59]
            .iter()
            .filter(|one| one.0 != Outcome::Regression)
            .count();
        assert_eq!(lost, 0, "seed {seed}: {:?}", &outcomes[found..59]);
        let half = &outcomes[outcomes.len() - 30..];
        n_half += half.len();
        n_half_bad += half.iter().filter(|one| one.0 == Outcome::Regression).count();
    }
    assert!(10 * n_half_bad >= 9 * n_half, "{n_half_bad} of {n_half}");
    assert!(n_found >= 10, "{n_found} of 12");
}

#[test]
fn a_change_behind_another_is_not_lost_with_it() {
    // A small one, made good at last, and a large one since, which is out of the window by then.
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4, window = 20 }";
    let values = [vec![1.0; 13], vec![1.02; 6], vec![1.0; 21], vec![1.1; 24]].concat();
    let approved = Approved {
        changes: vec![known(14, ChangeState::Open)],
        ..Approved::default()
    };
    let found = judge(rules, "gpu_time_ms", &[1.1], &history(&values), &approved).remove(0);
    assert_eq!(found.outcome, Outcome::Regression, "{}", found.detail);
    assert_eq!(found.finding.first_bad_commit.as_deref(), Some("c40"));
}

#[test]
fn a_change_is_made_good_by_the_level_before_it() {
    // What was approved before counts, not what was before that.
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4, window = 12 }";
    let values = [vec![1.0; 20], vec![1.3; 4], vec![1.4; 40], vec![1.3; 8]].concat();
    let approved = Approved {
        report_ids: vec![22],
        ..Approved::default()
    };
    let outcomes = nights(rules, &values, 29, &approved);
    assert_eq!(outcomes[35].0, Outcome::Regression);
    assert_eq!(outcomes.last().unwrap().0, Outcome::Ok);
}

#[test]
fn a_change_out_of_sight_is_left_to_people() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let outcome = |report_id| {
        let approved = Approved {
            changes: vec![known(report_id, ChangeState::Open)],
            ..Approved::default()
        };
        judge(rules, "gpu_time_ms", &[1.3], &history(&[1.3; 40]), &approved)[0].outcome
    };
    assert_eq!([-7, 1].map(outcome), [Outcome::Unknown; 2]);
    assert_eq!(outcome(9), Outcome::Ok);
}

#[test]
fn what_is_approved_elsewhere_accepts_nothing_here() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let past = history(&[[1.0; 8], [1.3; 8]].concat());
    let outcome = |approved: &Approved| judge(rules, "gpu_time_ms", &[1.3], &past, approved)[0].outcome;
    let report = |id| {
        outcome(&Approved {
            report_ids: vec![id],
            ..Approved::default()
        })
    };
    assert_eq!([9, 12].map(report), [Outcome::Ok; 2]);
    assert_eq!(
        [8, 99].map(report),
        [Outcome::Regression; 2],
        "before it, and on another branch"
    );
    let commit = |commit: &str| {
        outcome(&Approved {
            commits: [commit.to_owned()].into(),
            ..Approved::default()
        })
    };
    assert_eq!(commit("c9"), Outcome::Ok, "measured and approved on another branch");
    assert_eq!(commit("c7"), Outcome::Regression);
}

#[test]
fn a_known_change_that_is_seen_to_begin_elsewhere_is_the_same() {
    let rules = "[[rule]]\nmetric = 'gpu_time_ms'\nchange = { min_segment = 4 }";
    let past = history(&[[1.0; 8], [1.3; 8]].concat());
    let check = |report_id, state, effect| {
        let approved = Approved {
            changes: vec![KnownChange {
                effect,
                ..known(report_id, state)
            }],
            ..Approved::default()
        };
        judge(rules, "gpu_time_ms", &[1.3], &past, &approved).remove(0)
    };
    for report_id in [7, 8, 9, 10] {
        let dismissed = check(report_id, ChangeState::Dismissed, Some(0.25));
        assert_eq!(dismissed.finding.first_bad_report, Some(report_id), "{dismissed:?}");
        let small = check(report_id, ChangeState::Dismissed, Some(0.1));
        assert_eq!(small.finding.first_bad_report, Some(9), "another, and larger");
        assert_eq!(check(report_id, ChangeState::Approved, Some(0.25)).outcome, Outcome::Ok);
        assert_eq!(
            check(report_id, ChangeState::Approved, Some(0.1)).outcome,
            Outcome::Regression
        );
    }
    assert_eq!(check(3, ChangeState::Approved, None).outcome, Outcome::Regression);
}

#[test]
fn what_is_asked_for_by_name_must_be_measured() {
    let rules = "[[rule]]\nmetric = 'psnr'\nmin = 40\n[[rule]]\nmetric = 'flip'\nsequence = 'pan'\nbaseline = 0\n\
                 [[rule]]\nmetric = 'ssim*'\nmin = 0.9";
    let rules = Rules::parse(rules).unwrap();
    let missing = |sequence: &str, measured: &[&str]| -> Vec<(String, Kind)> {
        let measured = measured.iter().map(|&metric| metric.to_owned()).collect();
        let found = rules.unmeasured(None, sequence, "ema", &measured);
        assert!(found.iter().all(|check| check.outcome == Outcome::Unknown));
        found.into_iter().map(|check| (check.metric, check.kind)).collect()
    };
    assert_eq!(missing("ship", &["ssim"]), [("psnr".to_owned(), Kind::Limit)]);
    assert_eq!(missing("pan", &["psnr"]), [("flip".to_owned(), Kind::Baseline)]);
    assert!(missing("pan", &["psnr", "flip"]).is_empty());
}

#[test]
fn values_of_another_version_are_not_compared() {
    let rules = "[[rule]]\nmetric = 'psnr'\nchange = { min_segment = 2 }";
    let mut past = history(&[[30.0, 30.1].repeat(5), [20.0, 20.1].repeat(5)].concat());
    let outcome = |past: &[Past]| judge(rules, "psnr", &[20.0], past, &Approved::default())[0].outcome;
    assert_eq!(outcome(&past), Outcome::Regression);
    past[..10].iter_mut().for_each(|past| past.version = 0);
    assert_eq!(outcome(&past), Outcome::Ok);
    // Of nine, no order is improbable enough.
    assert_eq!(outcome(&past[..19]), Outcome::Unknown);
}

#[test]
fn worst_frames_follow_the_direction() {
    let frame = |index, value| FrameReport {
        metrics: [("m".to_owned(), Value(value))].into(),
        ..FrameReport::empty(index)
    };
    let frames = [frame(0, 3.0), frame(1, 1.0), frame(2, f64::NAN), frame(3, 2.0)];
    assert_eq!(worst_frames(&frames, "m", Some(Better::Higher)), [2, 1, 3]);
    assert_eq!(worst_frames(&frames, "m", Some(Better::Lower)), [2, 0, 3]);
    assert!(worst_frames(&frames, "m", None).is_empty());
}
