//! Detail in textures: a wall of text, a meadow of cut-out flowers, and a zoom into both.

use super::{
    font,
    parts::{bricks, ground, leaves, plaster},
};
use crate::{
    random::Random,
    scene::{
        mesh::placed,
        model::{Lighting, Mesh, Placement, Pose, Scene},
        texture::{Mips, Texel},
    },
};
use glam::{DMat4, DVec2, DVec3};
use std::f64::consts::TAU;

const TEXT: &str = "A SAMPLE IN EVERY PIXEL AND A PIXEL IN EVERY FRAME. WHAT WAS SEEN BEFORE IS SEEN AGAIN WHERE IT WENT \
     AND WHERE IT WENT THE MOTION SAYS. 0123456789. JITTER - REPROJECT - RECTIFY - BLEND. QUICK BROWN FOXES JUMP OVER \
     LAZY DOGS WHILE FIVE WIZARDS VEX A JUDGE.";

/// Three pages on a wall.
fn pages(scene: &mut Scene, seed: u64) {
    let wall = scene.matt(plaster([0.5, 0.48, 0.45], 0.15, seed));
    let panel = scene.mesh(Mesh::panel(6, DVec2::splat(4.0)));
    scene.place(
        panel,
        wall,
        placed(DVec3::new(0.0, 1.5, -0.02), DVec3::new(14.0, 7.0, 1.0), 0.0),
    );
    let sheet = scene.mesh(Mesh::panel(4, DVec2::ONE));
    let inks: [([f32; 3], [f32; 3]); 3] = [
        ([0.92, 0.91, 0.88], [0.02, 0.02, 0.03]),
        ([0.03, 0.03, 0.04], [0.85, 0.87, 0.9]),
        ([0.9, 0.85, 0.4], [0.6, 0.05, 0.05]),
    ];
    for (i, (paper, ink)) in inks.into_iter().enumerate() {
        let words = TEXT.split_whitespace().skip(9 * i).collect::<Vec<_>>().join(" ");
        let page = scene.matt(font::page(1024, &words, paper, ink));
        scene.place(
            sheet,
            page,
            placed(DVec3::new(-2.05 + 2.05 * i as f64, 1.5, 0.0), DVec3::splat(1.95), 0.0),
        );
    }
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(0.2, 0.5, 1.0),
        sun_color: [0.75, 0.73, 0.7],
        ..Lighting::default()
    });
}

pub fn text(seed: u64) -> Scene {
    let mut scene = Scene::default();
    pages(&mut scene, seed);
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-0.55 + 0.017 * time, 1.5 + 0.002 * time, 2.7);
        Pose::look(eye, DVec3::new(-0.1 + 0.012 * time, 1.5, 0.0), 48.0)
    });
    scene
}

pub fn zoom(seed: u64) -> Scene {
    let mut scene = Scene::default();
    pages(&mut scene, seed);
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-0.2, 1.7, 4.0);
        // The opening narrows by 3 % a frame.
        Pose::look(eye, DVec3::new(-0.2, 1.7, 0.0), 52.0 * libm::pow(0.97, time))
    });
    scene
}

/// Petals around a disc; alpha is coverage.
fn blossom(n_petals: f64, petal: [f32; 3], disc: [f32; 3]) -> Mips {
    Mips::paint(256, move |u, v| {
        let (x, y) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let (r, angle) = (libm::sqrt(x * x + y * y), libm::atan2(y, x));
        let wave = libm::fabs(libm::cos(0.5 * n_petals * angle));
        let rim = 0.35 + 0.6 * libm::sqrt(wave);
        let texel: Texel = match r {
            r if r < 0.24 => {
                let k = (0.7 + 1.2 * r) as f32;
                [disc[0] * k, disc[1] * k, disc[2] * k, 1.0]
            }
            r if r < rim => {
                let k = (0.55 + 0.5 * r - 0.25 * libm::cos(40.0 * angle) * (1.0 - r)) as f32;
                [petal[0] * k, petal[1] * k, petal[2] * k, 1.0]
            }
            _ => [petal[0], petal[1], petal[2], 0.0],
        };
        texel
    })
}

