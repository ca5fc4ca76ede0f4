//! The pass over an image under test: its pixels are converted, compared with the reference's where a quantity needs no
//! neighbours, and kept where another does. One pass, because memory is slower than arithmetic; and none at all over
//! tiles whose pixels are those of the reference.

use super::{
    display,
    mask::{self, ByClass, Class},
    picture::{Picture, round},
    plane::Plane,
    quantity::{Domain, Quantity, Sums},
    reference::Reference,
    relative_error,
    same::{self, Same, TILE},
    shown::Shown,
    temporal::Change,
    vector::vectorised,
};
use rayon::prelude::*;
use std::{collections::BTreeMap, ops::Range};

/// What the pass found.
pub struct Rows {
    pub sums: BTreeMap<Quantity, ByClass<Sums>>,
    /// Where it was to be kept.
    pub shown: Option<Shown>,
    pub same: Same,
    /// Pixels with a NaN or an infinity here or in the reference.
    pub n_non_finite: u64,
}

/// What is to be done.
pub struct Pass<'a> {
    pub reference: &'a Reference,
    pub test: &'a Picture,
    /// All those that need no neighbours.
    pub quantities: Vec<Quantity>,
    /// Whether other quantities read the image afterwards.
    pub keeps_shown: bool,
}

/// The errors of display RGB of the frame before, to be replaced by those of this one.
pub struct Errors<'a> {
    pub planes: &'a mut [Plane; 3],
    /// False where no frame came before: there is nothing to read yet.
    pub known: bool,
}

/// The rows of three planes that a thread works on.
type Band<'a> = Option<[&'a mut [f64]; 3]>;

/// What a thread found in its band.
struct Found {
    totals: Vec<ByClass<f64>>,
    same: Vec<bool>,
    n_non_finite: u64,
}

/// Most pixels of a run, so that all that becomes of them stays in the first-level cache.
const RUN: usize = 4 * TILE;

/// Room for a run of pixels.
struct Scratch {
    reference: [Vec<f64>; 3],
    shown: [Vec<f64>; 3],
    light: [[Vec<f64>; 3]; 2],
    derived: [Vec<f64>; 2],
    samples: Vec<f64>,
}

impl Quantity {
    /// Whether it is measured pixel by pixel.
    pub fn is_pointwise(self) -> bool {
        match self {
            Self::SquaredError(_) | Self::RelativeSquaredError | Self::SymmetricError => true,
            Self::Change(change) => change == Change::Step,
            _ => false,
        }
    }

    const fn pointwise_domain(self) -> Domain {
        match self {
            Self::SquaredError(domain) => domain,
            Self::RelativeSquaredError | Self::SymmetricError => Domain::Linear,
            _ => Domain::Display,
        }
    }
}

