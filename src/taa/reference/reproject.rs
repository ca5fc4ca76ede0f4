//! Where a pixel's surface was, and whether history can be trusted there: the twin of
//! `shaders/taa/temporal/reproject.wgsl`.

use super::{
    Pixels, Previous, RING,
    real::Real,
    sampling::{Position, containing},
};
use crate::{image::Image, sequence::frame::SKY_DEPTH, taa::recipe::Dilation};

/// A usable motion vector, in output pixels unless said otherwise.
#[derive(Clone, Copy, Default)]
pub struct Motion<R> {
    /// The texel whose vector it is.
    texel: [i64; 2],
    pub px: [R; 2],
    pub length_px: R,
}

/// Where history is.
#[derive(Clone, Copy)]
pub struct Reprojected<R> {
    /// Position in the previous frame.
    pub q: Position<R>,
    pub motion: Motion<R>,
}

impl<R: Real> Pixels<'_, R> {
    /// Where the surface at `p` was in the previous frame, unless history is absent there.
    pub fn reproject(&self, p: [i64; 2]) -> Option<Reprojected<R>> {
        if self.recipe.reproject {
            return self.reproject_by(p, self.motion(p)?);
        }
        self.previous.map(|_| Reprojected {
            q: p.map(|i| R::new(i as f64 + 0.5)),
            motion: Motion::default(),
        })
    }

    /// Where `motion` leads from `p`, unless history is absent there.
    pub fn reproject_by(&self, p: [i64; 2], motion: Motion<R>) -> Option<Reprojected<R>> {
        let previous = self.previous?;
        let centre = p.map(|i| R::new(i as f64 + 0.5));
        let q = [0, 1].map(|axis| centre[axis] + motion.px[axis]);
        let extent = self.sizes.output;
        let inside = |s: R, size: u32| s >= R::new(0.0) && s <= R::new(f64::from(size));
        (inside(q[0], extent.width)
            && inside(q[1], extent.height)
            && (!self.recipe.reject_depth || self.depth_fits(previous, motion.texel, q))
            && (!self.recipe.reject_id || self.id_fits(previous, p, q)))
        .then_some(Reprojected { q, motion })
    }

    /// Whether one of the four previous depths around `q` is that of the surface at `texel`.
    fn depth_fits(&self, previous: &Previous<R>, texel: [i64; 2], q: Position<R>) -> bool {
        let expected = self.depth(texel[0], texel[1]);
        let depth = previous
            .images
            .depth
            .as_ref()
            .expect("validated: the recipe needs depth");
        let [x, y] = self
            .input_position(q)
            .map(|s| (s - R::new(0.5)).floor().to_f64() as i64);
        let errors =
            [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (expected - depth_or_sky(depth.clamped(x + i, y + j))).abs());
        errors.into_iter().fold(f64::INFINITY, f64::min) <= self.recipe.reject_depth_tolerance * expected
    }

    /// Whether the texel that contains `q` was of the same object as the one under `p`.
    fn id_fits(&self, previous: &Previous<R>, p: [i64; 2], q: Position<R>) -> bool {
        let ids = |frame: &Option<Image<u32>>, [x, y]: [i64; 2]| {
            frame.as_ref().expect("validated: the recipe needs ids").clamped(x, y)
        };
        ids(&self.frame.object_id, self.input_texel(p))
            == ids(&previous.images.object_id, containing(self.input_position(q)))
    }

    /// The dilated motion of the output pixel `p`; none where the vector chosen is unusable.
    pub fn motion(&self, p: [i64; 2]) -> Option<Motion<R>> {
        let motion = self.dilated(self.input_texel(p), &RING)?;
        let px = [0, 1].map(|axis| motion.px[axis] * self.scale[axis]);
        Some(Motion {
            px,
            length_px: (px[0] * px[0] + px[1] * px[1]).sqrt(),
            ..motion
        })
    }

    /// The motion that dilation chooses among the texels at `offsets` from (x, y), in input pixels; none where that is
    /// unusable, or there are no offsets.
    pub fn dilated(&self, [x, y]: [i64; 2], offsets: &[[i64; 2]]) -> Option<Motion<R>> {
        let [i, j] = match self.recipe.dilation {
            Dilation::None => offsets.first().copied(),
            Dilation::Closest => first_largest(offsets, |[i, j]| -self.depth(x + i, y + j)),
            Dilation::Longest => first_largest(offsets, |[i, j]| {
                self.motion_at(x + i, y + j)
                    .map_or(0.0, |motion| motion.length_px.to_f64())
            }),
        }?;
        self.motion_at(x + i, y + j)
    }

    /// Linear view depth; what is not finite and positive is sky.
    pub fn depth(&self, x: i64, y: i64) -> f64 {
        let depth = self.depth_image.expect("validated: the recipe needs depth");
        depth_or_sky(depth.clamped(x, y))
    }

    /// The texel's own motion in input pixels; none where it is not finite or longer than four images.
    pub fn motion_at(&self, x: i64, y: i64) -> Option<Motion<R>> {
        let motion = self.motion_px.expect("validated: the recipe needs motion");
        let px = motion.clamped(x, y).map(f64::from);
        // In f64 no f32 overflows when squared; the comparison is false for NaN, too.
        let length = (px[0] * px[0] + px[1] * px[1]).sqrt();
        (length <= self.frame.longest_motion_px()).then(|| Motion {
            texel: [x, y],
            px: px.map(R::new),
            length_px: R::new(length),
        })
    }
}

/// What is not finite and positive is sky.
pub fn depth_or_sky(z: f32) -> f64 {
    f64::from(if z.is_finite() && z > 0.0 { z } else { SKY_DEPTH })
}

/// The first of `offsets` with the largest score.
fn first_largest(offsets: &[[i64; 2]], score: impl Fn([i64; 2]) -> f64) -> Option<[i64; 2]> {
    let mut best: Option<([i64; 2], f64)> = None;
    for &offset in offsets {
        let score = score(offset);
        if best.is_none_or(|(_, largest)| score > largest) {
            best = Some((offset, score));
        }
    }
    best.map(|(offset, _)| offset)
}
