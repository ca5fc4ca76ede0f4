//! Textures and shapes that several scenes use.

use crate::{
    random::{Random, lattice},
    scene::{
        model::{Alpha, Material, Mesh, Scene},
        texture::{Mips, Texel, blend, fractal_noise},
    },
};
use glam::{DMat4, DVec2, DVec3};

/// Side of textures, texels.
pub const SIDE: u32 = 512;

/// Bricks in mortar, eight courses high.
pub fn bricks(seed: u64) -> Mips {
    Mips::paint(SIDE, move |u, v| {
        let row = libm::floor(v * 8.0);
        let shift = 0.5 * row.rem_euclid(2.0);
        let (x, y) = ((u * 4.0 + shift).rem_euclid(4.0), (v * 8.0).rem_euclid(1.0));
        let (fx, column) = (x.rem_euclid(1.0), libm::floor(x));
        let grain = fractal_noise(u, v, 32, 3, seed);
        if !(0.03..0.97).contains(&fx) || !(0.07..0.93).contains(&y) {
            return blend([0.45, 0.43, 0.4], [0.6, 0.58, 0.55], grain);
        }
        let tone = lattice(column as i64, row as i64, seed);
        let [r, g, b, _] = blend([0.42, 0.13, 0.08], [0.62, 0.28, 0.16], tone);
        let shade = (0.75 + 0.5 * grain) as f32;
        [r * shade, g * shade, b * shade, 1.0]
    })
}

/// Square tiles of two tones with dark joints, `n` along a side, veined like marble.
pub fn tiles(n: u32, light: [f32; 3], dark: [f32; 3], seed: u64) -> Mips {
    Mips::paint(SIDE, move |u, v| {
        let (x, y) = (u * f64::from(n), v * f64::from(n));
        let (fx, fy) = (x.rem_euclid(1.0), y.rem_euclid(1.0));
        if fx < 0.03 || fy < 0.03 {
            return [0.08, 0.08, 0.08, 1.0];
        }
        let odd = (libm::floor(x) + libm::floor(y)).rem_euclid(2.0) > 0.5;
        let vein = libm::fabs(2.0 * fractal_noise(u, v, 8, 4, seed) - 1.0);
        let base = if odd { dark } else { light };
        blend(base.map(|c| c * 0.6), base, libm::sqrt(vein) * 1.6)
    })
}

/// Plaster or stone: a tone with grain.
pub fn plaster(color: [f32; 3], contrast: f64, seed: u64) -> Mips {
    Mips::paint(SIDE, move |u, v| {
        let grain = fractal_noise(u, v, 16, 5, seed) - 0.5;
        let k = (1.0 + 2.0 * contrast * grain) as f32;
        [color[0] * k, color[1] * k, color[2] * k, 1.0]
    })
}

/// Boards along u.
pub fn wood(n_boards: u32, seed: u64) -> Mips {
    Mips::paint(SIDE, move |u, v| {
        let y = v * f64::from(n_boards);
        let board = libm::floor(y);
        if (y - board) < 0.04 {
            return [0.04, 0.025, 0.015, 1.0];
        }
        let tone = lattice(board as i64, 7, seed);
        let ring = fractal_noise(u, v * 0.5 + tone, 4, 3, seed) * 14.0;
        let grain = 0.5 + 0.5 * libm::sin(ring + y * 9.0);
        let [r, g, b, _] = blend([0.28, 0.15, 0.07], [0.5, 0.3, 0.15], 0.6 * grain + 0.4 * tone);
        [r, g, b, 1.0]
    })
}

/// Squares of two colours, `n` along a side.
pub fn checker(n: u32, light: [f32; 3], dark: [f32; 3]) -> Mips {
    Mips::paint(SIDE, move |u, v| {
        let odd = (libm::floor(u * f64::from(n)) + libm::floor(v * f64::from(n))).rem_euclid(2.0) > 0.5;
        blend(light, dark, if odd { 1.0 } else { 0.0 })
    })
}

