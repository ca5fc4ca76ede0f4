//! What single frames cannot show: `tpsnr`, `warped_tpsnr`, `warp_excess`, `flicker`, `flicker.local`, `ghost`, `blur`
//! and `converge_frames`. A [`Step`] holds what follows from two frames of the reference, and is shared by every preset;
//! a [`Track`] holds what one preset has to remember.

mod definitions;
mod step;
mod track;

use super::{Shown, Sums, sum_in_rows};

pub(super) use definitions::*;
pub(super) use step::Step;
pub use track::{LateValue, Track};

/// What is measured between a frame and the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Change {
    /// Squared difference of the changes of display RGB.
    Step,
    /// The same of luma along the reference's motion.
    WarpedStep,
    /// How much more luma changes along the motion.
    WarpExcess,
    /// Change of the mean luma error.
    MeanError,
    /// The two factors of ghosting and blur.
    Fit,
}

impl Change {
    /// `None` where the frames leave it undefined: nothing reprojects, or nothing changes that could leave a ghost.
    pub(super) fn measure(self, step: &Step, reference: &Shown, [test, previous_test]: [&Shown; 2]) -> Option<Sums> {
        match self {
            Self::Step => Some(step.squared_error(reference, test, previous_test)),
            Self::WarpedStep => step.warp()?.squared_error(test, previous_test),
            Self::WarpExcess => step.warp()?.excess(test, previous_test),
            Self::MeanError => Some(step.mean_error(reference, test, previous_test)),
            Self::Fit => step.fit(reference, test),
        }
    }
}
