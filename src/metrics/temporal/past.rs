//! What one preset's previous frame leaves behind.

use super::super::{mask::ByMask, plane::Plane, quantity::Sums, reference::Reference, rows::Errors};
use std::sync::Arc;

/// The last frame scored; at first there is none.
#[derive(Default)]
pub struct Past {
    /// Test minus reference, display RGB.
    errors: Option<[Plane; 3]>,
    luma: Option<Arc<Plane>>,
    squared_errors: Option<ByMask<Sums>>,
    is_finite: bool,
    is_known: bool,
}

impl Past {
    /// Whether there is a frame.
    pub fn is_known(&self) -> bool {
        self.is_known
    }

    /// Whether all its pixels were finite.
    pub fn is_finite(&self) -> bool {
        self.is_finite
    }

    pub fn luma(&self) -> Option<&[f64]> {
        self.luma.as_ref().map(|plane| &plane[..])
    }

    /// Its squared errors of display RGB, where they were measured.
    pub fn squared_errors(&self) -> Option<&ByMask<Sums>> {
        self.squared_errors.as_ref()
    }

    /// Its errors, to be replaced by those of the next frame, which `follows` it or not.
    pub fn errors(&mut self, reference: &Reference, follows: bool) -> Errors<'_> {
        Errors {
            known: follows && self.errors.is_some(),
            planes: self
                .errors
                .get_or_insert_with(|| [(); 3].map(|()| reference.new_plane())),
        }
    }

    /// Becomes the frame that was scored.
    pub fn remember(&mut self, luma: Option<Arc<Plane>>, squared_errors: Option<&ByMask<Sums>>, is_finite: bool) {
        self.luma = luma;
        self.squared_errors = squared_errors.copied();
        self.is_finite = is_finite;
        self.is_known = true;
    }
}
