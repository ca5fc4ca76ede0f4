//! Where two images are equal, so that nothing needs to be computed there.

use super::Picture;
use std::ops::Range;

/// Side of a tile in pixels.
pub const TILE: usize = 64;

/// Which tiles of two images hold the same pixels.
pub struct Same {
    n_columns: usize,
    /// Row by row.
    tiles: Vec<bool>,
}

impl Same {
    /// From the rows of tiles, top to bottom.
    pub fn new(n_columns: usize, rows: impl IntoIterator<Item = Vec<bool>>) -> Self {
        Self {
            n_columns,
            tiles: rows.into_iter().flatten().collect(),
        }
    }

    /// Whether every pixel of a part of the image is the same; what lies beyond the image is.
    pub fn covers(&self, x: Range<usize>, y: Range<usize>) -> bool {
        let tiles = |pixels: Range<usize>| pixels.start / TILE..pixels.end.div_ceil(TILE);
        let (x, y) = (tiles(x), tiles(y));
        let rows = self.tiles.chunks(self.n_columns).skip(y.start).take(y.len());
        rows.flat_map(|row| &row[x.start..x.end.min(self.n_columns)])
            .all(|same| *same)
    }
}

/// Compares a row of tiles bit by bit: the rows `y` of both pictures.
pub fn compare(a: &Picture, b: &Picture, y: Range<usize>) -> Vec<bool> {
    let width = a.extent().width as usize;
    let tile = |x: usize| {
        let columns = x..width.min(x + TILE);
        y.clone().all(|y| a.has_pixels_of(b, y, columns.clone()))
    };
    (0..width).step_by(TILE).map(tile).collect()
}
