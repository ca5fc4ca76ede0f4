//! Pixel history linear models: the twin of `shaders/taa/phlm2016`, after Iglesias-Guitian et al. 2016, algorithm 1.

use super::{
    Pixels, RING,
    color::Color,
    neighbourhood::{ColorBox, minmax},
    planes::{Left, made},
    real::Real,
    rectify::clip_current,
    reproject::Reprojected,
    sampling::{Lerp, Position, bilinear, bilinear_of, containing},
};
use crate::image::Image;

/// How much of the past the fit keeps each frame.
const FORGETTING: f64 = 0.998;
/// Variance of a coefficient about which nothing is known.
const UNKNOWN: f64 = 1000.0;

/// A linear model from `(1, feature)` to a colour.
#[derive(Clone, Copy, Debug)]
struct Model<R> {
    /// One colour for each element of the vector.
    coefficients: [Color<R>; 4],
    covariance: Covariance<R>,
}

/// Symmetric: of four coefficients.
pub type Covariance<R> = [[R; 4]; 4];

/// What a frame makes of a pixel.
#[derive(Clone, Copy)]
struct Fitted<R> {
    feature: Color<R>,
    model: Model<R>,
    /// In the working domain, and of how many samples it is the mean.
    shown: Color<R>,
    n_samples: R,
}

impl<R: Real> Model<R> {
    /// Knows one colour and nothing else.
    fn constant(color: Color<R>) -> Self {
        let mut coefficients = [Color::default(); 4];
        coefficients[0] = color;
        Self {
            coefficients,
            covariance: unknown(),
        }
    }

    /// Coefficients interpolated at `q`, the covariance of the texel that contains it.
    fn at(left: &Left<R>, q: Position<R>) -> Self {
        let [x, y] = containing(q);
        let coefficients = made(&left.coefficients);
        Self {
            coefficients: bilinear_of(q, |x, y| Coefficients(coefficients.clamped(x, y))).0,
            covariance: made(&left.covariances).clamped(x, y),
        }
    }

    fn predict(&self, x: [R; 4]) -> Color<R> {
        let terms = self.coefficients.into_iter().zip(x).map(|(c, x)| c * x);
        terms.fold(Color::default(), |sum, term| sum + term)
    }

    /// Recursive least squares: after it has seen that `x` gave `y`.
    fn update(&mut self, x: [R; 4], y: Color<R>, guarded: bool) {
        let error = y - self.predict(x);
        let forgetting = R::new(FORGETTING);
        let px = self.covariance.map(|row| dot(row, x));
        let s = dot(x, px);
        let s = if guarded { s.max(R::new(0.0)) } else { s };
        let gain = px.map(|v| v / (forgetting + s));
        for (coefficient, gain) in self.coefficients.iter_mut().zip(gain) {
            *coefficient = *coefficient + error * gain;
        }
        for (row, gain) in self.covariance.iter_mut().zip(gain) {
            *row = std::array::from_fn(|j| (row[j] - gain * px[j]) / forgetting);
        }
        if guarded {
            self.bound();
        }
    }

    /// Symmetric, positive, and of bounded trace: where the feature does not change, forgetting would let it grow, and rounding
    /// makes it indefinite: then an element off the diagonal is larger than those on it allow.
    fn bound(&mut self) {
        let p = self.covariance;
        let symmetric = |i: usize, j: usize| (p[i][j] + p[j][i]) * R::new(0.5);
        let trace = (0..4).fold(R::new(0.0), |sum, i| sum + p[i][i]);
        let scale = (R::new(4.0 * UNKNOWN) / trace).min(R::new(1.0));
        let is_indefinite = |i: usize| {
            let exceeds = |j: usize| symmetric(i, j) * symmetric(i, j) > p[i][i] * p[j][j];
            p[i][i] <= R::new(0.0) || (0..4).any(exceeds)
        };
        self.covariance = if (0..4).any(is_indefinite) {
            unknown()
        } else {
            std::array::from_fn(|i| std::array::from_fn(|j| symmetric(i, j) * scale))
        };
    }
}

fn unknown<R: Real>() -> [[R; 4]; 4] {
    std::array::from_fn(|i| std::array::from_fn(|j| R::new(if i == j { UNKNOWN } else { 0.0 })))
}

fn dot<R: Real>(a: [R; 4], b: [R; 4]) -> R {
    a.into_iter().zip(b).fold(R::new(0.0), |sum, (a, b)| sum + a * b)
}

