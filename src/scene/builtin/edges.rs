//! Hard edges: pipes, blinds, windows, wires, checkers, a town far away.

use super::parts::{bar, bars, block, bricks, ground, plaster, wood};
use crate::{
    random::Random,
    scene::{
        mesh::placed,
        model::{Filter, Lighting, Material, Mesh, Pose, Scene, ShadowRegion},
        texture::Mips,
    },
};
use glam::{DMat4, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A pipe with flanges before a dark wall, turned by `tilt` radians about the view.
fn pipe_turned(seed: u64, tilt: f64) -> Scene {
    let mut scene = Scene::default();
    let wall = scene.matt(plaster([0.07, 0.09, 0.13], 0.3, seed));
    let white = scene.plain([0.92, 0.92, 0.9]);
    let red = scene.plain([0.8, 0.12, 0.08]);
    let panel = scene.mesh(Mesh::panel(4, DVec2::splat(3.0)));
    scene.place(
        panel,
        wall,
        placed(DVec3::new(0.0, 0.0, -2.0), DVec3::new(16.0, 10.0, 1.0), 0.0),
    );
    let tube = scene.mesh(Mesh::cylinder(64));
    let turn = DMat4::from_rotation_z(tilt);
    let mut put = |x: f64, y: f64, diameter: f64, length: f64, material| {
        let at = DMat4::from_translation(DVec3::new(x, y, 0.0));
        scene.place(
            tube,
            material,
            turn * at * DMat4::from_scale(DVec3::new(diameter, length, diameter)),
        );
    };
    for (x, diameter) in [
        (-1.9, 0.7),
        (-0.7, 0.35),
        (0.1, 0.16),
        (0.6, 0.07),
        (0.9, 0.03),
        (1.15, 0.012),
    ] {
        put(x, 0.0, diameter, 9.0, white);
        if diameter > 0.1 {
            for y in [-1.2, 0.9] {
                put(x, y, 1.35 * diameter, 0.12, red);
            }
        }
    }
    put(2.1, 0.0, 0.5, 9.0, red);
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(0.1 + 0.0062 * time, 0.0031 * time, 4.6);
        Pose::look(eye, eye - DVec3::Z, 42.0)
    });
    scene
}

pub fn pipe(seed: u64) -> Scene {
    pipe_turned(seed, 0.0)
}

pub fn pipe_tilted(seed: u64) -> Scene {
    // A slope of about 1 in 11: the longest stairs are eleven pixels.
    pipe_turned(seed, 0.09)
}

/// A wall with an opening of the given half width and height about the origin, and the room's sides.
fn wall_around(scene: &mut Scene, material: usize, half: DVec2) {
    let cube = scene.mesh(Mesh::cube());
    let far = DVec2::new(6.0, 4.0);
    for side in [-1.0, 1.0] {
        let (a, b) = (
            DVec3::new(side * half.x, -far.y, -0.15),
            DVec3::new(side * far.x, far.y, 0.15),
        );
        scene.place(cube, material, block(a.min(b), a.max(b)));
        let (a, b) = (
            DVec3::new(-half.x, side * half.y, -0.15),
            DVec3::new(half.x, side * far.y, 0.15),
        );
        scene.place(cube, material, block(a.min(b), a.max(b)));
    }
}

/// Hills, houses and a path outside a window.
fn outdoors(scene: &mut Scene, seed: u64) {
    let earth = scene.matt(ground(seed));
    let floor = scene.mesh(Mesh::floor(12, DVec2::splat(20.0)));
    scene.place(
        floor,
        earth,
        placed(DVec3::new(0.0, -2.2, -32.0), DVec3::new(80.0, 1.0, 60.0), 0.0),
    );
    let wall = scene.matt(bricks(seed + 1));
    let cube = scene.mesh(Mesh::cube());
    for (x, z, w, h) in [(-4.0, -13.0, 3.5, 3.0), (3.6, -17.0, 4.0, 4.4), (0.2, -26.0, 5.0, 3.4)] {
        scene.place(
            cube,
            wall,
            placed(DVec3::new(x, 0.5 * h - 2.2, z), DVec3::new(w, h, w), 0.4),
        );
    }
}

fn indoors() -> Lighting {
    Lighting {
        sun_direction: DVec3::new(0.4, 0.5, -1.0),
        sun_color: [2.2, 2.0, 1.7],
        sky_zenith: [0.5, 0.75, 1.25],
        sky_horizon: [1.3, 1.4, 1.5],
        ambient: 0.22,
        ..Lighting::default()
    }
}

