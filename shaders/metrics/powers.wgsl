// Powers whose accuracy is that of f32 on every adapter: the error of pow is the driver's affair. Twin: `pow` in
// src/metrics/flip/color.rs.

// x to the power p, for x that is 0 or normal, and 0 ≤ p ≤ 1; within 2e-6 of itself.
fn power(x: f32, p: f32) -> f32 {
    return select(0.0, exponential2(p * logarithm2(x)), x > 0.0);
}

// The exponent, and 2/ln 2 · artanh s for a mantissa (1 + s)/(1 − s) between √½ and √2.
fn logarithm2(x: f32) -> f32 {
    const SQRT_HALF_BITS = 0x3f3504f3;
    const TWO_LOG2_E = 2.8853900817779268;
    let bits = bitcast<i32>(x);
    let exponent = (bits - SQRT_HALF_BITS) >> 23u;
    let mantissa = bitcast<f32>(bits - (exponent << 23u));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let q = s * s;
    let series = 1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0))));
    return f32(exponent) + TWO_LOG2_E * s * series;
}

// The exponential series of the fraction, at most ½ either way, and the rest put into the exponent. Needs −126 ≤ x ≤ 127.
fn exponential2(x: f32) -> f32 {
    const LN_2 = 0.6931471805599453;
    let whole = round(x);
    let t = (x - whole) * LN_2;
    let tail = 1.0 / 24.0 + t * (1.0 / 120.0 + t * (1.0 / 720.0 + t * (1.0 / 5040.0)));
    let series = 1.0 + t * (1.0 + t * (0.5 + t * (1.0 / 6.0 + t * tail)));
    return series * bitcast<f32>((i32(whole) + 127) << 23u);
}
