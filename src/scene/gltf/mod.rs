//! Scenes of the user's own, from glTF 2.0: meshes, morph targets, skins, nodes, one animation, cameras, base materials. The
//! light is ours: a sun with shadows, and a sky.
//!
//! A frame lasts 1/30 s, as in every baked sequence, and frame 0 shows the animation one frame in, so that the frame before it has a
//! place too.

mod data;
mod look;
mod rig;
mod shape;
mod view;

pub use view::{CameraPath, Key, View};

use super::{
    folder::FPS,
    model::{Mesh, Placement, Scene, ShadowRegion},
};
use data::Data;
use glam::{DMat4, DVec3, Vec3};
use gltf::Node;
use look::Looks;
use rig::Rig;
use serde::Serialize;
use shape::{Shape, Skin};
use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
};
use view::Bounds;

/// Side of the sun's shadow map, texels.
const SHADOW_SIDE: u32 = 2048;
/// More corners than this are no scene for this rasteriser.
const MAX_VERTICES: usize = 20_000_000;

/// A glTF file that cannot be rendered.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct GltfError {
    /// The file, or the one with the camera's path.
    pub file: PathBuf,
    /// What is wrong, with the part of the file.
    pub problem: String,
}

/// A scene from a glTF file, and how it is seen.
#[derive(Clone, Debug, Serialize)]
pub struct GltfScene {
    #[serde(skip)]
    path: PathBuf,
    /// SHA-256 of the file and all that it refers to.
    pub sha256: String,
    /// The camera.
    pub camera: View,
    /// Which animation, by name or index; none for the first.
    pub animation: Option<String>,
    /// Whose it is, as the file says.
    #[serde(skip)]
    pub copyright: Option<String>,
    /// What the file held when it was opened: nothing is read a second time, so what is baked is what was hashed.
    #[serde(skip)]
    scene: Arc<Scene>,
}

impl GltfScene {
    /// Reads a file and checks that `n_frames` of it can be rendered. `camera` is a JSON file with a path, or the name of a
    /// camera; without, the file's first camera is taken, or one that circles the scene.
    ///
    /// # Errors
    /// Whatever would keep the scene from being rendered.
    pub fn open(
        path: &Path,
        camera: Option<&str>,
        animation: Option<&str>,
        n_frames: usize,
    ) -> Result<Self, GltfError> {
        let camera = match camera {
            None => View::Own,
            Some(text) => View::parse(text, n_frames).map_err(|problem| GltfError {
                file: text.into(),
                problem,
            })?,
        };
        let failed = |problem| GltfError {
            file: path.to_owned(),
            problem,
        };
        let data = Data::open(path).map_err(failed)?;
        Ok(Self {
            scene: Arc::new(assemble(&data, &camera, animation).map_err(failed)?),
            path: path.to_owned(),
            sha256: data.sha256(),
            camera,
            animation: animation.map(str::to_owned),
            copyright: data.document.as_json().asset.copyright.clone(),
        })
    }

    /// The file's name without its ending.
    pub fn name(&self) -> String {
        let name = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let plain = |c: char| {
            if c.is_ascii_alphanumeric() || "_.-".contains(c) {
                c
            } else {
                '-'
            }
        };
        name.chars().map(plain).collect()
    }

    /// The scene itself.
    pub(super) fn scene(&self) -> Arc<Scene> {
        Arc::clone(&self.scene)
    }
}

fn assemble(data: &Data, camera: &View, animation: Option<&str>) -> Result<Scene, String> {
    let rig = Arc::new(Rig::new(data, animation)?);
    let mut builder = Builder {
        data,
        rig: Arc::clone(&rig),
        scene: Scene::default(),
        looks: Looks::default(),
        meshes: HashMap::new(),
        n_vertices: 0,
    };
    let nodes: Vec<Node<'_>> = data.document.nodes().collect();
    for &index in &rig.order {
        builder
            .add(&nodes[index])
            .map_err(|error| format!("node {index}: {error}"))?;
    }
    let mut scene = builder.scene;
    let bounds = bounds(&scene).ok_or("has no triangles in its scene")?;
    let seen = view::camera(camera, data, &rig, bounds, seconds)?;
    (scene.camera, scene.cuts, scene.near) = (seen.camera, seen.cuts, seen.near);
    scene.shadows = Some(ShadowRegion {
        center: bounds.center,
        radius: bounds.radius,
        side: SHADOW_SIDE,
    });
    Ok(scene)
}

