//! Where two images are equal, so that nothing needs to be computed there.

use super::Picture;
use crate::image::Extent;
use rayon::prelude::*;
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
    /// Compares two images bit by bit.
    pub fn of(a: &Picture, b: &Picture) -> Self {
        let [width, height] = [a.extent().width, a.extent().height].map(|side| side as usize);
        let n_columns = width.div_ceil(TILE);
        let tiles = (0..n_columns * height.div_ceil(TILE)).into_par_iter().map(|tile| {
            let (x, y) = (tile % n_columns * TILE, tile / n_columns * TILE);
            let columns = x..width.min(x + TILE);
            (y..height.min(y + TILE)).all(|y| a.has_pixels_of(b, y, columns.clone()))
        });
        Self {
            n_columns,
            tiles: tiles.collect(),
        }
    }

    /// Of images that cannot be compared.
    pub fn nowhere(extent: Extent) -> Self {
        let [n_columns, n_rows] = [extent.width, extent.height].map(|side| (side as usize).div_ceil(TILE));
        Self {
            n_columns,
            tiles: vec![false; n_columns * n_rows],
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

    /// Some columns of row `y`, from the first of a tile on, in runs of `most` tiles at most; and whether those are the same.
    pub fn runs(&self, y: usize, columns: Range<usize>, most: usize) -> impl Iterator<Item = (bool, Range<usize>)> {
        let row = &self.tiles[y / TILE * self.n_columns..][columns.start / TILE..columns.end.div_ceil(TILE)];
        let mut start = columns.start;
        let alike = row.chunk_by(|a, b| a == b).flat_map(move |tiles| tiles.chunks(most));
        alike.map(move |tiles| {
            let end = columns.end.min(start + tiles.len() * TILE);
            (tiles[0], std::mem::replace(&mut start, end)..end)
        })
    }
}
