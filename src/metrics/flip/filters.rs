//! FLIP's filters: the eye's contrast sensitivity as Gaussians, one a colour channel, and Gaussian derivatives that
//! detect edges and points. All are separable; a tile is filtered along rows, then along columns.

use std::f64::consts::PI;

/// Pixels in a degree of the visual field: 3840 pixels over 0.7 m, seen from 0.7 m. The page rounds it to 67.02.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Side of a tile in pixels.
pub const TILE: usize = 64;
/// How far the widest filter reaches.
pub const APRON: usize = 10;
/// Side of a tile's input.
pub const INPUT: usize = TILE + 2 * APRON;
/// Columns summed at once, so that the sums stay in registers.
const BLOCK: usize = 16;
/// Taps below this share of the centre are left out: they move no result by a step of f32.
const NEGLIGIBLE: f64 = 1e-9;

/// Width of the detectors: the human eye's edges, 0.082 degrees.
const FEATURE_DEGREES: f64 = 0.082;

/// A one-dimensional filter, symmetric or antisymmetric: its weights from the centre on.
struct Kernel {
    weights: Vec<f32>,
    odd: bool,
}

impl Kernel {
    /// The even filter with weights proportional to `f`, which sum to 1; and their sum before that.
    fn smoothing(f: impl Fn(f64) -> f64) -> (Self, f64) {
        let weights: Vec<f64> = (0..=APRON)
            .map(|x| f(x as f64))
            .take_while(|weight| *weight > NEGLIGIBLE)
            .collect();
        let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
        (Self::new(&weights, 1.0 / sum, false), sum)
    }

    /// Scaled so that positive weights sum to 1 and, as far as there are any, negative ones to −1.
    fn detecting(f: impl Fn(f64) -> f64, reach: usize, odd: bool) -> Self {
        let weights: Vec<f64> = (0..=reach).map(|x| f(x as f64)).collect();
        if odd {
            let sum: f64 = weights.iter().map(|weight| weight.abs()).sum();
            return Self::new(&weights, 1.0 / sum, true);
        }
        let sum = |positive: bool| {
            let all = weights.iter().chain(&weights[1..]);
            all.filter(|weight| (**weight > 0.0) == positive).sum::<f64>()
        };
        let [above, below] = [sum(true), -sum(false)];
        let scaled: Vec<f64> = weights
            .iter()
            .map(|weight| weight / if *weight > 0.0 { above } else { below })
            .collect();
        Self::new(&scaled, 1.0, false)
    }

    fn new(weights: &[f64], scale: f64, odd: bool) -> Self {
        Self {
            weights: weights.iter().map(|weight| (weight * scale) as f32).collect(),
            odd,
        }
    }

    /// `output[i] = Σ weight(k) · tap(k)[i]`, where `tap(k)` is the input moved by k − [`APRON`].
    #[inline(always)]
    fn apply<'a>(&self, tap: impl Fn(usize) -> &'a [f32], output: &mut [f32; TILE]) {
        let sign = if self.odd { -1.0 } else { 1.0 };
        for (block, output) in output.chunks_exact_mut(BLOCK).enumerate() {
            let at = |k: usize| -> &[f32; BLOCK] {
                let run = tap(k)[block * BLOCK..].first_chunk();
                run.expect("a tap is a tile wide")
            };
            let centre = at(APRON);
            let mut sums = centre.map(|value| self.weights[0] * value);
            for (k, weight) in self.weights.iter().enumerate().skip(1) {
                let (before, after) = (at(APRON - k), at(APRON + k));
                for i in 0..BLOCK {
                    sums[i] += weight * (after[i] + sign * before[i]);
                }
            }
            output.copy_from_slice(&sums);
        }
    }
}

/// Rows of a tile's input after filtering along rows.
type Rows = Vec<[f32; TILE]>;

/// All filters for [`PIXELS_PER_DEGREE`].
pub struct Filters {
    achromatic: Kernel,
    red_green: Kernel,
    blue_yellow: [Kernel; 2],
    /// Shares of the two Gaussians of blue–yellow.
    pub shares: [f32; 2],
    gauss: Kernel,
    edge: Kernel,
    point: Kernel,
}

impl Filters {
    pub fn new() -> Self {
        // The transform of the sensitivity a·exp(−b f²) at x degrees is a·√(π/b)·exp(−π²x²/b).
        let sensitivity = |b: f64| {
            Kernel::smoothing(move |x| libm::exp(-(PI * x / PIXELS_PER_DEGREE) * (PI * x / PIXELS_PER_DEGREE) / b))
        };
        let ((wide, wide_sum), (narrow, narrow_sum)) = (sensitivity(0.04), sensitivity(0.025));
        let wide_share = 34.1 * (PI / 0.04).sqrt() * wide_sum * wide_sum;
        let narrow_share = 13.5 * (PI / 0.025).sqrt() * narrow_sum * narrow_sum;
        let deviation = 0.5 * FEATURE_DEGREES * PIXELS_PER_DEGREE;
        let gauss = move |x: f64| libm::exp(-0.5 * (x / deviation) * (x / deviation));
        let reach = (3.0 * deviation).ceil() as usize;
        let smooth: Vec<f64> = (0..=reach).map(|x| gauss(x as f64)).collect();
        let smooth_sum = 2.0 * smooth.iter().sum::<f64>() - 1.0;
        Self {
            achromatic: sensitivity(0.0047).0,
            red_green: sensitivity(0.0053).0,
            blue_yellow: [wide, narrow],
            shares: [wide_share, narrow_share].map(|share| (share / (wide_share + narrow_share)) as f32),
            gauss: Kernel::new(&smooth, 1.0 / smooth_sum, false),
            edge: Kernel::detecting(|x| x * gauss(x), reach, true),
            point: Kernel::detecting(|x| ((x / deviation) * (x / deviation) - 1.0) * gauss(x), reach, false),
        }
    }
}

