//! How different two images look when flipped between: `flip`, `flip.p95` and `hdr_flip`. Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for Alternating Images", 2020; for
//! high dynamic range Andersson, Nilsson, Shirley and Akenine-Möller, "Visualizing Errors in Rendered High Dynamic
//! Range Images", 2021.
//!
//! What the eye sees of an image (its filtered colour, its edges and points) is computed tile by tile: once for a
//! reference, and for each image under test only where a tile differs. In f32 throughout, since the published
//! implementations are.

mod color;
mod filters;

use super::{Better, Definition, Domain, MetricInfo, Quantity, Shown, Sums, display, summary::percentile};
use crate::image::{Extent, Image};
use color::Colors;
use filters::{APRON, Filters, INPUT, Scratch, TILE};
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
    value: Sums::mean,
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
    quantity: Quantity::Flip,
    value: |sums| percentile_95(&sums.samples),
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
    value: Sums::mean,
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
    Exposed(&'a Shown, f32),
}

/// The tools of a thread.
struct Eye {
    colors: Colors,
    filters: Filters,
    scratch: Scratch,
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
pub(super) fn map(reference: &Shown, test: &Shown) -> Image<f32> {
    let (columns, _) = tiles(reference.extent());
    let seen = reference.seen();
    per_tile(reference.extent(), |eye, column, row| {
        if same(Domain::Display, reference, test, column, row) {
            return None;
        }
        let test = eye.see(Light::Displayed(test), column, row);
        Some(eye.differences(&seen.0[row * columns + column], &test))
    })
}

/// The largest FLIP of each pixel over the exposures that show the reference from its highlights to its median.
pub(super) fn hdr_map(reference: &Shown, test: &Shown) -> Image<f32> {
    let exposures = reference.exposures();
    per_tile(reference.extent(), |eye, column, row| {
        if same(Domain::Linear, reference, test, column, row) {
            return None;
        }
        let mut largest = vec![[0.0_f32; TILE]; TILE];
        for factor in exposures.factors() {
            let [r, t] = [reference, test].map(|image| eye.see(Light::Exposed(image, factor), column, row));
            for (largest, differences) in largest.iter_mut().zip(eye.differences(&r, &t)) {
                *largest = std::array::from_fn(|x| largest[x].max(differences[x]));
            }
        }
        Some(largest)
    })
}

pub(super) fn sums(map: Image<f32>) -> Sums {
    // Row by row, so that rounding does not grow with the image.
    let rows = map.pixels().chunks(map.extent().width as usize);
    Sums {
        total: rows.map(|row| row.iter().copied().map(f64::from).sum::<f64>()).sum(),
        n: map.pixels().len(),
        samples: map.into_pixels(),
        ..Sums::default()
    }
}

fn percentile_95(samples: &[f32]) -> f64 {
    let mut sorted: Vec<f64> = samples.iter().copied().map(f64::from).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    percentile(&sorted, 0.95)
}

/// How many tiles cover each axis.
fn tiles(extent: Extent) -> (usize, usize) {
    (
        (extent.width as usize).div_ceil(TILE),
        (extent.height as usize).div_ceil(TILE),
    )
}

/// A map from the differences of each tile, given its column and row of tiles; none are zero everywhere.
fn per_tile(
    extent: Extent,
    differences: impl Fn(&mut Eye, usize, usize) -> Option<Vec<[f32; TILE]>> + Sync,
) -> Image<f32> {
    let width = extent.width as usize;
    let mut map = Image::filled(extent, 0.0);
    let bands = map.pixels_mut().par_chunks_mut(width * TILE).enumerate();
    bands.for_each_init(Eye::new, |eye, (row, band)| {
        for column in 0..width.div_ceil(TILE) {
            let Some(tile) = differences(eye, column, row) else {
                continue;
            };
            for (pixels, differences) in band.chunks_mut(width).zip(&tile) {
                let pixels = &mut pixels[column * TILE..];
                let n = pixels.len().min(TILE);
                pixels[..n].copy_from_slice(&differences[..n]);
            }
        }
    });
    map
}

/// Whether a tile and everything its filters reach are equal to the last bit.
fn same(domain: Domain, reference: &Shown, test: &Shown, column: usize, row: usize) -> bool {
    let extent = reference.extent();
    let reach =
        |tile: usize, size: u32| (tile * TILE).saturating_sub(APRON)..(tile * TILE + TILE + APRON).min(size as usize);
    let columns = reach(column, extent.width);
    (0..3).all(|channel| {
        let [r, t] = [reference, test].map(|image| image.plane(domain, channel));
        reach(row, extent.height).all(|y| {
            let start = y * extent.width as usize;
            let span = start + columns.start..start + columns.end;
            r[span.clone()] == t[span]
        })
    })
}

impl Eye {
    fn new() -> Self {
        Self {
            colors: Colors::new(),
            filters: Filters::new(),
            scratch: Scratch::new(),
        }
    }

