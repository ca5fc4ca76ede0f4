//! FLIP's filters: the eye's contrast sensitivity as Gaussians, one a colour channel, and Gaussian derivatives that
//! detect edges and points. All are separable; a tile is filtered along rows, then along columns. Filters of one channel
//! go over it together, because what is read of both sides of a pixel is the same for all that are symmetric.

use std::f64::consts::PI;

/// Pixels in a degree of the visual field: 3840 pixels over 0.7 m, seen from 0.7 m. The page rounds it to 67.02.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Side of a tile in pixels.
pub const TILE: usize = 64;
/// How far the widest filter reaches.
pub const APRON: usize = 10;
/// Side of a tile's input.
pub const INPUT: usize = TILE + 2 * APRON;
/// Pixels summed at once, so that the sums stay in registers.
const BLOCK: usize = 16;

/// Width of the detectors: the human eye's edges, 0.082 degrees.
const FEATURE_DEGREES: f64 = 0.082;

/// How many weights the filters have from the centre on. Those that would follow are below 1e-7 of the centre's and move
/// no result by a step of f32, or lie beyond what the publication's filters reach.
const ACHROMATIC: usize = 6;
const RED_GREEN: usize = 7;
const BLUE_YELLOW: usize = APRON + 1;
const FEATURE: usize = 10;

/// A one-dimensional filter, symmetric or antisymmetric: its weights from the centre on.
type Kernel<const N: usize> = [f32; N];

/// The even filter with weights proportional to `f`, which sum to 1; and their sum before that.
fn smoothing<const N: usize>(f: impl Fn(f64) -> f64) -> (Kernel<N>, f64) {
    let weights: [f64; N] = std::array::from_fn(|x| f(x as f64));
    let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
    (weights.map(|weight| (weight / sum) as f32), sum)
}

/// The odd filter with weights proportional to `f`, whose positive weights sum to 1.
fn detecting_odd<const N: usize>(f: impl Fn(f64) -> f64) -> Kernel<N> {
    let weights: [f64; N] = std::array::from_fn(|x| f(x as f64));
    let sum: f64 = weights.iter().map(|weight| weight.abs()).sum();
    weights.map(|weight| (weight / sum) as f32)
}

/// The even filter whose weights are proportional to `f` on either side of 0, where they sum to 1 and to −1.
fn detecting_even<const N: usize>(f: impl Fn(f64) -> f64) -> Kernel<N> {
    let weights: [f64; N] = std::array::from_fn(|x| f(x as f64));
    let sum = |positive: bool| {
        let all = weights.iter().chain(&weights[1..]);
        all.filter(|weight| (**weight > 0.0) == positive).sum::<f64>()
    };
    let [above, below] = [sum(true), -sum(false)];
    weights.map(|weight| (weight / if weight > 0.0 { above } else { below }) as f32)
}

/// All filters for [`PIXELS_PER_DEGREE`].
pub struct Filters {
    achromatic: Kernel<ACHROMATIC>,
    red_green: Kernel<RED_GREEN>,
    blue_yellow: [Kernel<BLUE_YELLOW>; 2],
    /// Shares of the two Gaussians of blue–yellow.
    pub shares: [f32; 2],
    gauss: Kernel<FEATURE>,
    edge: Kernel<FEATURE>,
    point: Kernel<FEATURE>,
}

/// How much of the centre's weight a pixel has `x` pixels away. The transform of the sensitivity a·exp(−b f²) at x degrees is
/// a·√(π/b)·exp(−π²x²/b).
fn sensitivity(b: f64) -> impl Fn(f64) -> f64 {
    move |x| libm::exp(-(PI * x / PIXELS_PER_DEGREE) * (PI * x / PIXELS_PER_DEGREE) / b)
}

impl Filters {
    pub fn new() -> Self {
        let ((wide, wide_sum), (narrow, narrow_sum)) = (smoothing(sensitivity(0.04)), smoothing(sensitivity(0.025)));
        let wide_share = 34.1 * (PI / 0.04).sqrt() * wide_sum * wide_sum;
        let narrow_share = 13.5 * (PI / 0.025).sqrt() * narrow_sum * narrow_sum;
        let deviation = 0.5 * FEATURE_DEGREES * PIXELS_PER_DEGREE;
        let gauss = move |x: f64| libm::exp(-0.5 * (x / deviation) * (x / deviation));
        Self {
            achromatic: smoothing(sensitivity(0.0047)).0,
            red_green: smoothing(sensitivity(0.0053)).0,
            blue_yellow: [wide, narrow],
            shares: [wide_share, narrow_share].map(|share| (share / (wide_share + narrow_share)) as f32),
            gauss: smoothing(gauss).0,
            edge: detecting_odd(|x| x * gauss(x)),
            point: detecting_even(|x| ((x / deviation) * (x / deviation) - 1.0) * gauss(x)),
        }
    }

