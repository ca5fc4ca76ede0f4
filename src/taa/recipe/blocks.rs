//! The variants of every block of the temporal pipeline. Their JSON names are what a job writes; their order is the number
//! that the shaders' constants have.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What resolves a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Algorithm {
    /// Blends a rectified history.
    Temporal,
    /// Fits a linear model to each pixel's past. Uses none of box, rectification and weight.
    Phlm2016,
    /// Fills the pixels that a checkerboard leaves out from history. Its box is that of the shaded neighbours; uses no weight.
    Checkerboard,
}

/// How each frame is anti-aliased by itself, before anything else reads its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Spatial {
    /// Not at all.
    None,
    /// FXAA 3.11, quality preset 39.
    Fxaa,
    /// SMAA 1x, preset ultra.
    Smaa,
}

/// Which texel's motion vector a pixel uses, over the 3×3 around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Dilation {
    /// Its own.
    None,
    /// That of the nearest surface.
    Closest,
    /// The longest.
    Longest,
}

/// How the current colour is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputFilter {
    /// The texel as it is.
    Texel,
    /// Bilinear, at the place where the jitter put the pixel's centre.
    Unjitter,
    /// A Gaussian fit of the Blackman-Harris window over 3×3 samples, `exp(-2.29 d²)`.
    BlackmanHarris,
    /// The same kernel in pixels of the output, which may have up to 4 times as many along each axis; the weight falls with
    /// the distance of the nearest sample.
    Upsample,
}

/// How history is read at the reprojected position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HistoryFilter {
    /// No history: each frame stands alone.
    None,
    /// The texel that contains the position.
    Texel,
    /// 2×2 bilinear.
    Bilinear,
    /// 4×4 Catmull-Rom spline.
    CatmullRom,
    /// The spline without its corners, as five bilinear taps.
    #[serde(rename = "catmull_rom_5")]
    CatmullRom5,
    /// Bilinear, of a history that half the error of sampling forth and back was added to.
    Bfecc,
    /// 4×4 cubic quasi-interpolator of a recursively prefiltered history.
    QuasiCubic,
}

impl HistoryFilter {
    /// Whether it samples something made of the whole history first.
    pub fn has_prefilter(self) -> bool {
        matches!(self, Self::Bfecc | Self::QuasiCubic)
    }
}

/// The colour space of box and rectification.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Space {
    /// Red, green, blue.
    Rgb,
    /// Luma and two chroma axes.
    Ycocg,
}

/// The colour box of the current neighbourhood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Neighbourhood {
    /// No box.
    None,
    /// Minimum and maximum of 5 texels.
    Cross,
    /// Minimum and maximum of 3×3.
    Box3,
    /// Average of the two before.
    Rounded,
    /// Mean ± `variance_gamma` standard deviations of `variance_window`² texels.
    Variance,
    /// As wide as edges, depths and objects around the pixel say that it is aliased.
    Sobel,
    /// Minimum and maximum of the samples within 1.5 output pixels, and of the four that surround the pixel's centre.
    Shrunk,
}

/// What is done to history outside the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rectify {
    /// Nothing.
    None,
    /// Each channel clamped.
    Clamp,
    /// Pulled towards the box's centre.
    ClipCentre,
    /// Pulled towards the current colour.
    ClipCurrent,
    /// Pulled towards the current colour until inside the convex hull of the 3×3, whatever the box. CPU twin only.
    Hull,
}

/// How the weight of the current colour is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// `current_weight`.
    Fixed,
    /// By the luma difference of current colour and rectified history.
    LumaFeedback,
    /// Less where history is close to being clamped.
    Antiflicker,
    /// One over the number of samples that history holds, at least `count_weight_min`.
    Count,
    /// As `count`, raised where history and the current colour differ on average and where resampling would blur.
    Amortized,
}

impl Weight {
    /// Whether the number of samples is kept for each pixel.
    pub fn counts(self) -> bool {
        matches!(self, Self::Count | Self::Amortized)
    }
}

/// Whether bright colours count less in the blend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HdrWeight {
    /// They do not.
    None,
    /// By `1 / (1 + luma)`.
    Karis,
}

/// The domain in which colours are compared, blended and stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Linear, as the engine wrote it.
    Linear,
    /// `c / (1 + max(r, g, b))`.
    Tonemapped,
    /// As shown: the sequence's display transform.
    Display,
}

/// What keeps values finite and bounded where a formula alone would not: the repair of hostile colours, the smallest divisors,
/// moments about a shift, stores that round and saturate, the limits of what is fitted. `docs/stress.md` lists them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Guards {
    /// The literal formulas, to show what becomes of them.
    Off,
    /// As the contract has it.
    On,
}

/// How the shown image is sharpened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sharpen {
    /// Not at all.
    None,
    /// The kernel 5 in the centre, -1 in the cross.
    Xu,
    /// The kernel 2 in the centre, -¼ in the cross.
    Normalised,
    /// As much as the contrast of the cross allows without ringing.
    Rcas,
}
