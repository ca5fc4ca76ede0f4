//! The colour box around a pixel: the twin of `shaders/taa/temporal/neighbourhood.wgsl`.

use super::{
    Pixels, RING,
    color::Color,
    planes::{Moments, made},
    real::Real,
    sampling::bilinear,
};
use crate::{image::Image, taa::recipe::Neighbourhood};

/// The range that history may lie in, and the mean, in the recipe's colour space.
#[derive(Clone, Copy, Debug)]
pub struct ColorBox<R> {
    /// Lower bound.
    pub lo: Color<R>,
    /// Upper bound.
    pub hi: Color<R>,
    /// Mean of the texels.
    pub mean: Color<R>,
}

const CROSS: [[i64; 2]; 5] = [[0, -1], [-1, 0], [0, 0], [1, 0], [0, 1]];

/// The cross and the 3×3.
pub const RINGS: [&[[i64; 2]]; 2] = [&CROSS, &RING];

impl<R: Real> Pixels<'_, R> {
    /// The box around pixel `p`, whose current colour is `current` (RGB), or none where the recipe has none.
    pub fn color_box(&self, p: [i64; 2], current: Color<R>) -> Option<ColorBox<R>> {
        let recipe = self.recipe;
        let under = self.input_texel(p);
        let texel = |[i, j]: [i64; 2]| {
            let [x, y] = [under[0] + i, under[1] + j];
            let rgb = if recipe.unjitter_neighbourhood {
                bilinear(self.color, self.unjittered(x, y))
            } else {
                self.color.clamped(x, y)
            };
            rgb.to_space(recipe.space)
        };
        let cross = || minmax(CROSS.into_iter().map(texel));
        let box3 = || minmax(window(3).map(texel));
        let bounds = match recipe.neighbourhood {
            Neighbourhood::None => return None,
            Neighbourhood::Cross => cross(),
            Neighbourhood::Box3 => box3(),
            Neighbourhood::Rounded => cross().average(box3()),
            Neighbourhood::Variance => {
                let bounds = if recipe.prefilter_moments {
                    self.prefiltered(under)
                } else {
                    self.distribution(texel([0, 0]), window(recipe.variance_window).map(texel))
                };
                let bounds = bounds.bounds(R::new(recipe.variance_gamma));
                if recipe.intersect_minmax {
                    bounds.intersect(box3())
                } else {
                    bounds
                }
            }
            Neighbourhood::Sobel => self.sobel_box(p, current.to_space(recipe.space), cross(), box3()),
            Neighbourhood::Shrunk => minmax(self.near_samples(p).map(|c| c.to_space(recipe.space))),
        };
        Some(if recipe.chroma_from_luma {
            bounds.narrow_chroma(current.to_space(recipe.space))
        } else {
            bounds
        })
    }
}

/// Offsets of n×n texels, row by row.
fn window(n: u32) -> impl Iterator<Item = [i64; 2]> {
    let radius = i64::from(n / 2);
    (-radius..=radius).flat_map(move |y| (-radius..=radius).map(move |x| [x, y]))
}

/// Minimum, maximum and mean of at least one texel.
pub fn minmax<R: Real>(mut texels: impl Iterator<Item = Color<R>>) -> ColorBox<R> {
    let first = texels.next().unwrap_or_default();
    let (mut lo, mut hi, mut sum, mut n) = (first, first, first, 1);
    for c in texels {
        (lo, hi, sum, n) = (lo.min(c), hi.max(c), sum + c, n + 1);
    }
    let mean = sum * R::new(1.0 / f64::from(n));
    ColorBox { lo, hi, mean }
}

/// Mean and variance of some texels.
#[derive(Clone, Copy)]
struct Distribution<R> {
    mean: Color<R>,
    variance: Color<R>,
}

/// Moments are taken about `centre`: `m2/N - μ²` cancels where the texels are bright and alike. The variance is at least `least`.
fn distribution<R: Real>(centre: Color<R>, texels: impl Iterator<Item = Color<R>>, least: R) -> Distribution<R> {
    let (mut m1, mut m2, mut n) = (Color::default(), Color::default(), 0);
    for texel in texels {
        let d = texel - centre;
        (m1, m2, n) = (m1 + d, m2 + square(d), n + 1);
    }
    let per_texel = R::new(1.0 / f64::from(n));
    let offset = m1 * per_texel;
    Distribution {
        mean: centre + offset,
        variance: (m2 * per_texel - square(offset)).map(|v| v.max(least)),
    }
}

fn square<R: Real>(c: Color<R>) -> Color<R> {
    c.zip(c, |a, b| a * b)
}

impl<R: Real> Distribution<R> {
    /// Mean ± γ σ.
    fn bounds(self, gamma: R) -> ColorBox<R> {
        let sigma = self.variance.map(R::sqrt);
        ColorBox {
            lo: self.mean - sigma * gamma,
            hi: self.mean + sigma * gamma,
            mean: self.mean,
        }
    }
}

