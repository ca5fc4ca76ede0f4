//! The worst frame of a cell, to be looked at.

use super::difference::display;
use crate::{
    image::{Extent, Image},
    sequence::frame::Rgb,
};

/// The worst frame, linear RGB.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// What the adapter showed.
    pub found: Image<Rgb>,
    /// What the f64 twin would show.
    pub expected: Image<Rgb>,
    /// Where they differ most.
    pub worst: [u32; 2],
}

/// Of what is shown around the worst pixel, pixels.
const MAX_SIDE: u32 = 96;
/// Pixels of the picture between its three parts.
const GAP: u32 = 4;

impl Pictures {
    /// Adapter, twin, and their difference as many times enlarged as makes its largest white: side by side, as PNG. Values that
    /// are not finite are magenta.
    pub fn png(&self) -> Vec<u8> {
        let size = self.found.extent();
        let side = Extent::new(size.width.min(MAX_SIDE), size.height.min(MAX_SIDE));
        let first = [
            self.worst[0]
                .saturating_sub(side.width / 2)
                .min(size.width - side.width),
            self.worst[1]
                .saturating_sub(side.height / 2)
                .min(size.height - side.height),
        ];
        // Small images are enlarged, so that a pixel can be seen.
        let scale = (MAX_SIDE / side.width.max(side.height)).clamp(1, 8);
        let at = |image: &Image<Rgb>, x: u32, y: u32| image.at(first[0] + x, first[1] + y);
        let gap = |x: u32, y: u32| {
            let (a, b) = (at(&self.found, x, y), at(&self.expected, x, y));
            [0, 1, 2].map(|c| (display(a[c].into()) - display(b[c].into())).abs())
        };
        let mut largest = 1e-6_f64;
        for y in 0..side.height {
            for x in 0..side.width {
                gap(x, y)
                    .into_iter()
                    .filter(|d| d.is_finite())
                    .for_each(|d| largest = largest.max(d));
            }
        }
        let width = (3 * side.width) * scale + 2 * GAP;
        let height = side.height * scale;
        let mut bytes = Vec::with_capacity((width * height * 3) as usize);
        for y in 0..height {
            for x in 0..width {
                let part = x / (side.width * scale + GAP);
                let inner = x % (side.width * scale + GAP);
                if inner >= side.width * scale {
                    bytes.extend([255; 3]);
                    continue;
                }
                let (x, y) = (inner / scale, y / scale);
                let shown = |rgb: Rgb| match rgb.iter().all(|c| c.is_finite()) {
                    true => rgb.map(|c| code(display(c.into()))),
                    false => [255, 0, 255],
                };
                bytes.extend(match part {
                    0 => shown(at(&self.found, x, y)),
                    1 => shown(at(&self.expected, x, y)),
                    _ => match gap(x, y) {
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
