//! Where a series changes its level: E-divisive.
//!
//! A series is cut where the two parts differ most by energy distance, the cut is kept if chance seldom makes one as good
//! (the values of a part shuffled among themselves), and the parts are cut again. Cuts whose step is smaller than asked
//! for are taken back, the smallest first. Matteson and James, "A Nonparametric Approach for Multiple Change Point
//! Analysis of Multivariate Data", 2014, with α = 1.

use super::{ChangeRule, Tolerance};
use crate::{metrics::Better, random::Random, statistics::median};

/// Shuffles that a significance test makes: the smallest probability that can be told is 0.002.
const N_SHUFFLES: usize = 499;
const N_RESAMPLES: usize = 1000;
/// Any number; it makes verdicts repeatable.
const SEED: u64 = 0x5eed_0af7_e131_4a9e;

/// A change of level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChangePoint {
    /// The first value of the new level.
    pub index: usize,
    /// The probability that chance made a cut as good.
    pub p: f64,
    /// Median before, back to the change before.
    pub before: f64,
    /// Median after, up to the next change.
    pub after: f64,
}

/// The fewest results in which a change can be seen: two of the shortest levels, and so many orders of the values that those which are
/// as good as a perfect step, of which there are two, are rare enough.
pub fn fewest(rule: &ChangeRule) -> usize {
    let mut n = 2 * rule.min_segment;
    let n_orders = |n: usize| (1..=n / 2).fold(1.0, |orders, i| orders * (n + 1 - i) as f64 / i as f64);
    while 2.0 * N_SHUFFLES as f64 / n_orders(n) >= n_allowed(rule) as f64 {
        n += 1;
    }
    n
}

/// How many orders of the values may be as good as theirs, themselves included.
fn n_allowed(rule: &ChangeRule) -> usize {
    (rule.p * (N_SHUFFLES + 1) as f64) as usize
}

/// The best cuts of finite `values`, oldest first, as otava finds them.
pub fn change_points(values: &[f64], rule: &ChangeRule) -> Vec<ChangePoint> {
    let mut cuts = Vec::new();
    // Start and end of each part that is still to be cut.
    let mut waiting = vec![(0, values.len())];
    while let Some((start, end)) = waiting.pop() {
        let Some((offset, p)) = cut(&values[start..end], rule) else {
            continue;
        };
        let index = start + offset;
        cuts.push((index, p));
        waiting.extend([(start, index), (index, end)]);
    }
    cuts.sort_by_key(|(index, _)| *index);
    loop {
        let found = levels(values, &cuts);
        let step = |point: &ChangePoint| {
            (point.after - point.before).abs() / rule.min_effect.of(point.before).max(f64::MIN_POSITIVE)
        };
        let smallest = found
            .iter()
            .enumerate()
            .min_by(|(_, a), (_, b)| step(a).total_cmp(&step(b)));
        match smallest {
            Some((position, point)) if step(point) < 1.0 => drop(cuts.remove(position)),
            _ => return found,
        }
    }
}

/// The changes of level in finite `values` ([`place`] makes them so), oldest first. No cut may be nearer to an end than the shortest
/// level, of which the first results may therefore belong to the level before: the change is behind them.
pub fn changes(values: &[f64], rule: &ChangeRule) -> Vec<ChangePoint> {
    let mut found = change_points(values, rule);
    let mut end = values.len();
    for point in found.iter_mut().rev() {
        let begin = point.index;
        if begin + rule.min_segment == end {
            let distance = |index: usize, level: f64| (values[index] - level).abs();
            let is_before = |&index: &usize| distance(index, point.before) < distance(index, point.after);
            point.index += (begin..end - 1).take_while(is_before).count();
        }
        end = begin;
    }
    found
}

/// The values with those that are not finite beside the others: infinities as far out as makes a step that counts, so that
/// one of them hides no other step, and what is not a number where the worst infinity is.
pub fn place(values: &[f64], better: Option<Better>, rule: &ChangeRule) -> Vec<f64> {
    let known = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = match (known().reduce(f64::min), known().reduce(f64::max)) {
        (Some(low), Some(high)) => (low, high),
        _ => (0.0, 0.0),
    };
    let scale = match low.abs().max(high.abs()) {
        0.0 => 1.0,
        largest => largest,
    };
    // A share is one of the infinity, too, where that comes first.
    let step = match rule.min_effect {
        Tolerance::Relative(share) => share * scale / (1.0 - share.min(0.9)),
        Tolerance::Absolute(step) => step,
    };
    let out = high - low + (2.0 * step).max(f64::EPSILON * scale);
    let (below, above) = (low - out, high + out);
    let worst = if better == Some(Better::Lower) { above } else { below };
    let placed = |&value: &f64| match value {
        value if value.is_finite() => value,
        value if value.is_nan() => worst,
        value if value > 0.0 => above,
        _ => below,
    };
    values.iter().map(placed).collect()
}

