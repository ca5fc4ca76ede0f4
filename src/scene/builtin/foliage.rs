//! Trees and bushes of cut-out leaves that sway.

use super::parts::{ground, leaves, wood};
use crate::{
    random::Random,
    scene::{
        mesh::placed,
        model::{Lighting, Mesh, Placement, Pose, Scene, ShadowRegion},
    },
};
use glam::{DMat4, DVec2, DVec3};
use std::f64::consts::TAU;

/// A card that sways about its root: the wind turns it by up to `strength` radians, each at its own time.
fn swaying(root: DMat4, phase: f64, strength: f64) -> Placement {
    Placement::Moving(Box::new(move |time| {
        let wind = 0.6 * libm::sin(0.21 * time + phase) + 0.4 * libm::sin(0.47 * time + 2.3 * phase);
        let bend = DMat4::from_rotation_z(strength * wind) * DMat4::from_rotation_x(0.6 * strength * wind);
        root * bend * DMat4::from_translation(DVec3::Y * 0.35)
    }))
}

/// A ball of leaf cards.
fn crown(scene: &mut Scene, card: usize, leaf: usize, center: DVec3, radius: f64, n: usize, random: &mut Random) {
    for _ in 0..n {
        let out = random.direction();
        let at = center + out * radius * libm::cbrt(random.between(0.25, 1.0));
        let size = random.between(0.55, 0.95);
        let turn = DMat4::from_rotation_y(random.between(0.0, TAU))
            * DMat4::from_rotation_x(random.between(-0.7, 0.7))
            * DMat4::from_rotation_z(random.between(-1.0, 1.0));
        let tone = random.between(0.65, 1.25) as f32;
        let root = DMat4::from_translation(at) * turn * DMat4::from_scale(DVec3::splat(size));
        let tint = [tone * random.between(0.8, 1.3) as f32, tone, tone * 0.8, 1.0];
        let phase = random.between(0.0, 1.5) + 0.6 * at.x;
        scene.add(card, leaf, tint, swaying(root, phase, 0.22));
    }
}

pub fn foliage(seed: u64) -> Scene {
    let mut scene = Scene::default();
    let mut random = Random::new(seed);
    let earth = scene.matt(ground(seed + 1));
    let bark = scene.matt(wood(12, seed + 2));
    let leaf = scene.cut_out(leaves(34, [0.16, 0.4, 0.07], seed + 3));
    let blade = scene.cut_out(leaves(22, [0.2, 0.36, 0.06], seed + 4));
    let floor = scene.mesh(Mesh::floor(16, DVec2::splat(24.0)));
    scene.place(floor, earth, placed(DVec3::ZERO, DVec3::new(60.0, 1.0, 60.0), 0.0));
    let trunk = scene.mesh(Mesh::cone(10, 0.6));
    let card = scene.mesh(Mesh::quad());
    let trees = [
        (-2.6, -2.0),
        (2.4, -3.4),
        (-0.4, -7.0),
        (5.5, -8.0),
        (-6.2, -8.5),
        (1.8, -13.0),
        (-3.5, -14.0),
    ];
    for (x, z) in trees {
        let height = random.between(2.6, 3.6);
        scene.place(
            trunk,
            bark,
            placed(DVec3::new(x, 0.5 * height, z), DVec3::new(0.35, height, 0.35), 0.0),
        );
    }
    for (x, z) in trees {
        let top = DVec3::new(x, random.between(3.0, 3.8), z);
        crown(&mut scene, card, leaf, top, 1.5, 110, &mut random);
    }
    for _ in 0..16 {
        let at = DVec3::new(random.between(-6.0, 6.0), 0.45, random.between(-11.0, 1.5));
        crown(&mut scene, card, leaf, at, 0.7, 22, &mut random);
    }
    for _ in 0..500 {
        let at = DVec3::new(random.between(-7.0, 7.0), 0.0, random.between(-12.0, 3.2));
        let turn = DMat4::from_rotation_y(random.between(0.0, TAU));
        let root = DMat4::from_translation(at) * turn * DMat4::from_scale(DVec3::new(0.6, 0.5, 0.6));
        let tone = random.between(0.6, 1.2) as f32;
        let phase = random.between(0.0, 1.0) + 0.8 * at.x;
        scene.add(card, blade, [tone, tone, tone, 1.0], swaying(root, phase, 0.3));
    }
    scene.shadows = Some(ShadowRegion {
        center: DVec3::new(0.0, 1.5, -4.0),
        radius: 12.0,
        side: 1536,
    });
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(0.7, 0.8, 0.45),
        sun_color: [1.9, 1.75, 1.4],
        ambient: 0.55,
        ..Lighting::default()
    });
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-1.2 + 0.035 * time, 1.6, 6.0);
        Pose::look(eye, DVec3::new(0.1 + 0.02 * time, 1.75, -3.0), 52.0)
    });
    scene
}
