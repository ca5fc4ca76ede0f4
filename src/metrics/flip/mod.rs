//! How different two images look when flipped between: `flip`, `flip.p95` and `hdr_flip`. Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for Alternating Images", 2020; for
//! high dynamic range Andersson, Nilsson, Shirley and Akenine-Möller, "Visualizing Errors in Rendered High Dynamic
//! Range Images", 2021.
//!
//! What the eye sees of an image (its filtered colour, its edges and points) is computed tile by tile: once for a
//! reference, and for each image under test only where a tile differs. In f32 throughout, since the published
//! implementations are.

pub(super) mod color;
mod filters;

use super::{
    Better, MetricInfo, display,
    mask::{self, ByClass, ByMask, Classes, counts, sum_rows},
    metric::Definition,
    picture::Picture,
    quantity::{Quantity, Sums},
    reference::Pair,
    same::Same,
    shown::Shown,
    vector::vectorised,
};
use crate::image::{Extent, Image};
use color::Colors;
pub(super) use filters::Filters;
use filters::{APRON, INPUT, Scratch, TILE};
use rayon::prelude::*;

pub(super) const FLIP: Definition = Definition {
    info: MetricInfo {
        id: "flip",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "LDR-FLIP at 67.02 pixels per degree: mean",
    },
    quantity: Quantity::Flip,
    value: |sums| Some(sums.mean()),
    relative_mse: None,
};

pub(super) const FLIP_P95: Definition = Definition {
    info: MetricInfo {
        id: "flip.p95",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "LDR-FLIP at 67.02 pixels per degree: 95th percentile",
    },
    quantity: Quantity::FlipPercentile,
    value: |sums| Some(sums.terms[0]),
    relative_mse: None,
};

pub(super) const HDR_FLIP: Definition = Definition {
    info: MetricInfo {
        id: "hdr_flip",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "HDR-FLIP at 67.02 pixels per degree, ACES, over the reference's exposures: mean",
    },
    quantity: Quantity::HdrFlip,
    value: |sums| Some(sums.mean()),
    relative_mse: None,
};

/// Beside `hdr_flip`, in stops: from the exposure that shows the reference's highlights …
pub(super) const START_EXPOSURE: &str = "hdr_flip.start_exposure";
/// … to the one that shows its median.
pub(super) const STOP_EXPOSURE: &str = "hdr_flip.stop_exposure";

/// What the eye sees of a tile: lightness, both chromas, strength of edges and of points; rows one after another.
type Seen = [Vec<[f32; TILE]>; 5];

/// An image's tiles, row by row.
pub(super) struct SeenImage(Vec<Seen>);