fn swaying(root: DVec3, turn: DMat4, scale: DVec3, phase: f64) -> Placement {
    Placement::Moving(Box::new(move |time| {
        let wind = 0.13 * libm::sin(0.24 * time + phase) + 0.05 * libm::sin(0.61 * time + 2.0 * phase);
        let bend = DMat4::from_rotation_z(wind) * DMat4::from_rotation_x(0.5 * wind);
        DMat4::from_translation(root) * bend * turn * DMat4::from_scale(scale)
    }))
}

pub fn flowers(seed: u64) -> Scene {
    let mut scene = Scene::default();
    let mut random = Random::new(seed);
    let earth = scene.matt(ground(seed + 1));
    let floor = scene.mesh(Mesh::floor(12, DVec2::splat(14.0)));
    scene.place(floor, earth, placed(DVec3::ZERO, DVec3::new(40.0, 1.0, 40.0), 0.0));
    let wall = scene.matt(bricks(seed + 2));
    let panel = scene.mesh(Mesh::panel(6, DVec2::new(8.0, 1.5)));
    scene.place(
        panel,
        wall,
        placed(DVec3::new(0.0, 0.8, -8.0), DVec3::new(30.0, 1.6, 1.0), 0.0),
    );
    let kinds = [
        blossom(8.0, [0.9, 0.88, 0.85], [0.9, 0.6, 0.05]),
        blossom(5.0, [0.85, 0.08, 0.06], [0.08, 0.05, 0.05]),
        blossom(12.0, [0.95, 0.75, 0.08], [0.3, 0.15, 0.05]),
        blossom(6.0, [0.45, 0.2, 0.75], [0.95, 0.9, 0.4]),
    ]
    .map(|mips| scene.cut_out(mips));
    let blade = scene.cut_out(leaves(24, [0.15, 0.34, 0.06], seed + 3));
    let card = scene.mesh(Mesh::quad());
    // A card that stands on its root.
    let standing = scene.mesh(Mesh::quad().transformed(DMat4::from_translation(DVec3::Y * 0.5)));
    let places: Vec<_> = (0..620)
        .map(|_| DVec3::new(random.between(-5.0, 5.0), 0.0, random.between(-7.0, 2.6)))
        .collect();
    for at in &places {
        let turn = DMat4::from_rotation_y(random.between(0.0, TAU));
        let scale = DVec3::new(0.5, random.between(0.35, 0.6), 0.5);
        let tone = random.between(0.6, 1.3) as f32;
        let placement = swaying(*at, turn, scale, 1.1 * at.x + 0.4 * at.z);
        scene.add(standing, blade, [tone, tone, tone, 1.0], placement);
    }
    for kind in kinds {
        for at in places.iter().step_by(4) {
            let offset = DVec3::new(random.between(-0.5, 0.5), 0.0, random.between(-0.5, 0.5));
            let height = random.between(0.4, 0.8);
            let turn = DMat4::from_translation(DVec3::Y * height)
                * DMat4::from_rotation_y(random.between(-0.7, 0.7))
                * DMat4::from_rotation_x(random.between(-1.1, -0.2));
            let size = DVec3::splat(random.between(0.16, 0.34));
            let placement = swaying(*at + offset, turn, size, 1.1 * at.x + 0.4 * at.z);
            scene.add(card, kind, [1.0; 4], placement);
        }
    }
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(0.3, 0.9, 0.6),
        sun_color: [1.2, 1.1, 0.95],
        ambient: 0.6,
        ..Lighting::default()
    });
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-0.4 + 0.02 * time, 0.95, 3.6);
        Pose::look(eye, DVec3::new(0.0 + 0.01 * time, 0.45, 0.0), 50.0)
    });
    scene
}
