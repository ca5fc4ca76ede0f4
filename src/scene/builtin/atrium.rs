//! A hall with two storeys of columns around a court that the sun looks into.

use super::parts::{bars, block, bricks, leaves, plaster, tiles};
use crate::{
    random::Random,
    scene::{
        mesh::placed,
        model::{Lighting, Material, Mesh, PointLight, Pose, Scene, ShadowRegion},
        texture::{Mips, blend},
    },
};
use glam::{DMat4, DVec2, DVec3};

const LENGTH: f64 = 22.0;
const COLUMN_X: f64 = 2.6;
const WALL_X: f64 = 4.8;
const GALLERY_Y: f64 = 3.3;
const ROOF_Y: f64 = 6.6;
const SPACING: f64 = 2.2;

/// A column with its base and capital, 3 high.
fn column() -> Mesh {
    let mut mesh = Mesh::default();
    let shaft = Mesh::cone(20, 0.85);
    mesh.append(&shaft, placed(DVec3::Y * 1.5, DVec3::new(0.46, 2.5, 0.46), 0.0));
    for (y, width, height) in [(0.1, 0.66, 0.2), (0.25, 0.56, 0.1), (2.78, 0.52, 0.08), (2.9, 0.7, 0.2)] {
        mesh.append(
            &Mesh::cube(),
            placed(DVec3::Y * y, DVec3::new(width, height, width), 0.0),
        );
    }
    mesh
}

/// A round arch over one bay: a wall of `SPACING` × 1.1 with a half-circle cut out.
fn arch() -> Mesh {
    const RADIUS: f64 = 0.85;
    const TOP: f64 = 1.15;
    let mut mesh = Mesh::default();
    for side in [-1.0, 1.0] {
        let face = Mesh::grid(16, 1, |u, v| {
            let angle = std::f64::consts::PI * (1.0 - u);
            let inner = DVec2::new(libm::cos(angle), libm::sin(angle)) * RADIUS;
            let outer = DVec2::new((u - 0.5) * SPACING, TOP);
            let p = inner.lerp(outer, v);
            (DVec3::new(p.x, p.y, 0.12), DVec3::Z, p * 0.5)
        });
        mesh.append(
            &face,
            DMat4::from_rotation_y(if side > 0.0 { 0.0 } else { std::f64::consts::PI }),
        );
    }
    // Its underside.
    mesh.append(
        &Mesh::grid(16, 1, |u, v| {
            let angle = std::f64::consts::PI * u;
            let out = DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
            (out * RADIUS + DVec3::Z * (0.12 - 0.24 * v), -out, DVec2::new(u, v))
        }),
        DMat4::IDENTITY,
    );
    mesh
}

fn cloth(seed: u64) -> Mips {
    Mips::paint(256, move |u, v| {
        let stripe = libm::sin(v * 40.0) * 0.5 + 0.5;
        let weave = (libm::floor(u * 128.0) + libm::floor(v * 128.0)).rem_euclid(2.0);
        let tone = crate::scene::texture::fractal_noise(u, v, 8, 3, seed);
        blend(
            [0.5, 0.02, 0.03],
            [0.75, 0.3, 0.08],
            0.5 * stripe + 0.2 * weave + 0.3 * tone,
        )
    })
}

/// A hanging with folds, two-sided, 1 wide and 1 high below its upper edge.
fn hanging() -> Mesh {
    Mesh::grid(24, 6, |u, v| {
        let fold = libm::sin(u * 30.0);
        let normal = DVec3::new(-libm::cos(u * 30.0) * 1.2, 0.0, 1.0).normalize();
        (
            DVec3::new(u - 0.5, v - 1.0, 0.04 * fold),
            normal,
            DVec2::new(u, 1.0 - v),
        )
    })
}

/// Rails and balusters along one bay of the gallery.
fn railing() -> Mesh {
    let mut mesh = bars(
        (0..14).map(|i| {
            let z = (f64::from(i) + 0.5) / 14.0 * SPACING - 0.5 * SPACING;
            (DVec3::new(0.0, 0.05, z), DVec3::new(0.0, 0.85, z), 0.035)
        }),
        6,
    );
    for y in [0.07, 0.88] {
        mesh.append(
            &Mesh::cube(),
            placed(DVec3::Y * y, DVec3::new(0.08, 0.05, SPACING), 0.0),
        );
    }
    mesh
}

