//! Which objects the camera cannot see: their meshes' boxes are held against the sides of the image.

use super::{
    model::{Mesh, Scene},
    moment::Moment,
};
use crate::image::Extent;
use glam::{DMat4, DVec3, DVec4};

/// What is known of a scene's meshes.
pub(super) struct Culling {
    /// Smallest and largest corner of each mesh that does not move by itself.
    bounds: Vec<Option<[DVec3; 2]>>,
}

impl Culling {
    pub fn new(scene: &Scene) -> Self {
        Self {
            bounds: scene.meshes.iter().map(bounds).collect(),
        }
    }

    /// Whether each object may be within the image, with room for jitter beside it.
    pub fn seen(&self, scene: &Scene, moment: &Moment, extent: Extent) -> Vec<bool> {
        let beside = 1.0 + 4.0 / f64::from(extent.width.min(extent.height));
        let clip_from_world = moment.camera.from_world();
        let objects = scene.objects.iter().zip(&moment.objects);
        let seen = objects.map(|(object, [now, _])| {
            let bounds = self.bounds[object.mesh];
            bounds.is_none_or(|bounds| may_be_within(clip_from_world * *now, bounds, beside))
        });
        seen.collect()
    }
}

/// The smallest and the largest corner of a mesh; none where vertices move by themselves, or there are none.
fn bounds(mesh: &Mesh) -> Option<[DVec3; 2]> {
    let corners = mesh
        .vertices
        .iter()
        .map(|vertex| DVec3::from_array(vertex.position.map(f64::from)));
    let bounds = corners
        .map(|corner| [corner; 2])
        .reduce(|[low, high], [a, b]| [low.min(a), high.max(b)]);
    bounds.filter(|_| mesh.deform.is_none())
}

/// Whether a box may reach into the image, or `beside` times its half width and height around the middle: not where all of its
/// corners are beyond one side, or behind the camera.
fn may_be_within(clip_from_object: DMat4, [low, high]: [DVec3; 2], beside: f64) -> bool {
    let corners: [DVec4; 8] = std::array::from_fn(|i| {
        let axis = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        clip_from_object * DVec4::new(axis(0), axis(1), axis(2), 1.0)
    });
    let all = |is_beyond: &dyn Fn(&DVec4) -> bool| corners.iter().all(is_beyond);
    !(all(&|c| c.x > beside * c.w)
        || all(&|c| c.x < -beside * c.w)
        || all(&|c| c.y > beside * c.w)
        || all(&|c| c.y < -beside * c.w)
        || all(&|c| c.w < 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_beside_and_behind_are_not_within() {
        // Looks along −z with a field of view of 90°.
        let clip_from_view = DMat4::from_cols(
            DVec4::X,
            DVec4::Y,
            DVec4::new(0.0, 0.0, 0.0, -1.0),
            DVec4::new(0.0, 0.0, 0.1, 0.0),
        );
        let within = |center: [f64; 3], half: f64| {
            let center = DVec3::from_array(center);
            may_be_within(clip_from_view, [center - half, center + half], 1.0)
        };
        assert!(within([0.0, 0.0, -5.0], 1.0));
        assert!(within([5.5, 0.0, -5.0], 1.0), "reaches in from the side");
        assert!(!within([8.0, 0.0, -5.0], 1.0) && !within([0.0, -8.0, -5.0], 1.0));
        assert!(!within([0.0, 0.0, 5.0], 1.0), "behind");
        assert!(within([0.0, 0.0, 0.0], 1.0), "around the camera");
        assert!(within([0.0, 0.0, 5.0], 20.0), "a room that the camera is in");
    }
}
