//! What is measured on a frame: the sums that metrics are made of. Several metrics share one (a squared error gives
//! `mse`, `psnr` and `snr` at once), and its cost.

use super::{Metric, ms_ssim, ssim, temporal::Change};
use std::collections::BTreeSet;

/// The values that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Domain {
    /// Linear RGB before exposure and tone mapping.
    Linear,
    /// Display RGB, sRGB-encoded, in `[0, 1]`.
    Display,
    /// Rec. 709 luma of the display values.
    Luma,
    /// Display RGB rounded to whole numbers in `[0, 255]`.
    U8,
}

impl Domain {
    pub const fn peak(self) -> f64 {
        match self {
            Self::U8 => 255.0,
            Self::Linear | Self::Display | Self::Luma => 1.0,
        }
    }

    pub const fn n_channels(self) -> usize {
        match self {
            Self::Luma => 1,
            Self::Linear | Self::Display | Self::U8 => 3,
        }
    }
}

/// See [`Sums::terms`] for what each one adds up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// Σ(T−R)², and ΣR² of display values.
    SquaredError(Domain),
    /// Σ of the index.
    Ssim(Domain),
    /// Σ of the index of each scale, then the windows' weights of each.
    MsSsim,
    /// Σ of the map.
    Flip,
    /// The percentile itself.
    FlipPercentile,
    /// Σ of the map.
    HdrFlip,
    /// Σ of the relative squared error.
    RelativeSquaredError,
    /// Σ of the symmetric relative error.
    SymmetricError,
    /// See [`Change`].
    Change(Change),
    /// Over all frames.
    ErrorDeviation,
    /// Over the frames after a reset.
    Convergence,
}

impl Quantity {
    /// Fewest pixels in either axis.
    pub const fn smallest(self) -> u32 {
        match self {
            Self::Ssim(_) => ssim::WINDOW as u32,
            Self::MsSsim => ms_ssim::SMALLEST,
            _ => 1,
        }
    }

    /// The domain whose windows it compares, if it is an index of windows at full size.
    pub const fn windows(self) -> Option<Domain> {
        match self {
            Self::Ssim(domain) => Some(domain),
            _ => None,
        }
    }

    /// Whether it needs display values.
    pub fn reads_display(self) -> bool {
        match self {
            Self::SquaredError(domain) => domain != Domain::Linear,
            Self::Ssim(_) | Self::Change(_) => true,
            _ => self.reads_luma(),
        }
    }

    /// Whether it needs luma of the whole image.
    pub fn reads_luma(self) -> bool {
        match self {
            Self::MsSsim | Self::ErrorDeviation => true,
            Self::Change(change) => change != Change::Step,
            _ => false,
        }
    }
}

/// The quantities that metrics are made of.
pub fn quantities(metrics: &[Metric]) -> BTreeSet<Quantity> {
    let mut all: BTreeSet<_> = metrics.iter().map(|metric| metric.definition().quantity).collect();
    if all.contains(&Quantity::Convergence) {
        all.insert(Quantity::SquaredError(Domain::Display));
    }
    all
}

/// A quantity summed over samples (pixels × channels).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// How many samples.
    pub n: f64,
    /// What was added up; each quantity says in which order.
    pub terms: [f64; 10],
}

impl Sums {
    /// Of `n` samples; terms that are not given are 0.
    pub fn new<const N: usize>(n: f64, given: [f64; N]) -> Self {
        let mut terms = [0.0; 10];
        terms[..N].copy_from_slice(&given);
        Self { n, terms }
    }

    pub fn mean(&self) -> f64 {
        self.terms[0] / self.n
    }

    pub fn plus(mut self, other: &Self) -> Self {
        self.n += other.n;
        for (sum, term) in self.terms.iter_mut().zip(other.terms) {
            *sum += term;
        }
        self
    }
}
