//! The sRGB transfer function in f64, both ways, to within three units in the last place of `libm::pow`. A frame of
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

/// Coefficients of `(1 + r)^P − 1` after `r`, for |r| ≤ 2⁻⁷, which is what a cell spans: the binomial series, whose sixth
/// power is replaced by the even powers below that are nearest to it (those of Chebyshev's polynomial): what it is by itself,
/// then the coefficients. Within 2e-16.
const SERIES: (f64, [f64; 5]) = {
    let mut series = [P; 6];
    let mut k = 1;
    while k < 6 {
        series[k] = series[k - 1] * (P - k as f64) / (k as f64 + 1.0);
        k += 1;
    }
    let [s1, s2, s3, s4, s5, s6] = series;
    const SPAN: f64 = 1.0 / ((1 << 7) * (1 << 7)) as f64;
    let coefficients = [s1, s2 - 9.0 / 16.0 * SPAN * SPAN * s6, s3, s4 + 1.5 * SPAN * s6, s5];
    (SPAN * SPAN * SPAN * s6 / 32.0, coefficients)
};

/// Places in the table: a power of two, so that masking the leading bits of a number proves that they lie inside.
const N_PLACES: usize = (N_CELLS + 1).next_power_of_two();

/// Of each cell, by its number's last bits: one over its centre, and its centre encoded. The last cell holds 1 alone, which
/// stays exactly 1.
static CELLS: LazyLock<[[f64; 2]; N_PLACES]> = LazyLock::new(|| {
    let mut cells = [[0.0; 2]; N_PLACES];
    for cell in FIRST_CELL..=FIRST_CELL + N_CELLS as u64 {
        let start = f64::from_bits(cell << (52 - CELL_BITS));
        let centre = f64::from_bits((cell << (52 - CELL_BITS)) + (1 << (51 - CELL_BITS)));
        let power = 1.055 * libm::pow(centre, P);
        let of_cell = [1.0 / centre, libm::fma(power, SERIES.0, power - 0.055)];
        cells[cell as usize % N_PLACES] = if start < 1.0 { of_cell } else { [1.0; 2] };
    }
    cells
});

/// What [`encode`] looks up, in memory that need not be cleared for every call.
pub struct Found<const N: usize> {
    places: [u64; N],
    cells: [[f64; 2]; N],
}

impl<const N: usize> Default for Found<N> {
    #[inline(always)]
    fn default() -> Self {
        Self {
            places: [0; N],
            cells: [[0.0; 2]; N],
        }
    }
}

/// Linear to sRGB-encoded, clamped to `[0, 1]`; NaN stays NaN. `values` are left clamped.
///
/// One loop a step, and none has a branch: that is what lets all but the look-up vectorise.
#[inline(always)]
pub fn encode<const N: usize>(values: &mut [f64; N], codes: &mut [f64; N], found: &mut Found<N>) {
    let cells = &*CELLS;
    for (place, value) in found.places.iter_mut().zip(&mut *values) {
        // NaN passes both, as it would not through `clamp`.
        *value = if *value > 1.0 { 1.0 } else { *value };
        *value = if *value < 0.0 { 0.0 } else { *value };
        *place = value.to_bits() >> (52 - CELL_BITS);
    }
    for (cell, place) in found.cells.iter_mut().zip(&found.places) {
        *cell = cells[*place as usize % N_PLACES];
    }
    let (_, [s1, s2, s3, s4, s5]) = SERIES;
    for i in 0..N {
        let (linear, [inverse, encoded]) = (values[i], found.cells[i]);
        let r = linear.mul_add(inverse, -1.0);
        let series = r * r.mul_add(r.mul_add(r.mul_add(r.mul_add(s5, s4), s3), s2), s1);
        let curve = (encoded + 0.055).mul_add(series, encoded);
        // Below, the curve is that of some other cell.
        codes[i] = if linear <= LINEAR_BELOW { 12.92 * linear } else { curve };
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
        let mut code = [0.0];
        super::encode(&mut [linear], &mut code, &mut Found::default());
        code[0]
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
