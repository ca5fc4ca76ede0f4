//! Display values of a whole image, for metrics whose samples need more than one pixel.

use super::{
    plane::Plane,
    quantity::Domain,
    rows::{code, luma},
};
use crate::image::Extent;
use rayon::prelude::*;
use std::ops::Range;

/// Display RGB in planes. A pixel with a non-finite component is NaN in all of them.
pub struct Shown {
    extent: Extent,
    planes: [Plane; 3],
    is_finite: bool,
}

impl Shown {
    pub fn new(extent: Extent, planes: [Plane; 3], is_finite: bool) -> Self {
        Self {
            extent,
            planes,
            is_finite,
        }
    }

    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// Whether every pixel is.
    pub fn is_finite(&self) -> bool {
        self.is_finite
    }

    /// Some columns of row `y`, of each channel.
    pub fn rows(&self, y: usize, columns: Range<usize>) -> [&[f64]; 3] {
        let start = y * self.extent.width as usize;
        let at = start + columns.start..start + columns.end;
        self.planes.each_ref().map(|plane| &plane[at.clone()])
    }

    /// The same of one channel of a domain; values that are not stored are computed into `scratch`.
    pub fn row<'a>(
        &'a self,
        domain: Domain,
        channel: usize,
        y: usize,
        columns: Range<usize>,
        scratch: &'a mut Vec<f64>,
    ) -> &'a [f64] {
        let rows = self.rows(y, columns);
        match domain {
            Domain::Display => rows[channel],
            Domain::Luma => {
                scratch.resize(rows[0].len(), 0.0);
                luma(rows, scratch);
                scratch
            }
            Domain::U8 => {
                scratch.resize(rows[0].len(), 0.0);
                code([rows[channel]; 3], scratch);
                scratch
            }
            Domain::Linear => unreachable!("no metric compares neighbours of linear values"),
        }
    }

    /// Fills a plane with luma.
    pub fn luma(&self, plane: &mut [f64]) {
        let width = self.extent.width as usize;
        let rows = plane.par_chunks_mut(width).enumerate();
        rows.for_each(|(y, row)| luma(self.rows(y, 0..width), row));
    }
}
