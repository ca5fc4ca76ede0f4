//! Primitives as meshes, and what bends them: morph targets, then skins.

use super::{data::Data, rig::Rig};
use crate::scene::model::{Mesh, Vertex};
use glam::{DMat3, DMat4, DVec3, Mat3, Vec2, Vec3};
use gltf::{Primitive, Semantic, accessor::Dimensions, mesh::Mode};
use std::sync::Arc;

/// More corners than this in one primitive are taken for a mistake.
const MAX_CORNERS: usize = 1 << 26;

/// A primitive as it was read.
pub struct Shape {
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
    /// What each morph target adds to positions and normals.
    pub targets: Vec<Vec<[Vec3; 2]>>,
    /// Joints of the skin and their shares, for each vertex; empty without.
    pub joints: Vec<Vec<(u32, f64)>>,
}

/// Places a texture: applied to texture coordinates.
pub type TextureMatrix = Mat3;

impl Shape {
    /// Reads a primitive with one set of texture coordinates. None where it has no triangles.
    pub fn read(
        data: &Data,
        primitive: &Primitive<'_>,
        set: u32,
        matrix: TextureMatrix,
    ) -> Result<Option<Self>, String> {
        let positions = primitive.get(&Semantic::Positions).ok_or("has no positions")?;
        let positions = vectors(data, &positions)?;
        let n = positions.len();
        let normals = match primitive.get(&Semantic::Normals) {
            Some(accessor) => Some(of_length(n, "normals", vectors(data, &accessor)?)?),
            None => None,
        };
        let uvs = match primitive.get(&Semantic::TexCoords(set)) {
            Some(accessor) => of_length(n, "texture coordinates", pairs(data, &accessor)?)?,
            None => vec![Vec2::ZERO; n],
        };
        let Some(indices) = triangles(data, primitive, n)? else {
            return Ok(None);
        };
        let mut shape = Self {
            vertices: (0..n)
                .map(|i| Vertex {
                    position: positions[i].to_array(),
                    normal: normals.as_ref().map_or([0.0; 3], |normals| normals[i].to_array()),
                    uv: matrix.transform_point2(uvs[i]).to_array(),
                })
                .collect(),
            indices,
            targets: targets(data, primitive, n)?,
            joints: joints(data, primitive, n)?,
        };
        if normals.is_none() {
            shape.flatten();
        }
        Ok(Some(shape))
    }

    /// Gives every triangle corners and a normal of its own.
    fn flatten(&mut self) {
        let pick = |i: &u32| *i as usize;
        self.targets
            .iter_mut()
            .for_each(|target| *target = self.indices.iter().map(|i| target[pick(i)]).collect());
        if !self.joints.is_empty() {
            self.joints = self.indices.iter().map(|i| self.joints[pick(i)].clone()).collect();
        }
        self.vertices = self.indices.iter().map(|i| self.vertices[pick(i)]).collect();
        for triangle in self.vertices.as_chunks_mut::<3>().0 {
            let [a, b, c] = triangle.each_ref().map(|vertex| Vec3::from(vertex.position));
            let normal = (b - a).cross(c - a).normalize_or(Vec3::Y).to_array();
            triangle.iter_mut().for_each(|vertex| vertex.normal = normal);
        }
        self.indices = (0..self.vertices.len() as u32).collect();
    }

    /// Turned inside out, for a place that mirrors: there it shows its front again.
    pub fn mirrored(&self) -> Mesh {
        let flip = |vertex: &Vertex| Vertex {
            normal: vertex.normal.map(|c| -c),
            ..*vertex
        };
        Mesh {
            vertices: self.vertices.iter().map(flip).collect(),
            indices: self
                .indices
                .as_chunks()
                .0
                .iter()
                .flat_map(|[a, b, c]| [*a, *c, *b])
                .collect(),
            deform: None,
        }
    }

    /// As it is.
    pub fn still(&self) -> Mesh {
        Mesh {
            vertices: self.vertices.clone(),
            indices: self.indices.clone(),
            deform: None,
        }
    }

    /// Bent by the weights of a node, and by a skin into world space where it has one.
    pub fn bent(self, rig: Arc<Rig>, node: usize, skin: Option<Arc<Skin>>, seconds: fn(f64) -> f64) -> Mesh {
        let Self {
            vertices,
            indices,
            targets,
            joints,
        } = self;
        let deform = move |time: f64, vertices: &[Vertex]| {
            let seconds = seconds(time);
            let weights = rig.weights(node, seconds);
            let matrices = skin.as_ref().map(|skin| skin.matrices(&rig, seconds));
            let bend = |(i, vertex): (usize, &Vertex)| {
                let [mut position, mut normal] = [vertex.position, vertex.normal].map(|v| Vec3::from(v).as_dvec3());
                for (target, weight) in targets.iter().zip(&weights) {
                    position += *weight * target[i][0].as_dvec3();
                    normal += *weight * target[i][1].as_dvec3();
                }
                if let (Some(matrices), Some(joints)) = (&matrices, joints.get(i)) {
                    let blended = joints.iter().fold(DMat4::ZERO, |sum, (joint, weight)| {
                        sum + matrices[*joint as usize] * *weight
                    });
                    position = blended.transform_point3(position);
                    normal = cofactor(DMat3::from_mat4(blended)) * normal;
                }
                Vertex {
                    position: position.as_vec3().to_array(),
                    normal: normal.normalize_or(DVec3::Y).as_vec3().to_array(),
                    uv: vertex.uv,
                }
            };
            vertices.iter().enumerate().map(bend).collect()
        };
        Mesh {
            vertices,
            indices,
            deform: Some(Box::new(deform)),
        }
    }
}

/// What normals are multiplied by; right for every scaling, and needs no inverse.
fn cofactor(m: DMat3) -> DMat3 {
    DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    )
}