fn levels(values: &[f64], cuts: &[(usize, f64)]) -> Vec<ChangePoint> {
    let bound = |position: usize| cuts.get(position).map_or(values.len(), |(index, _)| *index);
    let start = |position: usize| if position == 0 { 0 } else { bound(position - 1) };
    cuts.iter()
        .enumerate()
        .map(|(position, &(index, p))| ChangePoint {
            index,
            p,
            before: median(&values[start(position)..index]),
            after: median(&values[index..bound(position + 1)]),
        })
        .collect()
}

/// The best cut of a part, if chance seldom makes one as good.
fn cut(values: &[f64], rule: &ChangeRule) -> Option<(usize, f64)> {
    let (index, energy) = best_cut(values, rule.min_segment)?;
    if energy <= 0.0 {
        return None;
    }
    let mut random = Random::new(SEED);
    let mut shuffled = values.to_vec();
    // Once so many shuffles are as good, the cut is lost whatever the others are.
    let allowed = n_allowed(rule);
    let mut n_as_good = 1;
    for _ in 0..N_SHUFFLES {
        random.shuffle(&mut shuffled);
        if best_cut(&shuffled, rule.min_segment).is_some_and(|(_, other)| other >= energy) {
            n_as_good += 1;
            if n_as_good > allowed {
                return None;
            }
        }
    }
    Some((index, n_as_good as f64 / (N_SHUFFLES + 1) as f64))
}

/// The start of the right part of the best cut: that with the largest scaled energy distance between what is left of it
/// and what is right of it, up to where the right part is best ended. A level that soon falls back is found so.
fn best_cut(values: &[f64], min: usize) -> Option<(usize, f64)> {
    let n = values.len();
    if n < 2 * min {
        return None;
    }
    let sums = DistanceSums::new(values);
    let mut best: Option<(usize, f64)> = None;
    for cut in min..=n - min {
        for end in cut + min..=n {
            let energy = sums.energy(cut, end);
            if best.is_none_or(|(_, other)| energy > other) {
                best = Some((cut, energy));
            }
        }
    }
    best
}

/// Sums of |a − b| over the first values on either side: row × column.
struct DistanceSums {
    n: usize,
    sums: Vec<f64>,
}

impl DistanceSums {
    fn new(values: &[f64]) -> Self {
        let n = values.len();
        let mut sums = vec![0.0; (n + 1) * (n + 1)];
        for (row, a) in values.iter().enumerate() {
            let (above, here) = sums.split_at_mut((row + 1) * (n + 1));
            let above = &above[row * (n + 1)..];
            let mut along = 0.0;
            for (column, b) in values.iter().enumerate() {
                along += (a - b).abs();
                here[column + 1] = above[column + 1] + along;
            }
        }
        Self { n, sums }
    }

    fn at(&self, rows: usize, columns: usize) -> f64 {
        self.sums[rows * (self.n + 1) + columns]
    }

    /// Between the values before `cut` and those from there to `end`.
    fn energy(&self, cut: usize, end: usize) -> f64 {
        let (n_left, n_right) = (cut as f64, (end - cut) as f64);
        let left = self.at(cut, cut);
        let across = self.at(cut, end) - left;
        let right = self.at(end, end) - 2.0 * across - left;
        // Each pair of a side is in its sum twice, as it is among its n (n - 1) ordered pairs.
        let ordered_pairs = |n: f64| (n * (n - 1.0)).max(1.0);
        let between = 2.0 * across / (n_left * n_right);
        n_left * n_right / (n_left + n_right)
            * (between - left / ordered_pairs(n_left) - right / ordered_pairs(n_right))
    }
}

