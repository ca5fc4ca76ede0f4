//! The canonical form of a frame: what every recipe and metric sees, whatever engine it came from.

use crate::image::{Extent, Image};

/// Linear or display-referred RGB.
pub type Rgb = [f32; 3];

/// The images of a frame that a caller wants; the loader decodes no others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Linear view depth.
    pub depth: bool,
    /// Motion vectors.
    pub motion: bool,
    /// Object ids.
    pub object_id: bool,
    /// Unlit colour.
    pub albedo: bool,
    /// Reactive mask.
    pub reactive: bool,
    /// Colour rendered without jitter.
    pub unjittered_color: bool,
    /// Ground truth.
    pub reference: bool,
}

impl Channels {
    /// Everything that either wants. Colour is always loaded.
    pub fn union(self, other: Self) -> Self {
        self.zip(other, |a, b| a | b)
    }

    /// What both have.
    pub fn intersection(self, other: Self) -> Self {
        self.zip(other, |a, b| a & b)
    }

    fn zip(self, other: Self, f: impl Fn(bool, bool) -> bool) -> Self {
        Self {
            depth: f(self.depth, other.depth),
            motion: f(self.motion, other.motion),
            object_id: f(self.object_id, other.object_id),
            albedo: f(self.albedo, other.albedo),
            reactive: f(self.reactive, other.reactive),
            unjittered_color: f(self.unjittered_color, other.unjittered_color),
            reference: f(self.reference, other.reference),
        }
    }
}

/// One frame with all conventions normalised. Values are as the engine wrote them otherwise: non-finite and negative
/// ones are still there, because repairing them is the recipe's work and is counted.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the sequence, from 0.
    pub index: usize,
    /// History is dropped before this frame (camera cut).
    pub reset: bool,
    /// Texel `(x, y)` holds the scene at `(x + 0.5 + jitter_px[0], y + 0.5 + jitter_px[1])`; y down.
    pub jitter_px: [f64; 2],
    /// Distance of the far plane in depth units; infinite where the engine has none.
    pub far: f64,
    /// Linear RGB at render size.
    pub color: Image<Rgb>,
    /// Distance along the view axis; sky is [`SKY_DEPTH`].
    pub depth: Option<Image<f32>>,
    /// Where this pixel's surface was last frame, minus where it is now; pixels, y down, jitter removed.
    pub motion_px: Option<Image<[f32; 2]>>,
    /// Object ids, compared for equality only.
    pub object_id: Option<Image<u32>>,
    /// Unlit colour, linear RGB.
    pub albedo: Option<Image<Rgb>>,
    /// How little history may be trusted, 0 to 1.
    pub reactive: Option<Image<f32>>,
    /// The colour rendered without jitter, linear RGB.
    pub unjittered_color: Option<Image<Rgb>>,
    /// Ground truth at output size, linear RGB.
    pub reference: Option<Image<Rgb>>,
}

/// The depth that stands for "nothing was hit".
pub const SKY_DEPTH: f32 = 1e10;

impl Frame {
    /// Render size.
    pub fn extent(&self) -> Extent {
        self.color.extent()
    }

    /// The far plane's distance, 1000 where the engine has none.
    pub fn finite_far(&self) -> f64 {
        if self.far.is_finite() { self.far } else { 1000.0 }
    }
}
