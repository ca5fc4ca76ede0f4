//! Shapes. Front faces are counter-clockwise; normals point out.

use super::model::{Mesh, Vertex};
use glam::{DMat4, DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// A vertex from f64.
pub fn vertex(position: DVec3, normal: DVec3, uv: DVec2) -> Vertex {
    Vertex {
        position: position.as_vec3().to_array(),
        normal: normal.as_vec3().to_array(),
        uv: uv.as_vec2().to_array(),
    }
}

impl Mesh {
    /// A grid of `columns` × `rows` quads over parameters in [0, 1]², with a point, normal and uv for each.
    pub fn grid(columns: u32, rows: u32, at: impl Fn(f64, f64) -> (DVec3, DVec3, DVec2)) -> Self {
        let mut mesh = Self::default();
        for row in 0..=rows {
            for column in 0..=columns {
                let (p, n, uv) = at(f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows));
                mesh.vertices.push(vertex(p, n, uv));
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let i = row * (columns + 1) + column;
                let below = i + columns + 1;
                mesh.indices.extend([i, i + 1, below + 1, i, below + 1, below]);
            }
        }
        mesh
    }

    /// A square in x and y from −0.5 to 0.5 that faces +z, u to the right and v down.
    pub fn quad() -> Self {
        Self::panel(1, DVec2::ONE)
    }

    /// The same as `n` × `n` quads, with texture coordinates up to `repeats`.
    pub fn panel(n: u32, repeats: DVec2) -> Self {
        Self::grid(n, n, |u, v| {
            // Rows run upwards, so that the quads face +z.
            (
                DVec3::new(u - 0.5, v - 0.5, 0.0),
                DVec3::Z,
                DVec2::new(u, 1.0 - v) * repeats,
            )
        })
    }

    /// A square in x and z from −0.5 to 0.5 that faces up.
    pub fn floor(n: u32, repeats: DVec2) -> Self {
        Self::panel(n, repeats).transformed(DMat4::from_rotation_x(-PI / 2.0))
    }

    /// A cube from −0.5 to 0.5, each face with the whole texture.
    pub fn cube() -> Self {
        let mut mesh = Self::default();
        let face = Self::quad().transformed(DMat4::from_translation(DVec3::Z * 0.5));
        for turn in 0..4 {
            mesh.append(&face, DMat4::from_rotation_y(f64::from(turn) * PI / 2.0));
        }
        mesh.append(&face, DMat4::from_rotation_x(-PI / 2.0));
        mesh.append(&face, DMat4::from_rotation_x(PI / 2.0));
        mesh
    }

    /// A ball of radius 0.5.
    pub fn sphere(columns: u32, rows: u32) -> Self {
        Self::grid(columns, rows, |u, v| {
            let (around, up) = (-u * TAU, (v - 0.5) * PI);
            let n = DVec3::new(
                libm::cos(up) * libm::sin(-around),
                libm::sin(up),
                libm::cos(up) * libm::cos(around),
            );
            (n * 0.5, n, DVec2::new(u, 1.0 - v))
        })
    }

    /// A tube along y from −0.5 to 0.5, of radius 0.5, open at its ends.
    pub fn tube(n_sides: u32) -> Self {
        Self::mantle(n_sides, 1.0)
    }

    fn mantle(n_sides: u32, top: f64) -> Self {
        Self::grid(n_sides, 1, |u, v| {
            let angle = u * TAU;
            let out = DVec3::new(libm::sin(angle), 0.0, libm::cos(angle));
            let radius = 0.5 * (1.0 + (top - 1.0) * v);
            let normal = (out + DVec3::Y * (0.5 * (1.0 - top))).normalize();
            (out * radius + DVec3::Y * (v - 0.5), normal, DVec2::new(u, 1.0 - v))
        })
    }

    /// The same of radius 0.5 below and `top` × 0.5 above, with lids.
    pub fn cone(n_sides: u32, top: f64) -> Self {
        let mut mesh = Self::mantle(n_sides, top);
        for (y, radius) in [(-0.5, 0.5), (0.5, 0.5 * top)] {
            let normal = DVec3::Y * libm::copysign(1.0, y);
            let first = mesh.vertices.len() as u32;
            mesh.vertices.push(vertex(DVec3::Y * y, normal, DVec2::splat(0.5)));
            for i in 0..n_sides {
                let angle = f64::from(i) * TAU / f64::from(n_sides);
                let rim = DVec3::new(libm::sin(angle), 0.0, libm::cos(angle)) * radius + DVec3::Y * y;
                mesh.vertices.push(vertex(rim, normal, DVec2::splat(0.5)));
            }
            for i in 0..n_sides {
                let (a, b) = (first + 1 + i, first + 1 + (i + 1) % n_sides);
                mesh.indices.extend(if y > 0.0 { [first, a, b] } else { [first, b, a] });
            }
        }
        mesh
    }

    /// A tube along y from −0.5 to 0.5, of radius 0.5.
    pub fn cylinder(n_sides: u32) -> Self {
        Self::cone(n_sides, 1.0)
    }

    /// A ring around y: `radius` to the middle of the tube, `tube` its own radius.
    pub fn torus(radius: f64, tube: f64, n_around: u32, n_sides: u32) -> Self {
        Self::grid(n_around, n_sides, |u, v| {
            let (around, across) = (u * TAU, v * TAU);
            let out = DVec3::new(libm::sin(around), 0.0, libm::cos(around));
            let normal = out * libm::cos(across) + DVec3::Y * libm::sin(across);
            (out * radius + normal * tube, normal, DVec2::new(u, v))
        })
    }

    /// A tube of `n_sides` along a path, its radius given at each of its points.
    pub fn along(path: &[DVec3], radius: impl Fn(f64) -> f64, n_sides: u32) -> Self {
        let n = path.len() - 1;
        let side = path[n] - path[0];
        let mut across = side.any_orthonormal_vector_or(DVec3::X);
        Self::grid_mut(n_sides, n as u32, |column, row| {
            let tangent = (path[(row + 1).min(n)] - path[row.max(1) - 1]).normalize_or(DVec3::Y);
            if column == 0 {
                // The frame is carried along, so that the tube does not twist.
                across = (across - tangent * across.dot(tangent)).normalize_or(tangent.any_orthonormal_vector());
            }
            let angle = column as f64 * TAU / f64::from(n_sides);
            let normal = across * libm::cos(angle) + tangent.cross(across) * libm::sin(angle);
            let t = row as f64 / n as f64;
            (path[row] + normal * radius(t), normal, DVec2::new(angle / TAU, t))
        })
    }

    fn grid_mut(columns: u32, rows: u32, mut at: impl FnMut(usize, usize) -> (DVec3, DVec3, DVec2)) -> Self {
        let mut mesh = Self::grid(columns, rows, |_, _| (DVec3::ZERO, DVec3::Z, DVec2::ZERO));
        let width = columns as usize + 1;
        for (i, corner) in mesh.vertices.iter_mut().enumerate() {
            let (p, n, uv) = at(i % width, i / width);
            *corner = vertex(p, n, uv);
        }
        mesh
    }

    /// Adds another mesh, transformed.
    pub fn append(&mut self, other: &Self, transform: DMat4) {
        let first = self.vertices.len() as u32;
        let normals = glam::DMat3::from_mat4(transform).inverse().transpose();
        self.vertices.extend(other.vertices.iter().map(|corner| {
            let position = transform.transform_point3(glam::Vec3::from(corner.position).as_dvec3());
            let normal = (normals * glam::Vec3::from(corner.normal).as_dvec3()).normalize_or(DVec3::Y);
            vertex(position, normal, glam::Vec2::from(corner.uv).as_dvec2())
        }));
        // A mirror turns triangles over.
        let mirrored = transform.determinant() < 0.0;
        self.indices
            .extend(other.indices.as_chunks::<3>().0.iter().flat_map(|&[a, b, c]| {
                let [b, c] = if mirrored { [c, b] } else { [b, c] };
                [first + a, first + b, first + c]
            }));
    }

    /// The mesh elsewhere.
    pub fn transformed(&self, transform: DMat4) -> Self {
        let mut mesh = Self::default();
        mesh.append(self, transform);
        mesh
    }
}

