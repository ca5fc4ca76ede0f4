//! What a frame repeats of the one before, tile by tile, found while it is uploaded. Bits are compared, not values: only
//! then does the same arithmetic give the same bits. The harness has its frames on the host, where comparing costs a tenth of
//! what a pass would, and an image that repeats need not be uploaded; an engine knows from its culling.

use super::reference::color::is_hostile;
use crate::{
    image::{Extent, Image},
    sequence::{Channels, Frame},
};
use bytemuck::{NoUninit, Pod};
use rayon::prelude::*;

/// Side of a tile, pixels: what `shaders/taa/tiles` lists.
pub const TILE: u32 = 16;
/// Side of the cells that are compared, pixels.
const CELL: u32 = 4;

/// Of a tile with its surroundings, or of a cell.
pub mod flag {
    /// Every image has the same bits as in the frame before.
    pub const SAME: u32 = 1;
    /// As that, in the frame before.
    pub const SAME_BEFORE: u32 = 2;
    /// Colour, albedo and reactive mask are one value each: wherever the jitter puts a sample, it finds the same.
    pub const FLAT: u32 = 4;
    /// Depth is one value, too.
    pub const FLAT_DEPTH: u32 = 8;
    /// Nothing moves: every vector is 0.
    pub const STILL: u32 = 16;
    /// No vector is longer than 2 pixels, which is where motion blur begins.
    pub const SLOW: u32 = 32;
    /// No texel of any colour or albedo is one that is repaired.
    pub const SOUND: u32 = 64;
    /// All that a cell can have.
    pub const OF_CELLS: u32 = 127;
    /// Of a tile: a part of a flat surface that moves. Colour, albedo and reactive mask are one value each, the one that they
    /// had in the frame before in every tile of the tile's region, which lies inside the image.
    pub const CARRIED: u32 = 128;
}

/// Compares each frame with the one before.
#[derive(Debug)]
pub struct Changes {
    extent: Extent,
    /// What is compared, beside colour.
    channels: Channels,
    /// How far around a tile its result depends on the inputs, pixels.
    reach_px: u32,
    color: Retained<[f32; 3]>,
    albedo: Retained<[f32; 3]>,
    unjittered_color: Retained<[f32; 3]>,
    depth: Retained<f32>,
    motion_px: Retained<[f32; 2]>,
    object_id: Retained<u32>,
    reactive: Retained<f32>,
    cells: Vec<u32>,
    tiles: Vec<u32>,
    /// The value of each flat tile; none where it is not flat.
    values: Vec<Option<Value>>,
    regions: Vec<Region>,
}

/// The bits of a flat tile's colour, albedo, colour without jitter, and reactive mask.
type Value = [u32; 10];

/// The tiles of which a tile reads history: first and last, x | y << 16 each.
pub type Region = [u32; 2];

/// How far from where a vector leads the widest filter reads, pixels.
const SUPPORT_PX: f32 = 2.0;
/// The most tiles along one side of a region; what moves faster is computed.
const MAX_REGION: u32 = 6;

/// An image as it was last seen; empty until then.
#[derive(Debug, Default)]
struct Retained<T>(Vec<T>);

impl Changes {
    /// Nothing seen yet. Only `channels` are looked at.
    pub fn new(extent: Extent, channels: Channels, reach_px: u32) -> Self {
        let n_cells = extent.width.div_ceil(CELL) as usize * extent.height.div_ceil(CELL) as usize;
        Self {
            extent,
            channels,
            reach_px,
            color: Retained::default(),
            albedo: Retained::default(),
            unjittered_color: Retained::default(),
            depth: Retained::default(),
            motion_px: Retained::default(),
            object_id: Retained::default(),
            reactive: Retained::default(),
            cells: vec![0; n_cells],
            tiles: vec![0; n_tiles(extent)],
            values: vec![None; n_tiles(extent)],
            regions: vec![[0; 2]; n_tiles(extent)],
        }
    }

