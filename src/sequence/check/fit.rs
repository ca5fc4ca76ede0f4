//! Fits and their certainty: by how much images are shifted, and whether one explanation is better than another.

/// Sums of a least-squares fit of a shift, a tile each.
#[derive(Clone, Copy, Default)]
struct Normal {
    xx: f64,
    xy: f64,
    yy: f64,
    xe: f64,
    ye: f64,
}

impl Normal {
    fn solve(self) -> Option<[f64; 2]> {
        let determinant = self.xx * self.yy - self.xy * self.xy;
        let trace = self.xx + self.yy;
        // Below that nearly all slopes point one way, and a shift across them is only guessed.
        (trace > 0.0 && determinant > 0.002 * trace * trace).then(|| {
            [
                (self.yy * self.xe - self.xy * self.ye) / determinant,
                (self.xx * self.ye - self.xy * self.xe) / determinant,
            ]
        })
    }
}

/// A shift with its standard errors, in pixels.
#[derive(Clone, Copy, Debug)]
pub struct Shift {
    pub by: [f64; 2],
    pub sigma: [f64; 2],
}

/// The shift d for which the samples `(value, position → (value, slope))` agree best: values(i) ≈ at(i, d). Gauss and
/// Newton's iteration from no shift; certainty from leaving out one of the tiles at a time.
pub fn shift(
    n_samples: usize,
    n_tiles: usize,
    tile_of: impl Fn(usize) -> usize,
    residual: impl Fn(usize, [f64; 2]) -> Option<(f64, [f64; 2])>,
    start: [f64; 2],
) -> Option<Shift> {
    const MAX_STEPS: usize = 6;
    let mut d = start;
    let mut tiles = Vec::new();
    for step in 0..MAX_STEPS {
        tiles = vec![Normal::default(); n_tiles];
        for i in 0..n_samples {
            let Some((error, [gx, gy])) = residual(i, d) else {
                continue;
            };
            let tile = &mut tiles[tile_of(i)];
            tile.xx += gx * gx;
            tile.xy += gx * gy;
            tile.yy += gy * gy;
            tile.xe += gx * error;
            tile.ye += gy * error;
        }
        let by = total(&tiles).solve()?;
        d = [d[0] + by[0], d[1] + by[1]];
        if !(d[0].abs() < 4.0 && d[1].abs() < 4.0) {
            return None;
        }
        if by[0].abs().max(by[1].abs()) < 1e-3 && step > 0 {
            break;
        }
    }
    // Jackknife about the last linearisation, whose own step is nearly nothing.
    let all = total(&tiles);
    let whole = all.solve()?;
    let n = tiles.len() as f64;
    let mut variance = [0.0; 2];
    for tile in &tiles {
        let without = Normal {
            xx: all.xx - tile.xx,
            xy: all.xy - tile.xy,
            yy: all.yy - tile.yy,
            xe: all.xe - tile.xe,
            ye: all.ye - tile.ye,
        };
        let by = without.solve().unwrap_or([f64::INFINITY; 2]);
        for axis in 0..2 {
            variance[axis] += (by[axis] - whole[axis]).powi(2) * (n - 1.0) / n;
        }
    }
    Some(Shift {
        by: d,
        sigma: variance.map(f64::sqrt),
    })
}

fn total(tiles: &[Normal]) -> Normal {
    tiles.iter().fold(Normal::default(), |sum, tile| Normal {
        xx: sum.xx + tile.xx,
        xy: sum.xy + tile.xy,
        yy: sum.yy + tile.yy,
        xe: sum.xe + tile.xe,
        ye: sum.ye + tile.ye,
    })
}

/// A difference of tone-mapped luma that is none, a step of eight bits. In a sky that hardly changes, the steps and the noise that
/// images are stored with stay where they are whatever moves, and would speak for less motion.
const SAME_VALUE: f64 = 1.0 / 255.0;
/// Tiles that must differ for a gain to be certain: those that are missing count as no gain.
const MIN_TILES: usize = 8;

/// Sums of errors of several explanations of the same samples, a tile of a frame each.
#[derive(Clone, Default)]
pub struct Errors {
    /// By tile, then explanation.
    tiles: Vec<Vec<f64>>,
    /// By explanation, over all samples.
    apart: Vec<Apart>,
    n_samples: usize,
}