    /// The weights at each distance from the centre, as a device reads them: of lightness, red–green and both Gaussians of
    /// blue–yellow, then of the Gaussian of features and its derivatives.
    pub fn taps(&self) -> [[f32; 8]; APRON + 1] {
        let [wide, narrow] = &self.blue_yellow;
        let kernels: [&[f32]; 7] = [
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
                *weight = kernel.get(k).copied().unwrap_or(0.0);
            }
            tap
        })
    }
}

/// `EVEN` symmetric filters and `ODD` antisymmetric ones of the same input, all over `N` weights: `output[i] = Σ weight(k) ·
/// tap(k)[i]`, where `tap(k)` is the input moved by k − [`APRON`].
#[inline(always)]
fn apply<'a, const N: usize, const EVEN: usize, const ODD: usize>(
    even: [(&Kernel<N>, &mut [f32; TILE]); EVEN],
    odd: [(&Kernel<N>, &mut [f32; TILE]); ODD],
    tap: impl Fn(usize) -> &'a [f32],
) {
    for start in (0..TILE).step_by(BLOCK) {
        let at = |k: usize| -> &[f32; BLOCK] { tap(k)[start..].first_chunk().expect("a tap is a tile wide") };
        let centre = at(APRON);
        let (mut even_sums, mut odd_sums) = ([[0.0; BLOCK]; EVEN], [[0.0; BLOCK]; ODD]);
        for e in 0..EVEN {
            for i in 0..BLOCK {
                even_sums[e][i] = even[e].0[0] * centre[i];
            }
        }
        for k in 1..N {
            let (before, after) = (at(APRON - k), at(APRON + k));
            for e in 0..EVEN {
                for i in 0..BLOCK {
                    even_sums[e][i] = even[e].0[k].mul_add(after[i] + before[i], even_sums[e][i]);
                }
            }
            for o in 0..ODD {
                for i in 0..BLOCK {
                    odd_sums[o][i] = odd[o].0[k].mul_add(after[i] - before[i], odd_sums[o][i]);
                }
            }
        }
        for e in 0..EVEN {
            even[e].1[start..start + BLOCK].copy_from_slice(&even_sums[e]);
        }
        for o in 0..ODD {
            odd[o].1[start..start + BLOCK].copy_from_slice(&odd_sums[o]);
        }
    }
}

/// Rows of a tile's input after filtering along rows.
type Rows = Vec<[f32; TILE]>;

/// Room for a tile on its way through the filters.
pub struct Scratch {
    /// Y, Cx and Cz of the input.
    pub input: [Vec<[f32; INPUT]>; 3],
    /// Y, Cx and twice Cz, filtered for colour.
    colors: [Rows; 4],
    /// Y, filtered by the Gaussian of features and by its derivatives.
    features: [Rows; 3],
}

impl Scratch {
    pub fn new() -> Self {
        Self {
            input: [(); 3].map(|()| vec![[0.0; INPUT]; INPUT]),
            colors: [(); 4].map(|()| vec![[0.0; TILE]; INPUT]),
            features: [(); 3].map(|()| vec![[0.0; TILE]; INPUT]),
        }
    }

    #[inline(always)]
    pub fn filter_rows(&mut self, filters: &Filters) {
        let [lightness, red_green, blue_yellow] = &self.input;
        let ([achromatic, rg, wide, narrow], [gauss, edge, point]) = (&mut self.colors, &mut self.features);
        let [wide_kernel, narrow_kernel] = &filters.blue_yellow;
        for (y, row) in lightness.iter().enumerate() {
            apply([(&filters.achromatic, &mut achromatic[y])], [], |k| &row[k..]);
            let even = [(&filters.gauss, &mut gauss[y]), (&filters.point, &mut point[y])];
            apply(even, [(&filters.edge, &mut edge[y])], |k| &row[k..]);
        }
        for (y, row) in red_green.iter().enumerate() {
            apply([(&filters.red_green, &mut rg[y])], [], |k| &row[k..]);
        }
        for (y, row) in blue_yellow.iter().enumerate() {
            let even = [(wide_kernel, &mut wide[y]), (narrow_kernel, &mut narrow[y])];
            apply(even, [], |k| &row[k..]);
        }
    }

