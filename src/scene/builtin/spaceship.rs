//! A ship of panels, pipes and antennae before the stars.

use super::parts::{bar, bars, plaster};
use crate::{
    random::Random,
    scene::{
        mesh::placed,
        model::{Lighting, Material, Mesh, PointLight, Pose, Scene},
    },
};
use glam::{DMat4, DVec3};

/// Small boxes on the sides and back of a hull of the given half size.
fn greebles(half: DVec3, n: usize, random: &mut Random) -> Mesh {
    let cube = Mesh::cube();
    let mut mesh = Mesh::default();
    for _ in 0..n {
        let side = random.below(6);
        let (axis, sign) = (side / 2, if side.is_multiple_of(2) { 1.0 } else { -1.0 });
        let mut at = DVec3::new(
            random.between(-0.95, 0.95),
            random.between(-0.95, 0.95),
            random.between(-0.95, 0.95),
        ) * half;
        at[axis] = sign * half[axis];
        let mut size = DVec3::new(
            random.between(0.03, 0.28),
            random.between(0.02, 0.14),
            random.between(0.03, 0.35),
        );
        size[axis] = random.between(0.02, 0.09);
        mesh.append(&cube, placed(at, size, 0.0));
    }
    mesh
}

pub fn spaceship(seed: u64) -> Scene {
    let mut scene = Scene::default();
    let mut random = Random::new(seed);
    let texture = Some(scene.texture(plaster([0.75, 0.76, 0.8], 0.25, seed + 1)));
    let metal = |color: [f32; 3], roughness| Material {
        color,
        texture,
        roughness: Some(roughness),
        metallic: 0.8,
        specular: 0.5,
        ..Material::default()
    };
    let bright = scene.material(metal([0.8, 0.82, 0.85], 0.28));
    let dark = scene.material(metal([0.3, 0.32, 0.36], 0.35));
    let glow = |color| Material {
        color,
        emissive: [6.0; 3],
        lit: false,
        ..Material::default()
    };
    let window = scene.material(glow([1.0, 0.8, 0.45]));
    let engine = scene.material(glow([0.35, 0.6, 1.0]));
    let star = scene.material(glow([0.5, 0.55, 0.65]));
    hull(&mut scene, [bright, dark, window, engine], &mut random);
    let speck = scene.mesh(Mesh::quad());
    for _ in 0..900 {
        let out = random.direction();
        let turn = glam::DQuat::from_rotation_arc(DVec3::Z, -out);
        let size = DVec3::splat(random.between(0.06, 0.3));
        scene.place(
            speck,
            star,
            DMat4::from_scale_rotation_translation(size, turn, out * 90.0),
        );
    }
    scene.lighting = Box::new(|time| {
        let angle = 0.16 * time;
        Lighting {
            sun_direction: DVec3::new(0.6, 0.55, 0.8),
            sun_color: [1.5, 1.45, 1.35],
            sky_zenith: [0.012, 0.014, 0.024],
            sky_horizon: [0.02, 0.022, 0.035],
            sky_ground: [0.015, 0.02, 0.035],
            ambient: 1.5,
            points: vec![PointLight {
                position: DVec3::new(2.6 * libm::cos(angle), 1.3, 2.6 * libm::sin(angle)),
                range: 5.0,
                color: [2.6, 1.2, 0.5],
            }],
        }
    });
    scene.camera = Box::new(|time, _| {
        let angle = 0.75 + 0.006 * time;
        let eye = DVec3::new(5.0 * libm::sin(angle), 1.35, 5.0 * libm::cos(angle));
        Pose::look(eye, DVec3::new(0.0, 0.1, 0.0), 48.0)
    });
    scene
}

fn hull(scene: &mut Scene, [bright, dark, window, engine]: [usize; 4], random: &mut Random) {
    let cube = scene.mesh(Mesh::cube());
    let parts = [
        (DVec3::ZERO, DVec3::new(1.1, 0.7, 4.2), 420),
        (DVec3::new(0.0, 0.55, 0.9), DVec3::new(0.6, 0.5, 1.1), 120),
        (DVec3::new(0.0, -0.1, -1.7), DVec3::new(2.5, 0.28, 0.9), 200),
        (DVec3::new(1.25, -0.05, -1.7), DVec3::new(0.45, 0.55, 1.9), 110),
        (DVec3::new(-1.25, -0.05, -1.7), DVec3::new(0.45, 0.55, 1.9), 110),
    ];
    for (at, size, _) in parts {
        scene.place(cube, bright, placed(at, size, 0.0));
    }
    for (i, (at, size, n)) in parts.into_iter().enumerate() {
        let mesh = scene.mesh(greebles(0.5 * size, n, random));
        scene.place(
            mesh,
            if i % 2 == 0 { dark } else { bright },
            DMat4::from_translation(at),
        );
    }
    let nose = scene.mesh(Mesh::cone(24, 0.25));
    let forward = DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let along = DMat4::from_translation(DVec3::new(0.0, 0.0, 2.5)) * forward;
    scene.place(nose, bright, along * DMat4::from_scale(DVec3::new(1.0, 0.8, 0.65)));
    let nozzle = scene.mesh(Mesh::cylinder(20));
    for x in [-1.25, -0.3, 0.3, 1.25] {
        let at = DMat4::from_translation(DVec3::new(x, 0.0, if x.abs() > 1.0 { -2.72 } else { -2.2 })) * forward;
        scene.place(nozzle, engine, at * DMat4::from_scale(DVec3::new(0.32, 0.12, 0.32)));
    }
    // Windows in rows, a few pixels each.
    for side in [-1.0, 1.0] {
        for i in 0..44 {
            for row in 0..2 {
                if random.unit() < 0.7 {
                    let at = DVec3::new(side * 0.555, 0.08 + 0.1 * f64::from(row), -1.9 + 0.09 * f64::from(i));
                    scene.place(cube, window, placed(at, DVec3::new(0.02, 0.03, 0.035), 0.0));
                }
            }
        }
    }
    let antenna =
        |x: f64, y: f64, z: f64, up: f64| (DVec3::new(x, y, z), DVec3::new(1.08 * x, y + up, z - 0.15), 0.012);
    let antennae = (0..26).map(|i| {
        let t = f64::from(i) / 25.0;
        antenna(
            0.5 * libm::sin(9.0 * t),
            0.33,
            1.9 - 3.8 * t,
            0.3 + 0.5 * libm::fabs(libm::sin(17.0 * t)),
        )
    });
    let mesh = scene.mesh(bars(antennae, 5));
    scene.place(mesh, bright, DMat4::IDENTITY);
    let strut = scene.mesh(Mesh::cylinder(6));
    for i in 0..12 {
        let z = -2.4 + 0.13 * f64::from(i);
        for side in [-1.0, 1.0] {
            let (from, to) = (DVec3::new(side * 0.5, 0.2, z), DVec3::new(side * 1.1, 0.22, z + 0.07));
            scene.place(strut, dark, bar(from, to, 0.014));
        }
    }
    let dish = scene.mesh(Mesh::cone(18, 0.15));
    scene.animate(dish, bright, |time| {
        DMat4::from_translation(DVec3::new(0.0, 1.0, 1.1))
            * DMat4::from_rotation_y(0.09 * time)
            * DMat4::from_rotation_x(1.1)
            * DMat4::from_scale(DVec3::new(0.5, 0.16, 0.5))
    });
}