pub fn blinds(seed: u64) -> Scene {
    let mut scene = Scene::default();
    outdoors(&mut scene, seed);
    let paper = scene.matt(plaster([0.55, 0.5, 0.42], 0.25, seed + 3));
    wall_around(&mut scene, paper, DVec2::new(1.7, 1.15));
    let frame = scene.plain([0.75, 0.72, 0.68]);
    let slat = scene.material(Material {
        color: [0.8, 0.78, 0.74],
        translucency: 0.15,
        ..Material::default()
    });
    let cube = scene.mesh(Mesh::cube());
    for x in [-0.57, 0.57] {
        scene.place(
            cube,
            frame,
            placed(DVec3::new(x, 0.0, -0.1), DVec3::new(0.06, 2.3, 0.06), 0.0),
        );
    }
    for i in 0..58 {
        let y = 1.12 - 0.039 * f64::from(i);
        let at = DMat4::from_translation(DVec3::new(0.0, y, 0.05)) * DMat4::from_rotation_x(0.45);
        scene.place(cube, slat, at * DMat4::from_scale(DVec3::new(3.36, 0.0035, 0.034)));
    }
    let cord = scene.mesh(Mesh::cylinder(6));
    for x in [-1.3, -0.45, 0.45, 1.3] {
        let (from, to) = (DVec3::new(x, -1.15, 0.075), DVec3::new(x, 1.15, 0.075));
        scene.place(cord, frame, bar(from, to, 0.006));
    }
    scene.lighting = Box::new(|_| indoors());
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(0.6 - 0.008 * time, 0.1 + 0.004 * time, 3.4);
        Pose::look(eye, DVec3::new(0.05, 0.0, 0.0), 46.0)
    });
    scene
}

pub fn arched_window(seed: u64) -> Scene {
    const HALF: f64 = 1.2;
    const SILL: f64 = -1.3;
    let mut scene = Scene::default();
    outdoors(&mut scene, seed);
    let stone = scene.matt(plaster([0.5, 0.44, 0.36], 0.4, seed + 3));
    let lead = scene.plain([0.06, 0.06, 0.07]);
    wall_around(&mut scene, stone, DVec2::new(HALF, 1.5));
    // Between the rectangle and the arch, whose middle is at the origin; and the arch's underside.
    let spandrel = Mesh::grid(48, 1, |u, v| {
        let angle = PI * (1.0 - u);
        let inner = DVec2::new(libm::cos(angle), libm::sin(angle)) * HALF;
        let p = inner.lerp(DVec2::new(inner.x, 1.5), v);
        (p.extend(0.15), DVec3::Z, p * 0.4)
    });
    let soffit = Mesh::grid(48, 1, |u, v| {
        let angle = PI * u;
        let out = DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
        (out * HALF + DVec3::Z * (0.15 - 0.3 * v), -out, DVec2::new(u, v))
    });
    let mut arch = spandrel;
    arch.append(&soffit, DMat4::IDENTITY);
    let arch = scene.mesh(arch);
    scene.place(arch, stone, DMat4::IDENTITY);
    let cube = scene.mesh(Mesh::cube());
    scene.place(
        cube,
        stone,
        block(DVec3::new(-HALF, -1.6, -0.15), DVec3::new(HALF, SILL, 0.3)),
    );
    let spokes = (1..12).map(|i| {
        let angle = PI * f64::from(i) / 12.0;
        let out = DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
        (out * 0.3, out * HALF, 0.022)
    });
    let uprights = (-4..=4).map(|i| {
        let x = 0.24 * f64::from(i);
        (DVec3::new(x, SILL, 0.0), DVec3::new(x, 0.0, 0.0), 0.02)
    });
    let across = (0..6).map(|i| {
        let y = -0.24 * f64::from(i);
        (
            DVec3::new(-HALF, y, 0.0),
            DVec3::new(HALF, y, 0.0),
            if i == 0 { 0.06 } else { 0.02 },
        )
    });
    let came = scene.mesh(bars(spokes.chain(uprights).chain(across), 8));
    scene.place(came, lead, DMat4::IDENTITY);
    for radius in [0.3, 0.75] {
        let ring = scene.mesh(Mesh::torus(radius, 0.011, 64, 6));
        scene.place(ring, lead, DMat4::from_rotation_x(FRAC_PI_2));
    }
    scene.lighting = Box::new(|_| indoors());
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-0.9 + 0.011 * time, -0.25, 3.3);
        Pose::look(eye, DVec3::new(0.0, 0.0, 0.0), 50.0)
    });
    scene
}