/// How far what an explanation predicts is from what the first one predicts.
#[derive(Clone, Copy, Default)]
pub struct Apart {
    sum: f64,
    squares: f64,
}

impl Apart {
    pub fn add(&mut self, apart: f64) {
        self.sum += apart;
        self.squares += apart * apart;
    }

    /// The difference where there is one: the mean, weighted by itself.
    fn typical(self) -> f64 {
        if self.sum > 0.0 { self.squares / self.sum } else { 0.0 }
    }
}

/// How much better one explanation is than another.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// Share of the error that goes away; negative where the other is worse.
    pub share: f64,
    /// The difference in its standard errors, from how much it varies between tiles.
    pub z: f64,
}

impl Errors {
    /// A tile's sums over `n_samples` samples.
    pub fn push(&mut self, sums: Vec<f64>, n_samples: usize) {
        self.tiles.push(sums);
        self.n_samples += n_samples;
    }

    /// The same, with the differences of what explanations predict from what the first one does.
    pub fn push_apart(&mut self, sums: Vec<f64>, apart: &[Apart], n_samples: usize) {
        self.push(sums, n_samples);
        self.add_apart(apart);
    }

    fn add_apart(&mut self, apart: &[Apart]) {
        self.apart.resize(self.apart.len().max(apart.len()), Apart::default());
        for (all, apart) in self.apart.iter_mut().zip(apart) {
            all.sum += apart.sum;
            all.squares += apart.squares;
        }
    }

    /// Everything of `other` too.
    pub fn extend(&mut self, other: Self) {
        self.add_apart(&other.apart);
        self.tiles.extend(other.tiles);
        self.n_samples += other.n_samples;
    }

    /// Mean error of an explanation.
    pub fn mean(&self, index: usize) -> f64 {
        self.sum(index) / self.n_samples.max(1) as f64
    }

    fn sum(&self, index: usize) -> f64 {
        self.tiles.iter().map(|tile| tile[index]).sum()
    }

    /// What is gained by going from `from` to `to`. Tiles where both predict the same say nothing, and where few are left they are
    /// too few to tell a gain from chance.
    pub fn gain(&self, from: usize, to: usize) -> Gain {
        let all = self.tiles.iter().map(|tile| tile[from] - tile[to]);
        let differences: Vec<f64> = all.filter(|difference| *difference != 0.0).collect();
        let n = differences.len().max(MIN_TILES) as f64;
        let sum: f64 = differences.iter().sum();
        let mean = sum / n;
        let missing = n - differences.len() as f64;
        let squares = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() + missing * mean * mean;
        let variance = squares / (n - 1.0);
        let total = self.sum(from);
        Gain {
            share: if total > 0.0 { sum / total } else { 0.0 },
            z: if variance > 0.0 {
                mean / (variance / n).sqrt()
            } else {
                0.0
            },
        }
    }

    /// Of what an explanation and the first one predict differently, the share that speaks for the former: 1 where it always
    /// hits, −1 where the first always does, about 0 where neither has to do with what is seen. Errors that both have in common
    /// do not weigh here, however large. 0 as well where both predict nearly the same value.
    pub fn verdict(&self, index: usize) -> f64 {
        let apart = self.apart.get(index).copied().unwrap_or_default();
        if apart.typical() > SAME_VALUE {
            (self.sum(0) - self.sum(index)) / apart.sum
        } else {
            0.0
        }
    }