impl<R: Real> Pixels<'_, R> {
    /// The algorithm on the whole frame; shows nothing yet.
    pub fn phlm(&self) -> Left<R> {
        let still = self.previous.filter(|_| !self.planes.moves);
        let fitted = Image::from_fn(self.color.extent(), |x, y| {
            let fitted = self.fitted([x.into(), y.into()]);
            let Some(previous) = still else {
                return fitted;
            };
            // Without motion what is shown is the plain mean, the last image in motion its first sample.
            let (mean, n_before) = made(&previous.left.mean).at(x, y);
            let n_samples = n_before + R::new(1.0);
            let current = self.current([x.into(), y.into()], true);
            Fitted {
                shown: Color::mix(mean, current, R::new(1.0) / n_samples),
                n_samples,
                ..fitted
            }
        });
        Left {
            history: Some(fitted.map(|fitted| fitted.feature)),
            coefficients: Some(fitted.map(|fitted| fitted.model.coefficients)),
            covariances: Some(fitted.map(|fitted| fitted.model.covariance)),
            mean: Some(fitted.map(|fitted| (fitted.shown, fitted.n_samples))),
            ..Left::default()
        }
    }

    /// Whether no texel moves, and no vector is unusable.
    pub fn nothing_moves(&self) -> bool {
        let extent = self.color.extent();
        let mut texels = (0..extent.height).flat_map(|y| (0..extent.width).map(move |x| [x, y].map(i64::from)));
        texels.all(|[x, y]| self.motion_at(x, y).is_some_and(|motion| motion.px == [R::new(0.0); 2]))
    }

    /// The pixel's feature, its model after this frame, and what that predicts.
    fn fitted(&self, p: [i64; 2]) -> Fitted<R> {
        let y = self.current(p, true);
        let texels = self.ring(p);
        let bounds = minmax(texels.into_iter());
        let (feature, mut model) = match (self.reproject(p), self.previous) {
            (Some(at), Some(previous)) => (self.feature(&at, texels, &bounds), Model::at(&previous.left, at.q)),
            _ => (texels[0], Model::constant(y)),
        };
        let [z0, z1, z2] = feature.0;
        let x = [R::new(1.0), z0, z1, z2];
        let predicted = model.predict(x);
        let beyond = predicted - predicted.clamp(bounds.lo, bounds.hi);
        if beyond.map(R::abs).max3() > R::new(1e-4) {
            model = Model::constant(clip_current(predicted, y, &bounds, self.recipe.has_guards()));
        }
        model.update(x, y, self.recipe.has_guards());
        Fitted {
            feature,
            model,
            shown: self.saturated(model.predict(x).max(Color::splat(0.0))),
            n_samples: R::new(1.0),
        }
    }

    /// The feature's history, refreshed where its luma nears the end of the 3×3's range.
    fn feature(&self, at: &Reprojected<R>, texels: [Color<R>; 9], bounds: &ColorBox<R>) -> Color<R> {
        let c = R::new;
        let features = self.previous.expect("reprojected into it").history();
        let history = bilinear(features, at.q).clamp(bounds.lo, bounds.hi);
        let lumas = texels.map(Color::luma);
        let (lo, hi) = (
            lumas.into_iter().fold(lumas[0], R::min),
            lumas.into_iter().fold(lumas[0], R::max),
        );
        let l = (history.luma() - lo).min(hi - history.luma()).max(c(0.0));
        let range = (hi - lo).max(c(if self.recipe.has_guards() { 1e-4 } else { 0.0 }));
        let phi = c(0.125) * l + c(0.25) * at.motion.length_px * l * l;
        let weight = if self.recipe.phlm_printed {
            (phi * l / (l + range)).saturate()
        } else {
            (phi / (l + range)).saturate().max(c(0.02))
        };
        let mut low = Color::default();
        for ([i, j], texel) in RING.into_iter().zip(texels) {
            low = low + texel * c([0.5, 0.25][i.unsigned_abs() as usize] * [0.5, 0.25][j.unsigned_abs() as usize]);
        }
        Color::mix(history, low, weight)
    }
}

/// Coefficients, to be interpolated.
#[derive(Clone, Copy)]
struct Coefficients<R>([Color<R>; 4]);

impl<R: Real> Lerp<R> for Coefficients<R> {
    fn lerp(self, other: Self, t: R) -> Self {
        Self(std::array::from_fn(|i| self.0[i].lerp(other.0[i], t)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of one line through (1, z): the fit finds it, and its covariance stays bounded where z never changes.
    #[test]
    fn a_model_learns_a_line_and_stays_bounded() {
        let line = |z: f64| Color([0.25 + 0.5 * z, 1.0 - z, 0.5]);
        let mut model = Model::<f64>::constant(Color::splat(0.0));
        for i in 0..200 {
            let z = f64::from(i % 10) / 10.0;
            model.update([1.0, z, 0.0, 0.0], line(z), true);
        }
        let error = model.predict([1.0, 0.33, 0.0, 0.0]) - line(0.33);
        assert!(error.map(f64::abs).max3() < 1e-3, "{error:?}");
        for _ in 0..10_000 {
            model.update([1.0, 0.5, 0.0, 0.0], line(0.5), true);
        }
        let trace: f64 = (0..4).map(|i| model.covariance[i][i]).sum();
        assert!(trace <= 4.0 * UNKNOWN * 1.001, "{trace}");
        let error = model.predict([1.0, 0.5, 0.0, 0.0]) - line(0.5);
        assert!(error.map(f64::abs).max3() < 1e-6, "{error:?}");
    }

    /// A matrix of positive diagonal and trace below the bound, but with elements that no positive one has.
    #[test]
    fn an_indefinite_covariance_is_forgotten() {
        let mut model = Model::<f64>::constant(Color::splat(0.0));
        model.covariance[0][1] = 1500.0;
        model.covariance[1][0] = 1500.0;
        model.bound();
        assert_eq!(model.covariance, unknown::<f64>());
        model.covariance[0][1] = 900.0;
        model.covariance[1][0] = 900.0;
        model.bound();
        assert_eq!(model.covariance[0][1], 900.0);
    }
}