/// Linear light in `[0, 1]` of an image.
#[derive(Clone, Copy)]
enum Light<'a> {
    /// As displayed.
    Displayed(&'a Shown),
    /// Exposed by a factor and tone mapped.
    Exposed(&'a Picture, f32),
}

/// The tools of a thread.
struct Eye {
    colors: Colors,
    filters: Filters,
    scratch: Scratch,
    light: [Vec<f64>; 3],
}

impl SeenImage {
    pub(super) fn new(shown: &Shown) -> Self {
        let extent = shown.extent();
        let (columns, rows) = tiles(extent);
        let tiles = (0..columns * rows).into_par_iter();
        let seen = tiles.map_init(Eye::new, |eye, i| {
            eye.see(Light::Displayed(shown), i % columns, i / columns)
        });
        Self(seen.collect())
    }
}

/// FLIP of each pixel of the displayed images.
pub(super) fn map(pair: &Pair) -> Image<f32> {
    let (columns, _) = tiles(pair.reference.extent());
    let seen = pair.reference.seen();
    per_tile(pair, |eye, column, row| {
        let test = eye.see(Light::Displayed(pair.shown), column, row);
        eye.differences(&seen.0[row * columns + column], &test)
    })
}

/// The largest FLIP of each pixel over the exposures that show the reference from its highlights to its median.
pub(super) fn hdr_map(pair: &Pair) -> Image<f32> {
    let exposures = pair.reference.exposures();
    per_tile(pair, |eye, column, row| {
        let mut largest = vec![[0.0_f32; TILE]; TILE];
        for factor in exposures.factors() {
            let [r, t] = [pair.reference.picture(), pair.test]
                .map(|picture| eye.see(Light::Exposed(picture, factor), column, row));
            for (largest, differences) in largest.iter_mut().zip(eye.differences(&r, &t)) {
                *largest = std::array::from_fn(|x| largest[x].max(differences[x]));
            }
        }
        largest
    })
}

pub(super) fn sums(map: &Image<f32>, classes: Option<&Classes>) -> ByClass<Sums> {
    let [totals] = sum_rows(map.extent(), classes, |y, [values]| {
        for (value, flip) in values.iter_mut().zip(map.row(y as u32)) {
            *value = f64::from(*flip);
        }
    });
    let n = classes.map_or_else(|| mask::all(map.pixels().len()), |classes| classes.n_pixels);
    std::array::from_fn(|class| Sums::new(n[class], [totals[class]]))
}

/// Of all pixels, and of those of each mask.
pub(super) fn percentiles_95(map: &Image<f32>, classes: Option<&Classes>) -> ByMask<Sums> {
    std::array::from_fn(|place| {
        let mut sorted: Vec<f32> = match (place, classes) {
            (0, _) => map.pixels().to_vec(),
            (_, None) => Vec::new(),
            (_, Some(classes)) => {
                let pixels = map.pixels().iter().zip(classes.all());
                let counted = pixels.filter(|(_, class)| counts(place, usize::from(**class)));
                counted.map(|(flip, _)| *flip).collect()
            }
        };
        Sums::new(sorted.len() as f64, [percentile_95(&mut sorted)])
    })
}

/// Linear between the two order statistics around it, for which nothing else needs to be sorted.
fn percentile_95(values: &mut [f32]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let rank = 0.95 * (values.len() - 1) as f64;
    let (_, below, above) = values.select_nth_unstable_by(rank as usize, f32::total_cmp);
    let below = f64::from(*below);
    let next = above.iter().copied().min_by(f32::total_cmp).map_or(below, f64::from);
    below + (next - below) * rank.fract()
}

/// How many tiles cover each axis.
fn tiles(extent: Extent) -> (usize, usize) {
    (
        (extent.width as usize).div_ceil(TILE),
        (extent.height as usize).div_ceil(TILE),
    )
}

/// A map from the differences of each tile, given its column and row of tiles. They are zero where the images are the same
/// as far as the filters reach.
fn per_tile(pair: &Pair, differences: impl Fn(&mut Eye, usize, usize) -> Vec<[f32; TILE]> + Sync) -> Image<f32> {
    let extent = pair.reference.extent();
    let width = extent.width as usize;
    let mut map = Image::filled(extent, 0.0);
    let bands = map.pixels_mut().par_chunks_mut(width * TILE).enumerate();
    bands.for_each_init(Eye::new, |eye, (row, band)| {
        for column in 0..width.div_ceil(TILE) {
            if is_same(pair.same, column, row) {
                continue;
            }
            let tile = differences(eye, column, row);
            for (pixels, differences) in band.chunks_mut(width).zip(&tile) {
                let pixels = &mut pixels[column * TILE..];
                let n = pixels.len().min(TILE);
                pixels[..n].copy_from_slice(&differences[..n]);
            }
        }
    });
    map
}

fn is_same(same: &Same, column: usize, row: usize) -> bool {
    let reach = |tile: usize| (tile * TILE).saturating_sub(APRON)..tile * TILE + TILE + APRON;
    same.covers(reach(column), reach(row))
}

impl Eye {
    fn new() -> Self {
        Self {
            colors: Colors::new(),
            filters: Filters::new(),
            scratch: Scratch::new(),
            light: [(); 3].map(|()| vec![0.0; INPUT]),
        }
    }

    fn see(&mut self, light: Light, column: usize, row: usize) -> Seen {
        let extent = light.extent();
        // Beyond the image its edge goes on.
        let clamped = |tile: usize, i: usize, size: u32| (tile * TILE + i).saturating_sub(APRON).min(size as usize - 1);
        let columns: [usize; INPUT] = std::array::from_fn(|x| clamped(column, x, extent.width));
        for y in 0..INPUT {
            let rgb = light.row(clamped(row, y, extent.height), &columns, &mut self.light);
            let row = self.scratch.input.each_mut().map(|channel| &mut channel[y]);
            opponent(self.colors, &rgb, row);
        }
        filter_rows(&mut self.scratch, &self.filters);
        let mut seen = [(); 5].map(|()| Vec::with_capacity(TILE));
        for y in 0..TILE {
            let row = see_row(&self.scratch, &self.filters, self.colors, y);
            for (seen, row) in seen.iter_mut().zip(row) {
                seen.push(row);
            }
        }
        seen
    }

    fn differences(&self, reference: &Seen, test: &Seen) -> Vec<[f32; TILE]> {
        let row = |y: usize| {
            let [reference, test] = [reference, test].map(|seen| seen.each_ref().map(|plane| &plane[y]));
            differ(self.colors, reference, test)
        };
        (0..TILE).map(row).collect()
    }
}

vectorised! {
    /// Lightness and two chromas of a row.
    fn opponent<'a>(colors: Colors, rgb: &'a [[f32; INPUT]; 3], row: [&'a mut [f32; INPUT]; 3]) {
        let ([r, g, b], [l, cx, cz]) = (rgb, row);
        for x in 0..INPUT {
            [l[x], cx[x], cz[x]] = colors.ycxcz([r[x], g[x], b[x]]);
        }
    }

    fn filter_rows<'a>(scratch: &'a mut Scratch, filters: &'a Filters) {
        scratch.filter_rows(filters);
    }

    /// What the eye sees of a row.
    fn see_row<'a>(scratch: &'a Scratch, filters: &'a Filters, colors: Colors, y: usize) -> [[f32; TILE]; 5] {
        let [mut l, mut a, mut b, edge, point] = scratch.filter_columns(filters, y);
        for x in 0..TILE {
            [l[x], a[x], b[x]] = colors.hunt_lab([l[x], a[x], b[x]]);
        }
        [l, a, b, edge, point]
    }

    fn differ<'a>(colors: Colors, reference: [&'a [f32; TILE]; 5], test: [&'a [f32; TILE]; 5]) -> [f32; TILE] {
        let ([l, a, b, edge, point], [m, c, d, other_edge, other_point]) = (reference, test);
        let mut differences = [0.0; TILE];
        for x in 0..TILE {
            let color = colors.difference([l[x], a[x], b[x]], [m[x], c[x], d[x]]);
            let (edge, point) = ((edge[x] - other_edge[x]).abs(), (point[x] - other_point[x]).abs());
            let feature = if edge > point { edge } else { point };
            differences[x] = color::pow(color, 1.0 - (feature * std::f32::consts::FRAC_1_SQRT_2).sqrt());
        }
        differences
    }

    fn decode<'a>(light: &'a mut [[f32; INPUT]; 3]) {
        for row in light {
            for value in row {
                *value = color::decode(*value);
            }
        }
    }

    fn expose<'a>(light: &'a mut [[f32; INPUT]; 3], factor: f32) {
        for row in light {
            for value in row {
                *value = color::aces(factor * *value);
            }
        }
    }
}