pub fn far_edges(seed: u64) -> Scene {
    let mut scene = Scene::default();
    let mut random = Random::new(seed);
    let windows = Mips::paint(256, |u, v| {
        let (x, y) = ((u * 8.0).rem_euclid(1.0), (v * 12.0).rem_euclid(1.0));
        let lit = (0.25..0.75).contains(&x) && (0.3..0.75).contains(&y);
        if lit {
            [0.05, 0.07, 0.1, 1.0]
        } else {
            [0.85, 0.83, 0.78, 1.0]
        }
    });
    let facade = scene.matt(windows);
    let dark = scene.plain([0.08, 0.08, 0.09]);
    let earth = scene.matt(ground(seed + 1));
    let floor = scene.mesh(Mesh::floor(24, DVec2::splat(80.0)));
    scene.place(
        floor,
        earth,
        placed(DVec3::new(0.0, 0.0, -150.0), DVec3::new(600.0, 1.0, 600.0), 0.0),
    );
    let cube = scene.mesh(Mesh::cube());
    let rod = scene.mesh(Mesh::cylinder(5));
    let mut roofs = Vec::new();
    for _ in 0..230 {
        let at = DVec3::new(random.between(-130.0, 130.0), 0.0, -random.between(90.0, 300.0));
        let (width, height) = (random.between(4.0, 12.0), 6.0 + 40.0 * random.unit() * random.unit());
        let tone = random.between(0.45, 1.0) as f32;
        let placement = placed(
            at + DVec3::Y * 0.5 * height,
            DVec3::new(width, height, width),
            random.between(0.0, 0.5),
        );
        let tint = [tone, tone * 0.95, tone * 0.9, 1.0];
        scene.add(cube, facade, tint, crate::scene::model::Placement::Fixed(placement));
        roofs.push((at + DVec3::Y * height, height));
    }
    for (at, height) in roofs {
        if height > 18.0 {
            scene.place(rod, dark, bar(at, at + DVec3::Y * 9.0, 0.25));
        }
    }
    // A crane's lattice and a line of pylons with their wires.
    let mut wires = Vec::new();
    for i in 0..9 {
        let x = -100.0 + 25.0 * f64::from(i);
        let (foot, top) = (DVec3::new(x, 0.0, -85.0), DVec3::new(x, 17.0, -85.0));
        wires.push((foot, top, 0.35));
        for y in [13.0, 16.0] {
            wires.push((DVec3::new(x, y, -88.0), DVec3::new(x, y, -82.0), 0.2));
            for z in [-88.0, -82.0] {
                wires.push((DVec3::new(x, y, z), DVec3::new(x + 25.0, y, z), 0.06));
            }
        }
    }
    let wires = scene.mesh(bars(wires, 4));
    scene.place(wires, dark, DMat4::IDENTITY);
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(-0.8, 0.7, 0.5),
        sun_color: [1.2, 1.1, 0.95],
        ..Lighting::default()
    });
    scene.camera = Box::new(|time, _| {
        let yaw = 0.0016 * time;
        let eye = DVec3::new(0.15 * time, 14.0, 0.0);
        Pose::look(eye, eye + DVec3::new(libm::sin(yaw), 0.01, -libm::cos(yaw)), 40.0)
    });
    scene
}

/// Diagonal wires both ways, 2 wide and 2 high.
fn chain_link() -> Mesh {
    let mut wires = Vec::new();
    for i in -18..18 {
        let x = 0.11 * f64::from(i);
        for (lean, z) in [(1.0, 0.006), (-1.0, -0.006)] {
            let (mut a, mut b) = (DVec3::new(x, -1.0, z), DVec3::new(x + 2.0 * lean, 1.0, z));
            // Cut off at the posts.
            for side in [-1.0, 1.0] {
                let cut = |from: DVec3, to: DVec3| {
                    let t = (side * 1.0 - from.x) / (to.x - from.x);
                    from + (to - from) * t
                };
                if (side * a.x) > 1.0 {
                    a = cut(a, b);
                }
                if (side * b.x) > 1.0 {
                    b = cut(a, b);
                }
            }
            if a.x.abs() <= 1.001 && b.x.abs() <= 1.001 && (b - a).length() > 0.05 {
                wires.push((a, b, 0.011));
            }
        }
    }
    bars(wires, 5)
}

