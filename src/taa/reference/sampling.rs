//! Filters: the twin of `shaders/common/sampling.wgsl`. Positions are in pixels, texel centres at +0.5; a fetch outside
//! the image takes the nearest edge texel.

use super::{Pixels, color::Color, planes::made, quasi_cubic, real::Real};
use crate::{image::Image, taa::recipe::HistoryFilter};

/// A position in pixels.
pub type Position<R> = [R; 2];

/// The texel at or below a position's texel-centre grid, and the fractions beyond it.
pub fn split<R: Real>(position: Position<R>) -> ([i64; 2], [R; 2]) {
    let base = position.map(|s| (s - R::new(0.5)).floor());
    let fraction = std::array::from_fn(|axis| position[axis] - R::new(0.5) - base[axis]);
    (base.map(|s| s.to_f64() as i64), fraction)
}

/// The texel that contains a position.
pub fn containing<R: Real>(position: Position<R>) -> [i64; 2] {
    position.map(|s| s.floor().to_f64() as i64)
}

/// What can be interpolated: `a + (b - a) t`.
pub trait Lerp<R>: Copy {
    /// Between equals exactly their value: a box of flat colours must contain that colour.
    fn lerp(self, other: Self, t: R) -> Self;
}

impl<R: Real> Lerp<R> for Color<R> {
    fn lerp(self, other: Self, t: R) -> Self {
        self + (other - self) * t
    }
}

/// 2×2 bilinear.
pub fn bilinear<R: Real>(image: &Image<Color<R>>, position: Position<R>) -> Color<R> {
    bilinear_of(position, |x, y| image.clamped(x, y))
}

/// 2×2 bilinear of whatever `texel` returns.
pub fn bilinear_of<R: Real, T: Lerp<R>>(position: Position<R>, texel: impl Fn(i64, i64) -> T) -> T {
    let ([x, y], [fx, fy]) = split(position);
    let top = texel(x, y).lerp(texel(x + 1, y), fx);
    let bottom = texel(x, y + 1).lerp(texel(x + 1, y + 1), fx);
    top.lerp(bottom, fy)
}

/// Catmull-Rom weights of the texels at -1, 0, 1 and 2 for the fraction `f`.
fn catmull_rom_weights<R: Real>(f: R) -> [R; 4] {
    let c = |value: f64| R::new(value);
    [
        f * (c(-0.5) + f * (c(1.0) - c(0.5) * f)),
        c(1.0) + f * f * (c(-2.5) + c(1.5) * f),
        f * (c(0.5) + f * (c(2.0) - c(1.5) * f)),
        f * f * (c(-0.5) + c(0.5) * f),
    ]
}

/// The separable 4×4 spline.
fn catmull_rom<R: Real>(image: &Image<Color<R>>, position: Position<R>) -> Color<R> {
    let (_, fractions) = split(position);
    separable(image, position, fractions.map(catmull_rom_weights))
}

/// The 4×4 texels around a position, by weights along each axis.
pub fn separable<R: Real>(image: &Image<Color<R>>, position: Position<R>, [wx, wy]: [[R; 4]; 2]) -> Color<R> {
    let ([x, y], _) = split(position);
    let mut sum = Color::default();
    for (j, wy) in (-1..).zip(wy) {
        for (i, wx) in (-1..).zip(wx) {
            sum = sum + image.clamped(x + i, y + j) * (wx * wy);
        }
    }
    sum
}

