//! How different two images look when flipped between: `flip`, `flip.p95` and `hdr_flip`. Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for Alternating Images", 2020; for
//! high dynamic range Andersson, Nilsson, Shirley and Akenine-Möller, "Visualizing Errors in Rendered High Dynamic
//! Range Images", 2021.
//!
//! What the eye sees of an image (its filtered colour, its edges and points) is computed tile by tile: once for a
//! reference, and for each image under test only where a tile differs. In f32 throughout, since the published
//! implementations are. FLIP decodes what a display shows, so it takes the light before it is encoded.

pub(super) mod color;
mod filters;

use super::{
    Better, MetricInfo, display,
    mask::{self, ByClass, ByMask, Classes, counts, sum_rows},
    metric::Definition,
    picture::Picture,
    plane::{Plane, Pool},
    quantity::{Quantity, Sums},
    reference::Pair,
    same::Same,
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

/// What the eye sees: lightness, both chromas, strength of edges and of points.
const N_SENSES: usize = 5;

/// Of a tile; rows one after another.
type Seen = [Vec<[f32; TILE]>; N_SENSES];

/// FLIP of a tile's pixels.
type Differences = [[f32; TILE]; TILE];

/// Of an image, row by row. Two senses share a plane, whose values are twice as wide.
pub(super) struct SeenImage {
    planes: [Plane; N_SENSES.div_ceil(2)],
    extent: Extent,
}

/// The light of an image in `[0, 1]`.
#[derive(Clone, Copy)]
enum Light {
    /// As displayed.
    Displayed,
    /// Exposed by a factor and tone mapped.
    Exposed(f32),
}

/// The tools of a thread.
struct Eye {
    colors: Colors,
    filters: Filters,
    scratch: Scratch,
    reference: Seen,
    test: Seen,
}

impl SeenImage {
    /// In memory of the pool, whose planes are of the image's size.
    pub(super) fn new(picture: &Picture, pool: &Pool) -> Self {
        let extent = picture.extent();
        let (n, width) = (extent.n_pixels(), extent.width as usize);
        let mut planes = [(); N_SENSES.div_ceil(2)].map(|()| pool.plane(n));
        let senses = planes
            .each_mut()
            .map(|plane| halves_mut(plane).map(|half| half.chunks_mut(width * TILE)));
        let mut senses: Vec<_> = senses.into_iter().flatten().take(N_SENSES).collect();
        let bands = (0..(extent.height as usize).div_ceil(TILE)).map(|_| {
            senses
                .iter_mut()
                .map(|sense| sense.next().expect("as many bands"))
                .collect::<Vec<_>>()
        });
        let bands: Vec<Vec<&mut [f32]>> = bands.collect();
        bands
            .into_par_iter()
            .enumerate()
            .for_each_init(Eye::new, |eye, (row, mut band)| {
                for column in 0..width.div_ceil(TILE) {
                    eye.see_test(picture, Light::Displayed, column, row);
                    for (seen, sense) in eye.test.iter().zip(&mut band) {
                        write_tile(seen, sense, width, column);
                    }
                }
            });
        Self { planes, extent }
    }

    /// Of a row of a tile.
    fn row(&self, y: usize, column: usize) -> [&[f32]; N_SENSES] {
        let width = self.extent.width as usize;
        let start = y * width + column * TILE;
        let n = TILE.min(width - column * TILE);
        std::array::from_fn(|sense| &halves(&self.planes[sense / 2])[sense % 2][start..start + n])
    }
}

/// A plane of twice as many values of half the size, cut in the middle.
fn halves(plane: &[f64]) -> [&[f32]; 2] {
    bytemuck::cast_slice(plane).split_at(plane.len()).into()
}

fn halves_mut(plane: &mut [f64]) -> [&mut [f32]; 2] {
    let n = plane.len();
    bytemuck::cast_slice_mut(plane).split_at_mut(n).into()
}

/// Puts a tile's rows into a band of rows of an image, as far as they lie inside.
fn write_tile(tile: &[[f32; TILE]], band: &mut [f32], width: usize, column: usize) {
    for (row, tile) in band.chunks_mut(width).zip(tile) {
        let row = &mut row[column * TILE..];
        let n = row.len().min(TILE);
        row[..n].copy_from_slice(&tile[..n]);
    }
}

/// FLIP of each pixel of the displayed images.
pub(super) fn map(pair: &Pair) -> Image<f32> {
    let seen = pair.reference.seen();
    per_tile(pair, |eye, column, row, differences| {
        eye.see_test(pair.test, Light::Displayed, column, row);
        for (y, differences) in differences.iter_mut().enumerate() {
            let test = eye.test.each_ref().map(|sense| &sense[y]);
            if row * TILE + y < seen.extent.height as usize {
                differ(eye.colors, seen.row(row * TILE + y, column), test, differences);
            }
        }
    })
}

/// The largest FLIP of each pixel over the exposures that show the reference from its highlights to its median.
pub(super) fn hdr_map(pair: &Pair) -> Image<f32> {
    let exposures = pair.reference.exposures();
    per_tile(pair, |eye, column, row, largest| {
        let mut differences = [0.0; TILE];
        for factor in exposures.factors() {
            eye.see_reference(pair.reference.picture(), Light::Exposed(factor), column, row);
            eye.see_test(pair.test, Light::Exposed(factor), column, row);
            for (y, largest) in largest.iter_mut().enumerate() {
                let reference = eye.reference.each_ref().map(|sense| &sense[y][..]);
                let test = eye.test.each_ref().map(|sense| &sense[y]);
                differ(eye.colors, reference, test, &mut differences);
                *largest = std::array::from_fn(|x| largest[x].max(differences[x]));
            }
        }
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

/// A map from the differences of each tile, given its column and row of tiles. They are zero where the images are the same
/// as far as the filters reach.
fn per_tile(pair: &Pair, differences: impl Fn(&mut Eye, usize, usize, &mut Differences) + Sync) -> Image<f32> {
    let extent = pair.reference.extent();
    let width = extent.width as usize;
    let mut map = Image::filled(extent, 0.0);
    let bands = map.pixels_mut().par_chunks_mut(width * TILE).enumerate();
    bands.for_each_init(Eye::new, |eye, (row, band)| {
        for column in 0..width.div_ceil(TILE) {
            if is_same(&pair.same, column, row) {
                continue;
            }
            let mut tile = [[0.0; TILE]; TILE];
            differences(eye, column, row, &mut tile);
            write_tile(&tile, band, width, column);
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
        let seen = || [(); N_SENSES].map(|()| vec![[0.0; TILE]; TILE]);
        Self {
            colors: Colors::new(),
            filters: Filters::new(),
            scratch: Scratch::new(),
            reference: seen(),
            test: seen(),
        }
    }

    fn see_reference(&mut self, picture: &Picture, light: Light, column: usize, row: usize) {
        self.look(picture, light, column, row);
        see(&self.scratch, &self.filters, self.colors, &mut self.reference);
    }

    fn see_test(&mut self, picture: &Picture, light: Light, column: usize, row: usize) {
        self.look(picture, light, column, row);
        see(&self.scratch, &self.filters, self.colors, &mut self.test);
    }

    /// Fills the input of the filters, and filters it along rows. Beyond the image its edge goes on.
    fn look(&mut self, picture: &Picture, light: Light, column: usize, row: usize) {
        let extent = picture.extent();
        let clamped = |tile: usize, i: usize, size: u32| (tile * TILE + i).saturating_sub(APRON).min(size as usize - 1);
        let columns = clamped(column, 0, extent.width)..clamped(column, INPUT - 1, extent.width) + 1;
        let before = APRON.saturating_sub(column * TILE);
        let mut rgb = [[0.0; INPUT]; 3];
        for y in 0..INPUT {
            let y_image = clamped(row, y, extent.height);
            let inside = rgb
                .each_mut()
                .map(|channel| &mut channel[before..before + columns.len()]);
            match light {
                Light::Displayed => picture.shown_light(y_image, columns.clone(), inside),
                Light::Exposed(factor) => {
                    picture.light_f32(y_image, columns.clone(), inside);
                    expose(&mut rgb, factor);
                }
            }
            for channel in &mut rgb {
                let last = before + columns.len() - 1;
                let edges = [channel[before], channel[last]];
                channel[..before].fill(edges[0]);
                channel[last..].fill(edges[1]);
            }
            opponent(
                self.colors,
                &rgb,
                self.scratch.input.each_mut().map(|channel| &mut channel[y]),
            );
        }
        filter_rows(&mut self.scratch, &self.filters);
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

    /// What the eye sees of a tile: first its colours, then its features, so that the rows that each reads stay in the
    /// first-level cache.
    fn see<'a>(scratch: &'a Scratch, filters: &'a Filters, colors: Colors, seen: &'a mut Seen) {
        let [l, a, b, edge, point] = seen;
        for y in 0..TILE {
            let (l, a, b) = (&mut l[y], &mut a[y], &mut b[y]);
            scratch.colors(filters, y, [&mut *l, a, b]);
            for x in 0..TILE {
                [l[x], a[x], b[x]] = colors.hunt_lab([l[x], a[x], b[x]]);
            }
        }
        for y in 0..TILE {
            scratch.features(filters, y, [&mut edge[y], &mut point[y]]);
        }
    }

    /// Of as many pixels as there are of the reference.
    fn differ<'a>(
        colors: Colors,
        reference: [&'a [f32]; N_SENSES],
        test: [&'a [f32; TILE]; N_SENSES],
        differences: &'a mut [f32; TILE],
    ) {
        let n = reference[0].len().min(TILE);
        let ([l, a, b, edge, point], [m, c, d, other_edge, other_point]) = (reference, test);
        let (l, a, b, edge, point) = (&l[..n], &a[..n], &b[..n], &edge[..n], &point[..n]);
        for x in 0..n {
            let color = colors.difference([l[x], a[x], b[x]], [m[x], c[x], d[x]]);
            let (edge, point) = ((edge[x] - other_edge[x]).abs(), (point[x] - other_point[x]).abs());
            let feature = if edge > point { edge } else { point };
            differences[x] = color::pow(color, 1.0 - (feature * std::f32::consts::FRAC_1_SQRT_2).sqrt());
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