    /// Compares `frame`, and remembers it.
    pub fn see(&mut self, frame: &Frame) {
        self.cells.iter_mut().for_each(|cell| *cell |= flag::SAME);
        let (channels, cells) = (self.channels, &mut self.cells);
        self.color.compare(Some(&frame.color), cells);
        self.albedo
            .compare(frame.albedo.as_ref().filter(|_| channels.albedo), cells);
        let unjittered = frame.unjittered_color.as_ref().filter(|_| channels.unjittered_color);
        self.unjittered_color.compare(unjittered, cells);
        self.depth
            .compare(frame.depth.as_ref().filter(|_| channels.depth), cells);
        self.motion_px
            .compare(frame.motion_px.as_ref().filter(|_| channels.motion), cells);
        self.object_id
            .compare(frame.object_id.as_ref().filter(|_| channels.object_id), cells);
        self.reactive
            .compare(frame.reactive.as_ref().filter(|_| channels.reactive), cells);
        self.describe_changed_cells();
        if frame.others.is_some() {
            // Further samples and layers are not compared, so nothing is known.
            self.cells.fill(0);
        }
        self.gather_tiles();
        self.find_carried_tiles();
    }

    /// Flags of every tile, row by row.
    pub fn tiles(&self) -> &[u32] {
        &self.tiles
    }

    /// Of every tile, row by row; those that are not carried have any.
    pub fn regions(&self) -> &[Region] {
        &self.regions
    }

    /// Column and row of every tile that has not all of the flags `wanted`.
    pub fn tiles_without(&self, wanted: u32) -> impl Iterator<Item = [u32; 2]> {
        let across = self.extent.width.div_ceil(TILE) as usize;
        let tiles = self.tiles.iter().enumerate();
        let without = tiles.filter(move |(_, flags)| **flags & wanted != wanted);
        without.map(move |(index, _)| [index % across, index / across].map(|at| at as u32))
    }

    /// The share of tiles that have all of one of the combinations of flags `wanted`.
    pub fn share_with(&self, wanted: [u32; 2]) -> f64 {
        let has = |flags: u32| wanted.iter().any(|wanted| flags & wanted == *wanted);
        let n_with = self.tiles.iter().filter(|flags| has(**flags)).count();
        n_with as f64 / self.tiles.len() as f64
    }

    /// Whether the whole frame repeats the one before.
    pub fn is_repeat(&self) -> bool {
        self.cells.iter().all(|cell| cell & flag::SAME != 0)
    }

    /// Cells that repeat keep what is known of them.
    fn describe_changed_cells(&mut self) {
        let n_across = self.extent.width.div_ceil(CELL) as usize;
        let (extent, color, albedo, unjittered) = (self.extent, &self.color, &self.albedo, &self.unjittered_color);
        let (depth, motion, reactive) = (&self.depth, &self.motion_px, &self.reactive);
        self.cells
            .par_iter_mut()
            .with_min_len(n_across)
            .enumerate()
            .filter(|(_, cell)| **cell & flag::SAME == 0)
            .for_each(|(index, cell)| {
                let area = Area::of_cell(extent, [index % n_across, index / n_across]);
                let set = |holds: bool, flag: u32| if holds { flag } else { 0 };
                *cell = set(
                    color.is_flat(&area)
                        && albedo.is_flat(&area)
                        && unjittered.is_flat(&area)
                        && reactive.is_flat(&area),
                    flag::FLAT,
                ) | set(depth.is_flat(&area), flag::FLAT_DEPTH)
                    | set(motion.all(&area, |[x, y]| x == 0.0 && y == 0.0), flag::STILL)
                    | set(motion.all(&area, |[x, y]| x * x + y * y <= 4.0), flag::SLOW)
                    | set(
                        [color, albedo, unjittered]
                            .iter()
                            .all(|image| image.all(&area, is_sound)),
                        flag::SOUND,
                    );
            });
    }

    /// A tile has what all cells within reach have; flat cells of different values are not flat together.
    fn gather_tiles(&mut self) {
        let (extent, reach) = (self.extent, self.reach_px);
        let across = extent.width.div_ceil(TILE) as usize;
        let n_across = extent.width.div_ceil(CELL);
        let cells = |from: u32, size: u32| {
            let first = (from * TILE).saturating_sub(reach) / CELL;
            first..(from * TILE + TILE + reach).min(size).div_ceil(CELL)
        };
        let mut tiles = std::mem::take(&mut self.tiles);
        for (index, tile) in tiles.iter_mut().enumerate() {
            let (xs, ys) = (
                cells((index % across) as u32, extent.width),
                cells((index / across) as u32, extent.height),
            );
            let mut flags = flag::OF_CELLS;
            let first = [xs.start, ys.start];
            for y in ys {
                for x in xs.clone() {
                    flags &= self.cells[(y * n_across + x) as usize] | flag::SAME_BEFORE;
                    flags &= self.alike(first, [x, y], flags);
                }
            }
            let before = if *tile & flag::SAME != 0 { flag::SAME_BEFORE } else { 0 };
            *tile = flags & !flag::SAME_BEFORE | before;
        }
        self.tiles = tiles;
    }

