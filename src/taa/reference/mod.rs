//! The CPU twin: every recipe, written for clarity in the order of the pipeline, generic over f32 and f64. In f64 it is
//! the measure that the GPU's numbers are held against; it shares no code with the GPU's path but the recipe.
//!
//! It runs the passes that the GPU runs, and what each of them writes can be taken out, compared, and replaced
//! (`stages`): that is how a pass is found that an adapter gets wrong.

mod checkerboard;
pub mod color;
pub mod display;
mod fxaa;
mod hull;
mod merge;
mod neighbourhood;
mod output;
mod phlm2016;
mod planes;
mod quasi_cubic;
pub mod real;
mod rectify;
mod reproject;
mod sampling;
mod smaa;
mod sobel2018;
mod spatial;
mod stages;
mod upsample;
mod weight;

use super::{
    Precision, Recipe,
    recipe::{HdrWeight, HistoryFilter, InputFilter, Rectify},
};
use crate::{
    image::Image,
    sequence::{Frame, Sizes},
};
use color::{Color, F16_MAX};
use neighbourhood::ColorBox;
use planes::{Left, Planes, made};
pub use planes::{Plane, Scale};
use real::Real;
use reproject::Reprojected;
use sampling::{bilinear, containing};
use std::mem;
use weight::Blended;

/// One recipe with its history, pass by pass as the GPU has it.
#[derive(Clone, Debug)]
pub struct Twin<R> {
    recipe: Recipe,
    precision: Precision,
    /// What the passes of the current frame have written.
    planes: Planes<R>,
    /// What the current frame leaves to be read as it is.
    images: Images,
    /// None in the first frame and after a reset.
    previous: Option<Previous<R>>,
}

/// What a frame's reprojection reads of the frame before.
#[derive(Clone, Debug, Default, PartialEq)]
struct Images {
    depth: Option<Image<f32>>,
    object_id: Option<Image<u32>>,
}

/// What a frame has of the one before.
#[derive(Clone, Debug)]
struct Previous<R> {
    images: Images,
    left: Left<R>,
}

/// What a recipe makes of one frame.
#[derive(Clone, Debug)]
pub struct Resolved<R> {
    /// The image to show: linear RGB after the output stage.
    pub shown: Image<[R; 3]>,
    /// Texels whose colour, or albedo where that is read, had a hostile component.
    pub repaired_texels: u64,
}

/// The 3×3 offsets, the centre first, then row by row: ties keep the first.
const RING: [[i64; 2]; 9] = [
    [0, 0],
    [-1, -1],
    [0, -1],
    [1, -1],
    [-1, 0],
    [1, 0],
    [-1, 1],
    [0, 1],
    [1, 1],
];

impl<R: Real> Twin<R> {
    /// A twin of `recipe` that has seen no frame.
    pub fn new(recipe: Recipe, precision: Precision) -> Self {
        Self {
            precision: recipe.precision(precision),
            recipe,
            planes: Planes::default(),
            images: Images::default(),
            previous: None,
        }
    }

    /// How its history is stored.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// What the last frame left as history: the resolved image in the working domain, for `phlm2016` its feature.
    pub fn history(&self) -> Option<&Image<Color<R>>> {
        self.planes.left.history.as_ref()
    }

    /// Whether both would make the same of any frame that follows.
    pub fn is_in_the_state_of(&self, other: &Self) -> bool {
        self.planes.left == other.planes.left && self.images == other.images
    }

    /// The share of history in each pixel of a frame that was resolved last, before anything is sharpened or blurred. For
    /// recipes that [blend by weight](Recipe::blends_history).
    pub fn history_share(&self, frame: &Frame) -> Image<R> {
        let pixels = self.pixels(frame);
        Image::from_fn(pixels.sizes.output, |x, y| {
            pixels.resolve([x.into(), y.into()]).history_share
        })
    }