pub fn atrium(seed: u64) -> Scene {
    let mut scene = Scene::default();
    let stone = scene.matt(plaster([0.62, 0.55, 0.44], 0.35, seed));
    let bricks = scene.matt(bricks(seed + 1));
    let iron = scene.material(Material {
        color: [0.05, 0.05, 0.06],
        roughness: Some(0.4),
        ..Material::default()
    });
    let texture = Some(scene.texture(tiles(4, [0.7, 0.66, 0.58], [0.25, 0.1, 0.07], seed + 2)));
    let marble = scene.material(Material {
        color: [1.0; 3],
        texture,
        roughness: Some(0.25),
        ..Material::default()
    });
    let texture = Some(scene.texture(cloth(seed + 3)));
    let cloth = scene.material(Material {
        color: [1.0; 3],
        texture,
        two_sided: true,
        translucency: 0.4,
        ..Material::default()
    });
    shell(&mut scene, stone, bricks, marble);
    bays(&mut scene, stone, iron, cloth);
    plants_and_lamps(&mut scene, stone, iron, seed);
    scene.shadows = Some(ShadowRegion {
        center: DVec3::new(0.0, 2.5, -2.0),
        radius: 13.0,
        side: 1536,
    });
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(0.35, 1.0, 0.28),
        sun_color: [2.3, 2.0, 1.6],
        sky_ground: [0.32, 0.27, 0.22],
        ambient: 0.42,
        points: [-7.0, 0.0]
            .map(|z| PointLight {
                position: DVec3::new(0.0, 2.9, z),
                range: 6.0,
                color: [1.3, 0.8, 0.35],
            })
            .to_vec(),
        ..Lighting::default()
    });
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(0.9 - 0.028 * time, 1.65, 8.0 - 0.06 * time);
        let target = DVec3::new(-1.1 + 0.012 * time, 2.25, -2.0);
        Pose::look(eye, target, 58.0)
    });
    scene
}

/// Floors, walls, roof, and no lid over the court.
fn shell(scene: &mut Scene, stone: usize, bricks: usize, marble: usize) {
    let half = 0.5 * LENGTH;
    let floor = scene.mesh(Mesh::floor(8, DVec2::new(3.0, 7.0)));
    scene.place(
        floor,
        marble,
        placed(DVec3::ZERO, DVec3::new(2.0 * WALL_X, 1.0, LENGTH), 0.0),
    );
    let wall = scene.mesh(Mesh::panel(8, DVec2::new(9.0, 3.0)));
    let cube = scene.mesh(Mesh::cube());
    let quarter = std::f64::consts::FRAC_PI_2;
    for side in [-1.0, 1.0] {
        let at = DVec3::new(side * WALL_X, 0.5 * ROOF_Y, 0.0);
        scene.place(
            wall,
            bricks,
            placed(at, DVec3::new(LENGTH, ROOF_Y, 1.0), -side * quarter),
        );
        let outer = DVec3::new(side * WALL_X, GALLERY_Y, half);
        let inner = DVec3::new(side * (COLUMN_X - 0.35), GALLERY_Y - 0.28, -half);
        scene.place(cube, stone, block(inner.min(outer), inner.max(outer)));
        let (low, high) = (DVec3::new(0.0, ROOF_Y - 0.3, 0.0), DVec3::new(0.0, ROOF_Y, 0.0));
        scene.place(
            cube,
            stone,
            block(
                inner.with_y(low.y).min(outer.with_y(low.y)),
                inner.with_y(high.y).max(outer.with_y(high.y)),
            ),
        );
    }
    for (z, turn) in [(-half, 0.0), (half, std::f64::consts::PI)] {
        let at = DVec3::new(0.0, 0.5 * ROOF_Y, z);
        scene.place(wall, bricks, placed(at, DVec3::new(2.0 * WALL_X, ROOF_Y, 1.0), turn));
    }
    // A doorway and a window on the far wall, darker than any shadow.
    let dark = scene.plain([0.02, 0.02, 0.025]);
    scene.place(
        cube,
        dark,
        block(DVec3::new(-0.8, 0.0, -half), DVec3::new(0.8, 2.3, -half + 0.04)),
    );
    scene.place(
        cube,
        stone,
        block(DVec3::new(-1.0, 2.3, -half), DVec3::new(1.0, 2.55, -half + 0.15)),
    );
}

