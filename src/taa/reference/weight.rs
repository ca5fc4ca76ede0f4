//! How much the current colour counts in the blend: the twin of `shaders/taa/temporal/weight.wgsl`.

use super::{
    Pixels,
    color::Color,
    neighbourhood::ColorBox,
    planes::made,
    real::{Real, mix},
    reproject::{Motion, Reprojected},
};
use crate::{image::Image, taa::recipe::Weight};

/// What is blended, and what it was before.
pub struct Blended<'a, R> {
    pub current: Color<R>,
    /// History after rectification.
    pub rectified: Color<R>,
    /// History before it.
    pub unrectified: Color<R>,
    pub bounds: Option<&'a ColorBox<R>>,
}

impl<R: Real> Pixels<'_, R> {
    /// The weight of the current colour.
    pub fn weight(&self, p: [i64; 2], motion: Motion<R>, n_samples: R, colors: &Blended<'_, R>) -> R {
        let Blended {
            current,
            rectified,
            unrectified,
            bounds,
        } = *colors;
        let recipe = self.recipe;
        let c = R::new;
        let weight = match recipe.weight {
            Weight::Fixed => c(recipe.current_weight),
            Weight::LumaFeedback => self.luma_feedback(current.luma(), rectified.luma()),
            Weight::Antiflicker => {
                let bounds = bounds.expect("validated: the weight needs a box");
                let base = mix(c(0.04), c(0.2), (motion.length_px / c(40.0)).saturate());
                let [lo, hi, l] =
                    [bounds.lo, bounds.hi, unrectified.to_space(recipe.space)].map(|color| color.luma_in(recipe.space));
                let to_edge = (l - lo).min(hi - l).max(c(0.0));
                let inside = (c(2.0) * to_edge / (hi - lo).max(c(1e-7))).saturate();
                (base * (c(1.0) + c(3.0) * inside)).min(c(1.0))
            }
            Weight::Count => (c(1.0) / n_samples).max(c(recipe.count_weight_min)),
            Weight::Amortized => self.amortized(p, motion, n_samples),
        };
        let weight = weight * self.confidence(p);
        let weight = if recipe.reactive {
            weight.max(self.reactive(p))
        } else {
            weight
        };
        if !recipe.motion_weight {
            return weight;
        }
        let (from, to) = (c(recipe.motion_weight_from_px), c(recipe.motion_weight_to_px));
        weight.max(((motion.length_px - from) / (to - from)).saturate())
    }

    /// The current colour counts more where the lumas of both still differ.
    pub fn luma_feedback(&self, of_current: R, of_history: R) -> R {
        let c = R::new;
        let agreement = c(1.0) - (of_current - of_history).abs() / of_current.max(of_history).max(c(0.2));
        let (lo, hi) = (self.recipe.luma_feedback_lo, self.recipe.luma_feedback_hi);
        c(1.0) - mix(c(lo), c(hi), agreement * agreement)
    }

    /// Yang et al. 2009: shorter histories where they differ from the present on average, and where the fraction of the
    /// motion makes bilinear resampling blur.
    fn amortized(&self, [x, y]: [i64; 2], motion: Motion<R>, n_samples: R) -> R {
        let c = R::new;
        let rows = made(&self.planes.difference_rows);
        let difference = mean_of_7(|j| rows.clamped(x, y + j)).map(R::abs).max3();
        let changed =
            (c(1.0) - c(0.05) / difference.max(c(if self.recipe.has_guards() { 1e-6 } else { 0.0 }))).saturate();
        let fractions = motion.px.map(|m| m - m.floor());
        let [vx, vy] = fractions.map(|f| f * (c(1.0) - f));
        let blur = c(0.5) * (vx + vy);
        (c(1.0) / n_samples).max(changed).max(blur / (blur + c(0.5)))
    }

    /// History less the current colour, 0 where a pixel has none; nothing where it is absent as a whole.
    pub fn difference(&self) -> Option<Image<Color<R>>> {
        let history = self.previous?.history();
        let at = |p: [i64; 2]| {
            let reprojected = self.reproject(p);
            let less_current = |at: Reprojected<R>| self.filtered(history, at.q) - self.color.clamped(p[0], p[1]);
            reprojected.map_or(Color::default(), less_current)
        };
        Some(Image::from_fn(self.color.extent(), |x, y| at([x.into(), y.into()])))
    }

    /// Its means over rows of 7.
    pub fn difference_rows(&self) -> Option<Image<Color<R>>> {
        let difference = self.planes.difference.as_ref()?;
        let at = |[x, y]: [i64; 2]| mean_of_7(|i| difference.clamped(x + i, y));
        Some(Image::from_fn(difference.extent(), |x, y| at([x.into(), y.into()])))
    }

    /// Within 0 to 1; what is not finite counts as 0.
    fn reactive(&self, p: [i64; 2]) -> R {
        let mask = self
            .frame
            .reactive
            .as_ref()
            .expect("validated: the recipe needs a mask");
        let [x, y] = self.input_texel(p);
        let value = mask.clamped(x, y);
        R::new(if value.is_finite() { f64::from(value) } else { 0.0 }).saturate()
    }
}

/// Of what lies 3 before to 3 behind.
fn mean_of_7<R: Real>(at: impl Fn(i64) -> Color<R>) -> Color<R> {
    (-3..=3).fold(Color::default(), |sum, i| sum + at(i)) * R::new(1.0 / 7.0)
}
