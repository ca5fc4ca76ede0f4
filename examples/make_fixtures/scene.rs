//! A tiny analytic scene: a checkered wall with thin lines under a sky, a striped box in front of it, perhaps a lamp.
//! Everything is known exactly at every position, so that tests can ask it for the truth about the fixtures. Only
//! `libm` is used for what differs between platforms.

use std::f64::consts::PI;

/// A camera that looks along −z when `yaw` is 0 and turns right as it grows.
#[derive(Clone, Copy)]
pub struct Pose {
    pub x: f64,
    pub yaw: f64,
}

pub const NEAR: f64 = 0.1;
pub const FAR: f64 = 100.0;
pub const SKY: f64 = 1e10;
const EYE_HEIGHT: f64 = 0.2;
const FOCAL: f64 = 1.6;
const WALL_Z: f64 = -8.0;
const WALL_TOP: f64 = 2.5;
const BOX_Z: f64 = -5.0;
const BOX_HALF_SIDE: f64 = 0.8;

/// What moves, by frame. `frame` may be −1: the one before the first.
#[derive(Clone, Copy)]
pub struct Scene {
    pub size: [u32; 2],
    pub pose: fn(frame: i64) -> Pose,
    pub box_x: fn(frame: i64) -> f64,
    pub has_lamp: bool,
}

/// The frame at which [`PAN`] cuts to another place.
pub const CUT: i64 = 6;

pub const PAN: Scene = Scene {
    size: [64, 48],
    pose: |frame| {
        let start = if frame < CUT { 0.0 } else { -2.5 };
        Pose {
            x: start + 0.13 * frame as f64,
            yaw: 0.011 * frame as f64 - 0.1 * start,
        }
    },
    box_x: |frame| 0.09 * frame as f64 - 0.6,
    has_lamp: false,
};

/// The same in the size of the engine's dump.
pub const ENGINE: Scene = Scene { size: [48, 32], ..PAN };

/// The same at half of [`PAN`]'s size, to be upscaled to it.
pub const UPSCALE: Scene = Scene { size: [32, 24], ..PAN };

pub const STATIC: Scene = Scene {
    size: [61, 37],
    pose: |_| Pose { x: 0.3, yaw: 0.0 },
    box_x: |_| 0.5,
    has_lamp: true,
};

/// What one position of one frame sees, in canonical form.
pub struct Sample {
    pub color: [f64; 3],
    pub albedo: [f64; 3],
    /// Along the view axis.
    pub depth: f64,
    /// From the eye.
    pub distance: f64,
    pub motion_px: [f64; 2],
    /// 0 sky, 1 wall, 2 box, 3 lamp.
    pub object_id: u32,
}

impl Scene {
    fn focal(&self) -> [f64; 2] {
        let [width, height] = self.size.map(f64::from);
        [FOCAL, FOCAL * width / height]
    }

    /// World to view in rows; view space looks along −z.
    pub fn view(&self, frame: i64) -> [[f64; 4]; 4] {
        let Pose { x, yaw } = (self.pose)(frame);
        let (s, c) = (libm::sin(yaw), libm::cos(yaw));
        [
            [c, 0.0, s, -c * x],
            [0.0, 1.0, 0.0, -EYE_HEIGHT],
            [-s, 0.0, c, s * x],
            [0.0, 0.0, 0.0, 1.0],
        ]
    }

    /// View to clip in rows, as OpenGL has it.
    pub fn projection(&self) -> [[f64; 4]; 4] {
        let [fx, fy] = self.focal();
        let depth_range = FAR - NEAR;
        [
            [fx, 0.0, 0.0, 0.0],
            [0.0, fy, 0.0, 0.0],
            [0.0, 0.0, -(FAR + NEAR) / depth_range, -2.0 * FAR * NEAR / depth_range],
            [0.0, 0.0, -1.0, 0.0],
        ]
    }

    /// What `frame` sees at `position_px` (pixel centres are at halves, y down).
    pub fn sample(&self, frame: i64, position_px: [f64; 2]) -> Sample {
        let Pose { x: eye_x, yaw } = (self.pose)(frame);
        let (s, c) = (libm::sin(yaw), libm::cos(yaw));
        let [width, height] = self.size.map(f64::from);
        let [fx, fy] = self.focal();
        let ray_x = (2.0 * position_px[0] / width - 1.0) / fx;
        let ray_y = (1.0 - 2.0 * position_px[1] / height) / fy;
        // View direction (ray_x, ray_y, −1) in the world; a step of 1 along it is a linear depth of 1.
        let direction = [c * ray_x + s, ray_y, s * ray_x - c];
        let at = |depth: f64| {
            [
                eye_x + depth * direction[0],
                EYE_HEIGHT + depth * direction[1],
                depth * direction[2],
            ]
        };
        let plane = |z: f64| at(z / direction[2]);
        let (albedo, light, object_id, point) = self.surface(frame, plane(BOX_Z), plane(WALL_Z), at(SKY));
        let depth = if object_id == 0 { SKY } else { point[2] / direction[2] };
        let moved = if object_id == 2 {
            (self.box_x)(frame) - (self.box_x)(frame - 1)
        } else {
            0.0
        };
        let previous = self.project(frame - 1, [point[0] - moved, point[1], point[2]]);
        let length = libm::sqrt(ray_x * ray_x + ray_y * ray_y + 1.0);
        Sample {
            color: albedo.map(|a| a * light),
            albedo,
            depth,
            distance: if object_id == 0 { SKY } else { depth * length },
            motion_px: [previous[0] - position_px[0], previous[1] - position_px[1]],
            object_id,
        }
    }

