//! FLIP's colour spaces, and the roots and powers that it takes of every pixel. All in f32 and free of branches, so
//! that loops over a tile vectorise: for which every function must also be inlined.

use glam::{DMat3, DVec3};
use std::sync::LazyLock;

/// Exponent of colour differences.
pub const QC: f32 = 0.7;
/// Differences below this share of the largest spread over most of the range …
pub const PC: f32 = 0.4;
/// … namely over this much of it.
pub const PT: f32 = 0.95;

/// sRGB's primaries and white, as XYZ of linear R, G and B.
const XYZ_FROM_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(0.412_386_563_253, 0.212_636_821_677, 0.019_330_620_152),
    DVec3::new(0.357_591_490_921, 0.715_182_981_842, 0.119_197_163_640),
    DVec3::new(0.180_450_421_204, 0.072_180_196_481, 0.950_372_587_005),
);

/// XYZ over that of white, from linear RGB, and back: rows.
static TO_XYZ: LazyLock<[[f32; 3]; 3]> = LazyLock::new(|| rows(relative_xyz()));
static FROM_XYZ: LazyLock<[[f32; 3]; 3]> = LazyLock::new(|| rows(relative_xyz().inverse()));

fn relative_xyz() -> DMat3 {
    let white = XYZ_FROM_RGB * DVec3::ONE;
    DMat3::from_diagonal(white.recip()) * XYZ_FROM_RGB
}

fn rows(matrix: DMat3) -> [[f32; 3]; 3] {
    matrix.transpose().to_cols_array_2d().map(|row| row.map(|x| x as f32))
}

#[inline(always)]
fn mul([a, b, c]: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    let dot = |row: &[f32; 3]| row[0].mul_add(v[0], row[1].mul_add(v[1], row[2] * v[2]));
    [dot(a), dot(b), dot(c)]
}

/// The conversions of one thread: holds the matrices, which a loop must not look up anew for every pixel.
#[derive(Clone, Copy)]
pub struct Colors {
    pub to_xyz: [[f32; 3]; 3],
    pub from_xyz: [[f32; 3]; 3],
    pub largest: f32,
}

impl Colors {
    pub fn new() -> Self {
        let mut colors = Self {
            to_xyz: *TO_XYZ,
            from_xyz: *FROM_XYZ,
            largest: 1.0,
        };
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| colors.hunt_lab(colors.ycxcz(rgb)));
        colors.largest = pow(hyab(green, blue), QC);
        colors
    }

    /// The linear form of CIELAB in which contrast sensitivity is known.
    #[inline(always)]
    pub fn ycxcz(&self, rgb: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = mul(&self.to_xyz, rgb);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    /// CIELAB of a filtered colour, brought back into sRGB's gamut; chroma scaled by lightness, after Hunt.
    #[inline(always)]
    pub fn hunt_lab(&self, [l, cx, cz]: [f32; 3]) -> [f32; 3] {
        let y = (l + 16.0) * (1.0 / 116.0);
        let rgb = mul(&self.from_xyz, [y + cx * (1.0 / 500.0), y, y - cz * (1.0 / 200.0)]);
        let [r, g, b] = rgb;
        let [x, y, z] = mul(&self.to_xyz, [clamp(r), clamp(g), clamp(b)]);
        let [x, y, z] = [lab_root(x), lab_root(y), lab_root(z)];
        let l = 116.0 * y - 16.0;
        [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)]
    }

    /// How different two such colours look, 0 to 1.
    #[inline(always)]
    pub fn difference(&self, a: [f32; 3], b: [f32; 3]) -> f32 {
        let difference = pow(hyab(a, b), QC);
        let knee = PC * self.largest;
        if difference < knee {
            PT / knee * difference
        } else {
            PT + (difference - knee) / (self.largest - knee) * (1.0 - PT)
        }
    }
}

/// City-block in lightness, Euclidean in chroma: Abasi, Tehran and Fairchild, "Distance metrics for very large color
/// differences", 2019.
#[inline(always)]
fn hyab([l, a, b]: [f32; 3], [m, c, d]: [f32; 3]) -> f32 {
    (l - m).abs() + ((a - c) * (a - c) + (b - d) * (b - d)).sqrt()
}

/// Into `[0, 1]`.
#[inline(always)]
fn clamp(x: f32) -> f32 {
    let below = if x < 1.0 { x } else { 1.0 };
    if below > 0.0 { below } else { 0.0 }
}