pub fn fence(seed: u64) -> Scene {
    let mut scene = Scene::default();
    outdoors(&mut scene, seed);
    let steel = scene.material(Material {
        color: [0.62, 0.64, 0.66],
        roughness: Some(0.45),
        ..Material::default()
    });
    let link = scene.mesh(chain_link());
    let post = scene.mesh(Mesh::cylinder(12));
    for i in -3..4 {
        let x = 2.0 * f64::from(i);
        scene.place(link, steel, DMat4::from_translation(DVec3::new(x, -1.0, -1.2)));
    }
    for i in -3..5 {
        let x = 2.0 * f64::from(i) - 1.0;
        let (from, to) = (DVec3::new(x, -2.2, -1.2), DVec3::new(x, 0.15, -1.2));
        scene.place(post, steel, bar(from, to, 0.06));
    }
    let black = scene.plain([0.04, 0.04, 0.045]);
    let wires = (0..14).map(|i| {
        let (y, z) = (0.9 + 0.13 * f64::from(i), -4.0 - 1.3 * f64::from(i));
        (DVec3::new(-14.0, y + 0.3, z), DVec3::new(14.0, y, z), 0.012)
    });
    let wires = scene.mesh(bars(wires, 5));
    scene.place(wires, black, DMat4::IDENTITY);
    let mut wheel = Mesh::torus(0.8, 0.025, 64, 8);
    let spokes = (0..36).map(|i| {
        let angle = TAU * f64::from(i) / 36.0;
        (
            DVec3::ZERO,
            DVec3::new(0.8 * libm::cos(angle), 0.0, 0.8 * libm::sin(angle)),
            0.006,
        )
    });
    wheel.append(&bars(spokes, 4), DMat4::IDENTITY);
    let wheel = scene.mesh(wheel);
    scene.animate(wheel, steel, |time| {
        DMat4::from_translation(DVec3::new(1.5, -1.2, -2.6))
            * DMat4::from_rotation_x(FRAC_PI_2)
            * DMat4::from_rotation_y(0.035 * time)
    });
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-0.4 + 0.014 * time, -0.5, 2.2);
        Pose::look(eye, DVec3::new(0.0 + 0.008 * time, -0.55, -3.0), 55.0)
    });
    scene
}

/// Side of a square of [`checker`].
const CHECKER_SIDE: f64 = 0.5;
const CHECKER_COLORS: [u8; 2] = [245, 60];

/// Colour at a point of [`checker`]'s floor.
pub fn checker_color(on_floor: DVec3) -> f32 {
    let cell = |v: f64| libm::floor(v / CHECKER_SIDE);
    let odd = (cell(on_floor.x) + cell(on_floor.z)).rem_euclid(2.0) > 0.5;
    let c = f64::from(CHECKER_COLORS[usize::from(odd)]) / 255.0;
    libm::pow((c + 0.055) / 1.055, 2.4) as f32
}

pub fn checker(_seed: u64) -> Scene {
    let mut scene = Scene::default();
    let texture = Some(scene.texture(Mips::paint(2, |u, v| {
        // The squares around the origin.
        let c = checker_color(DVec3::new(u - 0.5, 0.0, v - 0.5) * 2.0 * CHECKER_SIDE);
        [c, c, c, 1.0]
    })));
    let squares = scene.material(Material {
        color: [1.0; 3],
        texture,
        filter: Filter::Nearest,
        emissive: [1.0; 3],
        lit: false,
        ..Material::default()
    });
    const SIDE: f64 = 400.0;
    let floor = scene.mesh(Mesh::floor(100, DVec2::splat(SIDE / (2.0 * CHECKER_SIDE))));
    scene.place(floor, squares, placed(DVec3::ZERO, DVec3::new(SIDE, 1.0, SIDE), 0.0));
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(0.02 * time, 1.2, -0.05 * time);
        Pose::look(eye, eye + DVec3::new(0.25, -0.13, -1.0), 55.0)
    });
    scene
}