    fn see(&mut self, light: Light, column: usize, row: usize) -> Seen {
        let extent = light.image().extent();
        // Beyond the image its edge goes on.
        let clamped = |tile: usize, i: usize, size: u32| (tile * TILE + i).saturating_sub(APRON).min(size as usize - 1);
        let columns: [usize; INPUT] = std::array::from_fn(|x| clamped(column, x, extent.width));
        for y in 0..INPUT {
            let rgb = light.row(clamped(row, y, extent.height), &columns);
            let [l, cx, cz] = self.scratch.input.each_mut().map(|channel| &mut channel[y]);
            for x in 0..INPUT {
                [l[x], cx[x], cz[x]] = self.colors.ycxcz([rgb[0][x], rgb[1][x], rgb[2][x]]);
            }
        }
        self.scratch.filter_rows(&self.filters);
        let mut seen = [(); 5].map(|()| Vec::with_capacity(TILE));
        for y in 0..TILE {
            let [mut l, mut a, mut b, edge, point] = self.scratch.filter_columns(&self.filters, y);
            for x in 0..TILE {
                [l[x], a[x], b[x]] = self.colors.hunt_lab([l[x], a[x], b[x]]);
            }
            for (seen, row) in seen.iter_mut().zip([l, a, b, edge, point]) {
                seen.push(row);
            }
        }
        seen
    }

    fn differences(&self, reference: &Seen, test: &Seen) -> Vec<[f32; TILE]> {
        let row = |y: usize| {
            let [l, a, b, edge, point] = reference.each_ref().map(|plane| &plane[y]);
            let [m, c, d, other_edge, other_point] = test.each_ref().map(|plane| &plane[y]);
            let mut differences = [0.0; TILE];
            for x in 0..TILE {
                let color = self.colors.difference([l[x], a[x], b[x]], [m[x], c[x], d[x]]);
                let (edge, point) = ((edge[x] - other_edge[x]).abs(), (point[x] - other_point[x]).abs());
                let feature = if edge > point { edge } else { point };
                differences[x] = color::pow(color, 1.0 - (feature * std::f32::consts::FRAC_1_SQRT_2).sqrt());
            }
            differences
        };
        (0..TILE).map(row).collect()
    }
}

impl<'a> Light<'a> {
    fn image(self) -> &'a Shown {
        match self {
            Self::Displayed(shown) | Self::Exposed(shown, _) => shown,
        }
    }

    /// Some columns of row `y`.
    fn row(self, y: usize, columns: &[usize; INPUT]) -> [[f32; INPUT]; 3] {
        let start = y * self.image().extent().width as usize;
        let load = |domain: Domain, light: &dyn Fn(&mut [f32; INPUT])| {
            std::array::from_fn(|channel| {
                let row = &self.image().plane(domain, channel)[start..];
                let mut values = [0.0; INPUT];
                for (value, &x) in values.iter_mut().zip(columns) {
                    *value = row[x] as f32;
                }
                light(&mut values);
                values
            })
        };
        match self {
            Self::Displayed(_) => load(Domain::Display, &|row| {
                for value in row {
                    *value = color::decode(*value);
                }
            }),
            Self::Exposed(_, factor) => load(Domain::Linear, &|row| {
                for value in row {
                    *value = color::aces(factor * *value);
                }
            }),
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
    pub(super) fn of(reference: &Shown) -> Self {
        let [r, g, b] = [0, 1, 2].map(|channel| reference.plane(Domain::Linear, channel));
        let mut luminance: Vec<f64> = (0..r.len()).map(|i| display::luma([r[i], g[i], b[i]])).collect();
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
    fn factors(self) -> impl Iterator<Item = f32> {
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
