//! Frames of a cell, to be looked at.

use super::difference::display;
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};
use std::collections::BTreeSet;

/// What adapter and twin showed in the first frame, in the worst and the disturbed with those before and after them, and in the last.
#[derive(Clone, Debug)]
pub struct Pictures {
    frames: Vec<Picture>,
    /// Where they differ most.
    worst: [u32; 2],
}

/// Of one frame, linear RGB.
#[derive(Clone, Debug)]
pub struct Picture {
    pub frame: usize,
    /// What the adapter showed.
    pub found: Image<Rgb>,
    /// What the f64 twin would show.
    pub expected: Image<Rgb>,
}

/// Of what is shown around the worst pixel, pixels.
const MAX_SIDE: u32 = 96;
/// Pixels of the picture between its parts.
const GAP: u32 = 4;

impl Pictures {
    /// Of `n` frames that `picture` has, those that tell what happened: around the worst, whose worst pixel is `pixel`, and around
    /// the one that was disturbed.
    pub fn around(
        pixel: [u32; 2],
        worst: usize,
        disturbed: Option<usize>,
        n: usize,
        picture: impl Fn(usize) -> Picture,
    ) -> Self {
        let last = n - 1;
        let mut chosen = BTreeSet::from([0, last]);
        for index in disturbed.into_iter().chain([worst]) {
            chosen.extend([index.saturating_sub(1), index, (index + 1).min(last)]);
        }
        Self {
            frames: chosen.into_iter().map(picture).collect(),
            worst: pixel,
        }
    }

    /// Which frames, in the order of their rows.
    pub fn frames(&self) -> Vec<usize> {
        self.frames.iter().map(|picture| picture.frame).collect()
    }

    /// A row a frame: adapter, twin, and their difference as many times enlarged as makes its largest in any row white, as PNG.
    /// Values that are not finite are magenta.
    pub fn png(&self) -> Vec<u8> {
        let size = self.frames[0].found.extent();
        let side = Extent::new(size.width.min(MAX_SIDE), size.height.min(MAX_SIDE));
        let first = [(side.width, size.width, 0), (side.height, size.height, 1)]
            .map(|(shown, of, axis)| self.worst[axis].saturating_sub(shown / 2).min(of - shown));
        // Small images are enlarged, so that a pixel can be seen.
        let scale = (MAX_SIDE / side.width.max(side.height)).clamp(1, 8);
        let at = |image: &Image<Rgb>, x: u32, y: u32| image.at(first[0] + x, first[1] + y);
        let gap = |picture: &Picture, x: u32, y: u32| {
            let (a, b) = (at(&picture.found, x, y), at(&picture.expected, x, y));
            [0, 1, 2].map(|c| (display(a[c].into()) - display(b[c].into())).abs())
        };
        let mut largest = 1e-6_f64;
        for picture in &self.frames {
            for i in 0..side.n_pixels() as u32 {
                let differences = gap(picture, i % side.width, i / side.width);
                largest = differences
                    .into_iter()
                    .filter(|d| d.is_finite())
                    .fold(largest, f64::max);
            }
        }
        let part = Extent::new(side.width * scale, side.height * scale);
        let width = 3 * part.width + 2 * GAP;
        let height = (part.height + GAP) * self.frames.len() as u32 - GAP;
        let mut bytes = Vec::with_capacity((width * height * 3) as usize);
        for y in 0..height {
            let picture = &self.frames[(y / (part.height + GAP)) as usize];
            let inner_y = y % (part.height + GAP);
            for x in 0..width {
                let inner_x = x % (part.width + GAP);
                if inner_x >= part.width || inner_y >= part.height {
                    bytes.extend([255; 3]);
                    continue;
                }
                let (of_part, x, y) = (x / (part.width + GAP), inner_x / scale, inner_y / scale);
                let shown = |rgb: Rgb| match rgb.iter().all(|c| c.is_finite()) {
                    true => rgb.map(|c| code(display(c.into()))),
                    false => [255, 0, 255],
                };
                bytes.extend(match of_part {
                    0 => shown(at(&picture.found, x, y)),
                    1 => shown(at(&picture.expected, x, y)),
                    _ => match gap(picture, x, y) {
                        d if d.iter().all(|d| d.is_finite()) => d.map(|d| code(d / largest)),
                        _ => [255, 0, 255],
                    },
                });
            }
        }
        encoded(width, height, &bytes)
    }
}

/// Of a value from 0 to 1.
fn code(value: f64) -> u8 {
    (libm::sqrt(value.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8
}

fn encoded(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(rgb));
    written.expect("a picture of at least one pixel is written to memory");
    file
}
