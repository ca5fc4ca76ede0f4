//! One value a pixel, read between pixels with its slope.

use crate::{image::Image, sequence::frame::Rgb};

/// A grey image. Values that are no colour are NaN.
pub struct Plane {
    pub width: usize,
    pub height: usize,
    values: Vec<f32>,
}

/// How colours are compared: luma over luma plus `key`, so that a lamp weighs no more than a wall.
#[derive(Clone, Copy, Debug)]
pub struct Tone {
    /// The luminance that becomes one half.
    pub key: f64,
}

impl Tone {
    /// With the geometric mean of `image` as key.
    pub fn of(image: &Image<Rgb>) -> Self {
        let lumas = image
            .pixels()
            .iter()
            .map(|&rgb| luma(rgb))
            .filter(|luma| *luma > 1e-6 && luma.is_finite());
        let (sum, n) = lumas.fold((0.0, 0_usize), |(sum, n), luma| (sum + libm::log(luma), n + 1));
        let key = if n == 0 { 1.0 } else { libm::exp(sum / n as f64) };
        Self { key }
    }

    /// NaN stays NaN; what is negative counts as black.
    pub fn map(self, rgb: Rgb) -> f32 {
        let luma = luma(rgb);
        if luma.is_nan() {
            return f32::NAN;
        }
        let luma = luma.clamp(0.0, 1e12);
        (luma / (luma + self.key)) as f32
    }
}

/// Luminance of linear light.
pub fn luma(rgb: Rgb) -> f64 {
    crate::metrics::display::luma(rgb.map(f64::from))
}

impl Plane {
    pub fn new(image: &Image<Rgb>, tone: Tone) -> Self {
        Self::from_values(
            [image.extent().width as usize, image.extent().height as usize],
            image.map(|rgb| tone.map(rgb)).into_pixels(),
        )
    }

    pub fn from_values([width, height]: [usize; 2], values: Vec<f32>) -> Self {
        Self { width, height, values }
    }

    /// Smoothed by (1, 2, 1) / 4 along both axes, edges repeated: what alternates from pixel to pixel is gone, which the spline
    /// damps by a share that depends on the position between pixels.
    pub fn smoothed(&self) -> Self {
        let (width, height) = (self.width, self.height);
        let along = |values: &[f32], step: usize, place: &dyn Fn(usize) -> [bool; 2]| -> Vec<f32> {
            let smooth = |(i, &own): (usize, &f32)| {
                let [is_first, is_last] = place(i);
                let before = if is_first { own } else { values[i - step] };
                let after = if is_last { own } else { values[i + step] };
                0.25 * before + 0.5 * own + 0.25 * after
            };
            values.iter().enumerate().map(smooth).collect()
        };
        let rows = along(&self.values, 1, &|i| [i % width == 0, i % width + 1 == width]);
        let values = along(&rows, width, &|i| [i < width, i / width + 1 == height]);
        Self::from_values([width, height], values)
    }

    pub fn at(&self, x: usize, y: usize) -> f64 {
        f64::from(self.values[y * self.width + x])
    }

    /// Bilinear; beyond the edge the nearest pixel's.
    pub fn bilinear(&self, [x, y]: [f64; 2]) -> f64 {
        if x.is_nan() || y.is_nan() {
            return f64::NAN;
        }
        let x = (x - 0.5).clamp(0.0, (self.width - 1) as f64);
        let y = (y - 0.5).clamp(0.0, (self.height - 1) as f64);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (tx, ty) = (x - left as f64, y - top as f64);
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        mix(
            mix(self.at(left, top), self.at(right, top), tx),
            mix(self.at(left, bottom), self.at(right, bottom), tx),
            ty,
        )
    }

    /// The Catmull-Rom spline through the pixels, and its slope along x and y; none within two pixels of the edge.
    pub fn spline(&self, position: [f64; 2]) -> Option<(f64, [f64; 2])> {
        let Taps { corner, wx, wy, dx, dy } = self.taps(position)?;
        let (mut value, mut slope) = (0.0, [0.0; 2]);
        for row in 0..4 {
            let pixels = self.row_of_four(corner, row);
            let across = dot(wx, pixels);
            value += wy[row] * across;
            slope[0] += wy[row] * dot(dx, pixels);
            slope[1] += dy[row] * across;
        }
        value.is_finite().then_some((value, slope))
    }

    /// The spline's value; near the edge bilinear.
    pub fn value(&self, position: [f64; 2]) -> f64 {
        let inside = self.taps(position).map(|taps| {
            let rows = (0..4).map(|row| taps.wy[row] * dot(taps.wx, self.row_of_four(taps.corner, row)));
            rows.sum::<f64>()
        });
        match inside {
            Some(value) if value.is_finite() => value,
            _ => self.bilinear(position),
        }
    }

    fn row_of_four(&self, [left, top]: [usize; 2], row: usize) -> &[f32] {
        &self.values[(top + row) * self.width + left..][..4]
    }

    fn taps(&self, [x, y]: [f64; 2]) -> Option<Taps> {
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        if !(left >= 1.0 && top >= 1.0 && left + 2.0 < self.width as f64 && top + 2.0 < self.height as f64) {
            return None;
        }
        let (wx, dx) = weights(x - left);
        let (wy, dy) = weights(y - top);
        let corner = [left as usize - 1, top as usize - 1];
        Some(Taps { corner, wx, wy, dx, dy })
    }
}

/// The 16 pixels around a position, and how much each counts.
struct Taps {
    corner: [usize; 2],
    wx: [f64; 4],
    wy: [f64; 4],
    /// Derivatives of the weights.
    dx: [f64; 4],
    dy: [f64; 4],
}

fn dot(weights: [f64; 4], pixels: &[f32]) -> f64 {
    weights
        .iter()
        .zip(pixels)
        .map(|(weight, pixel)| weight * f64::from(*pixel))
        .sum()
}

/// Catmull-Rom's weights at `t` between the second and the third of four pixels, and their derivatives.
fn weights(t: f64) -> ([f64; 4], [f64; 4]) {
    (
        [
            t * (-0.5 + t * (1.0 - 0.5 * t)),
            1.0 + t * t * (-2.5 + 1.5 * t),
            t * (0.5 + t * (2.0 - 1.5 * t)),
            t * t * (-0.5 + 0.5 * t),
        ],
        [
            -0.5 + t * (2.0 - 1.5 * t),
            t * (-5.0 + 4.5 * t),
            0.5 + t * (4.0 - 4.5 * t),
            t * (-1.0 + 1.5 * t),
        ],
    )
}