    /// All flags but those of flatness that two flat cells do not share.
    fn alike(&self, a: [u32; 2], b: [u32; 2], flags: u32) -> u32 {
        let index = |[x, y]: [u32; 2]| ((y * self.extent.width + x) * CELL) as usize;
        let (a, b) = (index(a), index(b));
        let mut kept = flag::OF_CELLS;
        if flags & flag::FLAT != 0
            && !(self.color.agree(a, b)
                && self.albedo.agree(a, b)
                && self.unjittered_color.agree(a, b)
                && self.reactive.agree(a, b))
        {
            kept &= !flag::FLAT;
        }
        if flags & flag::FLAT_DEPTH != 0 && !self.depth.agree(a, b) {
            kept &= !flag::FLAT_DEPTH;
        }
        kept
    }
}

impl Changes {
    /// Marks what is carried, and keeps the values for the next frame.
    fn find_carried_tiles(&mut self) {
        let across = self.extent.width.div_ceil(TILE) as usize;
        let values: Vec<_> = self
            .tiles
            .par_iter()
            .enumerate()
            .map(|(index, flags)| {
                let [x, y] = [index % across, index / across].map(|at| at as u32 * TILE);
                (flags & flag::FLAT != 0).then(|| self.value((y * self.extent.width + x) as usize))
            })
            .collect();
        let region = |index: usize| {
            let value = values[index]?;
            let [first, last] = self.region([(index % across) as u32, (index / across) as u32])?;
            let mut tiles = (first[1]..=last[1]).flat_map(|y| (first[0]..=last[0]).map(move |x| [x, y]));
            let is_same = |[x, y]: [u32; 2]| self.values[y as usize * across + x as usize] == Some(value);
            tiles.all(is_same).then(|| [first, last].map(|[x, y]| x | y << 16))
        };
        let regions: Vec<_> = (0..values.len()).into_par_iter().map(region).collect();
        for ((flags, kept), found) in self.tiles.iter_mut().zip(&mut self.regions).zip(regions) {
            if let Some(found) = found {
                *flags |= flag::CARRIED;
                *kept = found;
            }
        }
        self.values = values;
    }

    fn value(&self, pixel: usize) -> Value {
        let rgb = |image: &Retained<[f32; 3]>| image.0.get(pixel).map_or([0; 3], |color| color.map(f32::to_bits));
        let [color, albedo, unjittered] = [&self.color, &self.albedo, &self.unjittered_color].map(rgb);
        let reactive = self.reactive.0.get(pixel).map_or(0, |mask| mask.to_bits());
        std::array::from_fn(|i| match i {
            0..3 => color[i],
            3..6 => albedo[i - 3],
            6..9 => unjittered[i - 6],
            _ => reactive,
        })
    }

    /// First and last tile that a filter can touch from this one, whichever of its neighbours' vectors a pixel takes. None where a
    /// vector is not finite, leads out of the image, or the region is too large to look through.
    fn region(&self, tile: [u32; 2]) -> Option<[[u32; 2]; 2]> {
        let size = [self.extent.width, self.extent.height];
        let first: [u32; 2] = tile.map(|at| at * TILE);
        let last: [u32; 2] = std::array::from_fn(|axis| (first[axis] + TILE).min(size[axis]) - 1);
        let (mut least, mut most) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for y in first[1].saturating_sub(1)..=(last[1] + 1).min(size[1] - 1) {
            for x in first[0].saturating_sub(1)..=(last[0] + 1).min(size[0] - 1) {
                let vector = self
                    .motion_px
                    .0
                    .get((y * size[0] + x) as usize)
                    .copied()
                    .unwrap_or_default();
                if vector.iter().any(|component| component.is_nan()) {
                    return None;
                }
                for axis in 0..2 {
                    least[axis] = least[axis].min(vector[axis]);
                    most[axis] = most[axis].max(vector[axis]);
                }
            }
        }
        let (mut from, mut to) = (tile, tile);
        for axis in 0..2 {
            let low = first[axis] as f32 + least[axis];
            let high = last[axis] as f32 + 1.0 + most[axis];
            if !(low >= 0.0 && high <= size[axis] as f32) {
                return None;
            }
            let end = size[axis] as f32 - 1.0;
            from[axis] = from[axis].min((low - SUPPORT_PX).max(0.0) as u32 / TILE);
            to[axis] = to[axis].max((high + SUPPORT_PX).min(end) as u32 / TILE);
            if to[axis] - from[axis] >= MAX_REGION {
                return None;
            }
        }
        Some([from, to])
    }
}

