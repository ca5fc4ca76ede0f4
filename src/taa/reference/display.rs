//! What a display shows of linear colour, and back: the twin of `shaders/common/display.wgsl`.

use super::{color::Color, real::Real};
use crate::metrics::{Display, Tonemap};

/// Where the inverse of [`reinhard_max`] still is finite: `1 - 2⁻¹¹`.
pub const TONEMAPPED_MAX: f64 = 1.0 - 1.0 / 2048.0;

/// Exposure, tone mapping, sRGB: 0 to 1.
pub fn shown<R: Real>(linear: Color<R>, display: &Display) -> Color<R> {
    let exposed = linear * R::new(display.exposure);
    let tonemapped = match display.tonemap {
        Tonemap::None => exposed,
        Tonemap::ReinhardMax => reinhard_max(exposed),
        Tonemap::Aces => exposed.map(aces),
    };
    tonemapped.map(|t| srgb_encode(t.saturate()))
}

/// The linear colour that is shown so; the brightest where many are.
pub fn linear<R: Real>(shown: Color<R>, display: &Display) -> Color<R> {
    let tonemapped = shown.map(|e| srgb_decode(e.saturate()));
    let exposed = match display.tonemap {
        Tonemap::None => tonemapped,
        Tonemap::ReinhardMax => inverse_reinhard_max(tonemapped),
        Tonemap::Aces => tonemapped.map(inverse_aces),
    };
    exposed * (R::new(1.0) / R::new(display.exposure))
}

/// `c / (1 + max(r, g, b))`.
pub fn reinhard_max<R: Real>(c: Color<R>) -> Color<R> {
    c * (R::new(1.0) / (R::new(1.0) + c.max3()))
}

/// The colour that is tone-mapped so, at most 2047.
pub fn inverse_reinhard_max<R: Real>(t: Color<R>) -> Color<R> {
    t * (R::new(1.0) / (R::new(1.0) - t.max3().min(R::new(TONEMAPPED_MAX))))
}

/// Narkowicz's fit.
fn aces<R: Real>(c: R) -> R {
    let k = R::new;
    c * (k(2.51) * c + k(0.03)) / (c * (k(2.43) * c + k(0.59)) + k(0.14))
}

/// Its inverse on 0 to 1: the positive root of `(2.51 - 2.43 t) c² + (0.03 - 0.59 t) c - 0.14 t`.
fn inverse_aces<R: Real>(t: R) -> R {
    let k = R::new;
    let a = k(2.51) - k(2.43) * t;
    let b = k(0.03) - k(0.59) * t;
    ((b * b + k(0.56) * a * t).sqrt() - b) / (k(2.0) * a)
}

/// The sRGB transfer function.
pub fn srgb_encode<R: Real>(x: R) -> R {
    let k = R::new;
    if x <= k(0.003_130_8) {
        k(12.92) * x
    } else {
        k(1.055) * x.powf(k(1.0 / 2.4)) - k(0.055)
    }
}

/// Its inverse.
pub fn srgb_decode<R: Real>(x: R) -> R {
    let k = R::new;
    if x <= k(0.040_45) {
        x / k(12.92)
    } else {
        ((x + k(0.055)) / k(1.055)).powf(k(2.4))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISPLAYS: [Display; 3] = [
        Display {
            exposure: 0.5,
            tonemap: Tonemap::None,
        },
        Display {
            exposure: 1.5,
            tonemap: Tonemap::ReinhardMax,
        },
        Display {
            exposure: 2.0,
            tonemap: Tonemap::Aces,
        },
    ];

    #[test]
    fn shows_what_metrics_compare() {
        for display in DISPLAYS {
            for c in [[0.0, 0.001, 0.2], [0.01, 0.5, 0.9], [3.0, 40.0, 65504.0]] {
                let found = shown(Color(c.map(f64::from)), &display).0;
                let expected = display.apply(c);
                for (a, b) in found.into_iter().zip(expected) {
                    assert!(
                        (a - b).abs() < 1e-12,
                        "{display:?} of {c:?}: {found:?}, not {expected:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn linear_undoes_shown_until_the_display_clips() {
        for display in DISPLAYS {
            for c in [0.0, 1e-4, 0.002, 0.05, 0.3, 0.7, 1.9] {
                let color = Color([c, 0.5 * c, 0.25 * c]);
                let back = linear(shown(color, &display), &display);
                let worst = (back - color).map(f64::abs).max3();
                assert!(
                    worst < 1e-7 * (1.0 + c),
                    "{display:?}: {color:?} comes back as {back:?}"
                );
            }
        }
    }

    /// Whatever is asked for, what comes back is finite.
    #[test]
    fn white_comes_back_as_the_brightest_that_can_be_told() {
        for (display, brightest) in DISPLAYS.into_iter().zip([2.0, 2048.0 / 1.5, 3.620_83]) {
            for beyond in [1.0, 2.0] {
                let found = linear(Color::<f64>::splat(beyond), &display).0[0];
                assert!((found / brightest - 1.0).abs() < 1e-4, "{display:?}: {found}");
            }
        }
    }
}