    /// Row `y` of the tile: what the eye sees of Y, Cx and Cz.
    #[inline(always)]
    pub fn colors(&self, filters: &Filters, y: usize, [l, cx, cz]: [&mut [f32; TILE]; 3]) {
        let [achromatic, red_green, wide, narrow] = &self.colors;
        let [wide_kernel, narrow_kernel] = &filters.blue_yellow;
        let mut narrow_cz = [0.0; TILE];
        apply([(&filters.achromatic, l)], [], |k| &achromatic[y + k]);
        apply([(&filters.red_green, cx)], [], |k| &red_green[y + k]);
        apply([(wide_kernel, &mut *cz)], [], |k| &wide[y + k]);
        apply([(narrow_kernel, &mut narrow_cz)], [], |k| &narrow[y + k]);
        let [wide_share, narrow_share] = filters.shares;
        for x in 0..TILE {
            cz[x] = wide_share.mul_add(cz[x], narrow_share * narrow_cz[x]);
        }
    }

    /// The strengths of edges and points in row `y` of the tile.
    #[inline(always)]
    pub fn features(&self, filters: &Filters, y: usize, [edges, points]: [&mut [f32; TILE]; 2]) {
        let [gauss, edge, point] = &self.features;
        let [mut edge_y, mut point_y] = [[0.0; TILE]; 2];
        apply([(&filters.gauss, &mut *edges)], [], |k| &edge[y + k]);
        apply([(&filters.gauss, &mut *points)], [], |k| &point[y + k]);
        apply([(&filters.point, &mut point_y)], [(&filters.edge, &mut edge_y)], |k| {
            &gauss[y + k]
        });
        for (feature, other) in [(edges, &edge_y), (points, &point_y)] {
            for x in 0..TILE {
                // Of Y from −16 to 100; features are defined for 0 to 1.
                feature[x] = (feature[x] * feature[x] + other[x] * other[x]).sqrt() * (1.0 / 116.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filtered(f: impl Fn(usize, usize) -> f32) -> ([[f32; TILE]; 3], [[f32; TILE]; 2]) {
        let mut scratch = Scratch::new();
        for channel in &mut scratch.input {
            for (y, row) in channel.iter_mut().enumerate() {
                *row = std::array::from_fn(|x| f(x, y));
            }
        }
        let filters = Filters::new();
        scratch.filter_rows(&filters);
        let (mut colors, mut features) = ([[0.0; TILE]; 3], [[0.0; TILE]; 2]);
        scratch.colors(&filters, TILE / 2, colors.each_mut());
        scratch.features(&filters, TILE / 2, features.each_mut());
        (colors, features)
    }

    #[test]
    fn flat_input_stays_and_has_no_features() {
        let (colors, features) = filtered(|_, _| 50.0);
        for smooth in colors {
            assert!(smooth.iter().all(|value| (value - 50.0).abs() < 1e-4));
        }
        for feature in features {
            assert!(feature.iter().all(|&value| value < 1e-6), "{feature:?}");
        }
    }

    #[test]
    fn a_step_from_black_to_white_is_an_edge_of_strength_one() {
        let step = |at: usize| if at < APRON + TILE / 2 { -16.0 } else { 100.0 };
        for (_, [edge, _]) in [filtered(|x, _| step(x)), filtered(|_, y| step(y))] {
            let strongest = edge.iter().copied().fold(0.0, f32::max);
            assert!((strongest - 1.0).abs() < 1e-3, "{strongest}");
        }
    }

    /// Beyond the weights that are kept there are none to speak of.
    #[test]
    fn what_is_left_out_is_negligible() {
        let ends = [(0.0047, ACHROMATIC), (0.0053, RED_GREEN)];
        for (b, n) in ends {
            assert!(
                sensitivity(b)(n as f64) < 1e-7 && sensitivity(b)(n as f64 - 1.0) > 1e-7,
                "{b}"
            );
        }
        let reach = (3.0 * 0.5 * FEATURE_DEGREES * PIXELS_PER_DEGREE).ceil();
        assert_eq!(reach as usize + 1, FEATURE);
    }
}
