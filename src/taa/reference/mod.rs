//! The CPU twin: every recipe, written for clarity in the order of the pipeline, generic over f32 and f64. In f64 it is
//! the measure that the GPU's numbers are held against; it shares no code with the GPU's path but the recipe.

pub mod color;
mod neighbourhood;
pub mod real;
mod rectify;
mod sampling;

use super::{
    Precision, Recipe, Source,
    recipe::{Dilation, HdrWeight, HistoryFilter, InputFilter, Weight},
};
use crate::{
    image::Image,
    sequence::{Frame, frame::SKY_DEPTH},
};
use color::{Color, F16_MAX};
use neighbourhood::ColorBox;
use real::{Real, mix};
use sampling::bilinear;

/// One recipe with its history.
#[derive(Clone, Debug)]
pub struct Twin<R> {
    recipe: Recipe,
    precision: Precision,
    history: Option<Image<Color<R>>>,
}

/// What a recipe makes of one frame.
#[derive(Clone, Debug)]
pub struct Resolved<R> {
    /// The image to show: linear RGB after the output stage.
    pub shown: Image<[R; 3]>,
    /// Texels whose colour had a hostile component.
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
            recipe,
            precision,
            history: None,
        }
    }

    /// Resolves the next frame.
    ///
    /// # Panics
    /// When the frame lacks a channel of [`Recipe::required_channels`].
    pub fn resolve(&mut self, frame: &Frame) -> Resolved<R> {
        let source = match (self.recipe.source, &frame.unjittered_color) {
            (Source::UnjitteredIfPresent, Some(unjittered)) => unjittered,
            _ => &frame.color,
        };
        let (color, repaired_texels) = color::prepare(source, self.recipe.domain);
        let history = self.history.take().filter(|_| frame.index > 0 && !frame.reset);
        let jitter_px = frame.jitter_px.map(R::new);
        let pixel = Pixels {
            recipe: &self.recipe,
            frame,
            jitter_px,
            input_weights: blackman_harris(jitter_px),
            color: &color,
            history: history.as_ref(),
        };
        let resolved = Image::from_fn(color.extent(), |x, y| pixel.resolve([i64::from(x), i64::from(y)]));
        let shown = Image::from_fn(color.extent(), |x, y| {
            pixel
                .output([i64::from(x), i64::from(y)], resolved.at(x, y))
                .from_domain(self.recipe.domain)
                .0
        });
        self.history = Some(match self.precision {
            Precision::F16 => resolved.map(|c| c.map(R::round_to_f16)),
            Precision::F32 => resolved,
        });
        Resolved { shown, repaired_texels }
    }
}

/// A usable motion vector.
#[derive(Clone, Copy)]
struct Motion<R> {
    px: [R; 2],
    length_px: R,
}

/// What one pixel's resolve can see.
struct Pixels<'a, R> {
    recipe: &'a Recipe,
    frame: &'a Frame,
    jitter_px: [R; 2],
    /// Weights of the 3×3 input filter, in the order of [`RING`].
    input_weights: [R; 9],
    color: &'a Image<Color<R>>,
    history: Option<&'a Image<Color<R>>>,
}