trait Across {
    fn any_orthonormal_vector_or(self, fallback: DVec3) -> DVec3;
}

impl Across for DVec3 {
    fn any_orthonormal_vector_or(self, fallback: DVec3) -> DVec3 {
        self.try_normalize()
            .map_or(fallback, |unit| unit.any_orthonormal_vector())
    }
}

/// A place, a size along each axis, and a turn about y.
pub fn placed(at: DVec3, scale: DVec3, yaw: f64) -> DMat4 {
    DMat4::from_translation(at) * DMat4::from_rotation_y(yaw) * DMat4::from_scale(scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of closed shapes around their origin, every triangle faces away from it, and so do its normals.
    #[test]
    fn faces_and_normals_point_out() {
        let mirrored = Mesh::cube().transformed(DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)));
        let shapes = [
            ("cube", Mesh::cube()),
            ("sphere", Mesh::sphere(12, 8)),
            ("cone", Mesh::cone(9, 0.4)),
            ("cylinder", Mesh::cylinder(7)),
            ("mirrored", mirrored),
        ];
        for (name, mesh) in shapes {
            for &[a, b, c] in mesh.indices.as_chunks::<3>().0 {
                let corner = |i: u32| glam::Vec3::from(mesh.vertices[i as usize].position).as_dvec3();
                let [p, q, r] = [a, b, c].map(corner);
                let face = (q - p).cross(r - p);
                if face.length() < 1e-6 {
                    continue;
                }
                let middle = (p + q + r) / 3.0;
                assert!(face.dot(middle) > 0.0, "{name}: {p} {q} {r}");
                for i in [a, b, c] {
                    let normal = glam::Vec3::from(mesh.vertices[i as usize].normal).as_dvec3();
                    assert!(normal.dot(face.normalize()) > 0.5, "{name}: {normal}");
                    assert!((normal.length() - 1.0).abs() < 1e-5, "{name}: {normal}");
                }
            }
        }
    }

    #[test]
    fn a_floor_faces_up_and_a_tube_out() {
        let floor = Mesh::floor(2, DVec2::ONE);
        let [a, b, c] = [0, 1, 2].map(|i| glam::Vec3::from(floor.vertices[floor.indices[i] as usize].position));
        assert!((b - a).cross(c - a).y > 0.0);
        let tube = Mesh::along(&[DVec3::ZERO, DVec3::Y, DVec3::Y * 2.0], |_| 0.3, 6);
        for &[a, b, c] in tube.indices.as_chunks::<3>().0 {
            let [p, q, r] = [a, b, c].map(|i| glam::Vec3::from(tube.vertices[i as usize].position).as_dvec3());
            let middle = (p + q + r) / 3.0;
            let out = DVec3::new(middle.x, 0.0, middle.z);
            assert!((q - p).cross(r - p).dot(out) > 0.0, "{p} {q} {r}");
        }
        let torus = Mesh::torus(1.0, 0.2, 12, 8);
        for &[a, b, c] in torus.indices.as_chunks::<3>().0 {
            let [p, q, r] = [a, b, c].map(|i| glam::Vec3::from(torus.vertices[i as usize].position).as_dvec3());
            let middle = (p + q + r) / 3.0;
            let ring = DVec3::new(middle.x, 0.0, middle.z).normalize();
            assert!((q - p).cross(r - p).dot(middle - ring) > 0.0, "{p} {q} {r}");
        }
    }
}