/// A façade whose balconies have fine railings, chairs of slats, and awnings of stripes.
pub fn balcony(seed: u64) -> Scene {
    let mut scene = Scene::default();
    let wall = scene.matt(bricks(seed));
    let stone = scene.matt(plaster([0.7, 0.66, 0.6], 0.25, seed + 1));
    let planks = scene.matt(wood(16, seed + 2));
    let stripes = scene.matt(Mips::paint(512, |u, v| {
        let stripe = (u * 24.0).rem_euclid(1.0) < 0.5;
        let weave = 0.9 + 0.1 * ((libm::floor(u * 256.0) + libm::floor(v * 256.0)).rem_euclid(2.0)) as f32;
        if stripe {
            [0.85 * weave, 0.82 * weave, 0.75 * weave, 1.0]
        } else {
            [0.1, 0.25 * weave, 0.4 * weave, 1.0]
        }
    }));
    let weave = scene.matt(Mips::paint(512, |u, v| {
        // Herringbone: zigzags of two tones.
        let zigzag = libm::fabs((u * 16.0).rem_euclid(2.0) - 1.0);
        let band = (v * 40.0 + 4.0 * zigzag).rem_euclid(1.0);
        if band < 0.5 {
            [0.62, 0.5, 0.36, 1.0]
        } else {
            [0.2, 0.13, 0.09, 1.0]
        }
    }));
    let iron = scene.plain([0.05, 0.055, 0.06]);
    let dark = scene.plain([0.03, 0.04, 0.05]);
    let (panel, cube) = (
        scene.mesh(Mesh::panel(8, DVec2::new(8.0, 5.0))),
        scene.mesh(Mesh::cube()),
    );
    scene.place(
        panel,
        wall,
        placed(DVec3::new(0.0, 2.5, -1.2), DVec3::new(16.0, 10.0, 1.0), 0.0),
    );
    let railing = scene.mesh(railing());
    let chair = scene.mesh(chair());
    for (x, y) in [(-2.3, 0.0), (2.3, 0.0), (-2.3, 3.2), (2.3, 3.2)] {
        let at = DVec3::new(x, y, 0.0);
        scene.place(
            cube,
            stone,
            block(at + DVec3::new(-1.9, -0.2, -1.2), at + DVec3::new(1.9, 0.0, 0.05)),
        );
        scene.place(
            cube,
            dark,
            block(at + DVec3::new(-0.6, 0.0, -1.21), at + DVec3::new(0.6, 2.1, -1.18)),
        );
        scene.place(railing, iron, DMat4::from_translation(at));
        scene.place(
            chair,
            planks,
            placed(at + DVec3::new(-1.05, 0.0, -0.55), DVec3::ONE, 0.5),
        );
        scene.place(
            chair,
            planks,
            placed(at + DVec3::new(0.95, 0.0, -0.6), DVec3::ONE, -0.4),
        );
        for (dx, turn) in [(-1.05, 0.5), (0.95, -0.4)] {
            let seat = placed(at + DVec3::new(dx, 0.47, -0.57), DVec3::new(0.42, 0.05, 0.42), turn);
            scene.place(cube, weave, seat);
        }
        let awning = DMat4::from_translation(at + DVec3::new(0.0, 2.55, -0.75)) * DMat4::from_rotation_x(0.5);
        scene.place(cube, stripes, awning * DMat4::from_scale(DVec3::new(3.4, 0.03, 1.1)));
    }
    scene.shadows = Some(ShadowRegion {
        center: DVec3::new(0.0, 2.5, -0.5),
        radius: 8.0,
        side: 1536,
    });
    scene.lighting = Box::new(|_| Lighting {
        sun_direction: DVec3::new(0.5, 0.9, 0.9),
        sun_color: [1.7, 1.55, 1.3],
        ..Lighting::default()
    });
    scene.camera = Box::new(|time, _| {
        let eye = DVec3::new(-1.9 + 0.03 * time, 1.75, 5.2);
        Pose::look(eye, DVec3::new(-1.1 + 0.012 * time, 1.6, 0.0), 46.0)
    });
    scene
}

fn railing() -> Mesh {
    let upright = |x: f64| (DVec3::new(x, 0.0, 0.0), DVec3::new(x, 0.95, 0.0), 0.016);
    let mut mesh = bars((0..48).map(|i| upright(-1.88 + 0.08 * f64::from(i))), 5);
    for y in [0.06, 0.95] {
        mesh.append(&Mesh::cube(), placed(DVec3::Y * y, DVec3::new(3.8, 0.03, 0.05), 0.0));
    }
    mesh
}

fn chair() -> Mesh {
    let cube = Mesh::cube();
    let mut mesh = Mesh::default();
    for (x, z) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)] {
        let height = if z < 0.0 { 0.95 } else { 0.45 };
        mesh.append(
            &cube,
            placed(DVec3::new(x, 0.5 * height, z), DVec3::new(0.035, height, 0.035), 0.0),
        );
    }
    for i in 0..7 {
        let z = -0.2 + 0.067 * f64::from(i);
        mesh.append(
            &cube,
            placed(DVec3::new(0.0, 0.45, z), DVec3::new(0.44, 0.015, 0.04), 0.0),
        );
    }
    for i in 0..8 {
        let y = 0.55 + 0.05 * f64::from(i);
        mesh.append(
            &cube,
            placed(DVec3::new(0.0, y, -0.2), DVec3::new(0.4, 0.018, 0.012), 0.0),
        );
    }
    mesh
}