impl<R: Real> Pixels<'_, R> {
    /// The next history at `p`, unrounded.
    fn resolve(&self, p: [i64; 2]) -> Color<R> {
        let current = self.current(p);
        let resolved = match self.reproject(p) {
            None => current,
            Some((q, motion)) => self.accumulate(p, q, motion, current),
        };
        resolved.min(Color::splat(F16_MAX))
    }

    /// The current colour at `p` through the input filter.
    fn current(&self, [x, y]: [i64; 2]) -> Color<R> {
        match self.recipe.input_filter {
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

    /// Where the jittered image holds the centre of pixel (x, y).
    fn unjittered(&self, x: i64, y: i64) -> [R; 2] {
        let [jx, jy] = self.jitter_px;
        [R::new(x as f64 + 0.5) - jx, R::new(y as f64 + 0.5) - jy]
    }

    /// Where the surface at `p` was in the previous frame, unless history is absent there.
    fn reproject(&self, p: [i64; 2]) -> Option<([R; 2], Motion<R>)> {
        if self.history.is_none() || self.recipe.history_filter == HistoryFilter::None {
            return None;
        }
        let motion = self.motion(p)?;
        let q = [0, 1].map(|axis| R::new(p[axis] as f64 + 0.5) + motion.px[axis]);
        let extent = self.color.extent();
        let inside = |s: R, size: u32| s >= R::new(0.0) && s <= R::new(f64::from(size));
        (inside(q[0], extent.width) && inside(q[1], extent.height)).then_some((q, motion))
    }

    /// The dilated motion of `p`; none where the vector chosen is unusable.
    fn motion(&self, [x, y]: [i64; 2]) -> Option<Motion<R>> {
        let chosen = match self.recipe.dilation {
            Dilation::None => [0, 0],
            Dilation::Closest => first_largest(|[i, j]| -self.depth(x + i, y + j)),
            Dilation::Longest => first_largest(|[i, j]| {
                self.motion_at(x + i, y + j)
                    .map_or(0.0, |motion| motion.length_px.to_f64())
            }),
        };
        self.motion_at(x + chosen[0], y + chosen[1])
    }

    /// Linear view depth; what is not finite and positive is sky.
    fn depth(&self, x: i64, y: i64) -> f64 {
        let depth = self.frame.depth.as_ref().expect("validated: the recipe needs depth");
        let z = depth.clamped(x, y);
        f64::from(if z.is_finite() && z > 0.0 { z } else { SKY_DEPTH })
    }

    /// The texel's own motion; none where it is not finite or longer than four images.
    fn motion_at(&self, x: i64, y: i64) -> Option<Motion<R>> {
        let motion = self
            .frame
            .motion_px
            .as_ref()
            .expect("validated: the recipe needs motion");
        let px = motion.clamped(x, y).map(f64::from);
        let extent = self.color.extent();
        // In f64 no f32 overflows when squared; the comparison is false for NaN, too.
        let length = (px[0] * px[0] + px[1] * px[1]).sqrt();
        (length <= 4.0 * f64::from(extent.width.max(extent.height))).then(|| Motion {
            px: px.map(R::new),
            length_px: R::new(length),
        })
    }

    /// Filters, rectifies and blends the history at `q`.
    fn accumulate(&self, p: [i64; 2], q: [R; 2], motion: Motion<R>, current: Color<R>) -> Color<R> {
        let recipe = self.recipe;
        let history = self.history.expect("reprojected into it");
        let unrectified = sampling::history(history, q, recipe.history_filter, recipe.deringing);
        let bounds = neighbourhood::color_box(self.color, p, self.jitter_px, recipe);
        let rectified = match &bounds {
            None => unrectified,
            Some(bounds) => rectify::rectify(
                recipe.rectify,
                unrectified.to_space(recipe.space),
                current.to_space(recipe.space),
                bounds,
                recipe.domain,
            )
            .from_space(recipe.space),
        };
        let weight = self.weight(current, rectified, unrectified, bounds.as_ref(), motion);
        match recipe.hdr_weight {
            HdrWeight::None => Color::mix(rectified, current, weight),
            HdrWeight::Karis => {
                let one = R::new(1.0);
                let of_history = (one - weight) / (one + rectified.luma());
                let of_current = weight / (one + current.luma());
                (rectified * of_history + current * of_current) * (one / (of_history + of_current))
            }
        }
    }

    /// The weight of the current colour.
    fn weight(
        &self,
        current: Color<R>,
        rectified: Color<R>,
        unrectified: Color<R>,
        bounds: Option<&ColorBox<R>>,
        motion: Motion<R>,
    ) -> R {
        let recipe = self.recipe;
        let c = R::new;
        let weight = match recipe.weight {
            Weight::Fixed => c(recipe.current_weight),
            Weight::LumaFeedback => {
                let (l0, l1) = (current.luma(), rectified.luma());
                let agreement = c(1.0) - (l0 - l1).abs() / l0.max(l1).max(c(0.2));
                c(1.0)
                    - mix(
                        c(recipe.luma_feedback_lo),
                        c(recipe.luma_feedback_hi),
                        agreement * agreement,
                    )
            }
            Weight::Antiflicker => {
                let bounds = bounds.expect("validated: the weight needs a box");
                let base = mix(c(0.04), c(0.2), (motion.length_px / c(40.0)).saturate());
                let [lo, hi, l] =
                    [bounds.lo, bounds.hi, unrectified.to_space(recipe.space)].map(|color| color.luma_in(recipe.space));
                let to_edge = (l - lo).min(hi - l).max(c(0.0));
                let inside = (c(2.0) * to_edge / (hi - lo).max(c(1e-7))).saturate();
                (base * (c(1.0) + c(3.0) * inside)).min(c(1.0))
            }
        };
        if !recipe.motion_weight {
            return weight;
        }
        let (from, to) = (c(recipe.motion_weight_from_px), c(recipe.motion_weight_to_px));
        weight.max(((motion.length_px - from) / (to - from)).saturate())
    }

    /// The output stage: shown, never fed back.
    fn output(&self, p: [i64; 2], resolved: Color<R>) -> Color<R> {
        let motion = self.recipe.motion_blur.then(|| self.motion(p)).flatten();
        let Some(motion) = motion else {
            return resolved;
        };
        let c = R::new;
        let keep = c(1.0) - ((motion.length_px - c(2.0)) / c(13.0)).saturate();
        if keep == c(1.0) {
            return resolved;
        }
        let [x, y] = self.unjittered(p[0], p[1]);
        let mut sum = Color::default();
        for i in -3..=3 {
            let t = c(f64::from(i) / 6.0);
            sum = sum + bilinear(self.color, [x + motion.px[0] * t, y + motion.px[1] * t]);
        }
        Color::mix(sum * c(1.0 / 7.0), resolved, keep)
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

/// The first offset of [`RING`] with the largest score.
fn first_largest(score: impl Fn([i64; 2]) -> f64) -> [i64; 2] {
    let mut best = (RING[0], score(RING[0]));
    for offset in &RING[1..] {
        let score = score(*offset);
        if score > best.1 {
            best = (*offset, score);
        }
    }
    best.0
}
