//! A scene at one frame, as numbers for the device: matrices of now and of the frame before, light, rays.

use super::model::{Lighting, Pose, Scene, looking};
use glam::{DMat3, DMat4, DVec3, DVec4};

/// A scene at one frame.
pub(super) struct Moment {
    /// World to clip, and view to clip, without jitter.
    pub camera: Clip,
    pub previous_camera: Clip,
    /// World from object, now and in the frame before.
    pub objects: Vec<[DMat4; 2]>,
    pub lighting: Lighting,
    pub shadow_from_world: DMat4,
}

/// A camera as matrices.
#[derive(Clone, Copy, Debug)]
pub struct Clip {
    /// World to view; view space looks along −z.
    pub view: DMat4,
    /// View to clip, y up. Depth is reversed without a far plane: clip z is the near distance, clip w the view depth.
    pub projection: DMat4,
}

impl Clip {
    fn new(pose: Pose, near: f64, aspect: f64) -> Self {
        let half = 0.5 * pose.fov_y;
        let focal = libm::cos(half) / libm::sin(half);
        Self {
            view: pose.view,
            projection: DMat4::from_cols(
                DVec4::new(focal / aspect, 0.0, 0.0, 0.0),
                DVec4::new(0.0, focal, 0.0, 0.0),
                DVec4::new(0.0, 0.0, 0.0, -1.0),
                DVec4::new(0.0, 0.0, near, 0.0),
            ),
        }
    }

    /// World to clip.
    pub fn from_world(&self) -> DMat4 {
        self.projection * self.view
    }

    /// From a direction, as if its end were infinitely far.
    pub fn from_direction(&self) -> DMat4 {
        self.projection * DMat4::from_mat3(DMat3::from_mat4(self.view))
    }

    /// World directions of the axis, one long in depth, and of one unit of ndc x and y.
    pub fn rays(&self) -> [DVec3; 3] {
        let world_from_view = DMat3::from_mat4(self.view).transpose();
        [
            world_from_view * DVec3::NEG_Z,
            world_from_view * DVec3::X / self.projection.x_axis.x,
            world_from_view * DVec3::Y / self.projection.y_axis.y,
        ]
    }

    /// The camera's place in the world.
    pub fn eye(&self) -> DVec3 {
        self.view.inverse().transform_point3(DVec3::ZERO)
    }
}

impl Moment {
    /// The scene at frame `times[0]`, and at `times[1]` before it. That is of the same shot, so that motion goes on through a cut.
    pub fn new(scene: &Scene, times: [f64; 2], aspect: f64) -> Self {
        let [time, before] = times;
        let shot = scene.shot(time as usize);
        let camera = |time| Clip::new((scene.camera)(time, shot), scene.near, aspect);
        let lighting = (scene.lighting)(time);
        let shadow_from_world = scene.shadows.map_or(DMat4::IDENTITY, |region| {
            let radius = region.radius;
            let direction = lighting.sun_direction.normalize();
            let up = if direction.y.abs() > 0.9 { DVec3::X } else { DVec3::Y };
            let view = looking(region.center + direction * radius, region.center, up);
            // Depth 0 to 1 through the ball, from the sun.
            DMat4::from_scale(DVec3::new(1.0 / radius, 1.0 / radius, -0.5 / radius)) * view
        });
        Self {
            camera: camera(time),
            previous_camera: camera(before),
            objects: scene
                .objects
                .iter()
                .map(|object| times.map(|time| object.placement.at(time)))
                .collect(),
            lighting,
            shadow_from_world,
        }
    }
}