#[inline(always)]
fn lab_root(t: f32) -> f32 {
    const DELTA: f32 = 6.0 / 29.0;
    let linear = t * (1.0 / (3.0 * DELTA * DELTA)) + 4.0 / 29.0;
    if t > DELTA * DELTA * DELTA { cbrt(t) } else { linear }
}

/// Narkowicz's fit of ACES as FLIP uses it, which lets 0.6 of the exposure through.
#[inline(always)]
pub fn aces(linear: f32) -> f32 {
    let c = 0.6 * linear.max(0.0);
    (c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14)).min(1.0)
}

/// Cube root of `x` ≥ 0, within 3e-7 of itself: z = 1/∛x, guessed from the exponent and improved by the series of
/// (1 − e)^(−1/3), where e = 1 − x z³, to its second term, twice; no step divides.
#[inline(always)]
fn cbrt(x: f32) -> f32 {
    let mut z = f32::from_bits(1_420_032_652 - x.to_bits() / 3);
    for _ in 0..2 {
        let e = (-x * z).mul_add(z * z, 1.0);
        z = (z * e).mul_add((2.0_f32 / 9.0).mul_add(e, 1.0 / 3.0), z);
    }
    x * z * z
}

/// `x` to the power `p`, for `x` that is 0 or normal, and 0 ≤ `p` ≤ 1; within 2e-6 of itself.
#[inline(always)]
pub fn pow(x: f32, p: f32) -> f32 {
    let power = exp2(p * log2(x));
    if x > 0.0 { power } else { 0.0 }
}

/// The exponent, and 2/ln 2 · artanh s for a mantissa (1 + s)/(1 − s) between √½ and √2.
#[inline(always)]
fn log2(x: f32) -> f32 {
    const SQRT_HALF_BITS: i32 = 0x3f35_04f3;
    let exponent = (x.to_bits() as i32).wrapping_sub(SQRT_HALF_BITS) >> 23;
    let mantissa = f32::from_bits((x.to_bits() as i32).wrapping_sub(exponent << 23) as u32);
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let q = s * s;
    let series = polynomial(q, [1.0, 1.0 / 3.0, 1.0 / 5.0, 1.0 / 7.0, 1.0 / 9.0]);
    (2.0 * std::f32::consts::LOG2_E * s).mul_add(series, exponent as f32)
}

/// The exponential series of the fraction, at most ½ either way, and the rest put into the exponent.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5·2²³ leaves no bits for a fraction.
    let shifted = x + ROUND;
    let t = (x - (shifted - ROUND)) * std::f32::consts::LN_2;
    let series = polynomial(t, [1.0, 1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0]);
    let whole = shifted.to_bits().wrapping_sub(ROUND.to_bits());
    series * f32::from_bits(whole.wrapping_add(127) << 23)
}

#[inline(always)]
fn polynomial<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    let mut sum = coefficients[N - 1];
    let mut k = N - 1;
    while k > 0 {
        k -= 1;
        sum = sum.mul_add(x, coefficients[k]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_and_roots_agree_with_libm() {
        for i in 1..100_000 {
            let x = libm::powf(1.0003, i as f32 - 80_000.0);
            let near = |actual: f32, exact: f64| ((f64::from(actual) - exact) / exact).abs();
            assert!(near(cbrt(x), libm::cbrt(f64::from(x))) < 3e-7, "cbrt {x}");
            for p in [0.4, 0.7, 1.0] {
                let error = near(pow(x, p), libm::pow(f64::from(x), f64::from(p)));
                assert!(error < 4e-6, "{x}^{p}: {error:e}");
            }
        }
        assert_eq!(pow(0.0, 0.7), 0.0);
    }

    #[test]
    fn the_largest_difference_is_one_and_equal_colours_have_none() {
        let colors = Colors::new();
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| colors.hunt_lab(colors.ycxcz(rgb)));
        assert!((colors.difference(green, blue) - 1.0).abs() < 1e-6);
        assert_eq!(colors.difference(green, green), 0.0);
        let white = colors.hunt_lab(colors.ycxcz([1.0; 3]));
        assert!((white[0] - 100.0).abs() < 1e-3 && white[1].abs() < 1e-3 && white[2].abs() < 1e-3);
    }
}