/// Mean and variance in two passes whose cost does not grow with the window.
impl<R: Real> Pixels<'_, R> {
    /// Of the texels in each pixel's row of the window.
    pub fn row_moments(&self) -> Moments<R> {
        let radius = i64::from(self.recipe.variance_window / 2);
        self.moments(|[x, y]| {
            let texel = |i| self.color.clamped(x + i, y).to_space(self.recipe.space);
            self.distribution(texel(0), (-radius..=radius).map(texel))
        })
    }

    /// Of the whole window: the rows' means have a variance, which adds to the mean of the rows' own.
    pub fn window_moments(&self) -> Moments<R> {
        let radius = i64::from(self.recipe.variance_window / 2);
        let [means, variances] = [&self.planes.row_moments.means, &self.planes.row_moments.variances].map(made);
        self.moments(|[x, y]| {
            let mean = |j| means.clamped(x, y + j);
            let of_means = self.distribution(mean(0), (-radius..=radius).map(mean));
            let variances = (-radius..=radius).map(|j| variances.clamped(x, y + j));
            let sum = variances.fold(Color::default(), |sum, variance| sum + variance);
            Distribution {
                mean: of_means.mean,
                variance: of_means.variance + sum * R::new(1.0 / f64::from(self.recipe.variance_window)),
            }
        })
    }

    /// Without guards about 0, and with whatever cancellation leaves.
    fn distribution(&self, centre: Color<R>, texels: impl Iterator<Item = Color<R>>) -> Distribution<R> {
        match self.recipe.has_guards() {
            true => distribution(centre, texels, R::new(0.0)),
            false => distribution(Color::default(), texels, R::new(f64::NEG_INFINITY)),
        }
    }

    fn moments(&self, at: impl Fn([i64; 2]) -> Distribution<R> + Sync) -> Moments<R> {
        let both = Image::from_fn(self.color.extent(), |x, y| at([x.into(), y.into()]));
        Moments {
            means: Some(both.map(|distribution| distribution.mean)),
            variances: Some(both.map(|distribution| distribution.variance)),
        }
    }

    fn prefiltered(&self, [x, y]: [i64; 2]) -> Distribution<R> {
        let Moments { means, variances } = &self.planes.window_moments;
        Distribution {
            mean: made(means).clamped(x, y),
            variance: made(variances).clamped(x, y),
        }
    }
}

impl<R: Real> ColorBox<R> {
    /// Bounds and mean half-way between both.
    pub fn average(self, other: Self) -> Self {
        let average = |a: Color<R>, b: Color<R>| (a + b) * R::new(0.5);
        Self {
            lo: average(self.lo, other.lo),
            hi: average(self.hi, other.hi),
            mean: average(self.mean, other.mean),
        }
    }

    /// Chroma within an eighth of luma's range of `current`'s. All in YCoCg.
    fn narrow_chroma(self, current: Color<R>) -> Self {
        let extent = (self.hi.0[0] - self.lo.0[0]) * R::new(0.125);
        let [_, co, cg] = current.0;
        Self {
            lo: Color([self.lo.0[0], co - extent, cg - extent]),
            hi: Color([self.hi.0[0], co + extent, cg + extent]),
            mean: Color([self.mean.0[0], co, cg]),
        }
    }

    /// The part inside `other`; the whole of `other` where a channel has none. The mean stays.
    fn intersect(self, other: Self) -> Self {
        let (lo, hi) = (self.lo.max(other.lo), self.hi.min(other.hi));
        let is_empty = (0..3).any(|i| lo.0[i] > hi.0[i]);
        let (lo, hi) = if is_empty { (other.lo, other.hi) } else { (lo, hi) };
        Self {
            lo,
            hi,
            mean: self.mean,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variance_of_a_bright_flat_neighbourhood_does_not_cancel() {
        // 10000 ± 0.001 in f32: the naive formula loses all digits of the variance.
        let texels: Vec<_> = (0..9)
            .map(|i| Color::<f32>::splat(1e4 + if i % 2 == 0 { 1e-3 } else { -1e-3 }))
            .collect();
        let bounds = distribution(texels[0], texels.iter().copied(), 0.0).bounds(1.0);
        let extent = bounds.hi.0[0] - bounds.lo.0[0];
        assert!((1e-3..4e-3).contains(&extent), "{extent}");
    }

    #[test]
    fn an_empty_intersection_is_the_whole_other_box() {
        let range = |lo: f64, hi: f64| ColorBox::<f64> {
            lo: Color::splat(lo),
            hi: Color::splat(hi),
            mean: Color::splat(0.5),
        };
        assert_eq!(range(0.0, 0.4).intersect(range(0.2, 1.0)).hi, Color::splat(0.4));
        assert_eq!(range(0.0, 0.1).intersect(range(0.2, 1.0)).lo, Color::splat(0.2));
    }
}