impl Light<'_> {
    fn extent(self) -> Extent {
        match self {
            Self::Displayed(shown) => shown.extent(),
            Self::Exposed(picture, _) => picture.extent(),
        }
    }

    /// Some columns of row `y`; `rows` is room for it.
    fn row(self, y: usize, columns: &[usize; INPUT], rows: &mut [Vec<f64>; 3]) -> [[f32; INPUT]; 3] {
        let span = columns[0]..columns[INPUT - 1] + 1;
        let mut light = [[0.0; INPUT]; 3];
        let mut gather = |rows: [&[f64]; 3]| {
            for (light, row) in light.iter_mut().zip(rows) {
                for (value, x) in light.iter_mut().zip(columns) {
                    *value = row[x - span.start] as f32;
                }
            }
        };
        match self {
            Self::Displayed(shown) => {
                gather(shown.rows(y, span.clone()));
                decode(&mut light);
            }
            Self::Exposed(picture, factor) => {
                let n = span.len();
                picture.light(y, span.clone(), rows.each_mut().map(|row| &mut row[..n]));
                gather(rows.each_ref().map(|row| &row[..n]));
                expose(&mut light, factor);
            }
        }
        light
    }
}

/// The exposures at which HDR-FLIP looks, in stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exposures {
    /// Brings the brightest luminance of the reference to 85 % of white.
    pub start: f64,
    /// Brings its median luminance there.
    pub stop: f64,
}

impl Exposures {
    pub(super) fn of(reference: &Picture) -> Self {
        let width = reference.extent().width as usize;
        let mut luminance = vec![0.0; reference.extent().n_pixels()];
        let mut rows = [(); 3].map(|()| vec![0.0; width]);
        for (y, luminance) in luminance.chunks_mut(width).enumerate() {
            reference.light(y, 0..width, rows.each_mut().map(|row| &mut row[..]));
            for (x, luminance) in luminance.iter_mut().enumerate() {
                *luminance = display::luma(rows.each_ref().map(|row| row[x]));
            }
        }
        let middle = luminance.len() / 2;
        let (_, median, above) = luminance.select_nth_unstable_by(middle, f64::total_cmp);
        let brightest = above.iter().copied().fold(*median, f64::max);
        let stops = |luminance: f64| libm::log2(aces_inverse(0.85) / luminance.max(f64::from(f32::EPSILON)));
        Self {
            start: stops(brightest),
            stop: stops(*median),
        }
    }

    /// A stop apart at most, and at least two.
    pub(super) fn factors(self) -> impl Iterator<Item = f32> {
        let n = (self.stop - self.start).ceil().max(2.0);
        let step = (self.stop - self.start) / (n - 1.0);
        (0..n as u32).map(move |i| libm::exp2(self.start + f64::from(i) * step) as f32)
    }
}

/// The light that [`color::aces`] maps to `shown`.
fn aces_inverse(shown: f64) -> f64 {
    let (a, b, c) = (2.51 - 2.43 * shown, 0.03 - 0.59 * shown, -0.14 * shown);
    ((b * b - 4.0 * a * c).sqrt() - b) / (2.0 * a) / 0.6
}
