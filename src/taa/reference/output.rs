//! The output stage: the twin of `shaders/taa/temporal/output.wgsl`.

use super::{Pixels, color::Color, real::Real, sampling::bilinear};

impl<R: Real> Pixels<'_, R> {
    /// The output stage: shown, never fed back.
    pub fn output(&self, p: [i64; 2], resolved: Color<R>) -> Color<R> {
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