/// How many tiles cover an image.
pub fn n_tiles(extent: Extent) -> usize {
    extent.width.div_ceil(TILE) as usize * extent.height.div_ceil(TILE) as usize
}

/// Some pixels of an image, as ranges of indices, one a row.
struct Area {
    rows: std::ops::Range<usize>,
    columns: std::ops::Range<usize>,
    width: usize,
}

impl Area {
    fn of_cell(extent: Extent, [x, y]: [usize; 2]) -> Self {
        let (width, height, cell) = (extent.width as usize, extent.height as usize, CELL as usize);
        Self {
            rows: y * cell..((y + 1) * cell).min(height),
            columns: x * cell..((x + 1) * cell).min(width),
            width,
        }
    }
}

impl<T: Pod + NoUninit + Send + Sync> Retained<T> {
    /// Takes SAME from the cells in which `image` differs from what is retained, and retains it.
    fn compare(&mut self, image: Option<&Image<T>>, cells: &mut [u32]) {
        let Some(image) = image else {
            return;
        };
        let (width, image) = (image.extent().width as usize, image.pixels());
        if self.0.is_empty() {
            self.0.extend_from_slice(image);
            cells.iter_mut().for_each(|cell| *cell &= !flag::SAME);
            return;
        }
        let n_across = width.div_ceil(CELL as usize);
        let band = width * CELL as usize;
        self.0
            .par_chunks_mut(band)
            .zip(image.par_chunks(band))
            .zip(cells.par_chunks_mut(n_across))
            .with_min_len(8)
            .for_each(|((old, new), cells)| {
                for (old, new) in old.chunks_mut(width).zip(new.chunks(width)) {
                    if same_bits(old, new) {
                        continue;
                    }
                    let pieces = old.chunks(CELL as usize).zip(new.chunks(CELL as usize));
                    for ((old, new), cell) in pieces.zip(&mut *cells) {
                        if *cell & flag::SAME != 0 && !same_bits(old, new) {
                            *cell &= !flag::SAME;
                        }
                    }
                    old.copy_from_slice(new);
                }
            });
    }

    /// An image that is not there is flat.
    fn is_flat(&self, area: &Area) -> bool {
        let Some(first) = self.0.get(area.rows.start * area.width + area.columns.start) else {
            return true;
        };
        self.all(area, |pixel| same_bits(&[pixel], &[*first]))
    }

    fn all(&self, area: &Area, holds: impl Fn(T) -> bool) -> bool {
        self.0.is_empty()
            || area.rows.clone().all(|y| {
                let row = &self.0[y * area.width..][area.columns.clone()];
                row.iter().all(|pixel| holds(*pixel))
            })
    }

    fn agree(&self, a: usize, b: usize) -> bool {
        self.0.is_empty() || same_bits(&self.0[a..=a], &self.0[b..=b])
    }
}

fn is_sound(color: [f32; 3]) -> bool {
    !color.into_iter().any(is_hostile)
}

