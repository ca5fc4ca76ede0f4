//! Jitter sequences: where in its pixel each frame's sample lies. Published systems name the one they were tuned for
//! (Pedersen, INSIDE, GDC 2016, "sequences tested"; Yang et al., Survey, 2020, 3.1).

use serde::{Serialize, Serializer};
use std::{fmt, str::FromStr};

/// A repeating sequence of sample offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JitterSequence {
    /// Always the pixel's centre.
    None,
    /// Halton's in bases 2 and 3, this many points of it.
    Halton23(u32),
    /// Four quarter points, along a helix.
    Uniform4Helix,
    /// Two opposite quarter points.
    Quincunx2,
}

/// Text that names no jitter sequence.
#[derive(Debug, thiserror::Error)]
#[error(
    "`{0}` is no jitter sequence; there are none, quincunx2, uniform4_helix, and halton23(N) with N from 1 to {max}",
    max = JitterSequence::MAX_LENGTH
)]
pub struct UnknownJitter(String);

impl JitterSequence {
    /// The longest sequence that can be asked for.
    pub const MAX_LENGTH: u32 = 4096;

    /// Number of frames after which it repeats.
    pub fn length(self) -> u32 {
        match self {
            Self::None => 1,
            Self::Halton23(length) => length,
            Self::Uniform4Helix => 4,
            Self::Quincunx2 => 2,
        }
    }

    /// The sample's offset from the pixel's centre in frame `index`, in pixels, y down.
    pub fn offset_px(self, index: usize) -> [f64; 2] {
        let at = index % self.length() as usize;
        match self {
            Self::None => [0.0, 0.0],
            Self::Halton23(_) => [2, 3].map(|base| radical_inverse(at as u32 + 1, base) - 0.5),
            Self::Uniform4Helix => [[-0.25, -0.25], [0.25, 0.25], [0.25, -0.25], [-0.25, 0.25]][at],
            Self::Quincunx2 => [[-0.25, -0.25], [0.25, 0.25]][at],
        }
    }
}

/// The digits of `i` in `base`, mirrored at the point: in [0, 1).
pub(crate) fn radical_inverse(mut i: u32, base: u32) -> f64 {
    let (mut numerator, mut denominator) = (0_u64, 1_u64);
    while i > 0 {
        numerator = numerator * u64::from(base) + u64::from(i % base);
        denominator *= u64::from(base);
        i /= base;
    }
    numerator as f64 / denominator as f64
}

impl fmt::Display for JitterSequence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Halton23(length) => write!(f, "halton23({length})"),
            Self::Uniform4Helix => f.write_str("uniform4_helix"),
            Self::Quincunx2 => f.write_str("quincunx2"),
        }
    }
}

impl Serialize for JitterSequence {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl FromStr for JitterSequence {
    type Err = UnknownJitter;

    fn from_str(text: &str) -> Result<Self, UnknownJitter> {
        let unknown = || UnknownJitter(text.to_owned());
        match text {
            "none" => Ok(Self::None),
            "uniform4_helix" => Ok(Self::Uniform4Helix),
            "quincunx2" => Ok(Self::Quincunx2),
            _ => {
                let length = text.strip_prefix("halton23(").and_then(|rest| rest.strip_suffix(')'));
                let length = length.and_then(|length| length.parse().ok()).ok_or_else(unknown)?;
                match length {
                    1..=Self::MAX_LENGTH => Ok(Self::Halton23(length)),
                    _ => Err(unknown()),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [JitterSequence; 7] = [
        JitterSequence::None,
        JitterSequence::Quincunx2,
        JitterSequence::Uniform4Helix,
        JitterSequence::Halton23(8),
        JitterSequence::Halton23(16),
        JitterSequence::Halton23(32),
        JitterSequence::Halton23(128),
    ];

    fn mean(jitter: JitterSequence) -> [f64; 2] {
        let n = jitter.length() as usize;
        let sum = (0..n)
            .map(|i| jitter.offset_px(i))
            .fold([0.0; 2], |[x, y], [jx, jy]| [x + jx, y + jy]);
        sum.map(|sum| sum / n as f64)
    }

    #[test]
    fn samples_stay_in_their_pixel_and_average_near_its_centre() {
        for jitter in ALL {
            for index in 0..300 {
                assert!(
                    jitter.offset_px(index).iter().all(|j| j.abs() <= 0.5),
                    "{jitter} {index}"
                );
                assert_eq!(
                    jitter.offset_px(index),
                    jitter.offset_px(index + jitter.length() as usize)
                );
            }
            // Halton's n points leave out the origin: in base 2 their mean is 1/2 − 1/(2n) and 1/n of the last point more.
            let bound = match jitter {
                JitterSequence::Halton23(length) => 1.5 / f64::from(length),
                _ => 0.0,
            };
            assert!(
                mean(jitter).iter().all(|m| m.abs() <= bound),
                "{jitter}: {:?}",
                mean(jitter)
            );
        }
    }

    #[test]
    fn second_moments_are_those_of_a_pixel() {
        for length in [32, 128] {
            let jitter = JitterSequence::Halton23(length);
            for axis in 0..2 {
                let sum: f64 = (0..length as usize).map(|i| jitter.offset_px(i)[axis].powi(2)).sum();
                let variance = sum / f64::from(length);
                assert!(
                    (variance - 1.0 / 12.0).abs() < 1.0 / f64::from(length),
                    "{jitter}: {variance}"
                );
            }
        }
        // Always the centre: the control.
        assert_eq!(JitterSequence::None.offset_px(3), [0.0, 0.0]);
    }

    #[test]
    fn the_first_points_of_halton_are_known() {
        let jitter = JitterSequence::Halton23(8);
        let first: Vec<_> = (0..3).map(|i| jitter.offset_px(i)).collect();
        assert_eq!(
            first,
            [
                [0.0, 1.0 / 3.0 - 0.5],
                [-0.25, 2.0 / 3.0 - 0.5],
                [0.25, 1.0 / 9.0 - 0.5]
            ]
        );
    }

    #[test]
    fn names_come_back() {
        for jitter in ALL {
            assert_eq!(jitter.to_string().parse::<JitterSequence>().unwrap(), jitter);
        }
        for wrong in ["halton23", "halton23(0)", "halton23(x)", "halton23(9999)", "quincunx"] {
            assert!(wrong.parse::<JitterSequence>().is_err(), "{wrong}");
        }
    }
}
