//! The output stage: the twin of `shaders/taa/temporal/{output,sharpen}.wgsl`.

use super::{Pixels, color::Color, display::TONEMAPPED_MAX, real::Real, sampling::bilinear};
use crate::{
    image::Image,
    taa::recipe::{Domain, Sharpen},
};

impl<R: Real> Pixels<'_, R> {
    /// What is shown of a resolved image, and never fed back; in the working domain.
    pub fn output(&self, resolved: &Image<Color<R>>) -> Image<Color<R>> {
        Image::from_fn(resolved.extent(), |x, y| {
            let p = [x.into(), y.into()];
            self.blurred(p, self.sharpened(p, resolved))
        })
    }

    fn sharpened(&self, [x, y]: [i64; 2], resolved: &Image<Color<R>>) -> Color<R> {
        let centre = resolved.clamped(x, y);
        let ring = [(0, -1), (-1, 0), (1, 0), (0, 1)].map(|(i, j)| resolved.clamped(x + i, y + j));
        let sum = ring.into_iter().fold(Color::default(), |sum, c| sum + c);
        let (strength, four) = (R::new(self.recipe.sharpen_strength), R::new(4.0));
        let sharpened = match self.recipe.sharpen {
            Sharpen::None => return centre,
            Sharpen::Xu => centre + (centre * four - sum) * strength,
            Sharpen::Normalised => centre + (centre - sum * R::new(0.25)) * strength,
            Sharpen::Rcas => {
                let lobe = contrast_limited_lobe(centre, ring) * strength;
                (centre + sum * lobe) * (R::new(1.0) / (R::new(1.0) + lobe * four))
            }
        };
        let positive = sharpened.max(Color::splat(0.0));
        match self.recipe.domain {
            Domain::Linear => positive,
            Domain::Tonemapped => positive.min(Color::splat(TONEMAPPED_MAX)),
            Domain::Display => positive.min(Color::splat(1.0)),
        }
    }

    /// Blurred along fast motion.
    fn blurred(&self, p: [i64; 2], resolved: Color<R>) -> Color<R> {
        let motion = self.recipe.motion_blur.then(|| self.motion(p)).flatten();
        let Some(motion) = motion else {
            return resolved;
        };
        let c = R::new;
        let keep = c(1.0) - ((motion.length_px - c(2.0)) / c(13.0)).saturate();
        if keep == c(1.0) {
            return resolved;
        }
        let mut sum = Color::default();
        for i in -3..=3 {
            let t = c(f64::from(i) / 6.0);
            let along = [0, 1].map(|axis| {
                let position = c(p[axis] as f64 + 0.5) + motion.px[axis] * t;
                position / self.scale[axis] - self.jitter_px[axis]
            });
            sum = sum + bilinear(self.color, along);
        }
        Color::mix(sum * c(1.0 / 7.0), resolved, keep)
    }
}

/// The most negative weight of a neighbour with which (c + lobe Σ) / (1 + 4 lobe) stays within 0 to 1 in every channel.
fn contrast_limited_lobe<R: Real>(centre: Color<R>, ring: [Color<R>; 4]) -> R {
    let (one, four, tiny) = (R::new(1.0), R::new(4.0), R::new(1e-7));
    let lo = ring.into_iter().fold(centre, Color::min);
    let hi = ring.into_iter().fold(centre, Color::max);
    let positive = lo.zip(hi, |lo, hi| lo / (four * hi).max(tiny));
    let below_one = lo.zip(hi, |lo, hi| (one - hi) / (four * (one - lo)).max(tiny));
    let [r, g, b] = positive.min(below_one).0;
    -(r.min(g).min(b).clamp(R::new(0.0), R::new(0.1875)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lobe_keeps_extremes_within_range() {
        for (centre, ring) in [(0.9, 0.2), (0.2, 0.9), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5)] {
            let ring = [Color::<f64>::splat(ring); 4];
            let lobe = contrast_limited_lobe(Color::splat(centre), ring);
            let sharpened = (centre + lobe * 4.0 * ring[0].0[0]) / (1.0 + 4.0 * lobe);
            assert!((0.0..=1.0).contains(&sharpened), "{sharpened}");
            assert!((-0.1875..=0.0).contains(&lobe), "{lobe}");
        }
        // Where there is room to both sides, it does sharpen.
        assert!(contrast_limited_lobe(Color::<f64>::splat(0.6), [Color::splat(0.5); 4]) < -0.1);
    }
}
