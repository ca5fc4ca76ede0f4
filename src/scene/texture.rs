//! Textures made from formulas, and their smaller levels.
//!
//! Levels are halved by a 2×2 box in linear light, colour weighed by alpha, else what lies behind a hole bleeds into its
//! rim. They are stored as half floats: finer than sRGB in bytes, and on lavapipe cheaper to read.

use crate::{
    image::{Extent, Image},
    random::lattice,
};
use half::f16;

/// An image of linear RGB and alpha, and its halves down to one texel.
#[derive(Clone, Debug)]
pub struct Mips {
    /// From the finest.
    pub levels: Vec<Image<[f16; 4]>>,
}

/// Linear RGB and alpha.
pub type Texel = [f32; 4];

impl Mips {
    /// Computes `side`×`side` texels from their centres' coordinates in [0, 1), then their levels.
    pub fn paint(side: u32, texel: impl Fn(f64, f64) -> Texel + Sync) -> Self {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
        Self::new(Image::from_fn(Extent::new(side, side), |x, y| texel(at(x), at(y))))
    }

    /// The levels of an image.
    pub fn new(finest: Image<Texel>) -> Self {
        let mut levels = vec![stored(&finest)];
        let mut level = finest;
        while level.extent() != Extent::new(1, 1) {
            level = halved(&level);
            levels.push(stored(&level));
        }
        Self { levels }
    }
}

fn halved(image: &Image<Texel>) -> Image<Texel> {
    let Extent { width, height } = image.extent();
    let half = Extent::new((width / 2).max(1), (height / 2).max(1));
    // An odd side leaves its last texel to the last but one, so that none is lost.
    let span = |i: u32, n: u32, n_half: u32| (i * n / n_half)..((i + 1) * n).div_ceil(n_half).min(n);
    Image::from_fn(half, |x, y| {
        let (mut color, mut alpha, mut n) = ([0.0; 3], 0.0, 0.0);
        for v in span(y, height, half.height) {
            for u in span(x, width, half.width) {
                let [r, g, b, a] = image.at(u, v);
                color = [color[0] + a * r, color[1] + a * g, color[2] + a * b];
                alpha += a;
                n += 1.0;
            }
        }
        match alpha > 0.0 {
            true => [color[0] / alpha, color[1] / alpha, color[2] / alpha, alpha / n],
            // All of it a hole: its colour still shows through bilinear rims.
            false => {
                let [r, g, b, _] = image.at((2 * x).min(width - 1), (2 * y).min(height - 1));
                [r, g, b, 0.0]
            }
        }
    })
}

fn stored(image: &Image<Texel>) -> Image<[f16; 4]> {
    image.map(|texel| texel.map(f16::from_f32))
}

/// Smooth noise in [0, 1] that repeats after `period` cells.
pub fn value_noise(u: f64, v: f64, period: i64, seed: u64) -> f64 {
    let (x, y) = (u * period as f64, v * period as f64);
    let (x0, y0) = (libm::floor(x), libm::floor(y));
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (ease(x - x0), ease(y - y0));
    let corner = |dx: i64, dy: i64| {
        let cell = |origin: f64, d: i64| (origin as i64 + d).rem_euclid(period);
        lattice(cell(x0, dx), cell(y0, dy), seed)
    };
    let row = |dy: i64| corner(0, dy) + (corner(1, dy) - corner(0, dy)) * fx;
    row(0) + (row(1) - row(0)) * fy
}

/// Noise of several scales, each half as strong and twice as fine as the one before; in [0, 1].
pub fn fractal_noise(u: f64, v: f64, period: i64, octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for octave in 0..octaves {
        sum += weight * value_noise(u, v, period << octave, seed + u64::from(octave));
        total += weight;
        weight *= 0.5;
    }
    sum / total
}

/// An opaque texel between two colours.
pub fn blend(a: [f32; 3], b: [f32; 3], t: f64) -> Texel {
    let t = t.clamp(0.0, 1.0) as f32;
    let mix = |i: usize| a[i] + (b[i] - a[i]) * t;
    [mix(0), mix(1), mix(2), 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_average_light() {
        let mips = Mips::paint(4, |u, v| match ((u * 4.0) as u32 + (v * 4.0) as u32) % 2 {
            0 => [0.0, 0.0, 0.0, 1.0],
            _ => [1.0, 1.0, 1.0, 1.0],
        });
        assert_eq!(mips.levels.len(), 3);
        let grey = [0.5, 0.5, 0.5, 1.0].map(f16::from_f32);
        for level in &mips.levels[1..] {
            assert!(level.pixels().iter().all(|texel| *texel == grey), "{level:?}");
        }
    }

    #[test]
    fn holes_do_not_bleed() {
        let mips = Mips::paint(2, |u, _| match u < 0.5 {
            true => [0.0, 1.0, 0.0, 1.0],
            false => [1.0, 0.0, 1.0, 0.0],
        });
        assert_eq!(mips.levels[1].pixels(), [[0.0, 1.0, 0.0, 0.5].map(f16::from_f32)]);
    }

    #[test]
    fn odd_sides_lose_no_texel() {
        let image = Image::from_fn(Extent::new(3, 1), |x, _| [x as f32 / 2.0, 0.0, 0.0, 1.0]);
        assert_eq!(halved(&image).pixels(), [[0.5, 0.0, 0.0, 1.0]]);
    }

    #[test]
    fn noise_repeats_and_stays_in_range() {
        for i in 0..50 {
            let u = f64::from(i) * 0.037;
            let here = fractal_noise(u, 0.3, 4, 3, 9);
            assert!((0.0..=1.0).contains(&here));
            assert!((here - fractal_noise(u + 1.0, 1.3, 4, 3, 9)).abs() < 1e-9);
        }
    }
}
