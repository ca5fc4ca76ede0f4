//! Display values of a whole image, for metrics that read them more than once or beside a pixel.

use super::{
    Picture,
    plane::{Plane, Pool},
    rows::luma,
};
use crate::image::Extent;
use rayon::prelude::*;
use std::ops::Range;

/// Columns and rows of an image.
pub type Area = [Range<usize>; 2];

/// Display RGB. A pixel with a non-finite component is NaN in all channels.
pub struct Shown {
    extent: Extent,
    values: Values,
}

enum Values {
    Kept(Strips),
    /// Made where they are read.
    Made(Picture),
}

/// Strips of columns, one after the other, each row by row: whoever reads down a strip reads memory as it lies, which is three times
/// as fast as reading a part of every row of an image.
pub struct Strips {
    planes: [Plane; 3],
    extent: Extent,
    strip: Strip,
}

/// How an image is cut.
#[derive(Clone, Copy)]
pub struct Strip {
    /// Columns, but for the last one.
    pub width: usize,
    /// Columns of the next strip that a strip has, too.
    pub beyond: usize,
}

/// Rows that one thread fills at a time.
const BAND: usize = 128;

impl Strips {
    /// What a picture shows, and whether all of it is finite.
    fn new(picture: &Picture, strip: Strip, pool: &Pool) -> (Self, bool) {
        let extent = picture.extent();
        let [width, height] = [extent.width, extent.height].map(|side| side as usize);
        let n = (strip.width + strip.beyond) * height;
        let mut strips = Self {
            planes: [(); 3].map(|()| pool.plane(width.div_ceil(strip.width) * n)),
            extent,
            strip,
        };
        let columns: Vec<_> = (0..width).step_by(strip.width).map(|x| strips.columns_of(x)).collect();
        let [r, g, b] = strips.planes.each_mut().map(|plane| plane.chunks_mut(n));
        let pieces = r.zip(g).zip(b).zip(columns).flat_map(|(((r, g), b), columns)| {
            let [r, g, b] = [r, g, b].map(|plane| plane[..columns.len() * height].chunks_mut(columns.len() * BAND));
            let bands = r.zip(g).zip(b).zip((0..height).step_by(BAND));
            bands.map(move |(((r, g), b), y)| ([columns.clone(), y..height.min(y + BAND)], [r, g, b]))
        });
        let pieces: Vec<(Area, [&mut [f64]; 3])> = pieces.collect();
        let are_finite = pieces.into_par_iter().map(|(area, [r, g, b])| {
            picture.show(area, [&mut *r, g, b]);
            r.iter().all(|value| value.is_finite())
        });
        let is_finite = are_finite.reduce(|| true, |a, b| a & b);
        (strips, is_finite)
    }

    /// All columns of the strip that `x` lies in.
    fn columns_of(&self, x: usize) -> Range<usize> {
        let start = x / self.strip.width * self.strip.width;
        start..(self.extent.width as usize).min(start + self.strip.width + self.strip.beyond)
    }

    fn row(&self, channel: usize, y: usize, columns: Range<usize>) -> &[f64] {
        let Strip { width, beyond } = self.strip;
        let of_strip = self.columns_of(columns.start);
        let strip = of_strip.start / width * (width + beyond) * self.extent.height as usize;
        let row = &self.planes[channel][strip + y * of_strip.len()..][..of_strip.len()];
        &row[columns.start - of_strip.start..columns.end - of_strip.start]
    }
}

/// An area of an image, to be read by rows.
pub enum View<'a> {
    /// What is kept of the whole.
    Kept(&'a Strips),
    /// What was made for this.
    Made {
        /// Row by row.
        planes: [&'a [f64]; 3],
        area: Area,
    },
}

impl<'a> View<'a> {
    /// An area of what a picture shows, put into `planes`, which have room for it.
    pub fn of(picture: &Picture, area: Area, planes: &'a mut [Plane; 3]) -> Self {
        let n = area[0].len() * area[1].len();
        picture.show(area.clone(), planes.each_mut().map(|plane| &mut plane[..n]));
        Self::Made {
            planes: planes.each_ref().map(|plane| &plane[..n]),
            area,
        }
    }

    /// Some columns of row `y` of a channel; of what is kept, columns of one strip.
    pub fn row(&self, channel: usize, y: usize, columns: Range<usize>) -> &'a [f64] {
        match self {
            Self::Kept(strips) => strips.row(channel, y, columns),
            Self::Made { planes, area } => {
                let row = &planes[channel][(y - area[1].start) * area[0].len()..];
                &row[columns.start - area[0].start..columns.end - area[0].start]
            }
        }
    }

    /// The same of each channel.
    pub fn rows(&self, y: usize, columns: Range<usize>) -> [&'a [f64]; 3] {
        std::array::from_fn(|channel| self.row(channel, y, columns.clone()))
    }
}

impl Shown {
    /// Of `picture`, and whether all of it is finite.
    pub fn new(picture: &Picture, strip: Strip, pool: &Pool) -> (Self, bool) {
        let (values, is_finite) = match picture.is_codes() {
            // Keeping them would cost more than making them again.
            true => (Values::Made(picture.clone()), true),
            false => {
                let (strips, is_finite) = Strips::new(picture, strip, pool);
                (Values::Kept(strips), is_finite)
            }
        };
        let extent = picture.extent();
        (Self { extent, values }, is_finite)
    }

    /// An area, which may be put into `planes`.
    pub fn view<'a>(&'a self, area: Area, planes: &'a mut [Plane; 3]) -> View<'a> {
        match &self.values {
            Values::Kept(strips) => View::Kept(strips),
            Values::Made(picture) => View::of(picture, area, planes),
        }
    }

    /// Some columns of row `y`, of each channel; of one strip, where they are kept.
    pub fn rows<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut [Vec<f64>; 3]) -> [&'a [f64]; 3] {
        match &self.values {
            Values::Kept(strips) => View::Kept(strips).rows(y, columns),
            Values::Made(picture) => {
                scratch.iter_mut().for_each(|row| row.resize(columns.len(), 0.0));
                picture.show([columns, y..y + 1], scratch.each_mut().map(Vec::as_mut_slice));
                scratch.each_ref().map(Vec::as_slice)
            }
        }
    }

    /// The columns of each strip; all, where none is kept.
    pub fn columns(&self) -> impl Iterator<Item = Range<usize>> {
        let width = self.extent.width as usize;
        let strip = match &self.values {
            Values::Kept(strips) => strips.strip.width,
            Values::Made(_) => width,
        };
        (0..width).step_by(strip).map(move |x| x..width.min(x + strip))
    }

    /// Fills a plane with luma.
    pub fn luma(&self, plane: &mut [f64]) {
        let rows = plane.par_chunks_mut(self.extent.width as usize).enumerate();
        rows.for_each_init(Default::default, |scratch, (y, row)| {
            for columns in self.columns() {
                luma(self.rows(y, columns.clone(), scratch), &mut row[columns]);
            }
        });
    }
}
