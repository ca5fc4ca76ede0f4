//! A perspective camera, asked both ways: which point a pixel sees at a depth, and where a point appears.

use crate::{image::Extent, sequence::manifest::Camera};
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

/// A camera on an image of given size. Does not care which way view space looks or how depth is mapped: it uses only
/// that clip w is the linear view depth.
#[derive(Clone, Debug)]
pub struct Projector {
    /// World to clip.
    world_to_clip: DMat4,
    view_to_world: DMat4,
    /// From `(clip x, clip y, clip w)` to view space.
    clip_to_view: DMat3,
    /// Where view space's origin lies in `(clip x, clip y, clip w)`; zero for all but sheared cameras.
    clip_origin: DVec3,
    size_px: DVec2,
}

impl Projector {
    /// None when the matrices cannot be inverted: an orthographic projection, or a singular one.
    pub fn new(camera: &Camera, render_size: Extent) -> Option<Self> {
        let view = DMat4::from_cols_array_2d(&camera.view).transpose();
        let projection = DMat4::from_cols_array_2d(&camera.projection).transpose();
        let rows = [projection.row(0), projection.row(1), projection.row(3)];
        let view_to_clip = DMat3::from_cols(rows[0].truncate(), rows[1].truncate(), rows[2].truncate()).transpose();
        let invertible = |determinant: f64| determinant.is_finite() && determinant.abs() > 1e-12;
        (invertible(view.determinant()) && invertible(view_to_clip.determinant())).then(|| Self {
            world_to_clip: projection * view,
            view_to_world: view.inverse(),
            clip_to_view: view_to_clip.inverse(),
            clip_origin: DVec3::new(rows[0].w, rows[1].w, rows[2].w),
            size_px: DVec2::new(f64::from(render_size.width), f64::from(render_size.height)),
        })
    }

    fn ndc(&self, position_px: DVec2) -> DVec2 {
        let uv = position_px / self.size_px;
        DVec2::new(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y)
    }

    /// The point in the world seen at `position_px` and linear view depth `z`.
    pub fn unproject(&self, position_px: DVec2, z: f64) -> DVec3 {
        let clip = (self.ndc(position_px) * z).extend(z);
        let view = self.clip_to_view * (clip - self.clip_origin);
        self.view_to_world.transform_point3(view)
    }