impl Pass<'_> {
    pub fn run(self, mut errors: Option<Errors>) -> Rows {
        let extent = self.test.extent();
        let width = extent.width as usize;
        let mut kept = match self.keeps_shown && !self.test.is_codes() {
            true => Some([(); 3].map(|()| self.reference.new_plane())),
            false => None,
        };
        let known = errors.as_ref().is_some_and(|errors| errors.known);
        let n_bands = (extent.height as usize).div_ceil(TILE);
        let shown = bands(kept.as_mut(), width, n_bands);
        let errors = bands(errors.as_mut().map(|errors| &mut *errors.planes), width, n_bands);
        let work: Vec<(Band, Band)> = shown.into_iter().zip(errors).collect();
        let found = work.into_par_iter().enumerate();
        let found: Vec<Found> = found
            .map_init(Scratch::new, |scratch, (band, (shown, errors))| {
                self.band(band, shown, (errors, known), scratch)
            })
            .collect();
        let n_non_finite = found.iter().map(|band| band.n_non_finite).sum();
        let sums = self.quantities.iter().enumerate();
        Rows {
            sums: sums
                .map(|(i, quantity)| {
                    (
                        *quantity,
                        self.sums(*quantity, found.iter().map(|band| &band.totals[i])),
                    )
                })
                .collect(),
            n_non_finite,
            same: Same::new(width.div_ceil(TILE), found.into_iter().map(|band| band.same)),
            shown: self.keeps_shown.then(|| match kept {
                Some(planes) => Shown::kept(extent, planes),
                None => Shown::codes(self.test),
            }),
        }
    }

    /// The sums of all bands, top to bottom, so that they do not depend on the number of threads.
    fn sums<'b>(&self, quantity: Quantity, bands: impl Iterator<Item = &'b ByClass<f64>>) -> ByClass<Sums> {
        let n_channels = quantity.pointwise_domain().n_channels() as f64;
        let mut sums = self.reference.n_pixels().map(|n| Sums::new(n * n_channels, []));
        for band in bands {
            for (sums, total) in sums.iter_mut().zip(band) {
                sums.terms[0] += total;
            }
        }
        if quantity == Quantity::SquaredError(Domain::Display) {
            for (sums, energy) in sums.iter_mut().zip(self.reference.energy()) {
                sums.terms[1] = energy;
            }
        }
        sums
    }

    fn band(&self, band: usize, mut shown: Band, (mut errors, known): (Band, bool), scratch: &mut Scratch) -> Found {
        let extent = self.test.extent();
        let rows = band * TILE..(extent.height as usize).min((band + 1) * TILE);
        let comparable = self.test.reads_like(self.reference.picture()) && self.reference.is_finite();
        let mut found = Found {
            totals: vec![Default::default(); self.quantities.len()],
            same: match comparable {
                true => same::compare(self.reference.picture(), self.test, rows.clone()),
                false => vec![false; (extent.width as usize).div_ceil(TILE)],
            },
            n_non_finite: 0,
        };
        let runs = runs(&found.same, extent.width as usize);
        for y in rows.clone() {
            let row = (y - rows.start) * extent.width as usize;
            for (same, columns) in &runs {
                let at = row + columns.start..row + columns.end;
                let mut run = Run {
                    pass: self,
                    y,
                    columns: columns.clone(),
                    shown: cut(&mut shown, at.clone()),
                    errors: cut(&mut errors, at),
                    known,
                };
                match same {
                    true => run.repeat(scratch, &mut found.totals),
                    false => found.n_non_finite += run.compare(scratch, &mut found.totals),
                }
            }
        }
        found
    }
}

/// Planes cut into the rows of each band.
fn bands(planes: Option<&mut [Plane; 3]>, width: usize, n_bands: usize) -> Vec<Band<'_>> {
    let Some(planes) = planes else {
        return (0..n_bands).map(|_| None).collect();
    };
    let [r, g, b] = planes.each_mut().map(|plane| plane.chunks_mut(width * TILE));
    r.zip(g).zip(b).map(|((r, g), b)| Some([r, g, b])).collect()
}

/// A part of a band.
fn cut<'a>(band: &'a mut Band, at: Range<usize>) -> Band<'a> {
    let planes = band.as_mut()?;
    Some(planes.each_mut().map(|plane| &mut plane[at.clone()]))
}

/// The columns of neighbouring tiles that are all the same, or all not.
fn runs(same: &[bool], width: usize) -> Vec<(bool, Range<usize>)> {
    let mut start = 0;
    let alike = same.chunk_by(|a, b| a == b);
    let runs = alike.flat_map(|tiles| tiles.chunks(RUN / TILE)).map(|tiles| {
        let end = width.min(start + tiles.len() * TILE);
        (tiles[0], std::mem::replace(&mut start, end)..end)
    });
    runs.collect()
}

/// Some columns of a row.
struct Run<'a> {
    pass: &'a Pass<'a>,
    y: usize,
    columns: Range<usize>,
    /// Where the image is to be kept.
    shown: Band<'a>,
    /// Where errors are replaced.
    errors: Band<'a>,
    /// Whether there are any yet.
    known: bool,
}

