//! The box that is as wide as a pixel is aliased: the twin of `shaders/taa/sobel2018`.

use super::{
    Pixels, RING,
    color::Color,
    neighbourhood::{ColorBox, RINGS, minmax},
    planes::made,
    real::{Real, mix},
    reproject::depth_or_sky,
    sampling::{bilinear, containing},
};
use crate::image::Image;

/// One channel, in all three.
pub type Scalars<R> = Image<Color<R>>;

impl<R: Real> Pixels<'_, R> {
    /// How strong the edge through each pixel of this frame is, 0 to 1.
    pub fn edges(&self) -> Scalars<R> {
        let unlit_luma = made(&self.planes.unlit_luma);
        let features = |x: i64, y: i64| {
            let lit = self.color.clamped(x, y).luma();
            Color([lit, unlit_luma.clamped(x, y), self.relative_depth(self.depth(x, y))])
        };
        Image::from_fn(self.color.extent(), |x, y| {
            let at = |i: i64, j: i64| features(i64::from(x) + i, i64::from(y) + j);
            let two = R::new(2.0);
            let gx = at(1, -1) + at(1, 0) * two + at(1, 1) - at(-1, -1) - at(-1, 0) * two - at(-1, 1);
            let gy = at(-1, 1) + at(0, 1) * two + at(1, 1) - at(-1, -1) - at(0, -1) * two - at(1, -1);
            let [lit, unlit, depth] = gx.zip(gy, |x, y| (x * x + y * y).sqrt()).0;
            let g = (R::new(0.3) * unlit + R::new(0.7) * lit + depth).saturate();
            Color([(g * g * (R::new(3.0) - two * g)).sqrt(); 3])
        })
    }

    /// The edges through a temporal resolve of their own.
    pub fn stabilised(&self) -> Scalars<R> {
        let edges = made(&self.planes.edges);
        let history = self.previous.and_then(|previous| previous.left.edge_history.as_ref());
        Image::from_fn(edges.extent(), |x, y| {
            let p = [i64::from(x), i64::from(y)];
            let current = bilinear(edges, self.unjittered(p[0], p[1]));
            let (Some(at), Some(history)) = (self.reproject(p), history) else {
                return current;
            };
            let [cross, square] = RINGS.map(|ring| minmax(ring.iter().map(|[i, j]| edges.clamped(p[0] + i, p[1] + j))));
            let bounds = cross.average(square);
            let h = bilinear(history, at.q).clamp(bounds.lo, bounds.hi);
            Color::mix(h, current, self.luma_feedback(current.0[0], h.0[0]))
        })
    }

    /// Between `cross` and `square`, and on to the current colour, by how much the pixel is aliased. In the recipe's space.
    pub fn sobel_box(&self, p: [i64; 2], current: Color<R>, cross: ColorBox<R>, square: ColorBox<R>) -> ColorBox<R> {
        let t = self.aliased(p);
        let between = |a, b| Color::mix(a, b, t);
        ColorBox {
            lo: between(current, between(cross.lo, square.lo)),
            hi: between(current, between(cross.hi, square.hi)),
            mean: between(cross.mean, square.mean),
        }
    }

    /// From edges, other objects and depths that stand out, 0 to 1.
    fn aliased(&self, [x, y]: [i64; 2]) -> R {
        let edges = made(&self.planes.stable_edges);
        let mean = |ring: &[[i64; 2]]| {
            let sum = ring
                .iter()
                .fold(R::new(0.0), |sum, [i, j]| sum + edges.clamped(x + i, y + j).0[0]);
            sum / R::new(ring.len() as f64)
        };
        let other = R::new(self.other_objects([x, y]));
        let [cross, square] = RINGS.map(mean);
        let edge = mix(cross, square, (other + edges.clamped(x, y).0[0]).saturate());
        (edge + self.depth_deviation([x, y]) + other).saturate()
    }

    /// The share of the 3×3 that is of another object than the centre; 0 without ids.
    fn other_objects(&self, [x, y]: [i64; 2]) -> f64 {
        self.frame.object_id.as_ref().map_or(0.0, |ids| {
            let differs = |[i, j]: &&[i64; 2]| ids.clamped(x + i, y + j) != ids.clamped(x, y);
            RING.iter().filter(differs).count() as f64 / 9.0
        })
    }

    /// Pseudo-variances of depth in space and in time.
    fn depth_deviation(&self, p: [i64; 2]) -> R {
        let depths = RING.map(|[i, j]| self.relative_depth(self.depth(p[0] + i, p[1] + j)));
        let mean = depths.into_iter().fold(R::new(0.0), |sum, d| sum + d) / R::new(9.0);
        let nearest = depths.into_iter().fold(depths[0], R::min);
        let farthest = depths.into_iter().fold(depths[0], R::max);
        let range = (mean - nearest).min(farthest - mean);
        if range < R::new(0.002) {
            return R::new(0.0);
        }
        let now = (depths[0] - mean) / range;
        let before = self.depth_before(p).map_or(R::new(0.0), |d| (d - mean) / range);
        now * now + before * before * before * before
    }

    /// The previous depth in the texel that contains `q`; none where history is absent.
    fn depth_before(&self, p: [i64; 2]) -> Option<R> {
        let at = self.reproject(p)?;
        let [x, y] = containing(at.q);
        let depth = self
            .previous?
            .images
            .depth
            .as_ref()
            .expect("validated: the recipe needs depth");
        Some(self.relative_depth(depth_or_sky(depth.clamped(x, y))))
    }

    /// As a share of the far plane's distance.
    fn relative_depth(&self, z: f64) -> R {
        R::new((z / self.frame.finite_far()).min(1.0))
    }
}
