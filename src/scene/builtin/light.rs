//! What motion cannot tell: light that changes, layers without vectors, specks brighter than a history can hold.

use super::{
    parts::plaster,
    simple::{room, smoke},
};
use crate::{
    random::{Random, lattice},
    scene::{
        mesh::placed,
        model::{Alpha, Lighting, Material, Mesh, PointLight, Pose, Scene},
        texture::Mips,
    },
};
use glam::{DMat4, DVec3};

/// Things to shine on.
fn furniture(scene: &mut Scene, seed: u64) {
    room(scene, seed);
    let (ball, cube) = (scene.mesh(Mesh::sphere(40, 28)), scene.mesh(Mesh::cube()));
    let clay = scene.matt(plaster([0.7, 0.6, 0.5], 0.4, seed + 8));
    let glazed = scene.material(Material {
        color: [0.25, 0.4, 0.5],
        roughness: Some(0.25),
        ..Material::default()
    });
    scene.place(ball, glazed, placed(DVec3::new(-1.3, 0.7, 0.2), DVec3::splat(1.4), 0.0));
    scene.place(cube, clay, placed(DVec3::new(1.2, 0.55, 0.0), DVec3::splat(1.1), 0.6));
    scene.place(cube, clay, placed(DVec3::new(0.2, 0.25, 1.0), DVec3::splat(0.5), 0.2));
}

pub fn flicker(seed: u64) -> Scene {
    let mut scene = Scene::default();
    furniture(&mut scene, seed);
    scene.lighting = Box::new(move |time| {
        // A bad tube: a new strength in most frames, out in one of six.
        let draw = lattice(libm::floor(time) as i64, 0, seed);
        let strength = if draw < 1.0 / 6.0 { 0.02 } else { 0.55 + 0.6 * draw } as f32;
        let candle = (1.0 + 0.35 * libm::sin(0.9 * time) + 0.2 * libm::sin(2.3 * time)) as f32;
        Lighting {
            sun_color: [0.12, 0.12, 0.14],
            ambient: 0.18,
            points: vec![
                PointLight {
                    position: DVec3::new(0.4, 3.4, 1.2),
                    range: 9.0,
                    color: [1.5, 1.6, 1.8].map(|c: f32| c * strength),
                },
                PointLight {
                    position: DVec3::new(-0.3, 0.9, 1.1),
                    range: 3.0,
                    color: [1.6, 0.8, 0.3].map(|c: f32| c * candle),
                },
            ],
            ..Lighting::default()
        }
    });
    scene.camera = Box::new(|_, _| Pose::look(DVec3::new(0.2, 1.7, 5.0), DVec3::new(0.0, 1.1, 0.0), 48.0));
    scene
}

/// A layer that is laid over the scene and leaves no vectors.
fn layer(scene: &mut Scene, color: [f32; 3], opacity: f32, texture: Option<Mips>, emissive: f32) -> usize {
    let texture = texture.map(|mips| scene.texture(mips));
    scene.material(Material {
        color,
        opacity,
        texture,
        alpha: Alpha::Blended,
        emissive: [emissive; 3],
        lit: emissive == 0.0,
        two_sided: true,
        casts_shadow: false,
        reactive: 1.0,
        ..Material::default()
    })
}

/// A disc that fades.
fn spark() -> Mips {
    Mips::paint(64, |u, v| {
        let (x, y) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let alpha = (1.0 - libm::sqrt(x * x + y * y)).clamp(0.0, 1.0);
        [1.0, 1.0, 1.0, alpha as f32]
    })
}