    /// Resolves the next frame.
    ///
    /// # Panics
    /// When the frame lacks a channel of [`Recipe::required_channels`] or the parity that the recipe needs, or [`Recipe::check_sizes`] refuses its sizes.
    pub fn resolve(&mut self, frame: &Frame) -> Resolved<R> {
        self.begin(frame);
        for pass in self.passes(frame) {
            for plane in self.compute(pass, frame) {
                self.keep(pass, &plane);
            }
        }
        Resolved {
            shown: made(&self.planes.shown).map(|color| color.0),
            repaired_texels: self.planes.repaired_texels,
        }
    }

    /// Begins the next frame: what was current becomes previous.
    pub fn begin(&mut self, frame: &Frame) {
        self.recipe
            .check_sizes(frame.sizes())
            .expect("validated with the sequence");
        let left = mem::take(&mut self.planes).left;
        let current = Images {
            depth: frame.depth.clone(),
            object_id: frame.object_id.clone(),
        };
        let images = mem::replace(&mut self.images, current);
        let follows = frame.index > 0 && !frame.reset;
        self.previous = follows.then_some(Previous { images, left });
    }

    /// What a pass after `prepare` can see.
    fn pixels<'a>(&'a self, frame: &'a Frame) -> Pixels<'a, R> {
        let jitter_px = frame.jitter_px.map(R::new);
        let sizes = frame.sizes();
        Pixels {
            recipe: &self.recipe,
            frame,
            sizes,
            scale: sizes.scale().map(R::new),
            jitter_px,
            input_weights: blackman_harris(jitter_px),
            color: self.planes.antialiased.as_ref().unwrap_or(made(&self.planes.color)),
            planes: &self.planes,
            depth_image: self.images.depth.as_ref(),
            motion_px: self.planes.merged_motion_px.as_ref().or(frame.motion_px.as_ref()),
            previous: self.previous.as_ref(),
        }
    }
}

/// What the temporal pass makes of a pixel.
#[derive(Clone, Copy)]
struct Accumulated<R> {
    /// The next history, unrounded.
    color: Color<R>,
    /// How much of it was history, 0 to 1.
    history_share: R,
    /// How many samples it holds.
    n_samples: R,
}

/// What one pixel's resolve can see.
struct Pixels<'a, R> {
    recipe: &'a Recipe,
    frame: &'a Frame,
    sizes: Sizes,
    /// Output pixels for an input pixel.
    scale: [R; 2],
    jitter_px: [R; 2],
    /// Weights of the 3×3 input filter, in the order of [`RING`].
    input_weights: [R; 9],
    color: &'a Image<Color<R>>,
    planes: &'a Planes<R>,
    /// Of every pixel one, where the recipe reads them.
    depth_image: Option<&'a Image<f32>>,
    motion_px: Option<&'a Image<[f32; 2]>>,
    /// None in the first frame and after a reset.
    previous: Option<&'a Previous<R>>,
}

impl<R: Real> Previous<R> {
    fn history(&self) -> &Image<Color<R>> {
        made(&self.left.history)
    }
}