    /// The explanation with the least error.
    pub fn best(&self) -> usize {
        let n = self.tiles.first().map_or(0, Vec::len);
        (0..n).min_by(|&a, &b| self.sum(a).total_cmp(&self.sum(b))).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 32;
    const N_TILES: usize = 16;

    fn tile_of(i: usize) -> usize {
        (i / SIDE / 8) * 4 + i % SIDE / 8
    }

    /// A pattern with slopes in both directions, and its slope.
    fn waves([x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        let ((sx, cx), (sy, cy)) = ((0.5 * x).sin_cos(), (0.4 * y).sin_cos());
        (sx + sy, [0.5 * cx, 0.4 * cy])
    }

    fn position(i: usize) -> [f64; 2] {
        [(i % SIDE) as f64, (i / SIDE) as f64]
    }

    /// Fits samples that a tile's own shift moved, against `pattern`.
    fn fitted(pattern: impl Fn([f64; 2]) -> (f64, [f64; 2]), moved_by: impl Fn(usize) -> [f64; 2]) -> Option<Shift> {
        let residual = |i: usize, d: [f64; 2]| {
            let ([x, y], [mx, my]) = (position(i), moved_by(tile_of(i)));
            let (value, slope) = pattern([x + d[0], y + d[1]]);
            Some((pattern([x + mx, y + my]).0 - value, slope))
        };
        shift(SIDE * SIDE, N_TILES, tile_of, residual, [0.0; 2])
    }

    #[test]
    fn a_shift_is_found_with_its_certainty() {
        let found = fitted(waves, |_| [0.37, -0.21]).unwrap();
        assert!(
            (found.by[0] - 0.37).abs() < 1e-3 && (found.by[1] + 0.21).abs() < 1e-3,
            "{found:?}"
        );
        assert!(found.sigma.iter().all(|sigma| *sigma < 1e-3), "{found:?}");
        // Tiles that do not agree say so, each axis for itself.
        let torn = fitted(waves, |tile| [if tile % 2 == 0 { 0.6 } else { -0.6 }, 0.0]).unwrap();
        assert!(torn.sigma[0] > 0.05 && torn.sigma[1] < 0.5 * torn.sigma[0], "{torn:?}");
    }

    #[test]
    fn a_shift_along_edges_is_not_guessed() {
        let stripes = |[x, _]: [f64; 2]| (libm::sin(0.5 * x), [0.5 * libm::cos(0.5 * x), 0.0]);
        assert!(fitted(stripes, |_| [0.3, 0.3]).is_none());
        assert!(fitted(|_| (1.0, [0.0; 2]), |_| [0.3, 0.3]).is_none(), "nothing to see");
        let far = fitted(
            |[x, y]| (x + y + 0.1 * x * y, [1.0 + 0.1 * y, 1.0 + 0.1 * x]),
            |_| [9.0, 9.0],
        );
        assert!(far.is_none(), "further than a shift can be: {far:?}");
    }

    /// Three explanations of `n_tiles` tiles: the second is right in `n_right` of them, the third says what the first says.
    fn explained(n_tiles: usize, n_right: usize) -> Errors {
        let mut errors = Errors::default();
        for tile in 0..n_tiles {
            // A little of its own in every tile, as real ones have it.
            let own = 1.0 + 0.01 * (tile % 3) as f64;
            let second = if tile < n_right { 0.0 } else { own };
            let mut apart = [Apart::default(); 3];
            apart[1].add(if tile < n_right { own } else { 0.0 });
            errors.push_apart(vec![own, second, own], &apart, 1);
        }
        errors
    }

    #[test]
    fn a_gain_needs_tiles_enough() {
        let everywhere = explained(16, 16);
        let gain = everywhere.gain(0, 1);
        assert!((gain.share - 1.0).abs() < 1e-9 && gain.z > 20.0, "{gain:?}");
        assert!(everywhere.gain(1, 0).z < -20.0);
        assert_eq!(everywhere.best(), 1);
        let same = everywhere.gain(0, 2);
        assert_eq!((same.share, same.z), (0.0, 0.0));
        // As sure of itself in each of its tiles, but there are two of them.
        let gain = explained(16, 2).gain(0, 1);
        assert!(gain.share > 0.1 && gain.z < 2.0, "{gain:?}");
    }

    #[test]
    fn a_verdict_weighs_what_is_predicted_differently() {
        assert!((explained(16, 16).verdict(1) - 1.0).abs() < 1e-9);
        assert!(
            (explained(16, 2).verdict(1) - 1.0).abs() < 1e-9,
            "where they differ it is right"
        );
        assert_eq!(explained(16, 16).verdict(2), 0.0, "it says what the first says");
        let one_tile = |first: f64, second: f64, apart: f64| {
            let mut errors = Errors::default();
            let mut aparts = [Apart::default(); 2];
            aparts[1].add(apart);
            errors.push_apart(vec![first, second], &aparts, 1);
            errors.verdict(1)
        };
        assert_eq!(one_tile(0.0, 0.4, 0.4), -1.0);
        assert_eq!(one_tile(0.5, 0.5, 0.4), 0.0);
        // Less than eight bits can tell.
        assert_eq!(one_tile(0.003, 0.0, 0.003), 0.0);
    }
}
