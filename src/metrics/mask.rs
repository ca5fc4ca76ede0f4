//! Which pixels count. A pixel moves or stands still, and its surface was there one frame ago or was not: sums are kept
//! for each of these four classes, so that every mask is a sum of sums and costs nothing of its own.

use super::{quantity::Sums, vector::vectorised};
use crate::image::Extent;
use rayon::prelude::*;
use std::ops::Range;

/// Pixels that a metric may be taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Mask {
    /// Motion shorter than a hundredth of a pixel.
    Static,
    /// All others.
    Moving,
    /// Where the reference itself does not find the pixel in its previous frame.
    Disoccluded,
}

impl Mask {
    /// Every mask.
    pub const ALL: [Self; 3] = [Self::Static, Self::Moving, Self::Disoccluded];

    /// What stands behind the last dot of a metric's id.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Moving => "moving",
            Self::Disoccluded => "disoccluded",
        }
    }

    /// A few words for people.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Static => "where motion is under 0.01 px",
            Self::Moving => "where motion is 0.01 px or more",
            Self::Disoccluded => "where the reference was not visible one frame ago",
        }
    }

    const fn holds(self, class: usize) -> bool {
        match self {
            Self::Static => class & MOVING as usize == 0,
            Self::Moving => class & MOVING as usize != 0,
            Self::Disoccluded => class & DISOCCLUDED as usize != 0,
        }
    }
}

/// A pixel's class is the sum of what holds of it.
pub type Class = u8;
pub const MOVING: Class = 1;
pub const DISOCCLUDED: Class = 2;
pub const N_CLASSES: usize = 4;

/// One for each class. Where no mask is asked for, all pixels are of class 0.
pub type ByClass<T> = [T; N_CLASSES];

/// One over all pixels, and one for each mask.
pub type ByMask<T> = [T; 1 + Mask::ALL.len()];

/// Where [`ByMask`] has it.
pub const fn place(mask: Option<Mask>) -> usize {
    match mask {
        None => 0,
        Some(mask) => 1 + mask as usize,
    }
}

/// Whether pixels of `class` count at a place of [`ByMask`].
pub fn counts(place: usize, class: usize) -> bool {
    place == 0 || Mask::ALL[place - 1].holds(class)
}

/// The sums of each mask from those of its classes.
pub fn by_mask(by_class: &ByClass<Sums>) -> ByMask<Sums> {
    std::array::from_fn(|place| {
        let classes = by_class.iter().enumerate().filter(|(class, _)| counts(place, *class));
        classes.fold(Sums::default(), |sums, (_, class)| sums.plus(class))
    })
}

/// The class of each pixel of a frame, row by row, and how many there are.
pub struct Classes {
    classes: Vec<Class>,
    extent: Extent,
    pub n_pixels: ByClass<f64>,
}

impl Classes {
    pub fn new(extent: Extent, classes: Vec<Class>) -> Self {
        let mut n_pixels = [0.0; N_CLASSES];
        classes.iter().for_each(|class| n_pixels[usize::from(*class)] += 1.0);
        Self {
            classes,
            extent,
            n_pixels,
        }
    }

    /// Some columns of row `y`.
    pub fn row(&self, y: usize, columns: Range<usize>) -> &[Class] {
        let start = y * self.extent.width as usize;
        &self.classes[start + columns.start..start + columns.end]
    }

    /// All pixels, row by row.
    pub fn all(&self) -> &[Class] {
        &self.classes
    }
}

/// All of class 0.
pub fn all(n: usize) -> ByClass<f64> {
    let mut by_class = [0.0; N_CLASSES];
    by_class[0] = n as f64;
    by_class
}

/// `N` kinds of samples, a row of each at a time, added up by class: rows in parallel, their sums from top to bottom, so
/// that they do not depend on the number of threads.
pub fn sum_rows<const N: usize>(
    extent: Extent,
    classes: Option<&Classes>,
    samples: impl Fn(usize, &mut [Vec<f64>; N]) + Sync,
) -> [ByClass<f64>; N] {
    let width = extent.width as usize;
    let rows = (0..extent.height as usize).into_par_iter();
    let new = || [(); N].map(|()| vec![0.0; width]);
    let rows = rows.map_init(new, |row, y| {
        samples(y, row);
        row.each_ref().map(|values| {
            let mut sums = [0.0; N_CLASSES];
            add(values, classes.map(|classes| classes.row(y, 0..width)), &mut sums);
            sums
        })
    });
    let rows: Vec<[ByClass<f64>; N]> = rows.collect();
    std::array::from_fn(|i| std::array::from_fn(|class| rows.iter().map(|row| row[i][class]).sum()))
}

vectorised! {
    /// [`accumulate`] as a function of its own.
    pub fn add<'a>(values: &'a [f64], classes: Option<&'a [Class]>, sums: &'a mut ByClass<f64>) {
        accumulate(values, classes, sums);
    }
}

/// Adds each value to the sum of its pixel's class.
#[inline(always)]
pub fn accumulate(values: &[f64], classes: Option<&[Class]>, sums: &mut ByClass<f64>) {
    match classes {
        None => sums[0] += sum(values.len(), |i| values[i]),
        Some(classes) => {
            for (value, class) in values.iter().zip(classes) {
                sums[usize::from(*class) % N_CLASSES] += value;
            }
        }
    }
}

/// Σ `f(i)` for `i` below `n`, in sixteen interleaved partial sums: fewer would wait for their own last addition.
#[inline(always)]
pub fn sum(n: usize, f: impl Fn(usize) -> f64) -> f64 {
    const LANES: usize = 16;
    let mut sums = [0.0; LANES];
    let whole = n / LANES * LANES;
    for start in (0..whole).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += f(start + lane);
        }
    }
    let mut total = sums.iter().sum::<f64>();
    for i in whole..n {
        total += f(i);
    }
    total
}
