//! Where the samples of a reference lie in their pixel.

use crate::random::Random;
use crate::sequence::jitter::radical_inverse;
use serde::{Deserialize, Serialize};

/// How a reference samples a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pattern {
    /// Each half a grid of its own with one sample in a random place of every cell, so placed that every column and row
    /// of the finer grid has one too (Chiu, Shirley and Wang, "Multi-jittered sampling", 1994). Where renders are finer than
    /// the reference, the quarters of a pixel share one such grid.
    #[default]
    Stratified,
    /// Halton's points in bases 2 and 3, moved by a random offset that each half has its own of.
    Halton23,
}

impl Pattern {
    /// Offsets from the pixel's centre of `n` samples, in [−0.5, 0.5). Different seeds are independent, and each sample
    /// alone is uniform over the pixel: so is the difference of two halves an honest measure of noise.
    pub fn offsets_px(self, n: u32, seed: u64) -> Vec<[f64; 2]> {
        let mut random = Random::new(seed);
        match self {
            Self::Stratified => multi_jittered(n, &mut random),
            Self::Halton23 => {
                let shift = [random.unit(), random.unit()];
                let point = |i: u32, axis: usize| radical_inverse(i, [2, 3][axis]) + shift[axis];
                (1..=n)
                    .map(|i| [0, 1].map(|axis| point(i, axis).rem_euclid(1.0) - 0.5))
                    .collect()
            }
        }
    }
}

/// The most square grid of `n` cells.
fn grid(n: u32) -> (u32, u32) {
    let columns = (1..=n)
        .take_while(|columns| columns * columns <= n)
        .filter(|columns| n.is_multiple_of(*columns))
        .last();
    let columns = columns.unwrap_or(1);
    (columns, n / columns)
}

fn multi_jittered(n: u32, random: &mut Random) -> Vec<[f64; 2]> {
    let (columns, rows) = grid(n);
    let mut shuffled = |length: u32| {
        let mut order: Vec<u32> = (0..length).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, random.below(i + 1));
        }
        order
    };
    // In column x, cell y has the sub-column `across[x][y]`; in row y, cell x the sub-row `down[y][x]`.
    let across: Vec<_> = (0..columns).map(|_| shuffled(rows)).collect();
    let down: Vec<_> = (0..rows).map(|_| shuffled(columns)).collect();
    let mut offsets = Vec::with_capacity(n as usize);
    for y in 0..rows {
        for x in 0..columns {
            let sub = [across[x as usize][y as usize], down[y as usize][x as usize]];
            let fine_x = f64::from(x * rows + sub[0]) + random.unit();
            let fine_y = f64::from(y * columns + sub[1]) + random.unit();
            offsets.push([fine_x / f64::from(n) - 0.5, fine_y / f64::from(n) - 0.5]);
        }
    }
    offsets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_column_and_row_has_one() {
        for n in [16, 24, 64] {
            let (columns, rows) = grid(n);
            let offsets = Pattern::Stratified.offsets_px(n, 3);
            let index = |v: f64, n: u32| ((v + 0.5) * f64::from(n)) as u32;
            for cells in [
                offsets
                    .iter()
                    .map(|o| index(o[0], columns) * rows + index(o[1], rows))
                    .collect::<Vec<_>>(),
                offsets.iter().map(|o| index(o[0], n)).collect(),
                offsets.iter().map(|o| index(o[1], n)).collect(),
            ] {
                let mut sorted = cells;
                sorted.sort_unstable();
                assert_eq!(sorted, (0..n).collect::<Vec<_>>());
            }
        }
        assert_eq!((grid(64), grid(128), grid(7)), ((8, 8), (8, 16), (1, 7)));
    }

    #[test]
    fn moments_are_those_of_a_pixel() {
        for pattern in [Pattern::Stratified, Pattern::Halton23] {
            let offsets = pattern.offsets_px(64, 11);
            for axis in 0..2 {
                let mean = offsets.iter().map(|o| o[axis]).sum::<f64>() / 64.0;
                let variance = offsets.iter().map(|o| o[axis] * o[axis]).sum::<f64>() / 64.0;
                assert!(mean.abs() < 0.02, "{pattern:?}: {mean}");
                assert!((variance - 1.0 / 12.0).abs() < 0.005, "{pattern:?}: {variance}");
            }
        }
    }

    #[test]
    fn seeds_differ_and_repeat() {
        let of = |seed| Pattern::Stratified.offsets_px(16, seed);
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
    }
}
