//! The exact convex hull of the neighbourhood, which boxes approximate: an accuracy reference. Salvi, GDC 2016.
//!
//! History moves towards the current colour by the smallest share `t` with which it is a mean of the 9 colours: a linear
//! program in `t` and the 9 weights, solved by the simplex method in f64.

use super::{color::Color, real::Real};

/// Columns: 9 weights, `t`, the slack of `t <= 1`, then one artificial a row.
const N_COLORS: usize = 9;
const T: usize = N_COLORS;
const SLACK: usize = T + 1;
/// Three channels, the weights' sum, and `t <= 1`.
const N_ROWS: usize = 5;
const ARTIFICIAL: usize = SLACK + 1;
const VALUE: usize = ARTIFICIAL + N_ROWS;

/// Below this a coefficient is rounding.
const TINY: f64 = 1e-10;

/// The nearest point to `history` on the segment to `current` that lies in the hull; to the mean of `colors` where
/// `current` lies outside itself.
pub fn clip<R: Real>(history: Color<R>, current: Color<R>, colors: [Color<R>; 9]) -> Color<R> {
    let sum = colors.into_iter().fold(Color::default(), |sum, c| sum + c);
    for end in [current, sum * R::new(1.0 / 9.0)] {
        if let Some(t) = smallest_share(history, end, colors) {
            return history + (end - history) * R::new(t);
        }
    }
    current
}

fn smallest_share<R: Real>(history: Color<R>, end: Color<R>, colors: [Color<R>; 9]) -> Option<f64> {
    let mut tableau = Tableau::new(history, end, colors);
    // First drive out the artificials, which leaves a feasible point; then lower t.
    tableau.minimise(|column| f64::from(u8::from(column >= ARTIFICIAL)), VALUE);
    if tableau.value_of(|column| column >= ARTIFICIAL) > 1e-7 {
        return None;
    }
    tableau.minimise(|column| f64::from(u8::from(column == T)), ARTIFICIAL);
    Some(tableau.value_of(|column| column == T).clamp(0.0, 1.0))
}

struct Tableau {
    rows: [[f64; VALUE + 1]; N_ROWS],
    basis: [usize; N_ROWS],
}

impl Tableau {
    /// Weights w and share t with `Σ w c - t (end - history) = history`, `Σ w = 1`, `t + slack = 1`.
    fn new<R: Real>(history: Color<R>, end: Color<R>, colors: [Color<R>; 9]) -> Self {
        let mut rows = [[0.0; VALUE + 1]; N_ROWS];
        for (channel, row) in rows[..3].iter_mut().enumerate() {
            let of = |c: Color<R>| c.0[channel].to_f64();
            row[..N_COLORS].copy_from_slice(&colors.map(of));
            row[T] = of(history) - of(end);
            row[VALUE] = of(history);
        }
        rows[3][..N_COLORS].fill(1.0);
        rows[3][VALUE] = 1.0;
        (rows[4][T], rows[4][SLACK], rows[4][VALUE]) = (1.0, 1.0, 1.0);
        for (i, row) in rows.iter_mut().enumerate() {
            if row[VALUE] < 0.0 {
                row.iter_mut().for_each(|v| *v = -*v);
            }
            row[ARTIFICIAL + i] = 1.0;
        }
        Self {
            rows,
            basis: std::array::from_fn(|i| ARTIFICIAL + i),
        }
    }

    /// Bland's rule, which cannot cycle: the first column of `0..n_columns` that lowers the cost enters.
    fn minimise(&mut self, cost: impl Fn(usize) -> f64, n_columns: usize) {
        let reduced = |tableau: &Self, column: usize| {
            let rows = tableau.rows.iter().zip(tableau.basis);
            cost(column) - rows.map(|(row, basic)| cost(basic) * row[column]).sum::<f64>()
        };
        while let Some(enters) = (0..n_columns).find(|&column| reduced(self, column) < -TINY) {
            let ratio = |i: usize| self.rows[i][VALUE] / self.rows[i][enters];
            let candidates = (0..N_ROWS).filter(|&i| self.rows[i][enters] > TINY);
            let Some(leaves) = candidates.min_by(|&a, &b| {
                let by_index = self.basis[a].cmp(&self.basis[b]);
                ratio(a).total_cmp(&ratio(b)).then(by_index)
            }) else {
                return;
            };
            self.pivot(leaves, enters);
        }
    }

    fn pivot(&mut self, leaves: usize, enters: usize) {
        let by = self.rows[leaves][enters];
        self.rows[leaves].iter_mut().for_each(|v| *v /= by);
        let pivot_row = self.rows[leaves];
        for (i, row) in self.rows.iter_mut().enumerate() {
            let factor = row[enters];
            if i != leaves {
                row.iter_mut().zip(pivot_row).for_each(|(v, p)| *v -= factor * p);
            }
        }
        self.basis[leaves] = enters;
    }

    /// The sum of the basic variables that `is_wanted`; others are 0.
    fn value_of(&self, is_wanted: impl Fn(usize) -> bool) -> f64 {
        let basic = self
            .rows
            .iter()
            .zip(self.basis)
            .filter(|(_, column)| is_wanted(*column));
        basic.map(|(row, _)| row[VALUE]).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners of the unit cube's lower half: a tetrahedron and five points inside it.
    fn tetrahedron() -> [Color<f64>; 9] {
        let mut colors = [Color::splat(0.1); 9];
        colors[1] = Color([0.0, 0.0, 0.0]);
        colors[2] = Color([1.0, 0.0, 0.0]);
        colors[3] = Color([0.0, 1.0, 0.0]);
        colors[4] = Color([0.0, 0.0, 1.0]);
        colors
    }

    fn assert_near(found: Color<f64>, expected: [f64; 3]) {
        let error = (found - Color(expected)).map(f64::abs).max3();
        assert!(error < 1e-9, "{found:?} instead of {expected:?}");
    }

    #[test]
    fn history_stops_at_the_face_it_meets() {
        // From (1, 1, 1) towards the origin, the plane r + g + b = 1 is met at a third.
        assert_near(
            clip(Color::splat(1.0), Color::splat(0.0), tetrahedron()),
            [1.0 / 3.0; 3],
        );
        // Inside the box but outside the hull, which is what the box gets wrong.
        assert_near(
            clip(Color([0.6, 0.6, 0.0]), Color([0.4, 0.4, 0.0]), tetrahedron()),
            [0.5, 0.5, 0.0],
        );
    }

    #[test]
    fn what_is_inside_stays() {
        assert_near(
            clip(Color([0.2, 0.3, 0.1]), Color::splat(0.1), tetrahedron()),
            [0.2, 0.3, 0.1],
        );
    }

    #[test]
    fn flat_hulls_have_no_inside_but_a_nearest_point() {
        let point = [Color::splat(0.5); 9];
        assert_near(clip(Color([0.9, 0.1, 0.5]), point[0], point), [0.5; 3]);
        let mut line = point;
        line[7] = Color([1.0, 0.5, 0.5]);
        assert_near(clip(Color([2.0, 0.5, 0.5]), Color::splat(0.5), line), [1.0, 0.5, 0.5]);
        assert_near(
            clip(Color([0.7, 0.9, 0.5]), Color([0.7, 0.5, 0.5]), line),
            [0.7, 0.5, 0.5],
        );
    }

    #[test]
    fn a_current_colour_outside_gives_way_to_the_mean() {
        let found = clip(Color::splat(1.0), Color::splat(2.0), tetrahedron());
        assert!(found.0.iter().sum::<f64>() <= 1.0 + 1e-9, "{found:?}");
    }
}
