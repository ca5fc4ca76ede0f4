//! Where a glTF scene is seen from: a path of the user's, a camera of the file's, or around it.

use super::{
    data::Data,
    rig::{self, Rig},
};
use crate::scene::model::{Camera, Pose, looking};
use glam::{DMat4, DVec3};
use gltf::camera::Projection;
use serde::{Deserialize, Serialize};
use std::{fs, path::Path, sync::Arc};

/// Opening of the camera where nothing says otherwise.
const FOV_Y_DEGREES: f64 = 45.0;

/// Which camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// The file's first camera, or around the scene where it has none.
    Own,
    /// One of the file's cameras, by the name of its node or its own.
    Named(String),
    /// Given from outside.
    Path(CameraPath),
}

/// A camera by frames: straight from key to key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Vertical opening, degrees.
    pub fov_y_degrees: f64,
    /// Rising by frame. A single key is a camera that stands still.
    pub keys: Vec<Key>,
    /// Frames at which another shot begins; each shot has keys of its own.
    #[serde(default)]
    pub cuts: Vec<usize>,
}

/// A camera at one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// Which; may lie between two.
    pub frame: f64,
    /// Where it is.
    pub eye: [f64; 3],
    /// What it looks at.
    pub target: [f64; 3],
}

impl View {
    /// A path where `text` names a JSON file, else the name of a camera.
    pub fn parse(text: &str, n_frames: usize) -> Result<Self, String> {
        let path = Path::new(text);
        if !path
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
        {
            return Ok(Self::Named(text.to_owned()));
        }
        let content = fs::read_to_string(path).map_err(|error| error.to_string())?;
        let path: CameraPath = serde_json::from_str(&content).map_err(|error| error.to_string())?;
        path.check(n_frames)?;
        Ok(Self::Path(path))
    }
}

impl CameraPath {
    /// Whether every frame has a place.
    fn check(&self, n_frames: usize) -> Result<(), String> {
        if !(1.0..=170.0).contains(&self.fov_y_degrees) {
            return Err(format!("fov_y_degrees: must be 1 to 170, not {}", self.fov_y_degrees));
        }
        for (i, key) in self.keys.iter().enumerate() {
            let [eye, target] = [key.eye, key.target].map(DVec3::from_array);
            let sight = target - eye;
            if !(key.frame.is_finite() && sight.is_finite() && sight.length() > 0.0) {
                return Err(format!("keys[{i}]: needs a frame, and an eye apart from its target"));
            }
            if sight.cross(DVec3::Y).length() < 1e-6 * sight.length() {
                return Err(format!(
                    "keys[{i}]: looks straight up or down, where there is no upright"
                ));
            }
            if i > 0 && self.keys[i - 1].frame >= key.frame {
                return Err(format!("keys[{i}].frame: must be after the key before"));
            }
        }
        if self.cuts.windows(2).any(|pair| pair[0] >= pair[1]) || self.cuts.first() == Some(&0) {
            return Err("cuts: must rise, and be after the first frame".to_owned());
        }
        for shot in 0..=self.cuts.len() {
            let (first, end) = self.span(shot, n_frames);
            let keys = self.shot(shot);
            let Some(last) = keys.last() else {
                return Err(format!("keys: there is none for the shot that begins at frame {first}"));
            };
            if keys.len() > 1 && last.frame < (end - 1) as f64 {
                return Err(format!(
                    "keys: the last of a shot is at frame {}, and its last frame is {}; add keys, or bake fewer frames",
                    last.frame,
                    end - 1
                ));
            }
            if keys[0].frame > first as f64 && keys.len() > 1 {
                return Err(format!(
                    "keys: the shot begins at frame {first}, and its keys at {}",
                    keys[0].frame
                ));
            }
        }
        Ok(())
    }

    /// First frame of a shot, and the one after its last.
    fn span(&self, shot: usize, n_frames: usize) -> (usize, usize) {
        let first = if shot == 0 { 0 } else { self.cuts[shot - 1] };
        (first, self.cuts.get(shot).map_or(n_frames, |cut| (*cut).min(n_frames)))
    }