/// Grass and earth.
pub fn ground(seed: u64) -> Mips {
    Mips::paint(SIDE, move |u, v| {
        let patch = fractal_noise(u, v, 4, 4, seed);
        let blade = fractal_noise(u, v, 128, 2, seed + 1);
        let [r, g, b, _] = blend([0.16, 0.12, 0.07], [0.12, 0.24, 0.05], 3.0 * patch - 1.0);
        let k = (0.5 + blade) as f32;
        [r * k, g * k, b * k, 1.0]
    })
}

/// A spray of pointed leaves on stems, with holes between: alpha is coverage.
pub fn leaves(n_leaves: usize, color: [f32; 3], seed: u64) -> Mips {
    let mut random = Random::new(seed);
    let shapes: Vec<(DVec2, f64, f64, f64)> = (0..n_leaves)
        .map(|_| {
            let at = DVec2::new(random.between(0.15, 0.85), random.between(0.12, 0.85));
            (
                at,
                random.between(0.0, std::f64::consts::TAU),
                random.between(0.07, 0.13),
                random.unit(),
            )
        })
        .collect();
    Mips::paint(SIDE / 2, move |u, v| {
        let mut texel: Texel = [color[0], color[1], color[2], 0.0];
        for &(at, turn, length, tone) in &shapes {
            let d = DVec2::new(u, v) - at;
            let (s, c) = (libm::sin(turn), libm::cos(turn));
            let (along, across) = ((d.x * c + d.y * s) / length, (d.y * c - d.x * s) / length);
            let half_width = 0.42 * (1.0 - along * along);
            if along.abs() < 1.0 && across.abs() < half_width {
                let vein = if across.abs() < 0.035 { 1.35 } else { 1.0 };
                let k = (vein * (0.55 + 0.7 * tone)) as f32;
                texel = [color[0] * k, color[1] * k, color[2] * k, 1.0];
            }
        }
        texel
    })
}

impl Scene {
    /// Adds a matt material with a texture.
    pub fn matt(&mut self, texture: Mips) -> usize {
        let texture = Some(self.texture(texture));
        self.material(Material {
            color: [1.0; 3],
            texture,
            ..Material::default()
        })
    }

    /// Adds a plain matt material.
    pub fn plain(&mut self, color: [f32; 3]) -> usize {
        self.material(Material {
            color,
            ..Material::default()
        })
    }

    /// Adds a material of cut-out leaves.
    pub fn cut_out(&mut self, texture: Mips) -> usize {
        let texture = Some(self.texture(texture));
        self.material(Material {
            color: [1.0; 3],
            texture,
            alpha: Alpha::Cut,
            two_sided: true,
            translucency: 0.5,
            ..Material::default()
        })
    }
}

/// A thin round bar from one point to another: a [`Mesh::cylinder`] put in place.
pub fn bar(from: DVec3, to: DVec3, diameter: f64) -> DMat4 {
    let along = to - from;
    let turn = glam::DQuat::from_rotation_arc(DVec3::Y, along.normalize());
    DMat4::from_scale_rotation_translation(DVec3::new(diameter, along.length(), diameter), turn, 0.5 * (from + to))
}

/// A box between two corners: a [`Mesh::cube`] put in place.
pub fn block(low: DVec3, high: DVec3) -> DMat4 {
    DMat4::from_translation(0.5 * (low + high)) * DMat4::from_scale(high - low)
}

/// A mesh of many bars, open at their ends.
pub fn bars(ends: impl IntoIterator<Item = (DVec3, DVec3, f64)>, n_sides: u32) -> Mesh {
    let one = Mesh::tube(n_sides);
    let mut mesh = Mesh::default();
    for (from, to, diameter) in ends {
        mesh.append(&one, bar(from, to, diameter));
    }
    mesh
}