fn same_bits<T: NoUninit>(a: &[T], b: &[T]) -> bool {
    bytemuck::cast_slice::<T, u8>(a) == bytemuck::cast_slice::<T, u8>(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXTENT: Extent = Extent::new(70, 40);
    const CHANNELS: Channels = Channels {
        depth: true,
        motion: true,
        object_id: false,
        albedo: false,
        reactive: false,
        unjittered_color: false,
        reference: false,
        several: None,
    };

    fn frame(color: impl Fn(u32, u32) -> f32 + Sync, motion: f32) -> Frame {
        Frame {
            index: 0,
            reset: false,
            jitter_px: [0.0; 2],
            far: 1.0,
            output_size: EXTENT,
            display: Default::default(),
            parity: None,
            color: Image::from_fn(EXTENT, |x, y| [color(x, y); 3]),
            depth: Some(Image::filled(EXTENT, 1.0)),
            motion_px: Some(Image::filled(EXTENT, [motion, 0.0])),
            object_id: None,
            albedo: None,
            reactive: None,
            unjittered_color: None,
            reference: None,
            others: None,
        }
    }

    /// Flags of the tile at column `x`, row `y`.
    fn tile(changes: &Changes, x: usize, y: usize) -> u32 {
        changes.tiles()[y * 5 + x]
    }

    #[test]
    fn a_changed_pixel_is_seen_by_every_tile_within_reach() {
        let mut changes = Changes::new(EXTENT, CHANNELS, 2);
        changes.see(&frame(|_, _| 0.5, 0.0));
        assert!(
            changes.tiles().iter().all(|flags| flags & flag::SAME == 0),
            "nothing came before"
        );
        changes.see(&frame(|_, _| 0.5, 0.0));
        assert!(changes.is_repeat());
        let all = flag::SAME | flag::FLAT | flag::FLAT_DEPTH | flag::STILL | flag::SLOW | flag::SOUND;
        assert!(
            changes.tiles().iter().all(|flags| *flags == all | flag::CARRIED),
            "{:?}",
            changes.tiles()
        );
        // One texel, two pixels left of the border to the next tile.
        changes.see(&frame(|x, y| if (x, y) == (14, 8) { 0.6 } else { 0.5 }, 0.0));
        assert!(!changes.is_repeat());
        for (x, y) in [(0, 0), (1, 0)] {
            assert_eq!(tile(&changes, x, y) & (flag::SAME | flag::FLAT), 0, "{x} {y}");
        }
        assert_eq!(tile(&changes, 2, 0), all | flag::SAME_BEFORE | flag::CARRIED);
        assert_eq!(tile(&changes, 0, 0) & flag::STILL, flag::STILL);
        changes.see(&frame(|x, y| if (x, y) == (14, 8) { 0.6 } else { 0.5 }, 0.0));
        assert_eq!(
            tile(&changes, 0, 0),
            flag::SAME | flag::FLAT_DEPTH | flag::STILL | flag::SLOW | flag::SOUND
        );
    }

    #[test]
    fn a_flat_surface_is_carried_where_its_vectors_stay_on_it() {
        let mut changes = Changes::new(EXTENT, CHANNELS, 1);
        let flat = |x: u32, _| if x < 40 { 0.5 } else { 0.6 };
        changes.see(&frame(flat, 3.0));
        let carried = |changes: &Changes| {
            (0..5)
                .map(|x| tile(changes, x, 1) & flag::CARRIED != 0)
                .collect::<Vec<_>>()
        };
        assert_eq!(carried(&changes), [false; 5], "nothing came before");
        changes.see(&frame(flat, 3.0));
        // The second tile's vectors lead to the edge, and the last one's out of the image.
        assert_eq!(carried(&changes), [true, false, false, true, false]);
        // Filters reach 2 pixels further than the vectors.
        assert_eq!(changes.regions()[5], [0, 1 | 2 << 16]);
        changes.see(&frame(flat, -1.0));
        assert_eq!(carried(&changes), [false, false, false, false, true]);
        changes.see(&frame(|x, y| flat(x, y) + 0.1, 3.0));
        assert_eq!(carried(&changes), [false; 5], "another colour");
        changes.see(&frame(|x, y| flat(x, y) + 0.1, f32::NAN));
        assert_eq!(carried(&changes), [false; 5], "vectors lead nowhere");
    }

    #[test]
    fn bits_count_and_not_values() {
        let mut changes = Changes::new(EXTENT, CHANNELS, 1);
        changes.see(&frame(|_, _| 0.0, 0.0));
        changes.see(&frame(|_, _| -0.0, 0.0));
        assert!(!changes.is_repeat());
        changes.see(&frame(|_, _| f32::NAN, 0.0));
        changes.see(&frame(|_, _| f32::NAN, 0.0));
        assert!(changes.is_repeat());
    }

    #[test]
    fn motion_and_steps_between_flat_cells_are_seen() {
        let mut changes = Changes::new(EXTENT, CHANNELS, 1);
        changes.see(&frame(|x, _| if x < 32 { 0.5 } else { 0.6 }, 0.25));
        assert!(changes.tiles().iter().all(|flags| flags & flag::STILL == 0));
        // The step lies on a border of tiles: flat on either side, but not with its surroundings.
        let flat: Vec<_> = (0..5).map(|x| tile(&changes, x, 1) & flag::FLAT != 0).collect();
        assert_eq!(flat, [true, false, false, true, true]);
    }
}