    fn surface(
        &self,
        frame: i64,
        on_box: [f64; 3],
        on_wall: [f64; 3],
        in_sky: [f64; 3],
    ) -> ([f64; 3], f64, u32, [f64; 3]) {
        let local = [on_box[0] - (self.box_x)(frame), on_box[1]];
        if local.iter().all(|side| side.abs() < BOX_HALF_SIDE) {
            let stripe = libm::floor((local[0] + local[1]) * 4.0).rem_euclid(2.0);
            let albedo = if stripe < 0.5 {
                [0.85, 0.8, 0.1]
            } else {
                [0.05, 0.1, 0.3]
            };
            return (albedo, 1.0, 2, on_box);
        }
        if self.has_lamp && (on_wall[0] + 2.0).hypot(on_wall[1] - 1.2) < 0.35 {
            return ([1.0, 0.9, 0.7], 4000.0, 3, on_wall);
        }
        if on_wall[1] < WALL_TOP {
            let light = 0.9 + 0.3 * libm::sin(0.7 * on_wall[0]);
            return (wall(on_wall), light, 1, on_wall);
        }
        ([0.3, 0.5, 0.9], 1.0, 0, in_sky)
    }

    fn project(&self, frame: i64, point: [f64; 3]) -> [f64; 2] {
        let view = self
            .view(frame)
            .map(|row| row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3]);
        let [fx, fy] = self.focal();
        let [width, height] = self.size.map(f64::from);
        [
            (0.5 + 0.5 * fx * view[0] / -view[2]) * width,
            (0.5 - 0.5 * fy * view[1] / -view[2]) * height,
        ]
    }

    /// The mean of 8 × 8 samples spread evenly over the pixel: a box filter of one pixel.
    pub fn reference(&self, frame: i64, x: u32, y: u32) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for i in 0..64 {
            let offset = [(f64::from(i % 8) + 0.5) / 8.0, (f64::from(i / 8) + 0.5) / 8.0];
            let color = self
                .sample(frame, [f64::from(x) + offset[0], f64::from(y) + offset[1]])
                .color;
            (0..3).for_each(|channel| sum[channel] += color[channel] / 64.0);
        }
        sum
    }
}

/// Checkers, with lines thinner than a pixel.
fn wall(point: [f64; 3]) -> [f64; 3] {
    let from_line = |coordinate: f64, spacing: f64| {
        let phase = (coordinate / spacing).rem_euclid(1.0);
        (phase - 0.5).abs() * spacing
    };
    if from_line(point[0] + 0.3 * point[1], 1.3) < 0.03 {
        return [0.95, 0.2, 0.1];
    }
    if from_line(point[1], 0.9) < 0.02 {
        return [0.02, 0.02, 0.02];
    }
    let parity = (libm::floor(point[0] / 0.6) + libm::floor(point[1] / 0.6)).rem_euclid(2.0);
    if parity < 0.5 {
        [0.8, 0.75, 0.7]
    } else {
        [0.12, 0.15, 0.2]
    }
}

/// The sample offset of `frame` in pixels: Halton's sequence in bases 2 and 3, sixteen long, about 0.
pub fn jitter_px(frame: i64) -> [f64; 2] {
    let i = frame.rem_euclid(16) + 1;
    [radical_inverse(i, 2) - 0.5, radical_inverse(i, 3) - 0.5]
}

fn radical_inverse(mut i: i64, base: i64) -> f64 {
    let (mut digit, mut inverse) = (1.0, 0.0);
    while i > 0 {
        digit /= base as f64;
        inverse += digit * (i % base) as f64;
        i /= base;
    }
    inverse
}

/// How little history may be trusted where `object_id` is seen: only the box is animated in ways motion cannot tell.
pub fn reactive(object_id: u32) -> f64 {
    if object_id == 2 { 0.25 } else { 0.0 }
}

/// A pixel of [`STATIC`]'s hostile frame that is no colour, if this is one.
pub fn hostile(x: u32, y: u32) -> Option<[f64; 3]> {
    match (x, y) {
        (7, 5) => Some([f64::NAN, 0.2, 0.2]),
        (30, 18) => Some([0.1, f64::INFINITY, 0.1]),
        (31, 18) => Some([-1.0, 0.5, 0.5]),
        (60, 36) => Some([f64::NAN, f64::NEG_INFINITY, -0.25]),
        _ => None,
    }
}

/// The frame of [`STATIC`] that has them.
pub const HOSTILE_FRAME: i64 = 3;

/// What frame `frame` of the engine's dump multiplied its colour by.
pub fn exposure(frame: i64) -> f64 {
    0.5 + 0.1 * libm::sin(PI * frame as f64 / 4.0)
}