impl Run<'_> {
    /// Where pixels are those of the reference: it is copied, and no error is left.
    fn repeat(&mut self, scratch: &mut Scratch, totals: &mut [ByClass<f64>]) {
        if let Some(shown) = &mut self.shown {
            let shown_reference = self.pass.reference.shown();
            let reference = shown_reference.rows(self.y, self.columns.clone(), &mut scratch.reference);
            shown
                .iter_mut()
                .zip(reference)
                .for_each(|(kept, row)| kept.copy_from_slice(row));
        }
        let classes = self.pass.classes(self.y, self.columns.clone());
        for row in self.errors.iter_mut().flatten() {
            if let (true, Some(total)) = (self.known, self.pass.of_step(totals)) {
                add_squares(row, classes, total);
            }
            row.fill(0.0);
        }
    }

    /// Converts and measures; the number of pixels that are not finite.
    fn compare(&mut self, scratch: &mut Scratch, totals: &mut [ByClass<f64>]) -> u64 {
        let (pass, y, columns, n) = (self.pass, self.y, self.columns.clone(), self.columns.len());
        if let Some(squares) = self.squares_of_codes() {
            for (quantity, totals) in pass.quantities.iter().zip(totals) {
                let peak = quantity.pointwise_domain().peak();
                totals[0] += squares as f64 * (peak / 255.0) * (peak / 255.0);
            }
            return 0;
        }
        let Scratch {
            reference,
            shown,
            light,
            derived,
            samples,
        } = scratch;
        let samples = &mut samples[..n];
        let reads_display = self.shown.is_some() || pass.quantities.iter().any(|quantity| quantity.reads_display());
        let mut reference_shown = [&[][..]; 3];
        if reads_display {
            let rows = shown.each_mut().map(|row| &mut row[..n]);
            pass.test.show(y, columns.clone(), rows);
            reference_shown = pass.reference.shown().rows(y, columns.clone(), reference);
        }
        let (shown, reference) = (shown.each_ref().map(|row| &row[..n]), reference_shown);
        for (kept, row) in self.shown.iter_mut().flatten().zip(shown) {
            kept.copy_from_slice(row);
        }
        if pass
            .quantities
            .iter()
            .any(|quantity| quantity.pointwise_domain() == Domain::Linear)
        {
            for (picture, light) in [pass.reference.picture(), pass.test].into_iter().zip(&mut *light) {
                picture.light(y, columns.clone(), light.each_mut().map(|row| &mut row[..n]));
            }
        }
        let classes = self.pass.classes(self.y, self.columns.clone());
        for (quantity, totals) in pass.quantities.iter().zip(&mut *totals) {
            let domain = quantity.pointwise_domain();
            for channel in 0..domain.n_channels() {
                let [r, t] = match domain {
                    Domain::Display => [reference[channel], shown[channel]],
                    Domain::Linear => light.each_ref().map(|rows| &rows[channel][..n]),
                    Domain::Luma => derive(derived, [reference, shown], luma),
                    Domain::U8 => derive(derived, [[reference[channel]; 3], [shown[channel]; 3]], code),
                };
                let compared = Compared {
                    r,
                    t,
                    samples,
                    classes,
                    totals,
                };
                match quantity {
                    Quantity::SquaredError(_) => squared(compared),
                    Quantity::RelativeSquaredError => relative_squared(compared),
                    Quantity::SymmetricError => symmetric(compared),
                    _ => {}
                }
            }
        }
        for (channel, row) in self.errors.iter_mut().flatten().enumerate() {
            replace(reference[channel], shown[channel], row, samples);
            if let (true, Some(totals)) = (self.known, pass.of_step(totals)) {
                add_squares(samples, classes, totals);
            }
        }
        match reads_display {
            true => count_nan(reference[0], shown[0]),
            false => pass.test.n_non_finite(pass.reference.picture(), y, columns),
        }
    }
}

impl Run<'_> {
    /// The sum of squared differences of 8-bit images, in codes and exact, where nothing but what follows from it is asked for.
    fn squares_of_codes(&self) -> Option<u64> {
        let follows = |quantity: &Quantity| match quantity {
            Quantity::SquaredError(domain) => matches!(domain, Domain::Display | Domain::U8),
            _ => false,
        };
        let pass = self.pass;
        let alone = self.shown.is_none() && self.errors.is_none() && pass.reference.classes().is_none();
        if !alone || !pass.quantities.iter().all(follows) {
            return None;
        }
        pass.test
            .squares_of_codes(pass.reference.picture(), self.y, self.columns.clone())
    }
}