pub fn particles(seed: u64) -> Scene {
    let mut scene = Scene::default();
    furniture(&mut scene, seed);
    let mut random = Random::new(seed + 20);
    let puff = layer(&mut scene, [0.8, 0.8, 0.82], 0.75, Some(smoke(seed + 9)), 0.0);
    let ember = layer(&mut scene, [1.0, 0.55, 0.15], 1.0, Some(spark()), 7.0);
    let pane = layer(&mut scene, [0.35, 0.7, 0.75], 0.28, None, 0.0);
    let card = scene.mesh(Mesh::quad());
    scene.animate(card, pane, |time| {
        placed(
            DVec3::new(-2.6 + 0.06 * time, 1.4, 1.5),
            DVec3::new(1.1, 2.4, 1.0),
            0.25,
        )
    });
    for _ in 0..26 {
        let (x, z, born) = (
            random.between(0.3, 1.4),
            random.between(0.6, 1.3),
            random.between(0.0, 40.0),
        );
        let (drift, turn) = (random.between(-0.02, 0.03), random.between(-0.04, 0.04));
        scene.animate(card, puff, move |time| {
            let age = (time + born).rem_euclid(40.0);
            let at = DVec3::new(x + drift * age, 0.5 + 0.062 * age, z);
            DMat4::from_translation(at)
                * DMat4::from_rotation_z(turn * age)
                * DMat4::from_scale(DVec3::splat(0.35 + 0.035 * age))
        });
    }
    for _ in 0..160 {
        let (x, z, born) = (
            random.between(-2.8, 2.8),
            random.between(-0.5, 2.2),
            random.between(0.0, 30.0),
        );
        let (up, drift) = (random.between(0.05, 0.13), random.between(-0.05, 0.05));
        let size = DVec3::splat(random.between(0.03, 0.07));
        scene.animate(card, ember, move |time| {
            let age = (time + born).rem_euclid(30.0);
            let at = DVec3::new(x + drift * age, 0.1 + up * age - 0.0012 * age * age, z);
            DMat4::from_translation(at) * DMat4::from_scale(size)
        });
    }
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(0.1 + 0.012 * time, 1.6, 5.0);
        Pose::look(eye, DVec3::new(0.0, 1.2, 0.0), 48.0)
    });
    scene
}

pub fn fireflies(seed: u64) -> Scene {
    let mut scene = Scene::default();
    furniture(&mut scene, seed);
    let mut random = Random::new(seed + 30);
    let ball = scene.mesh(Mesh::sphere(8, 6));
    let cube = scene.mesh(Mesh::cube());
    // 30 to 3000 times as bright as white, and smaller than a pixel.
    for strength in [30.0, 200.0, 3000.0] {
        let glow = scene.material(Material {
            color: [1.0, 0.85, 0.55],
            emissive: [strength; 3],
            lit: false,
            casts_shadow: false,
            ..Material::default()
        });
        for _ in 0..60 {
            let at = DVec3::new(
                random.between(-3.0, 3.0),
                random.between(0.2, 3.0),
                random.between(-2.0, 1.8),
            );
            let (phase, size) = (random.between(0.0, 6.0), DVec3::splat(random.between(0.004, 0.014)));
            scene.animate(ball, glow, move |time| {
                let sway = DVec3::new(
                    libm::sin(0.11 * time + phase),
                    0.6 * libm::sin(0.17 * time + 2.0 * phase),
                    0.0,
                );
                DMat4::from_translation(at + 0.12 * sway) * DMat4::from_scale(size)
            });
        }
    }
    let tube = scene.material(Material {
        color: [0.4, 0.8, 1.0],
        emissive: [25.0; 3],
        lit: false,
        ..Material::default()
    });
    for (y, width) in [(2.9, 2.6), (2.75, 1.8)] {
        scene.place(
            cube,
            tube,
            placed(DVec3::new(0.2, y, -2.9), DVec3::new(width, 0.02, 0.02), 0.0),
        );
    }
    let chrome = scene.material(Material {
        color: [0.9, 0.9, 0.92],
        roughness: Some(0.08),
        metallic: 1.0,
        ..Material::default()
    });
    let facets = scene.mesh(Mesh::sphere(24, 16));
    scene.animate(facets, chrome, |time| {
        placed(DVec3::new(0.0, 1.5, 0.6), DVec3::splat(0.7), 0.03 * time)
    });
    scene.lighting = Box::new(|time| Lighting {
        sun_color: [0.03, 0.035, 0.05],
        sky_zenith: [0.02, 0.025, 0.05],
        sky_horizon: [0.03, 0.035, 0.06],
        sky_ground: [0.02, 0.02, 0.02],
        ambient: 1.0,
        points: vec![PointLight {
            position: DVec3::new(1.5 * libm::sin(0.05 * time), 2.6, 1.5),
            range: 7.0,
            color: [0.5, 0.6, 0.8],
        }],
        ..Lighting::default()
    });
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-0.2 + 0.02 * time, 1.6, 5.0);
        Pose::look(eye, DVec3::new(0.0, 1.3, 0.0), 48.0)
    });
    scene
}
