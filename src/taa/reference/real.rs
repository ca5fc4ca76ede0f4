//! The arithmetic the twin is generic over: f32 like the GPU, or f64 as the measure of both.

use std::{
    fmt::Debug,
    ops::{Add, Div, Mul, Neg, Sub},
};

/// A real number: `f32` or `f64`.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The nearest representable number.
    fn new(value: f64) -> Self;
    /// The number as f64.
    fn to_f64(self) -> f64;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// e to this power, the same on every platform.
    fn exp(self) -> Self;
    /// The power of a number that is not negative, the same on every platform.
    fn powf(self, exponent: Self) -> Self;
    /// The largest integer not above.
    fn floor(self) -> Self;
    /// The nearest f16, ties to even.
    fn round_to_f16(self) -> Self;
    /// Not a number.
    fn is_nan(self) -> bool;

    /// The smaller; the other where one is NaN.
    fn min(self, other: Self) -> Self {
        if self <= other || other.is_nan() { self } else { other }
    }

    /// The larger; the other where one is NaN.
    fn max(self, other: Self) -> Self {
        if self >= other || other.is_nan() { self } else { other }
    }

    /// Within `lo` to `hi`.
    fn clamp(self, lo: Self, hi: Self) -> Self {
        self.max(lo).min(hi)
    }

    /// Within 0 to 1.
    fn saturate(self) -> Self {
        self.clamp(Self::new(0.0), Self::new(1.0))
    }

    /// Magnitude.
    fn abs(self) -> Self {
        self.max(-self)
    }
}

impl Real for f32 {
    fn new(value: f64) -> Self {
        value as f32
    }
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }
    fn exp(self) -> Self {
        libm::expf(self)
    }
    fn powf(self, exponent: Self) -> Self {
        libm::powf(self, exponent)
    }
    fn floor(self) -> Self {
        Self::floor(self)
    }
    fn round_to_f16(self) -> Self {
        half::f16::from_f32(self).to_f32()
    }
    fn is_nan(self) -> bool {
        self.is_nan()
    }
}

impl Real for f64 {
    fn new(value: f64) -> Self {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }
    fn exp(self) -> Self {
        libm::exp(self)
    }
    fn powf(self, exponent: Self) -> Self {
        libm::pow(self, exponent)
    }
    fn floor(self) -> Self {
        Self::floor(self)
    }
    fn round_to_f16(self) -> Self {
        half::f16::from_f64(self).to_f64()
    }
    fn is_nan(self) -> bool {
        self.is_nan()
    }
}

/// `a (1 - t) + b t`.
pub fn mix<R: Real>(a: R, b: R, t: R) -> R {
    a * (R::new(1.0) - t) + b * t
}
