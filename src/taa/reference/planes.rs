//! What the passes of a frame write: for each other, for the next frame, and to be shown. A [`Plane`] is that of one binding
//! of one pass, in the layout of the GPU's, so that either can take the other's place.

use super::{
    Color, Real,
    color::Repaired,
    phlm2016::Covariance,
    smaa::{Sides, Weights},
    sobel2018::Scalars,
};
use crate::{
    image::{Extent, Image},
    taa::recipe::Domain,
};

/// An image that a pass writes, or a buffer.
#[derive(Clone, Debug)]
pub struct Plane<R> {
    /// The name under which the pass's shader binds it.
    pub name: &'static str,
    /// Width and height; of a single number, 1×1.
    pub extent: Extent,
    /// What each channel means.
    pub scales: Vec<Scale>,
    /// All channels of the first pixel, all of the next.
    pub values: Vec<R>,
}

/// What a value means, and so how far apart two of them are: about the share of a display's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// 0 to 1, or a number that must be met exactly: their difference.
    Range,
    /// Without a limit: that of `x / (1 + |x|)`.
    Open,
    /// The square of one in a range, or of an open one: that of their roots.
    Variance {
        /// Of an open one.
        open: bool,
    },
    /// Of samples, at least 1: that of each sample's share.
    Count,
}

impl Scale {
    /// Of colours in `domain`.
    pub fn of(domain: Domain) -> Self {
        match domain {
            Domain::Linear => Self::Open,
            Domain::Tonemapped | Domain::Display => Self::Range,
        }
    }

    /// Of variances of colours in `domain`.
    pub fn of_variance(domain: Domain) -> Self {
        Self::Variance {
            open: Self::of(domain) == Self::Open,
        }
    }

    /// How far apart two finite values are.
    pub fn distance(self, a: f64, b: f64) -> f64 {
        let compressed = |x: f64| x / (1.0 + x.abs());
        match self {
            Self::Range => (a - b).abs(),
            Self::Open => (compressed(a) - compressed(b)).abs(),
            Self::Variance { open } => {
                let [a, b] = [a, b].map(|variance| variance.max(0.0).sqrt());
                if open { Self::Open } else { Self::Range }.distance(a, b)
            }
            Self::Count => (1.0 / a - 1.0 / b).abs(),
        }
    }
}

impl<R: Real> Plane<R> {
    /// Of `N` channels a pixel.
    pub fn new<T: Copy + Send + Sync, const N: usize>(
        name: &'static str,
        scales: [Scale; N],
        image: &Image<T>,
        channels: impl Fn(T) -> [R; N],
    ) -> Self {
        Self {
            name,
            extent: image.extent(),
            scales: scales.to_vec(),
            values: image.pixels().iter().flat_map(|&pixel| channels(pixel)).collect(),
        }
    }

    /// Of colours.
    pub fn colors(name: &'static str, scale: Scale, image: &Image<Color<R>>) -> Self {
        Self::new(name, [scale; 3], image, |color| color.0)
    }

    /// The first channel of colours that have the same in all three.
    pub fn scalars(name: &'static str, image: &Scalars<R>) -> Self {
        Self::new(name, [Scale::Range], image, |color| [color.0[0]])
    }

    /// A number that must be met exactly.
    pub fn number(name: &'static str, number: u64) -> Self {
        Self {
            name,
            extent: Extent::new(1, 1),
            scales: vec![Scale::Range],
            values: vec![R::new(number as f64)],
        }
    }

    /// Back to an image, from all channels of each pixel.
    pub fn image<T: Copy + Send + Sync>(&self, pixel: impl Fn(&[R]) -> T) -> Image<T> {
        let pixels = self.values.chunks_exact(self.scales.len()).map(pixel).collect();
        Image::from_pixels(self.extent, pixels)
    }

    /// Back to colours, from the first three channels.
    pub fn to_colors(&self) -> Image<Color<R>> {
        self.image(|c| Color([c[0], c[1], c[2]]))
    }

    /// Back to what has the same in all three, from the first.
    pub fn to_scalars(&self) -> Scalars<R> {
        self.image(|c| Color([c[0]; 3]))
    }
}

impl Plane<f64> {
    /// Rounded.
    pub fn to_f32(&self) -> Plane<f32> {
        Plane {
            name: self.name,
            extent: self.extent,
            scales: self.scales.clone(),
            values: self.values.iter().map(|&value| value as f32).collect(),
        }
    }
}

/// What has been written so far in a frame; none of what its passes have not come to, or do not write without history.
#[derive(Clone, Debug, Default)]
pub struct Planes<R> {
    /// Of several samples or layers, linear.
    pub merged: Option<Repaired<R>>,
    pub merged_motion_px: Option<Image<[f32; 2]>>,
    /// In the working domain.
    pub color: Option<Image<Color<R>>>,
    pub unlit_luma: Option<Image<R>>,
    pub repaired_texels: u64,
    /// What a spatial filter makes of the colour, and on its way there.
    pub smaa_edges: Option<Image<Sides>>,
    pub smaa_weights: Option<Image<Weights<R>>>,
    pub antialiased: Option<Image<Color<R>>>,
    /// History carried along the motion, and history with half of what that and the way back lose of it.
    pub advected: Option<Image<Color<R>>>,
    pub compensated: Option<Image<Color<R>>>,
    /// Of history for `quasi_cubic`, along its rows and then along its columns.
    pub row_coefficients: Option<Image<Color<R>>>,
    pub coefficients: Option<Image<Color<R>>>,
    /// History less current colour, and its means over rows of 7.
    pub difference: Option<Image<Color<R>>>,
    pub difference_rows: Option<Image<Color<R>>>,
    /// Mean and variance of rows, and of windows.
    pub row_moments: Moments<R>,
    pub window_moments: Moments<R>,
    pub edges: Option<Scalars<R>>,
    pub stable_edges: Option<Scalars<R>>,
    /// Whether anything moves.
    pub moves: bool,
    /// In the working domain, not rounded, where sharpening follows.
    pub resolved: Option<Image<Color<R>>>,
    /// Linear.
    pub shown: Option<Image<Color<R>>>,
    pub left: Left<R>,
}

#[derive(Clone, Debug, Default)]
pub struct Moments<R> {
    pub means: Option<Image<Color<R>>>,
    pub variances: Option<Image<Color<R>>>,
}

/// What a frame leaves to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Left<R> {
    /// The resolved image; for `phlm2016` its feature.
    pub history: Option<Image<Color<R>>>,
    /// How many samples each pixel of history holds, where they are counted.
    pub n_samples: Option<Image<R>>,
    /// Where the recipe finds edges.
    pub edge_history: Option<Scalars<R>>,
    /// Where the recipe fits models: one colour for each element of the vector.
    pub coefficients: Option<Image<[Color<R>; 4]>>,
    pub covariances: Option<Image<Covariance<R>>>,
    /// What models show, in the working domain, and of how many samples it is the mean.
    pub mean: Option<Image<(Color<R>, R)>>,
}

/// The image of a pass that has run.
pub fn made<T>(plane: &Option<T>) -> &T {
    plane.as_ref().expect("made by a pass before this one")
}