    /// Where a point of the world appears; none behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let clip: DVec4 = self.world_to_clip * point.extend(1.0);
        let ndc = DVec2::new(clip.x, clip.y) / clip.w;
        (clip.w > 0.0).then(|| DVec2::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y) * self.size_px)
    }

    /// Length of the ray through `position_px` per unit of linear view depth.
    pub fn ray_length(&self, position_px: DVec2) -> f64 {
        (self.clip_to_view * self.ndc(position_px).extend(1.0)).length()
    }

    /// How far a resting surface seen at `position_px` and depth `z` moves to where `previous` saw it, in pixels.
    /// NaN where that is behind `previous`: such a surface has no history.
    pub fn motion_px(&self, previous: &Self, position_px: DVec2, z: f64) -> DVec2 {
        previous
            .project(self.unproject(position_px, z))
            .map_or(DVec2::NAN, |previous_px| previous_px - position_px)
    }

    /// One over the depth at which a resting surface seen at `position_px` would move by `motion_px` to where `previous` saw it,
    /// by least squares over both axes. Says nothing where the camera only turned, which moves all depths alike.
    pub fn inverse_depth(&self, previous: &Self, position_px: DVec2, motion_px: DVec2) -> f64 {
        let origin = self.unproject(position_px, 0.0);
        let far = previous.world_to_clip * (self.unproject(position_px, 1.0) - origin).extend(0.0);
        let step = previous.world_to_clip * origin.extend(1.0);
        // (far + q step) shows at this ndc: an equation for q along each axis.
        let ndc = previous.ndc(position_px + motion_px);
        let off = (ndc * far.w - DVec2::new(far.x, far.y)) * self.size_px;
        let slope = (DVec2::new(step.x, step.y) - ndc * step.w) * self.size_px;
        off.dot(slope) / slope.length_squared()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sequence::manifest::FarPlane;

    pub const SIZE: Extent = Extent::new(64, 48);

    /// Looks along −z of view space, as OpenGL does; `x` is the camera's place, `yaw` its turn to the right.
    pub fn camera(x: f64, yaw: f64) -> Camera {
        let (s, c) = (libm::sin(yaw), libm::cos(yaw));
        let (n, f) = (0.1, 100.0);
        Camera {
            view: [
                [c, 0.0, s, -c * x],
                [0.0, 1.0, 0.0, -0.5],
                [-s, 0.0, c, s * x],
                [0.0, 0.0, 0.0, 1.0],
            ],
            projection: [
                [1.5, 0.0, 0.1, 0.0],
                [0.0, 2.0, 0.0, 0.0],
                [0.0, 0.0, -(f + n) / (f - n), -2.0 * f * n / (f - n)],
                [0.0, 0.0, -1.0, 0.0],
            ],
            near: Some(n),
            far: FarPlane::At(f),
        }
    }

    #[test]
    fn a_point_straight_ahead_is_where_it_should_be() {
        let projector = Projector::new(&camera(0.0, 0.0), SIZE).unwrap();
        // View-space (1, 1, −4): ndc = (1.5/4 − 0.1, 2/4), half the image is 32 × 24 px, y down.
        let position = projector.project(DVec3::new(1.0, 1.5, -4.0)).unwrap();
        assert!((position - DVec2::new(32.0 + 32.0 * 0.275, 24.0 - 24.0 * 0.5)).length() < 1e-12);
        assert!(projector.project(DVec3::new(1.0, 1.5, 4.0)).is_none());
    }

    #[test]
    fn unprojecting_inverts_projecting() {
        let projector = Projector::new(&camera(0.7, 0.3), SIZE).unwrap();
        for (position, z) in [((3.2, 40.1), 0.5), ((60.0, 1.0), 80.0)] {
            let position = DVec2::new(position.0, position.1);
            let back = projector.project(projector.unproject(position, z)).unwrap();
            assert!((back - position).length() < 1e-9);
        }
    }

    #[test]
    fn a_ray_is_one_long_on_the_axis_and_longer_beside_it() {
        let projector = Projector::new(&camera(0.7, 0.3), SIZE).unwrap();
        // The axis is at ndc (−0.1, 0).
        assert!((projector.ray_length(DVec2::new(32.0 - 3.2, 24.0)) - 1.0).abs() < 1e-12);
        // ndc (0.9, 1) is the direction (1/1.5, 1/2, 1).
        let expected = (1.0_f64 / 2.25 + 0.25 + 1.0).sqrt();
        assert!((projector.ray_length(DVec2::new(32.0 + 32.0 * 0.9, 0.0)) - expected).abs() < 1e-9);
    }

    #[test]
    fn a_point_behind_the_previous_camera_has_no_motion() {
        let current = Projector::new(&camera(0.0, 0.0), SIZE).unwrap();
        let previous = Projector::new(&camera(0.0, std::f64::consts::PI), SIZE).unwrap();
        assert!(current.motion_px(&previous, DVec2::new(32.0, 24.0), 5.0).is_nan());
    }

    #[test]
    fn depth_follows_from_motion() {
        let current = Projector::new(&camera(0.7, 0.3), SIZE).unwrap();
        let previous = Projector::new(&camera(0.5, 0.28), SIZE).unwrap();
        let position = DVec2::new(20.3, 11.8);
        for z in [0.4, 3.0, 70.0] {
            let motion = current.motion_px(&previous, position, z);
            let found = 1.0 / current.inverse_depth(&previous, position, motion);
            assert!((found / z - 1.0).abs() < 1e-6, "{found} is not {z}");
        }
    }

    #[test]
    fn an_orthographic_projection_is_refused() {
        let mut flat = camera(0.0, 0.0);
        flat.projection[3] = [0.0, 0.0, 0.0, 1.0];
        assert!(Projector::new(&flat, SIZE).is_none());
    }
}
