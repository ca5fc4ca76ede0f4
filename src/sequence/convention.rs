//! Engines' conventions into the canonical form, a value at a time: the only place that knows how they differ.
//!
//! Everything here is pure and in f64, and nothing repairs: a NaN or a negative colour stays one, because recipes
//! repair and count such texels themselves. Positions are in pixels, origin top-left, y down, so that the centre of
//! pixel `(x, y)` is `(x + 0.5, y + 0.5)`.

mod camera;
mod depth;
mod motion;

pub use camera::Projector;
pub use depth::DepthDecoder;
pub use motion::MotionDecoder;

use super::{
    frame::Rgb,
    manifest::{JitterConvention, JitterMeaning, JitterUnits, Transfer, YAxis},
};
use crate::{image::Extent, metrics::srgb};

/// Where a jittered frame's samples lie within their pixels: texel `(x, y)` holds the scene at
/// `(x + 0.5, y + 0.5)` plus the result.
pub fn jitter_px(convention: JitterConvention, stored: [f64; 2], render_size: Extent) -> [f64; 2] {
    let (width, height) = (f64::from(render_size.width), f64::from(render_size.height));
    let unit_px = match convention.units {
        JitterUnits::PixelsRender => [1.0, 1.0],
        JitterUnits::Uv => [width, height],
        JitterUnits::Ndc => [0.5 * width, 0.5 * height],
    };
    let moves_sample = match convention.meaning {
        JitterMeaning::SampleOffset => 1.0,
        // An image that moves right shows each pixel a point further left.
        JitterMeaning::ProjectionOffset => -1.0,
    };
    // Adding zero turns −0 into 0.
    [
        stored[0] * unit_px[0] * moves_sample + 0.0,
        stored[1] * unit_px[1] * moves_sample * downwards(convention.y) + 0.0,
    ]
}

/// The sign that makes y point down.
fn downwards(y: YAxis) -> f64 {
    match y {
        YAxis::Down => 1.0,
        YAxis::Up => -1.0,
    }
}

/// Turns stored colour into linear light of one frame.
#[derive(Clone, Copy, Debug)]
pub struct ColorDecoder {
    /// Encoding of the stored values.
    pub transfer: Transfer,
    /// With `pq`: cd/m² of linear 1.0.
    pub nits_per_unit: f64,
    /// What the linear values were multiplied by before they were stored.
    pub exposure: f64,
}

impl ColorDecoder {
    /// Linear RGB of one stored pixel.
    pub fn decode(self, stored: Rgb) -> Rgb {
        stored.map(|value| {
            let value = f64::from(value);
            let linear = match self.transfer {
                Transfer::Linear => value,
                Transfer::Srgb => srgb::decode(value),
                Transfer::Pq => pq_to_nits(value) / self.nits_per_unit,
            };
            (linear / self.exposure) as f32
        })
    }
}

/// The EOTF of SMPTE ST 2084, in cd/m². It has no negative side: such values stay as they are, to be found later.
fn pq_to_nits(value: f64) -> f64 {
    const M1: f64 = 2610.0 / 16384.0;
    const M2: f64 = 2523.0 / 4096.0 * 128.0;
    const C1: f64 = 3424.0 / 4096.0;
    const C2: f64 = 2413.0 / 4096.0 * 32.0;
    const C3: f64 = 2392.0 / 4096.0 * 32.0;
    if value < 0.0 {
        return value;
    }
    let root = libm::pow(value, 1.0 / M2);
    10_000.0 * libm::pow((root - C1).max(0.0) / (C2 - C3 * root), 1.0 / M1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Extent = Extent::new(64, 48);

    /// Every way to write down the sample offset (0.25, −0.125) px.
    #[test]
    fn jitter_is_the_same_in_every_convention() {
        use {JitterMeaning::*, JitterUnits::*, YAxis::*};
        for (units, unit_px) in [(PixelsRender, [1.0, 1.0]), (Uv, [64.0, 48.0]), (Ndc, [32.0, 24.0])] {
            for (meaning, sign) in [(SampleOffset, 1.0), (ProjectionOffset, -1.0)] {
                for (y, up) in [(Down, 1.0), (Up, -1.0)] {
                    let stored = [0.25 * sign / unit_px[0], -0.125 * sign * up / unit_px[1]];
                    let jitter = jitter_px(JitterConvention { units, meaning, y }, stored, SIZE);
                    assert!((jitter[0] - 0.25).abs() < 1e-12 && (jitter[1] + 0.125).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn zero_jitter_has_no_negative_zero() {
        let convention = JitterConvention {
            units: JitterUnits::Uv,
            meaning: JitterMeaning::ProjectionOffset,
            y: YAxis::Up,
        };
        assert!(
            jitter_px(convention, [0.0; 2], SIZE)
                .iter()
                .all(|j| j.is_sign_positive())
        );
    }

    fn decode(transfer: Transfer, exposure: f64, value: f32) -> f32 {
        let decoder = ColorDecoder {
            transfer,
            nits_per_unit: 100.0,
            exposure,
        };
        decoder.decode([value; 3])[0]
    }

    #[test]
    fn linear_values_keep_every_bit() {
        for value in [0.1, -3.0, f32::INFINITY, f32::MIN_POSITIVE, 65504.0] {
            assert_eq!(decode(Transfer::Linear, 1.0, value).to_bits(), value.to_bits());
        }
    }

    #[test]
    fn hostile_values_stay_visible() {
        for transfer in [Transfer::Linear, Transfer::Srgb, Transfer::Pq] {
            assert!(decode(transfer, 1.0, f32::NAN).is_nan());
            assert!(decode(transfer, 1.0, -0.5) < 0.0);
        }
        assert!(decode(Transfer::Srgb, 1.0, f32::INFINITY).is_infinite());
    }

    #[test]
    fn srgb_meets_its_standard() {
        for (stored, linear) in [(0.0, 0.0), (0.04045, 0.003_130_8), (0.5, 0.214_041_14), (1.0, 1.0)] {
            assert!((decode(Transfer::Srgb, 1.0, stored) - linear).abs() < 1e-6);
        }
    }

    /// ST 2084 codes 0.508078 as 100 cd/m², 0.751827 as 1000 and 1 as 10000.
    #[test]
    fn pq_meets_its_standard() {
        for (stored, nits) in [(0.0, 0.0), (0.508_078_4, 100.0), (0.751_827_1, 1000.0), (1.0, 10_000.0)] {
            let decoded = decode(Transfer::Pq, 1.0, stored) * 100.0;
            assert!((decoded - nits).abs() <= 1e-4 * nits, "{stored}: {decoded}");
        }
    }

    #[test]
    fn pre_exposure_is_divided_out() {
        assert_eq!(decode(Transfer::Linear, 4.0, 2.0), 0.5);
    }
}