/// The spline without its corners: five bilinear taps, weights divided by their sum.
fn catmull_rom_5<R: Real>(image: &Image<Color<R>>, position: Position<R>) -> Color<R> {
    let half = R::new(0.5);
    let b: [R; 2] = position.map(|s| (s - half).floor() + half);
    let f: [R; 2] = std::array::from_fn(|axis| position[axis] - b[axis]);
    let [[wx0, wx1, wx2, wx3], [wy0, wy1, wy2, wy3]] = f.map(catmull_rom_weights);
    let (wx12, wy12) = (wx1 + wx2, wy1 + wy2);
    let (x12, y12) = (b[0] + wx2 / wx12, b[1] + wy2 / wy12);
    let (one, two) = (R::new(1.0), R::new(2.0));
    let taps = [
        ([x12, b[1] - one], wx12 * wy0),
        ([b[0] - one, y12], wx0 * wy12),
        ([x12, y12], wx12 * wy12),
        ([b[0] + two, y12], wx3 * wy12),
        ([x12, b[1] + two], wx12 * wy3),
    ];
    let mut sum = Color::default();
    let mut weights = R::new(0.0);
    for (at, weight) in taps {
        sum = sum + bilinear(image, at) * weight;
        weights = weights + weight;
    }
    sum * (R::new(1.0) / weights)
}

impl<R: Real> Pixels<'_, R> {
    /// The previous frame's `history` at `q`.
    pub fn filtered(&self, history: &Image<Color<R>>, q: Position<R>) -> Color<R> {
        let (filter, deringing) = (self.recipe.history_filter, self.recipe.deringing);
        let value = match filter {
            HistoryFilter::Bfecc => bilinear(made(&self.planes.compensated), q),
            HistoryFilter::QuasiCubic => quasi_cubic::sample(made(&self.planes.coefficients), q),
            _ => return filtered(history, q, filter, deringing),
        };
        without_lobes(value, history, q, deringing)
    }

    /// History carried along the motion; none where it is absent as a whole.
    pub fn advected(&self) -> Option<Image<Color<R>>> {
        let history = self.previous?.history();
        Some(Image::from_fn(history.extent(), |x, y| {
            self.carried(history, [x, y], 1.0)
        }))
    }

    /// History and half of what sampling it forth and back loses.
    pub fn compensated(&self) -> Option<Image<Color<R>>> {
        let history = self.previous?.history();
        let advected = made(&self.planes.advected);
        Some(Image::from_fn(history.extent(), |x, y| {
            let h = history.at(x, y);
            h + (h - self.carried(advected, [x, y], -1.0)) * R::new(0.5)
        }))
    }

    /// An image where the pixel's motion leads, `sign` times; in place where that is unusable.
    fn carried(&self, image: &Image<Color<R>>, p: [u32; 2], sign: f64) -> Color<R> {
        let p = p.map(i64::from);
        let motion = if self.recipe.reproject { self.motion(p) } else { None };
        let motion = motion.unwrap_or_default().px;
        let at = std::array::from_fn(|axis| R::new(p[axis] as f64 + 0.5) + R::new(sign) * motion[axis]);
        bilinear(image, at)
    }
}

/// An image at `q`, by a filter that needs nothing else.
fn filtered<R: Real>(image: &Image<Color<R>>, q: Position<R>, filter: HistoryFilter, deringing: bool) -> Color<R> {
    let value = match filter {
        HistoryFilter::None | HistoryFilter::Texel => {
            let [x, y] = containing(q);
            return image.clamped(x, y);
        }
        HistoryFilter::Bilinear => return bilinear(image, q),
        HistoryFilter::CatmullRom => catmull_rom(image, q),
        HistoryFilter::CatmullRom5 => catmull_rom_5(image, q),
        HistoryFilter::Bfecc | HistoryFilter::QuasiCubic => unreachable!("history is prefiltered first"),
    };
    without_lobes(value, image, q, deringing)
}