/// The step between two levels of finite values, `after` − `before` by medians, with its 95 % interval by resampling.
pub fn effect(before: &[f64], after: &[f64]) -> (f64, f64, f64) {
    let step = median(after) - median(before);
    if before.is_empty() || after.is_empty() {
        return (step, step, step);
    }
    let mut random = Random::new(SEED);
    let mut resample = |values: &[f64]| {
        let drawn: Vec<f64> = values.iter().map(|_| values[random.below(values.len())]).collect();
        median(&drawn)
    };
    let mut steps: Vec<f64> = (0..N_RESAMPLES).map(|_| resample(after) - resample(before)).collect();
    steps.sort_by(f64::total_cmp);
    (step, steps[N_RESAMPLES / 40], steps[N_RESAMPLES - 1 - N_RESAMPLES / 40])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Those of a table of what was seen to fire and what never did.
    #[test]
    fn few_results_are_never_improbable() {
        for (p, min_segment, fewest) in [
            (0.01, 4, 10),
            (0.01, 2, 10),
            (0.002, 4, 13),
            (0.05, 4, 8),
            (0.01, 20, 40),
        ] {
            let rule = ChangeRule {
                p,
                min_segment,
                ..ChangeRule::default()
            };
            assert_eq!(super::fewest(&rule), fewest, "p = {p}, {min_segment}");
            let step = |n: usize| series(&[(n - n / 2, 1.0), (n / 2, 1.5)], 7);
            assert_eq!(change_points(&step(fewest), &rule).len(), 1, "p = {p}, {min_segment}");
            if fewest > 2 * min_segment {
                assert_eq!(change_points(&step(fewest - 1), &rule), [], "p = {p}, {min_segment}");
            }
        }
    }

    /// Noise of about ±1 % around levels.
    fn series(levels: &[(usize, f64)], seed: u64) -> Vec<f64> {
        let mut random = Random::new(seed);
        let mut noise = || (random.below(1000) as f64 + random.below(1000) as f64 - 999.0) / 100_000.0;
        let values = levels.iter().flat_map(|&(n, level)| std::iter::repeat_n(level, n));
        values.map(|level| level * (1.0 + noise())).collect()
    }

    #[test]
    fn steps_are_found_where_they_are() {
        let values = series(&[(30, 1.0), (25, 1.1), (20, 1.04)], 3);
        let found = change_points(&values, &ChangeRule::default());
        let places: Vec<_> = found.iter().map(|point| point.index).collect();
        assert_eq!(places, [30, 55]);
        assert!((found[0].after - 1.1).abs() < 0.01 && found[0].p <= 0.01);
    }

    #[test]
    fn noise_alone_is_no_change() {
        // With p = 0.01, one of a hundred series may be cut by chance; its step is then below the least effect.
        for seed in 0..40 {
            let found = change_points(&series(&[(80, 5.0)], seed), &ChangeRule::default());
            assert!(found.is_empty(), "seed {seed}: {found:?}");
        }
    }

    #[test]
    fn one_outlier_and_small_steps_are_not_worth_a_word() {
        let mut values = series(&[(60, 1.0)], 9);
        values[40] = 3.0;
        assert!(change_points(&values, &ChangeRule::default()).is_empty());
        let values = series(&[(40, 1.0), (40, 1.02)], 4);
        let found = |min_effect| {
            change_points(
                &values,
                &ChangeRule {
                    min_effect,
                    ..ChangeRule::default()
                },
            )
            .len()
        };
        assert_eq!(
            (found(Tolerance::Relative(0.01)), found(Tolerance::Relative(0.05))),
            (1, 0)
        );
        assert_eq!(found(Tolerance::Absolute(0.05)), 0);
    }

    #[test]
    fn short_constant_and_odd_series_do_no_harm() {
        let rule = ChangeRule::default();
        assert!(change_points(&[], &rule).is_empty());
        assert!(change_points(&[1.0; 7], &rule).is_empty());
        assert!(change_points(&place(&[f64::NAN; 20], None, &rule), &rule).is_empty());
    }

    #[test]
    fn values_that_are_not_finite_are_levels_of_their_own() {
        let rule = ChangeRule::default();
        let places = |levels: &[f64], better| {
            let values: Vec<f64> = levels.iter().flat_map(|&level| [level; 10]).collect();
            let found = change_points(&place(&values, better, &rule), &rule);
            found.iter().map(|point| point.index).collect::<Vec<_>>()
        };
        let (inf, nan) = (f64::INFINITY, f64::NAN);
        assert_eq!(places(&[inf, 30.0, 31.5], None), [10, 20]);
        assert_eq!(places(&[inf, 60.0], Some(Better::Higher)), [10]);
        let large = ChangeRule {
            min_effect: Tolerance::Relative(0.6),
            ..rule
        };
        let values = [[inf; 10], [60.0; 10]].concat();
        assert_eq!(change_points(&place(&values, None, &large), &large).len(), 1);
        assert_eq!(places(&[34.0, nan], Some(Better::Higher)), [10]);
        assert_eq!(places(&[34.0, -inf], Some(Better::Higher)), [10]);
        assert_eq!(places(&[0.0, inf], Some(Better::Lower)), [10]);
        assert_eq!(places(&[inf, nan], Some(Better::Higher)), [10]);
        let worse = |better| place(&[1.0, nan], Some(better), &rule)[1] > 1.0;
        assert!(worse(Better::Lower) && !worse(Better::Higher));
    }

    #[test]
    fn an_interval_holds_the_step() {
        let (step, low, high) = effect(&series(&[(30, 1.0)], 1), &series(&[(30, 1.1)], 2));
        assert!(low < step && step < high && (0.09..0.11).contains(&low) && (0.09..0.11).contains(&high));
    }
}
