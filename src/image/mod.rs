//! Pixels in memory and on disk. Knows nothing of frames, recipes, the GPU or the service.
//!
//! An [`Image`] is a plain row-major array, origin top-left, x right, y down. `files` reads and writes image files.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

pub mod files;

/// Width and height in pixels. Written `[width, height]` in JSON.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(from = "[u32; 2]", into = "[u32; 2]")]
pub struct Extent {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Extent {
    /// An extent of `width` × `height` pixels.
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    pub const fn n_pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

impl From<[u32; 2]> for Extent {
    fn from([width, height]: [u32; 2]) -> Self {
        Self { width, height }
    }
}

impl From<Extent> for [u32; 2] {
    fn from(extent: Extent) -> Self {
        [extent.width, extent.height]
    }
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}×{}", self.width, self.height)
    }
}

impl fmt::Debug for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A row-major array of `extent.n_pixels()` pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    extent: Extent,
    pixels: Vec<T>,
}

impl<T: Copy + Send + Sync> Image<T> {
    /// An image with every pixel equal to `value`.
    pub fn filled(extent: Extent, value: T) -> Self {
        Self {
            extent,
            pixels: vec![value; extent.n_pixels()],
        }
    }

    /// Takes row-major `pixels`.
    ///
    /// # Panics
    /// When their number is not `extent.n_pixels()`: a caller's mistake, never a user's.
    pub fn from_pixels(extent: Extent, pixels: Vec<T>) -> Self {
        assert_eq!(pixels.len(), extent.n_pixels(), "pixels of a {extent} image");
        Self { extent, pixels }
    }

    /// Computes every pixel from its coordinates, rows in parallel.
    pub fn from_fn(extent: Extent, f: impl Fn(u32, u32) -> T + Sync) -> Self {
        // To wake a thread costs as much as some hundred pixels.
        const MIN_SHARE: usize = 256;
        let width = extent.width as usize;
        let mut pixels = Vec::with_capacity(extent.n_pixels());
        (0..extent.n_pixels())
            .into_par_iter()
            .with_min_len(width.max(MIN_SHARE))
            .map(|i| f((i % width) as u32, (i / width) as u32))
            .collect_into_vec(&mut pixels);
        Self { extent, pixels }
    }

    /// Applies `f` to every pixel.
    pub fn map<U: Copy + Send + Sync>(&self, f: impl Fn(T) -> U + Sync) -> Image<U> {
        let mut pixels = Vec::with_capacity(self.pixels.len());
        self.pixels
            .par_iter()
            .with_min_len(4096)
            .map(|&pixel| f(pixel))
            .collect_into_vec(&mut pixels);
        Image {
            extent: self.extent,
            pixels,
        }
    }

    /// Width and height.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// All pixels, row by row.
    pub fn pixels(&self) -> &[T] {
        &self.pixels
    }

    /// All pixels, row by row.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.pixels
    }

    /// All pixels, row by row.
    pub fn into_pixels(self) -> Vec<T> {
        self.pixels
    }

    /// The pixels of row `y`.
    pub fn row(&self, y: u32) -> &[T] {
        let width = self.extent.width as usize;
        &self.pixels[y as usize * width..][..width]
    }

    /// The pixel at column `x`, row `y`, which must lie inside.
    pub fn at(&self, x: u32, y: u32) -> T {
        self.pixels[y as usize * self.extent.width as usize + x as usize]
    }

    /// The pixel at `(x, y)`, or the nearest edge pixel where that lies outside.
    pub fn clamped(&self, x: i64, y: i64) -> T {
        let x = x.clamp(0, i64::from(self.extent.width) - 1) as u32;
        let y = y.clamp(0, i64::from(self.extent.height) - 1) as u32;
        self.at(x, y)
    }
}