    fn shot(&self, shot: usize) -> &[Key] {
        let after = |cut: usize| self.keys.partition_point(|key| key.frame < cut as f64);
        let first = if shot == 0 { 0 } else { after(self.cuts[shot - 1]) };
        let end = self.cuts.get(shot).map_or(self.keys.len(), |cut| after(*cut));
        &self.keys[first..end]
    }

    /// The camera at `time`; the frame before the first goes on as the first two keys do.
    fn pose(&self, time: f64, shot: usize) -> Pose {
        let keys = self.shot(shot);
        let [a, b] = match keys.partition_point(|key| key.frame <= time) {
            _ if keys.len() == 1 => [keys[0]; 2],
            0 => [keys[0], keys[1]],
            after => {
                let after = after.min(keys.len() - 1);
                [keys[after - 1], keys[after]]
            }
        };
        let t = match b.frame > a.frame {
            true => (time - a.frame) / (b.frame - a.frame),
            false => 0.0,
        };
        let between = |a: [f64; 3], b: [f64; 3]| DVec3::from_array(a).lerp(DVec3::from_array(b), t);
        Pose::look(between(a.eye, b.eye), between(a.target, b.target), self.fov_y_degrees)
    }
}

/// A ball around a scene.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub center: DVec3,
    pub radius: f64,
}

/// A camera with its cuts and its nearest distance.
pub struct Seen {
    pub camera: Camera,
    pub cuts: Vec<usize>,
    pub near: f64,
}

/// The camera that `view` names.
pub fn camera(
    view: &View,
    data: &Data,
    rig: &Arc<Rig>,
    bounds: Bounds,
    seconds: fn(f64) -> f64,
) -> Result<Seen, String> {
    let cameras = rig::cameras(data, rig);
    let near = 1e-3 * bounds.radius;
    let seen = |camera| Seen {
        camera,
        cuts: Vec::new(),
        near,
    };
    let node = match view {
        View::Path(path) => {
            let path = path.clone();
            return Ok(Seen {
                cuts: path.cuts.clone(),
                ..seen(Box::new(move |time, shot| path.pose(time, shot)))
            });
        }
        View::Named(name) => *cameras.get(name).ok_or_else(|| {
            let names: Vec<_> = cameras.keys().map(|name| format!("`{name}`")).collect();
            format!("has no camera `{name}`; there are: {}", names.join(", "))
        })?,
        View::Own => match cameras.values().min() {
            Some(node) => *node,
            None => return Ok(seen(Box::new(move |time, _| around(bounds, time)))),
        },
    };
    let of_node = data.document.nodes().nth(node);
    let camera = of_node.as_ref().and_then(gltf::Node::camera);
    let projection = camera.as_ref().map(gltf::Camera::projection);
    let Some(Projection::Perspective(lens)) = projection else {
        return Err(format!(
            "the camera of node {node} has no perspective; only such can be rendered"
        ));
    };
    let fov_y = f64::from(lens.yfov());
    if !(0.01..3.0).contains(&fov_y) {
        return Err(format!(
            "the camera of node {node} opens by {fov_y} radians; must be 0.01 to 3"
        ));
    }
    let rig = Arc::clone(rig);
    Ok(Seen {
        near: f64::from(lens.znear()).max(1e-6 * bounds.radius),
        ..seen(Box::new(move |time, _| Pose {
            view: view_of(rig.world(node, seconds(time))),
            fov_y,
        }))
    })
}

/// World to view of a camera's node, whatever its scale.
fn view_of(world: DMat4) -> DMat4 {
    let eye = world.transform_point3(DVec3::ZERO);
    let [up, back] = [DVec3::Y, DVec3::Z].map(|axis| world.transform_vector3(axis));
    looking(eye, eye - back, up)
}

/// All of the scene, a degree further in each frame.
fn around(bounds: Bounds, time: f64) -> Pose {
    let distance = 1.1 * bounds.radius / libm::sin(0.5 * FOV_Y_DEGREES.to_radians());
    let (angle, height) = ((30.0 + time).to_radians(), 20_f64.to_radians());
    let out = DVec3::new(
        libm::sin(angle) * libm::cos(height),
        libm::sin(height),
        libm::cos(angle) * libm::cos(height),
    );
    Pose::look(bounds.center + distance * out, bounds.center, FOV_Y_DEGREES)
}