impl Filters {
    /// The weights at each distance from the centre, as a device reads them: of lightness, red–green and both Gaussians of
    /// blue–yellow, then of the Gaussian of features and its derivatives.
    pub fn taps(&self) -> [[f32; 8]; APRON + 1] {
        let [wide, narrow] = &self.blue_yellow;
        let kernels = [
            &self.achromatic,
            &self.red_green,
            wide,
            narrow,
            &self.gauss,
            &self.edge,
            &self.point,
        ];
        std::array::from_fn(|k| {
            let mut tap = [0.0; 8];
            for (weight, kernel) in tap.iter_mut().zip(kernels) {
                *weight = kernel.weights.get(k).copied().unwrap_or(0.0);
            }
            tap
        })
    }
}

/// Room for a tile on its way through the filters.
pub struct Scratch {
    /// Y, Cx and Cz of the input.
    pub input: [Vec<[f32; INPUT]>; 3],
    along_rows: [Rows; 7],
}

impl Scratch {
    pub fn new() -> Self {
        Self {
            input: [(); 3].map(|()| vec![[0.0; INPUT]; INPUT]),
            along_rows: [(); 7].map(|()| vec![[0.0; TILE]; INPUT]),
        }
    }

    #[inline(always)]
    pub fn filter_rows(&mut self, filters: &Filters) {
        let Filters {
            blue_yellow: [wide, narrow],
            ..
        } = filters;
        let plan = [
            (&filters.achromatic, 0),
            (&filters.red_green, 1),
            (wide, 2),
            (narrow, 2),
            (&filters.gauss, 0),
            (&filters.edge, 0),
            (&filters.point, 0),
        ];
        for ((kernel, channel), output) in plan.into_iter().zip(&mut self.along_rows) {
            for (row, output) in self.input[channel].iter().zip(output) {
                kernel.apply(|k| &row[k..], output);
            }
        }
    }

    /// Row `y` of the tile: what the eye sees of Y, Cx and Cz, and the strengths of edges and points.
    #[inline(always)]
    pub fn filter_columns(&self, filters: &Filters, y: usize) -> [[f32; TILE]; 5] {
        let along = |kernel: &Kernel, rows: &Rows| {
            let mut output = [0.0; TILE];
            kernel.apply(|k| &rows[y + k], &mut output);
            output
        };
        let [achromatic, red_green, wide, narrow, gauss, edge, point] = &self.along_rows;
        let [wide, narrow] = [
            along(&filters.blue_yellow[0], wide),
            along(&filters.blue_yellow[1], narrow),
        ];
        let [wide_share, narrow_share] = filters.shares;
        [
            along(&filters.achromatic, achromatic),
            along(&filters.red_green, red_green),
            std::array::from_fn(|x| wide_share * wide[x] + narrow_share * narrow[x]),
            length(along(&filters.gauss, edge), along(&filters.edge, gauss)),
            length(along(&filters.gauss, point), along(&filters.point, gauss)),
        ]
    }
}

#[inline(always)]
fn length(a: [f32; TILE], b: [f32; TILE]) -> [f32; TILE] {
    // Of Y from −16 to 100; features are defined for 0 to 1.
    std::array::from_fn(|x| (a[x] * a[x] + b[x] * b[x]).sqrt() / 116.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filtered(f: impl Fn(usize, usize) -> f32) -> [[f32; TILE]; 5] {
        let mut scratch = Scratch::new();
        for channel in &mut scratch.input {
            for (y, row) in channel.iter_mut().enumerate() {
                *row = std::array::from_fn(|x| f(x, y));
            }
        }
        let filters = Filters::new();
        scratch.filter_rows(&filters);
        scratch.filter_columns(&filters, TILE / 2)
    }

    #[test]
    fn flat_input_stays_and_has_no_features() {
        let [y, cx, cz, edge, point] = filtered(|_, _| 50.0);
        for smooth in [y, cx, cz] {
            assert!(smooth.iter().all(|value| (value - 50.0).abs() < 1e-4));
        }
        for feature in [edge, point] {
            assert!(feature.iter().all(|&value| value < 1e-6), "{feature:?}");
        }
    }

    #[test]
    fn a_step_from_black_to_white_is_an_edge_of_strength_one() {
        let step = |at: usize| if at < APRON + TILE / 2 { -16.0 } else { 100.0 };
        for [_, _, _, edge, _] in [filtered(|x, _| step(x)), filtered(|_, y| step(y))] {
            let strongest = edge.iter().copied().fold(0.0, f32::max);
            assert!((strongest - 1.0).abs() < 1e-3, "{strongest}");
        }
    }
}
