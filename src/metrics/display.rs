//! How linear colour becomes what a viewer sees. Declared once a sequence and stored with every result, because every
//! display-referred metric depends on it.

use super::srgb::{self, Found};
use crate::sequence::frame::Rgb;
use serde::{Deserialize, Serialize};
use std::ops::{Add, Div, Mul};

/// Exposure, tone mapping, then the sRGB transfer function clamped to `[0, 1]`; nothing is rounded to 8 bits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Display {
    /// Factor on linear colour, before tone mapping.
    pub exposure: f64,
    /// How range is compressed.
    pub tonemap: Tonemap,
}

/// How range is compressed into `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tonemap {
    /// Not at all: clamped.
    #[default]
    None,
    /// `c / (1 + max(r, g, b))`: keeps hue.
    ReinhardMax,
    /// Narkowicz, "ACES Filmic Tone Mapping Curve", 2016, per channel.
    Aces,
}

impl Tonemap {
    /// Every tone mapping.
    pub const ALL: [Self; 3] = [Self::None, Self::ReinhardMax, Self::Aces];

    /// Its name in manifests and on the command line.
    pub const fn id(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::ReinhardMax => "reinhard_max",
            Self::Aces => "aces",
        }
    }
}

impl Default for Display {
    fn default() -> Self {
        Self {
            exposure: 1.0,
            tonemap: Tonemap::None,
        }
    }
}

impl Display {
    /// Display values of a linear colour. Negative components show as black. A colour with any NaN or infinity becomes
    /// NaN altogether: a clamp that turned it into 0 or 1 would hide it from every metric.
    pub fn apply(&self, linear: Rgb) -> [f64; 3] {
        let mut planes = linear.map(|c| [c]);
        poison(&mut planes);
        let mut shown = [[0.0]; 3];
        let mut planes = planes.map(|plane| plane.map(f64::from));
        self.show(&mut planes, shown.each_mut(), &mut Found::default());
        shown.map(|[value]| value)
    }

    /// The same of `N` colours, poisoned already, in planes, which are left as they come.
    #[inline(always)]
    pub(super) fn show<const N: usize>(
        &self,
        planes: &mut [[f64; N]; 3],
        shown: [&mut [f64; N]; 3],
        found: &mut Found<N>,
    ) {
        self.expose(planes);
        for (plane, shown) in planes.iter_mut().zip(shown) {
            srgb::encode(plane, shown, found);
        }
    }

    /// What a display gives off that shows them: linear light in `[0, 1]`.
    #[inline(always)]
    pub(super) fn shine<const N: usize>(&self, planes: &mut [[f32; N]; 3]) {
        self.expose(planes);
        for plane in planes {
            for value in plane {
                *value = if *value > 1.0 { 1.0 } else { *value };
            }
        }
    }

    /// Exposes and compresses range, which leaves values above 1 where there is no tone mapping.
    #[inline(always)]
    fn expose<T: Real, const N: usize>(&self, planes: &mut [[T; N]; 3]) {
        let [zero, one, exposure] = [0.0, 1.0, self.exposure].map(T::of);
        for plane in &mut *planes {
            for value in plane {
                // NaN passes, as it would not through `max`.
                *value = if *value < zero { zero } else { *value } * exposure;
            }
        }
        match self.tonemap {
            Tonemap::None => {}
            Tonemap::ReinhardMax => {
                let larger = |a: T, b: T| if a > b { a } else { b };
                let [r, g, b] = planes;
                for i in 0..N {
                    let scale = one / (one + larger(larger(r[i], g[i]), b[i]));
                    (r[i], g[i], b[i]) = (r[i] * scale, g[i] * scale, b[i] * scale);
                }
            }
            Tonemap::Aces => {
                let [a, b, c, d, e] = [2.51, 0.03, 2.43, 0.59, 0.14].map(T::of);
                for plane in planes {
                    for value in plane {
                        let x = *value;
                        *value = x * (a * x + b) / (x * (c * x + d) + e);
                    }
                }
            }
        }
    }
}

/// `f32` and `f64`.
trait Real: Copy + PartialOrd + Add<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    fn of(number: f64) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn of(number: f64) -> Self {
        number
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(number: f64) -> Self {
        number as f32
    }
}

/// Makes every component NaN of a colour that has a NaN or an infinity, so that Inf − Inf, Inf − 1 and NaN all end as
/// NaN.
#[inline(always)]
pub(super) fn poison<const N: usize>([r, g, b]: &mut [[f32; N]; 3]) {
    for i in 0..N {
        let poison = 0.0 * r[i] + 0.0 * g[i] + 0.0 * b[i];
        (r[i], g[i], b[i]) = (r[i] + poison, g[i] + poison, b[i] + poison);
    }
}

/// Rec. 709 luma of display values: weights on encoded, not linear, components. Of linear ones it is luminance.
#[inline(always)]
pub fn luma([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Linear value of an sRGB-encoded one in `[0, 1]`.
pub fn linear_from_srgb(encoded: f64) -> f64 {
    srgb::decode(encoded)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn display(tonemap: Tonemap) -> Display {
        Display { exposure: 2.0, tonemap }
    }

    fn assert_near(actual: [f64; 3], expected: [f64; 3]) {
        for (a, e) in actual.into_iter().zip(expected) {
            assert!((a - e).abs() < 1e-9, "{actual:?} instead of {expected:?}");
        }
    }

    #[test]
    fn known_values() {
        let half = 0.735_356_983_052_449_6; // sRGB code of 0.5
        assert_near(display(Tonemap::None).apply([0.25, 0.5, -1.0]), [half, 1.0, 0.0]);
        assert_near(display(Tonemap::ReinhardMax).apply([0.5, 0.0, 0.0]), [half, 0.0, 0.0]);
        let aces = (2.51 + 0.03) / (2.43 + 0.59 + 0.14);
        assert_near(
            display(Tonemap::Aces).apply([0.5; 3]),
            [1.055 * libm::pow(aces, 1.0 / 2.4) - 0.055; 3],
        );
    }

    #[test]
    fn every_tonemap_is_monotone_and_stays_in_range() {
        for tonemap in Tonemap::ALL {
            let mut previous = -1.0;
            for i in 0..2000 {
                let shown = display(tonemap).apply([i as f32 * 0.01; 3])[0];
                assert!((previous..=1.0).contains(&shown), "{tonemap:?} at {i}");
                previous = shown;
            }
        }
    }

    #[test]
    fn non_finite_colours_are_never_clamped_away() {
        for tonemap in Tonemap::ALL {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert!(display(tonemap).apply([0.5, bad, 0.5]).iter().all(|c| c.is_nan()));
            }
        }
    }

    #[test]
    fn ids_are_those_of_the_manifest() {
        for tonemap in Tonemap::ALL {
            assert_eq!(serde_json::to_value(tonemap).unwrap(), tonemap.id());
        }
        let error = serde_json::from_str::<Display>(r#"{"gamma": 2.2}"#)
            .unwrap_err()
            .to_string();
        assert!(error.contains("gamma"), "{error}");
    }
}
