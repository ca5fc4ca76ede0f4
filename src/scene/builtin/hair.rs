//! A ball of hair: strands about as wide as a pixel, seen against each other or against the sky.

use super::parts::{checker, plaster};
use crate::{
    random::Random,
    scene::{
        mesh::placed,
        model::{Lighting, Material, Mesh, Pose, Scene, ShadowRegion},
    },
};
use glam::{DMat4, DVec2, DVec3};

const N_STRANDS: usize = 1300;
const N_SEGMENTS: usize = 12;

/// Strands that grow out of a ball and curl.
fn strands(seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for _ in 0..N_STRANDS {
        let mut at = random.direction() * 0.35;
        let mut heading = (at.normalize() + 0.5 * random.direction()).normalize();
        let curl = random.direction() * random.between(0.1, 0.55);
        let mut path = vec![at];
        for _ in 0..N_SEGMENTS {
            heading = (heading + heading.cross(curl) + 0.18 * random.direction()).normalize();
            at += heading * 0.075;
            path.push(at);
        }
        let strand = Mesh::along(&path, |t| 0.0062 * (1.0 - 0.75 * t), 3);
        mesh.append(&strand, DMat4::IDENTITY);
    }
    mesh
}

fn hair(seed: u64, turn_per_frame: f64, silhouette: bool) -> Scene {
    let mut scene = Scene::default();
    let hair = scene.mesh(strands(seed));
    let material = scene.material(match silhouette {
        true => Material {
            color: [0.0; 3],
            lit: false,
            ..Material::default()
        },
        false => Material {
            color: [0.75, 0.48, 0.24],
            roughness: Some(0.45),
            translucency: 0.2,
            ..Material::default()
        },
    });
    let middle = DVec3::new(0.0, 1.25, 0.0);
    match turn_per_frame {
        0.0 => scene.place(hair, material, DMat4::from_translation(middle)),
        _ => scene.animate(hair, material, move |time| {
            DMat4::from_translation(middle) * DMat4::from_rotation_y(turn_per_frame * time)
        }),
    }
    if silhouette {
        scene.lighting = Box::new(|_| Lighting {
            sky_zenith: [0.9, 0.95, 1.0],
            sky_horizon: [1.0; 3],
            sky_ground: [0.85, 0.82, 0.8],
            ..Lighting::default()
        });
    } else {
        let floor = scene.matt(checker(8, [0.6, 0.6, 0.58], [0.2, 0.22, 0.25]));
        let wall = scene.matt(plaster([0.28, 0.33, 0.38], 0.3, seed + 1));
        let ground = scene.mesh(Mesh::floor(6, DVec2::splat(2.0)));
        scene.place(ground, floor, placed(DVec3::ZERO, DVec3::new(12.0, 1.0, 12.0), 0.0));
        let panel = scene.mesh(Mesh::panel(4, DVec2::splat(2.0)));
        scene.place(
            panel,
            wall,
            placed(DVec3::new(0.0, 3.0, -3.0), DVec3::new(14.0, 8.0, 1.0), 0.0),
        );
        scene.shadows = Some(ShadowRegion {
            center: DVec3::new(0.0, 1.0, 0.0),
            radius: 3.2,
            side: 1536,
        });
        scene.lighting = Box::new(|_| Lighting {
            sun_direction: DVec3::new(0.6, 0.9, 0.7),
            sun_color: [1.7, 1.6, 1.4],
            ..Lighting::default()
        });
    }
    scene.camera = Box::new(|_, _| Pose::look(DVec3::new(0.3, 1.6, 3.6), middle_of_view(), 46.0));
    scene
}

fn middle_of_view() -> DVec3 {
    DVec3::new(0.0, 1.2, 0.0)
}

pub fn still(seed: u64) -> Scene {
    hair(seed, 0.0, false)
}

pub fn rotating(seed: u64) -> Scene {
    hair(seed, 0.02, false)
}

pub fn silhouette(seed: u64) -> Scene {
    hair(seed, 0.0, true)
}

pub fn silhouette_rotating(seed: u64) -> Scene {
    hair(seed, 0.02, true)
}
