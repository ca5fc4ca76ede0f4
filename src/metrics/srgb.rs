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

/// Places in the table: a power of two, so that masking a cell's number proves that it lies inside.
const N_PLACES: usize = (N_CELLS + 1).next_power_of_two();

/// Of each cell: one over its centre, and its centre to the power `P` times 1.055.
struct Cells {
    inverses: [f64; N_PLACES],
    powers: [f64; N_PLACES],
}

static CELLS: LazyLock<Cells> = LazyLock::new(|| {
    let mut cells = Cells {
        inverses: [0.0; N_PLACES],
        powers: [0.0; N_PLACES],
    };
    for cell in 0..=N_CELLS {
        let bits = (FIRST_CELL + cell as u64) << (52 - CELL_BITS);
        let centre = f64::from_bits(bits + (1 << (51 - CELL_BITS)));
        cells.inverses[cell] = 1.0 / centre;
        cells.powers[cell] = 1.055 * libm::pow(centre, P);
    }
    cells
});

/// Linear to sRGB-encoded, clamped to `[0, 1]`; NaN stays NaN.
///
/// One loop a step, and none has a branch: that is what lets all but the look-up vectorise.
#[inline(always)]
pub fn encode<const N: usize>(values: &mut [f64; N]) {
    let cells = &*CELLS;
    let linear = *values;
    let mut places = [0; N];
    for (place, linear) in places.iter_mut().zip(linear) {
        let above = if linear > LINEAR_BELOW { linear } else { LINEAR_BELOW };
        let within = if above < 1.0 { above } else { 1.0 };
        *place = (within.to_bits() >> (52 - CELL_BITS)).wrapping_sub(FIRST_CELL);
    }
    let (mut inverses, mut powers) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        let place = places[i] as usize % N_PLACES;
        (inverses[i], powers[i]) = (cells.inverses[place], cells.powers[place]);
    }
    let [s1, s2, s3, s4, s5, s6] = SERIES;
    for i in 0..N {
        let r = linear[i] * inverses[i] - 1.0;
        let series = r * (s1 + r * (s2 + r * (s3 + r * (s4 + r * (s5 + r * s6)))));
        values[i] = powers[i] + powers[i] * series - 0.055;
    }
    for i in 0..N {
        let straight = 12.92 * if linear[i] > 0.0 { linear[i] } else { 0.0 };
        values[i] = if linear[i] <= LINEAR_BELOW { straight } else { values[i] };
    }
    for i in 0..N {
        values[i] = if linear[i] >= 1.0 { 1.0 } else { values[i] };
    }
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

    fn encode(linear: f64) -> f64 {
        let mut value = [linear];
        super::encode(&mut value);
        value[0]
    }

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