impl<R: Real> Pixels<'_, R> {
    /// What becomes of `p`.
    fn resolve(&self, p: [i64; 2]) -> Accumulated<R> {
        let reprojected = match (self.recipe.history_filter, self.previous) {
            (HistoryFilter::None, _) | (_, None) => None,
            (_, Some(previous)) => self.reproject(p).map(|at| (at, previous)),
        };
        let current = self.current(p, reprojected.is_some());
        let Some((at, previous)) = reprojected else {
            return Accumulated {
                color: self.saturated(current),
                history_share: R::new(0.0),
                n_samples: R::new(1.0),
            };
        };
        let [x, y] = containing(at.q);
        let counted = previous.left.n_samples.as_ref();
        let n_samples = counted.map_or(R::new(0.0), |counted| counted.clamped(x, y)) + R::new(1.0);
        let (color, history_share) = self.accumulate(p, at, previous.history(), n_samples, current);
        Accumulated {
            color: self.saturated(color),
            history_share,
            n_samples,
        }
    }

    /// As it is stored: no larger than an f16 can be.
    fn saturated(&self, color: Color<R>) -> Color<R> {
        match self.recipe.has_guards() {
            true => color.min(Color::splat(F16_MAX)),
            false => color,
        }
    }

    /// The current colour at `p` through the input filter, which may look at whether there is history.
    fn current(&self, [x, y]: [i64; 2], has_history: bool) -> Color<R> {
        match self.recipe.input_filter {
            InputFilter::Upsample => self.upsampled([x, y], has_history),
            InputFilter::Texel => self.color.clamped(x, y),
            InputFilter::Unjitter => bilinear(self.color, self.unjittered(x, y)),
            InputFilter::BlackmanHarris => {
                let texels = RING.iter().zip(self.input_weights);
                texels.fold(Color::default(), |sum, ([i, j], weight)| {
                    sum + self.color.clamped(x + i, y + j) * weight
                })
            }
        }
    }

    /// The 3×3 around `p`, the centre first.
    fn ring(&self, [x, y]: [i64; 2]) -> [Color<R>; 9] {
        RING.map(|[i, j]| self.color.clamped(x + i, y + j))
    }

    /// Where the jittered image holds the centre of pixel (x, y).
    fn unjittered(&self, x: i64, y: i64) -> [R; 2] {
        let [jx, jy] = self.jitter_px;
        [R::new(x as f64 + 0.5) - jx, R::new(y as f64 + 0.5) - jy]
    }

    /// Filters, rectifies and blends history; and the share that it has of the blend.
    fn accumulate(
        &self,
        p: [i64; 2],
        at: Reprojected<R>,
        history: &Image<Color<R>>,
        n_samples: R,
        current: Color<R>,
    ) -> (Color<R>, R) {
        let recipe = self.recipe;
        let unrectified = self.filtered(history, at.q);
        let bounds = self.color_box(p, current);
        let rectified = match &bounds {
            None => unrectified,
            Some(bounds) => self.rectified(p, unrectified, current, bounds),
        };
        let blended = Blended {
            current,
            rectified,
            unrectified,
            bounds: bounds.as_ref(),
        };
        let weight = self.weight(p, at.motion, n_samples, &blended);
        let one = R::new(1.0);
        match recipe.hdr_weight {
            HdrWeight::None => (Color::mix(rectified, current, weight), one - weight),
            HdrWeight::Karis => {
                let of_history = (one - weight) / (one + rectified.luma());
                let of_current = weight / (one + current.luma());
                let both = one / (of_history + of_current);
                (
                    (rectified * of_history + current * of_current) * both,
                    of_history * both,
                )
            }
        }
    }

    /// History, or what is left of it, against the box around `p`. All RGB but the box.
    fn rectified(&self, p: [i64; 2], history: Color<R>, current: Color<R>, bounds: &ColorBox<R>) -> Color<R> {
        let recipe = self.recipe;
        let [history, towards] = [history, current].map(|c| c.to_space(recipe.space));
        let rectified = match recipe.rectify {
            Rectify::None => history,
            Rectify::Clamp => history.clamp(bounds.lo, bounds.hi),
            Rectify::ClipCentre => rectify::clip_centre(history, bounds, recipe.domain, recipe.has_guards()),
            Rectify::ClipCurrent => rectify::clip_current(history, towards, bounds, recipe.has_guards()),
            Rectify::Hull => {
                let ring = self.ring(self.input_texel(p));
                hull::clip(history, towards, ring.map(|c| c.to_space(recipe.space)))
            }
        };
        rectified.from_space(recipe.space)
    }
}

/// `exp(-2.29 |d|²)` at the samples of [`RING`], which lie at their offset plus the jitter; normalised.
fn blackman_harris<R: Real>(jitter_px: [R; 2]) -> [R; 9] {
    let weights = RING.map(|offset| {
        let [dx, dy] = [0, 1].map(|axis| R::new(offset[axis] as f64) + jitter_px[axis]);
        (R::new(-2.29) * (dx * dx + dy * dy)).exp()
    });
    let sum = weights.into_iter().fold(R::new(0.0), |sum, weight| sum + weight);
    weights.map(|weight| weight / sum)
}