/// Never negative, and within the 4 texels around `q` where `deringing` is on.
fn without_lobes<R: Real>(value: Color<R>, image: &Image<Color<R>>, q: Position<R>, deringing: bool) -> Color<R> {
    let positive = value.max(Color::splat(0.0));
    if !deringing {
        return positive;
    }
    let ([x, y], _) = split(q);
    let around = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| image.clamped(x + i, y + j));
    let lo = around.into_iter().fold(around[0], Color::min);
    let hi = around.into_iter().fold(around[0], Color::max);
    positive.clamp(lo, hi)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;

    /// A plane `ax + by + c`, away from the edges of a 9×9 image.
    fn plane(a: f64, b: f64) -> Image<Color<f64>> {
        Image::from_fn(Extent::new(9, 9), |x, y| {
            Color::splat(2.0 + a * f64::from(x) + b * f64::from(y))
        })
    }

    #[test]
    fn filters_reproduce_what_they_promise() {
        let q = [4.3, 4.9];
        let value = |a, b| 2.0 + a * (q[0] - 0.5) + b * (q[1] - 0.5);
        for filter in [HistoryFilter::Bilinear, HistoryFilter::CatmullRom] {
            let found = filtered(&plane(0.25, 0.5), q, filter, false).0[0];
            assert!((found - value(0.25, 0.5)).abs() < 1e-12, "{filter:?}: {found}");
        }
        // Five taps drop the corners: axis-aligned ramps survive, oblique ones do not.
        let five = |a, b| filtered(&plane(a, b), q, HistoryFilter::CatmullRom5, false).0[0];
        assert!((five(0.0, 0.0) - 2.0).abs() < 1e-12);
        assert!((five(0.25, 0.5) - value(0.25, 0.5)).abs() > 1e-5);
    }

    #[test]
    fn negative_lobes_are_cut_and_deringing_bounds_the_rest() {
        let edge = Image::from_fn(Extent::new(9, 9), |x, _| Color::splat(f64::from(u8::from(x > 4))));
        let at = |x, deringing| filtered(&edge, [x, 4.5], HistoryFilter::CatmullRom, deringing).0[0];
        assert_eq!(at(4.2, false), 0.0, "undershoot before the edge");
        assert!(at(5.8, false) > 1.0, "overshoot behind it");
        assert_eq!(at(5.8, true), 1.0);
    }

    /// Moves an image by a fraction of a pixel.
    type Step<'a> = dyn Fn(&Image<Color<f64>>, [f64; 2]) -> Image<Color<f64>> + 'a;

    /// Survey of Yang et al. 2020, figure 8: history is resampled again and again, there and back by fractions of a pixel.
    #[test]
    fn of_a_hundred_resamplings_quasi_cubic_keeps_most() {
        let extent = Extent::new(40, 40);
        let scene = Image::from_fn(extent, |x, y| {
            let (x, y) = (f64::from(x), f64::from(y));
            Color::splat(0.5 + 0.2 * libm::sin(1.1 * x + 0.3 * y) + 0.2 * libm::cos(0.4 * x - 0.9 * y))
        });
        let error = |step: &Step<'_>| {
            let mut image = scene.clone();
            for i in 0..50 {
                let shift = [0.618, 0.755].map(|g: f64| (f64::from(i) * g).fract());
                image = step(&step(&image, shift), shift.map(|s| -s));
            }
            let inner = (10..30).flat_map(|y| (10..30).map(move |x| (x, y)));
            let squares = inner.map(|(x, y)| (image.at(x, y).0[0] - scene.at(x, y).0[0]).powi(2));
            squares.sum::<f64>() / 400.0
        };
        let moved = |[dx, dy]: [f64; 2], sample: &(dyn Fn([f64; 2]) -> Color<f64> + Sync)| {
            Image::from_fn(extent, |x, y| {
                sample([f64::from(x) + 0.5 + dx, f64::from(y) + 0.5 + dy])
            })
        };
        let of = |filter| error(&|image, shift| moved(shift, &|q| filtered(image, q, filter, false)));
        let quasi_cubic = error(&|image, shift| {
            let coefficients = quasi_cubic::along_columns(&quasi_cubic::along_rows(image));
            moved(shift, &|q| quasi_cubic::sample(&coefficients, q))
        });
        let errors = [quasi_cubic, of(HistoryFilter::CatmullRom), of(HistoryFilter::Bilinear)];
        assert!(errors[0] < 0.1 * errors[1] && errors[1] < 0.5 * errors[2], "{errors:?}");
    }
}