/// Bones: nodes, and the mesh's place as each of them sees it.
pub struct Skin {
    joints: Vec<(usize, DMat4)>,
}

impl Skin {
    pub fn read(data: &Data, skin: &gltf::Skin<'_>) -> Result<Self, String> {
        let nodes: Vec<usize> = skin.joints().map(|joint| joint.index()).collect();
        let inverse = match skin.inverse_bind_matrices() {
            Some(accessor) => data.numbers(&accessor, Dimensions::Mat4)?,
            None => nodes
                .iter()
                .flat_map(|_| glam::Mat4::IDENTITY.to_cols_array())
                .collect(),
        };
        if inverse.len() < 16 * nodes.len() {
            return Err(format!(
                "has {} joints and {} matrices",
                nodes.len(),
                inverse.len() / 16
            ));
        }
        let matrices = inverse.as_chunks::<16>().0.iter();
        let matrices = matrices.map(|columns| DMat4::from_cols_array(&columns.map(f64::from)));
        Ok(Self {
            joints: nodes.into_iter().zip(matrices).collect(),
        })
    }

    pub fn n_joints(&self) -> usize {
        self.joints.len()
    }

    fn matrices(&self, rig: &Rig, seconds: f64) -> Vec<DMat4> {
        let matrix = |(node, inverse): &(usize, DMat4)| rig.world(*node, seconds) * *inverse;
        self.joints.iter().map(matrix).collect()
    }
}

fn vectors(data: &Data, accessor: &gltf::Accessor<'_>) -> Result<Vec<Vec3>, String> {
    let numbers = data.numbers(accessor, Dimensions::Vec3)?;
    Ok(numbers.as_chunks().0.iter().map(|v| Vec3::from_array(*v)).collect())
}

fn pairs(data: &Data, accessor: &gltf::Accessor<'_>) -> Result<Vec<Vec2>, String> {
    let numbers = data.numbers(accessor, Dimensions::Vec2)?;
    Ok(numbers.as_chunks().0.iter().map(|v| Vec2::from_array(*v)).collect())
}

fn of_length<T>(n: usize, what: &str, found: Vec<T>) -> Result<Vec<T>, String> {
    match found.len() == n {
        true => Ok(found),
        false => Err(format!("has {n} positions and {} {what}", found.len())),
    }
}

/// Corners of triangles; none of points and lines.
fn triangles(data: &Data, primitive: &Primitive<'_>, n_vertices: usize) -> Result<Option<Vec<u32>>, String> {
    let corners = match primitive.indices() {
        Some(accessor) => data.integers(&accessor, Dimensions::Scalar)?,
        None => (0..n_vertices as u32).collect(),
    };
    if let Some(wrong) = corners.iter().find(|index| **index as usize >= n_vertices) {
        return Err(format!("has {n_vertices} vertices and refers to vertex {wrong}"));
    }
    if corners.len() > MAX_CORNERS {
        return Err(format!("has {} corners, more than any model", corners.len()));
    }
    let indices: Vec<u32> = match primitive.mode() {
        Mode::Triangles => corners[..corners.len() / 3 * 3].to_vec(),
        // Every other triangle of a strip is turned, so that all show the same side.
        Mode::TriangleStrip => corners
            .windows(3)
            .enumerate()
            .flat_map(|(i, corner)| match i % 2 {
                0 => [corner[0], corner[1], corner[2]],
                _ => [corner[0], corner[2], corner[1]],
            })
            .collect(),
        Mode::TriangleFan => corners
            .windows(2)
            .skip(1)
            .flat_map(|corner| [corners[0], corner[0], corner[1]])
            .collect(),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => return Ok(None),
    };
    Ok(Some(indices).filter(|indices| !indices.is_empty()))
}

fn targets(data: &Data, primitive: &Primitive<'_>, n: usize) -> Result<Vec<Vec<[Vec3; 2]>>, String> {
    let read = |target: gltf::mesh::MorphTarget<'_>| {
        let part = |accessor: Option<gltf::Accessor<'_>>| match accessor {
            Some(accessor) => of_length(n, "of a morph target", vectors(data, &accessor)?),
            None => Ok(vec![Vec3::ZERO; n]),
        };
        let (positions, normals) = (part(target.positions())?, part(target.normals())?);
        Ok(positions.into_iter().zip(normals).map(|(p, n)| [p, n]).collect())
    };
    primitive.morph_targets().map(read).collect()
}

/// All sets of joints and weights, as shares that sum to one.
fn joints(data: &Data, primitive: &Primitive<'_>, n: usize) -> Result<Vec<Vec<(u32, f64)>>, String> {
    let mut found = Vec::new();
    for set in 0.. {
        let semantics = [Semantic::Joints(set), Semantic::Weights(set)];
        let [Some(joints), Some(weights)] = semantics.map(|semantic| primitive.get(&semantic)) else {
            break;
        };
        let joints = of_length(4 * n, "joints", data.integers(&joints, Dimensions::Vec4)?)?;
        let weights = of_length(4 * n, "weights", data.numbers(&weights, Dimensions::Vec4)?)?;
        found.resize_with(n, Vec::new);
        for (i, (joint, weight)) in joints.into_iter().zip(weights).enumerate() {
            if weight > 0.0 {
                found[i / 4].push((joint, f64::from(weight)));
            }
        }
    }
    for shares in &mut found {
        let sum: f64 = shares.iter().map(|(_, weight)| weight).sum();
        shares.iter_mut().for_each(|(_, weight)| *weight /= sum);
    }
    if let Some(bare) = found.iter().position(Vec::is_empty) {
        return Err(format!("vertex {bare} follows no joint"));
    }
    Ok(found)
}