impl Pass<'_> {
    fn classes(&self, y: usize, columns: Range<usize>) -> Option<&[Class]> {
        Some(self.reference.classes()?.row(y, columns))
    }

    /// The sums of [`Change::Step`], if it is asked for.
    fn of_step<'b>(&self, totals: &'b mut [ByClass<f64>]) -> Option<&'b mut ByClass<f64>> {
        let step = Quantity::Change(Change::Step);
        let place = self.quantities.iter().position(|quantity| *quantity == step)?;
        Some(&mut totals[place])
    }
}

impl Scratch {
    fn new() -> Self {
        let row = || vec![0.0; RUN];
        Self {
            reference: [(); 3].map(|()| row()),
            shown: [(); 3].map(|()| row()),
            light: [(); 2].map(|()| [(); 3].map(|()| row())),
            derived: [(); 2].map(|()| row()),
            samples: row(),
        }
    }
}

/// Values of both images that follow from those of up to three channels.
fn derive<'a>(
    derived: &'a mut [Vec<f64>; 2],
    images: [[&[f64]; 3]; 2],
    kernel: for<'k> fn([&'k [f64]; 3], &'k mut [f64]),
) -> [&'a [f64]; 2] {
    let n = images[0][0].len();
    for (derived, channels) in derived.iter_mut().zip(images) {
        kernel(channels, &mut derived[..n]);
    }
    derived.each_ref().map(|row| &row[..n])
}

vectorised! {
    pub fn luma<'a>(channels: [&'a [f64]; 3], luma: &'a mut [f64]) {
        let [r, g, b] = channels;
        for (((luma, r), g), b) in luma.iter_mut().zip(r).zip(g).zip(b) {
            *luma = display::luma([*r, *g, *b]);
        }
    }

    pub fn code<'a>(channels: [&'a [f64]; 3], codes: &'a mut [f64]) {
        for (code, value) in codes.iter_mut().zip(channels[0]) {
            *code = round(255.0 * value);
        }
    }
}

/// Two runs of samples, and what becomes of them.
struct Compared<'a> {
    r: &'a [f64],
    t: &'a [f64],
    samples: &'a mut [f64],
    classes: Option<&'a [Class]>,
    totals: &'a mut ByClass<f64>,
}

impl Compared<'_> {
    #[inline(always)]
    fn add(self, f: impl Fn(f64, f64) -> f64) {
        let n = self.samples.len();
        let (r, t) = (&self.r[..n], &self.t[..n]);
        if self.classes.is_none() {
            self.totals[0] += mask::sum(n, |i| f(r[i], t[i]));
            return;
        }
        for ((sample, r), t) in self.samples.iter_mut().zip(r).zip(t) {
            *sample = f(*r, *t);
        }
        mask::accumulate(self.samples, self.classes, self.totals);
    }
}

vectorised! {
    fn squared<'a>(compared: Compared<'a>) {
        compared.add(|r, t| (t - r) * (t - r));
    }

    fn relative_squared<'a>(compared: Compared<'a>) {
        compared.add(relative_error::squared);
    }

    fn symmetric<'a>(compared: Compared<'a>) {
        compared.add(relative_error::symmetric);
    }

    /// Puts the errors of this frame in place of those before, and how they changed into `changes`.
    fn replace<'a>(r: &'a [f64], t: &'a [f64], errors: &'a mut [f64], changes: &'a mut [f64]) {
        for (((error, change), r), t) in errors.iter_mut().zip(changes).zip(r).zip(t) {
            let now = t - r;
            *change = now - *error;
            *error = now;
        }
    }

    /// Squares in place, and adds.
    fn add_squares<'a>(values: &'a mut [f64], classes: Option<&'a [Class]>, totals: &'a mut ByClass<f64>) {
        for value in &mut *values {
            *value *= *value;
        }
        mask::accumulate(values, classes, totals);
    }

    fn count_nan<'a>(a: &'a [f64], b: &'a [f64]) -> u64 {
        let mut n = 0;
        for (a, b) in a.iter().zip(b) {
            n += u64::from((a + b).is_nan());
        }
        n
    }
}