/// When frame `time` is in an animation.
fn seconds(time: f64) -> f64 {
    (time + 1.0) / f64::from(FPS)
}

struct Builder<'a> {
    data: &'a Data,
    rig: Arc<Rig>,
    scene: Scene,
    looks: Looks,
    /// Meshes that nothing bends, by mesh, primitive and whether they are mirrored.
    meshes: HashMap<(usize, usize, bool), usize>,
    n_vertices: usize,
}

impl Builder<'_> {
    fn add(&mut self, node: &Node<'_>) -> Result<(), String> {
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let skin = match node.skin() {
            Some(skin) => {
                let read = Skin::read(self.data, &skin);
                Some(Arc::new(
                    read.map_err(|error| format!("skin {}: {error}", skin.index()))?,
                ))
            }
            None => None,
        };
        for primitive in mesh.primitives() {
            self.add_primitive(node, &mesh, &primitive, skin.clone())
                .map_err(|error| format!("mesh {}, primitive {}: {error}", mesh.index(), primitive.index()))?;
        }
        Ok(())
    }

    fn add_primitive(
        &mut self,
        node: &Node<'_>,
        mesh: &gltf::Mesh<'_>,
        primitive: &gltf::Primitive<'_>,
        skin: Option<Arc<Skin>>,
    ) -> Result<(), String> {
        let is_mirrored = self.rig.world(node.index(), seconds(0.0)).determinant() < 0.0;
        let key = (mesh.index(), primitive.index(), is_mirrored);
        let known = self.meshes.get(&key).copied().filter(|_| skin.is_none());
        let (mesh, is_skinned) = match known {
            Some(known) => (known, false),
            None => {
                let material = primitive.material();
                let (set, matrix) = look::texture_coordinates(&material);
                let Some(shape) = Shape::read(self.data, primitive, set, matrix)? else {
                    return Ok(());
                };
                self.n_vertices += shape.vertices.len();
                if self.n_vertices > MAX_VERTICES {
                    return Err(format!("more than {MAX_VERTICES} vertices in all"));
                }
                let skin = skin.filter(|_| !shape.joints.is_empty());
                let n_joints = skin.as_ref().map_or(0, |skin| skin.n_joints());
                let mut joints = shape.joints.iter().flatten();
                if let Some((wrong, _)) = joints.find(|(joint, _)| skin.is_some() && *joint as usize >= n_joints) {
                    return Err(format!("has {n_joints} joints and refers to joint {wrong}"));
                }
                let is_skinned = skin.is_some();
                let is_bent = is_skinned || !shape.targets.is_empty();
                let mesh = match (is_bent, is_mirrored) {
                    (true, _) => shape.bent(Arc::clone(&self.rig), node.index(), skin, seconds),
                    (false, true) => shape.mirrored(),
                    (false, false) => shape.still(),
                };
                let index = self.scene.mesh(mesh);
                if !is_bent {
                    self.meshes.insert(key, index);
                }
                (index, is_skinned)
            }
        };
        let material = self.looks.material(self.data, &mut self.scene, &primitive.material())?;
        let placement = self.placement(node.index(), is_skinned);
        self.scene.add(mesh, material, [1.0; 4], placement);
        Ok(())
    }

    /// A skin puts its mesh where its joints are, wherever its node is.
    fn placement(&self, node: usize, is_skinned: bool) -> Placement {
        if is_skinned {
            return Placement::Fixed(DMat4::IDENTITY);
        }
        if !self.rig.moves(node) {
            return Placement::Fixed(self.rig.world(node, seconds(0.0)));
        }
        let rig = Arc::clone(&self.rig);
        Placement::Moving(Box::new(move |time| rig.world(node, seconds(time))))
    }
}

/// A ball around everything in frame 0; none where there is nothing.
fn bounds(scene: &Scene) -> Option<Bounds> {
    let mut corners = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for object in &scene.objects {
        let Mesh { vertices, deform, .. } = &scene.meshes[object.mesh];
        let bent = deform.as_ref().map(|deform| deform(0.0, vertices));
        let world = object.placement.at(0.0);
        for vertex in bent.as_ref().unwrap_or(vertices) {
            let at = world.transform_point3(Vec3::from(vertex.position).as_dvec3());
            corners = [corners[0].min(at), corners[1].max(at)];
        }
    }
    let [low, high] = corners;
    let radius = 0.5 * (high - low).length();
    radius.is_finite().then(|| Bounds {
        center: 0.5 * (low + high),
        radius: radius.max(1e-6),
    })
}