/// What repeats along both sides.
fn bays(scene: &mut Scene, stone: usize, iron: usize, cloth: usize) {
    let (column, arch) = (scene.mesh(column()), scene.mesh(arch()));
    let (railing, hanging) = (scene.mesh(railing()), scene.mesh(hanging()));
    let n_bays = (LENGTH / SPACING) as i32;
    let z_of = |i: i32| (f64::from(i) - 0.5 * f64::from(n_bays)) * SPACING;
    let quarter = std::f64::consts::FRAC_PI_2;
    for side in [-1.0, 1.0] {
        let x = side * COLUMN_X;
        for i in 0..=n_bays {
            for y in [0.0, GALLERY_Y] {
                scene.place(column, stone, placed(DVec3::new(x, y, z_of(i)), DVec3::ONE, 0.0));
            }
        }
        for i in 0..n_bays {
            let z = z_of(i) + 0.5 * SPACING;
            scene.place(
                arch,
                stone,
                placed(DVec3::new(x, GALLERY_Y - 1.3, z), DVec3::ONE, quarter),
            );
        }
        for i in 0..n_bays {
            let z = z_of(i) + 0.5 * SPACING;
            scene.place(railing, iron, placed(DVec3::new(x, GALLERY_Y, z), DVec3::ONE, 0.0));
        }
        for i in (1..n_bays).step_by(3) {
            let z = z_of(i) + 0.5 * SPACING;
            let scale = DVec3::new(1.5, 2.0, 1.0);
            let at = DVec3::new(x - side * 0.3, GALLERY_Y - 0.3, z);
            scene.place(hanging, cloth, placed(at, scale, -side * quarter));
        }
    }
}

fn plants_and_lamps(scene: &mut Scene, stone: usize, iron: usize, seed: u64) {
    let leaf = scene.cut_out(leaves(26, [0.12, 0.36, 0.08], seed + 4));
    let glow = scene.material(Material {
        color: [1.0, 0.75, 0.4],
        emissive: [9.0; 3],
        lit: false,
        casts_shadow: false,
        ..Material::default()
    });
    let pot = scene.mesh(Mesh::cone(18, 1.35));
    let card = scene.mesh(Mesh::quad());
    let mut random = Random::new(seed + 5);
    for z in [5.2, 0.8, -3.6, -8.0] {
        for x in [-1.7, 1.7] {
            scene.place(
                pot,
                stone,
                placed(DVec3::new(x, 0.3, z), DVec3::new(0.55, 0.6, 0.55), 0.0),
            );
            for _ in 0..9 {
                let at = DVec3::new(x, random.between(0.85, 1.35), z) + random.direction() * 0.18;
                let turn = DMat4::from_rotation_y(random.between(0.0, std::f64::consts::TAU))
                    * DMat4::from_rotation_x(random.between(-0.6, 0.6));
                scene.place(
                    card,
                    leaf,
                    DMat4::from_translation(at) * turn * DMat4::from_scale(DVec3::splat(0.85)),
                );
            }
        }
    }
    let ball = scene.mesh(Mesh::sphere(16, 10));
    let chain = scene.mesh(Mesh::cylinder(5));
    for z in [-7.0, 0.0] {
        scene.place(ball, glow, placed(DVec3::new(0.0, 2.9, z), DVec3::splat(0.24), 0.0));
        let (from, to) = (DVec3::new(0.0, 3.0, z), DVec3::new(0.0, ROOF_Y, z));
        scene.place(chain, iron, super::parts::bar(from, to, 0.018));
        let across = [
            DVec3::new(-COLUMN_X, ROOF_Y - 0.1, z),
            DVec3::new(COLUMN_X, ROOF_Y - 0.1, z),
        ];
        scene.place(chain, iron, super::parts::bar(across[0], across[1], 0.03));
    }
}

/// The frame at which [`cut`] goes elsewhere.
pub const CUT: usize = 8;

/// The hall in two shots.
pub fn cut(seed: u64) -> Scene {
    let mut scene = atrium(seed);
    scene.cuts = vec![CUT];
    scene.camera = Box::new(|time, shot| {
        let step = 0.05 * time;
        match shot {
            0 => Pose::look(DVec3::new(1.0, 1.65, 7.5 - step), DVec3::new(-0.8, 2.2, -2.0), 58.0),
            _ => Pose::look(
                DVec3::new(-1.4 + step, 4.9, -9.0),
                DVec3::new(0.4 + step, 2.4, 4.0),
                62.0,
            ),
        }
    });
    scene
}

/// The hall, looked around in fast: the camera turns by about 50 pixels a frame at 640 × 360.
pub fn pan(seed: u64) -> Scene {
    let mut scene = atrium(seed);
    scene.camera = Box::new(|time, _| {
        let yaw = -0.9 + 0.12 * time;
        let eye = DVec3::new(0.2, 1.7, 1.0);
        Pose::look(eye, eye + DVec3::new(libm::sin(yaw), 0.05, -libm::cos(yaw)), 58.0)
    });
    scene
}
