//! The sRGB transfer function in f64, both ways, to within two units in the last place of `libm::pow`. A frame of
//! 1080p encodes six million values, which `pow` would make the most expensive part of every metric.

use std::sync::LazyLock;

const LINEAR_BELOW: f64 = 0.003_130_8;
const ENCODED_LINEAR_BELOW: f64 = 0.040_45;

/// Each octave is cut into `2^CELL_BITS` equal cells.
const CELL_BITS: u32 = 6;
/// The octave of `LINEAR_BELOW`: 2⁻⁹ ≤ 0.0031308 < 2⁻⁸.
const LOWEST_EXPONENT: i32 = -9;
const FIRST_CELL: u64 = ((1023 + LOWEST_EXPONENT) as u64) << CELL_BITS;
const N_CELLS: usize = (-LOWEST_EXPONENT as usize) << CELL_BITS;

/// The exponent of the transfer function.
const P: f64 = 1.0 / 2.4;

/// Coefficients of `(1 + r)^P − 1` after `r`: the binomial series. A cell spans |r| ≤ 2⁻⁷, so what follows r⁶ is below
/// 2⁻⁵⁵.
const SERIES: [f64; 6] = {
    let mut series = [P; 6];
    let mut k = 1;
    while k < 6 {
        series[k] = series[k - 1] * (P - k as f64) / (k as f64 + 1.0);
        k += 1;
    }
    series
};

/// Of each cell: one over its centre, and its centre to the power `P`.
static CELLS: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let centre = |cell: u64| f64::from_bits(((FIRST_CELL + cell) << (52 - CELL_BITS)) + (1 << (51 - CELL_BITS)));
    (0..N_CELLS as u64)
        .map(centre)
        .map(|c| [1.0 / c, libm::pow(c, P)])
        .collect()
});

/// Linear to sRGB-encoded, clamped to `[0, 1]`; NaN stays NaN.
pub fn encode(linear: f64) -> f64 {
    if linear <= LINEAR_BELOW {
        return 12.92 * linear.max(0.0);
    }
    if linear >= 1.0 {
        return 1.0;
    }
    let cell = (linear.to_bits() >> (52 - CELL_BITS)).wrapping_sub(FIRST_CELL) as usize;
    let Some(&[inverse, power]) = CELLS.get(cell) else {
        return f64::NAN; // Only a NaN has bits outside the table: everything else has returned.
    };
    let r = linear * inverse - 1.0;
    let series = SERIES
        .iter()
        .rev()
        .fold(0.0, |sum, &coefficient| (sum + coefficient) * r);
    1.055 * (power + power * series) - 0.055
}

/// sRGB-encoded in `[0, 1]` to linear.
pub fn decode(encoded: f64) -> f64 {
    if encoded <= ENCODED_LINEAR_BELOW {
        encoded / 12.92
    } else {
        libm::pow((encoded + 0.055) / 1.055, 2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encode_agrees_with_pow() {
        let n = 200_000;
        for i in 0..=n {
            let linear = LINEAR_BELOW + (1.0 - LINEAR_BELOW) * f64::from(i) / f64::from(n);
            let exact = 1.055 * libm::pow(linear, P) - 0.055;
            let error = (encode(linear) - exact).abs();
            assert!(linear == LINEAR_BELOW || error < 5e-16, "{linear}: {error:e}");
        }
    }

    #[test]
    fn encode_keeps_the_ends_and_nan() {
        assert_eq!(encode(-2.0), 0.0);
        assert_eq!(encode(0.0), 0.0);
        assert_eq!(encode(1.0), 1.0);
        assert_eq!(encode(f64::INFINITY), 1.0);
        assert!(encode(f64::NAN).is_nan() && encode(-f64::NAN).is_nan());
    }

    #[test]
    fn decode_inverts_encode() {
        for i in 0..=65_535 {
            let encoded = f64::from(i) / 65_535.0;
            assert!((encode(decode(encoded)) - encoded).abs() < 5e-9, "{encoded}");
        }
    }
}
