//! Display values of a whole image, for metrics whose samples need more than one pixel.

use super::{
    Picture,
    plane::Plane,
    quantity::Domain,
    rows::{code, luma},
};
use crate::image::Extent;
use rayon::prelude::*;
use std::ops::Range;

/// Display RGB. A pixel with a non-finite component is NaN in all channels.
pub struct Shown {
    extent: Extent,
    values: Values,
}

enum Values {
    /// A transform that is too dear to be made twice.
    Kept([Plane; 3]),
    /// Codes, whose values are made where they are read.
    Codes(Picture),
}

/// Room for values of a part of a row that are not stored.
#[derive(Default)]
pub struct RowScratch {
    channels: [Vec<f64>; 3],
    derived: Vec<f64>,
}

impl Shown {
    pub fn kept(extent: Extent, planes: [Plane; 3]) -> Self {
        Self {
            extent,
            values: Values::Kept(planes),
        }
    }

    /// Of a picture that [`Picture::is_codes`].
    pub fn codes(picture: &Picture) -> Self {
        Self {
            extent: picture.extent(),
            values: Values::Codes(picture.clone()),
        }
    }

    /// Some columns of row `y`, of each channel.
    pub fn rows<'a>(&'a self, y: usize, columns: Range<usize>, scratch: &'a mut [Vec<f64>; 3]) -> [&'a [f64]; 3] {
        match &self.values {
            Values::Kept(planes) => {
                let start = y * self.extent.width as usize;
                let at = start + columns.start..start + columns.end;
                planes.each_ref().map(|plane| &plane[at.clone()])
            }
            Values::Codes(picture) => {
                let n = columns.len();
                scratch.iter_mut().for_each(|row| row.resize(n, 0.0));
                picture.show(y, columns, scratch.each_mut().map(Vec::as_mut_slice));
                scratch.each_ref().map(Vec::as_slice)
            }
        }
    }

    /// The same of one channel of a domain.
    pub fn row<'a>(
        &'a self,
        domain: Domain,
        channel: usize,
        y: usize,
        columns: Range<usize>,
        scratch: &'a mut RowScratch,
    ) -> &'a [f64] {
        let RowScratch { channels, derived } = scratch;
        derived.resize(columns.len(), 0.0);
        match domain {
            Domain::Display => self.channel(channel, y, columns, &mut channels[channel]),
            Domain::Luma => {
                luma(self.rows(y, columns, channels), derived);
                derived
            }
            Domain::U8 => {
                code([self.channel(channel, y, columns, &mut channels[channel]); 3], derived);
                derived
            }
            Domain::Linear => unreachable!("no metric compares neighbours of linear values"),
        }
    }

    fn channel<'a>(&'a self, channel: usize, y: usize, columns: Range<usize>, scratch: &'a mut Vec<f64>) -> &'a [f64] {
        match &self.values {
            Values::Kept(planes) => {
                let start = y * self.extent.width as usize;
                &planes[channel][start + columns.start..start + columns.end]
            }
            Values::Codes(picture) => {
                scratch.resize(columns.len(), 0.0);
                picture.show_channel(channel, y, columns, scratch);
                scratch
            }
        }
    }

    /// Fills a plane with luma.
    pub fn luma(&self, plane: &mut [f64]) {
        let width = self.extent.width as usize;
        let rows = plane.par_chunks_mut(width).enumerate();
        rows.for_each_init(Default::default, |scratch, (y, row)| {
            luma(self.rows(y, 0..width, scratch), row);
        });
    }
}
