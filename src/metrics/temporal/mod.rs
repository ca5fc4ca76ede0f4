//! What single frames cannot show: `tpsnr`, `warped_tpsnr`, `warp_excess`, `flicker`, `flicker.local`, `ghost`, `blur`
//! and `converge_frames`. A [`Step`] holds what follows from two frames of the reference, and is shared by every preset;
//! a [`Past`] what is left of one preset's previous frame; a [`Track`] scores its frames in order.

mod convergence;
mod definitions;
mod past;
mod step;
mod track;

pub(super) use convergence::Convergence;
pub(super) use definitions::*;
pub(super) use past::Past;
pub(super) use step::{Change, MOVES_FROM_PX, REPROJECTS_WITHIN, Step, sums};
pub use track::{LateValue, Track};
