//! Scenes of a few objects before a detailed wall.

use super::parts::{bricks, checker, plaster, tiles, wood};
use crate::scene::{
    mesh::placed,
    model::{Alpha, Lighting, Material, Mesh, Pose, Scene, ShadowRegion},
    texture::{Mips, fractal_noise},
};
use glam::{DMat4, DVec2, DVec3};

/// A brick wall behind a wooden floor.
pub fn room(scene: &mut Scene, seed: u64) {
    let wall = scene.matt(bricks(seed));
    let floor = scene.matt(wood(10, seed + 1));
    let panel = scene.mesh(Mesh::panel(8, DVec2::new(6.0, 3.0)));
    scene.place(
        panel,
        wall,
        placed(DVec3::new(0.0, 3.0, -3.0), DVec3::new(14.0, 6.0, 1.0), 0.0),
    );
    let boards = scene.mesh(Mesh::floor(8, DVec2::new(5.0, 4.0)));
    scene.place(
        boards,
        floor,
        placed(DVec3::new(0.0, 0.0, 1.0), DVec3::new(14.0, 1.0, 8.0), 0.0),
    );
}

/// Where the ball of [`sphere`] is, and its radius.
pub const SPHERE_RADIUS: f64 = 0.75;

/// Its middle by time.
pub fn sphere_center(time: f64) -> DVec3 {
    DVec3::new(-2.6 + 0.24 * time, 1.3, 0.2)
}

pub fn sphere(seed: u64) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, seed);
    let texture = Some(scene.texture(checker(16, [0.9, 0.85, 0.2], [0.1, 0.15, 0.4])));
    let paint = scene.material(Material {
        color: [1.0; 3],
        texture,
        roughness: Some(0.3),
        ..Material::default()
    });
    let ball = scene.mesh(Mesh::sphere(96, 64));
    scene.animate(ball, paint, |time| {
        let scale = DMat4::from_scale(DVec3::splat(2.0 * SPHERE_RADIUS));
        DMat4::from_translation(sphere_center(time)) * DMat4::from_rotation_y(0.12 * time) * scale
    });
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(-0.3, 0.6, 1.0),
        ..Lighting::default()
    });
    scene.camera = Box::new(|_, _| Pose::look(DVec3::new(0.0, 1.6, 5.0), DVec3::new(0.0, 1.4, 0.0), 50.0));
    scene
}

/// Alpha that fades out from the middle, torn by noise.
pub fn smoke(seed: u64) -> Mips {
    Mips::paint(256, move |u, v| {
        let (x, y) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let fade = (1.0 - libm::sqrt(x * x + y * y)).max(0.0);
        let alpha = (fade * 2.2 * fractal_noise(u, v, 6, 4, seed)).min(0.9);
        [0.85, 0.85, 0.88, alpha as f32]
    })
}

pub fn stochastic_alpha(seed: u64) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, seed);
    let panel = scene.mesh(Mesh::quad());
    for (i, opacity) in [0.15, 0.35, 0.5, 0.75].into_iter().enumerate() {
        let color = [[0.9, 0.2, 0.15], [0.2, 0.75, 0.3], [0.2, 0.35, 0.9], [0.95, 0.9, 0.85]][i];
        let glass = scene.material(Material {
            color,
            opacity,
            alpha: Alpha::Stochastic,
            two_sided: true,
            casts_shadow: false,
            ..Material::default()
        });
        let at = DVec3::new(-2.4 + 1.45 * i as f64, 1.35, 0.6 - 0.35 * i as f64);
        scene.place(panel, glass, placed(at, DVec3::new(1.5, 2.2, 1.0), 0.15));
    }
    let texture = Some(scene.texture(smoke(seed + 7)));
    let puff = scene.material(Material {
        color: [1.0; 3],
        texture,
        alpha: Alpha::Stochastic,
        two_sided: true,
        casts_shadow: false,
        ..Material::default()
    });
    for i in 0..5 {
        let i = f64::from(i);
        scene.animate(panel, puff, move |time| {
            let at = DVec3::new(
                -2.2 + 1.1 * i + 0.02 * time,
                1.0 + 0.3 * libm::sin(2.0 * i),
                1.4 + 0.05 * i,
            );
            DMat4::from_translation(at)
                * DMat4::from_rotation_z(0.4 * i + 0.02 * time)
                * DMat4::from_scale(DVec3::splat(1.7))
        });
    }
    scene.camera = Box::new(|time, _| {
        Pose::look(
            DVec3::new(-0.3 + 0.03 * time, 1.6, 5.0),
            DVec3::new(0.0, 1.3, -1.0),
            50.0,
        )
    });
    scene
}

pub fn still(seed: u64) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, seed);
    let (ball, cube) = (scene.mesh(Mesh::sphere(48, 32)), scene.mesh(Mesh::cube()));
    let texture = Some(scene.texture(tiles(8, [0.85, 0.8, 0.7], [0.1, 0.3, 0.35], seed + 5)));
    let glazed = scene.material(Material {
        color: [1.0; 3],
        texture,
        roughness: Some(0.2),
        ..Material::default()
    });
    let clay = scene.matt(plaster([0.6, 0.3, 0.2], 0.5, seed + 6));
    scene.place(ball, glazed, placed(DVec3::new(-1.2, 0.8, 0.3), DVec3::splat(1.6), 0.4));
    scene.place(cube, clay, placed(DVec3::new(1.1, 0.6, 0.2), DVec3::splat(1.2), 0.5));
    let rod = scene.mesh(Mesh::cylinder(8));
    let white = scene.plain([0.9, 0.9, 0.9]);
    for i in 0..18 {
        let x = -3.2 + 0.37 * f64::from(i);
        let (from, to) = (DVec3::new(x, 0.0, -1.2), DVec3::new(x + 0.25, 3.4, -1.6));
        scene.place(rod, white, super::parts::bar(from, to, 0.006 + 0.002 * f64::from(i)));
    }
    scene.shadows = Some(ShadowRegion {
        center: DVec3::new(0.0, 1.0, -0.5),
        radius: 6.0,
        side: 1024,
    });
    scene.camera = Box::new(|_, _| Pose::look(DVec3::new(0.4, 1.7, 5.0), DVec3::new(0.0, 1.2, -0.5), 48.0));
    scene
}
