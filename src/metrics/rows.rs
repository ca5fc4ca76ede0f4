//! The pass over an image under test: its pixels are converted, compared with the reference's where a quantity needs no
//! neighbours, and their luma is kept where another does. One pass, because memory is slower than arithmetic; and none at all over
//! tiles whose pixels are those of the reference.

use super::{
    display,
    mask::{self, ByClass, Class},
    picture::{Picture, round},
    plane::Plane,
    quantity::{Domain, Quantity, Sums},
    reference::Reference,
    relative_error,
    same::{Same, TILE},
    shown::View,
    ssim,
    temporal::Change,
    vector::vectorised,
};
use rayon::prelude::*;
use std::{collections::BTreeMap, ops::Range};

/// What the pass found.
pub struct Rows {
    pub sums: BTreeMap<Quantity, ByClass<Sums>>,
    /// Where it was to be kept.
    pub luma: Option<Plane>,
    pub same: Same,
    /// Pixels with a NaN or an infinity here or in the reference.
    pub n_non_finite: u64,
}

/// What is to be done.
pub struct Pass<'a> {
    pub reference: &'a Reference,
    pub test: &'a Picture,
    /// All those that are [`Quantity::is_pointwise`].
    pub quantities: Vec<Quantity>,
    /// Where the structural similarity is measured.
    pub windows: Vec<Domain>,
    /// Whether other quantities read the image's luma afterwards.
    pub keeps_luma: bool,
}

/// The errors of display RGB of the frame before, to be replaced by those of this one.
pub struct Errors<'a> {
    pub planes: &'a mut [Plane; 3],
    /// False where no frame came before: there is nothing to read yet.
    pub known: bool,
}

/// The rows of three planes that a thread works on.
type Band<'a> = Option<[&'a mut [f64]; 3]>;

/// What a thread leaves of its band.
struct Left<'a> {
    luma: Option<&'a mut [f64]>,
    errors: Band<'a>,
}

/// What a thread found in its band.
struct Found {
    totals: Vec<ByClass<f64>>,
    windows: Vec<ByClass<Sums>>,
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
        let comparable = self.test.reads_like(self.reference.picture()) && self.reference.is_finite();
        let same = match comparable {
            true => Same::of(self.reference.picture(), self.test),
            false => Same::nowhere(extent),
        };
        let mut luma = self.keeps_luma.then(|| {
            // Made now, and not by whichever thread comes upon a tile that repeats it.
            self.reference.luma();
            self.reference.new_plane()
        });
        let known = errors.as_ref().is_some_and(|errors| errors.known);
        let n_rows = if self.windows.is_empty() { TILE } else { ssim::BAND };
        let n_bands = (extent.height as usize).div_ceil(n_rows);
        let errors = bands(
            errors.as_mut().map(|errors| &mut *errors.planes),
            width * n_rows,
            n_bands,
        );
        let lumas = luma.iter_mut().flat_map(|plane| plane.chunks_mut(width * n_rows));
        let lumas = lumas.map(Some).chain(std::iter::repeat_with(|| None));
        let left: Vec<Left> = lumas.zip(errors).map(|(luma, errors)| Left { luma, errors }).collect();
        let found = left.into_par_iter().enumerate();
        let found: Vec<Found> = found
            .map_init(
                || {
                    (
                        self.reference.room_for_windows(!self.windows.is_empty()),
                        Scratch::new(),
                    )
                },
                |(seen, scratch), (band, left)| {
                    let rows = band * n_rows..(extent.height as usize).min((band + 1) * n_rows);
                    self.band(rows, &same, (left, known), (seen, scratch))
                },
            )
            .collect();
        let n_non_finite = found.iter().map(|band| band.n_non_finite).sum();
        let pointwise = self.quantities.iter().enumerate();
        let pointwise = pointwise.map(|(i, quantity)| {
            let totals = found.iter().map(|band| &band.totals[i]);
            (*quantity, self.sums(*quantity, totals))
        });
        let windows = self.windows.iter().enumerate().map(|(i, domain)| {
            let bands = found.iter().map(|band| &band.windows[i]);
            let all = bands.fold(Default::default(), |all: ByClass<Sums>, band| {
                std::array::from_fn(|class| all[class].plus(&band[class]))
            });
            (Quantity::Ssim(*domain), all)
        });
        Rows {
            sums: pointwise.chain(windows).collect(),
            n_non_finite,
            same,
            luma,
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

    /// Part by part: what is converted for windows stays in the second-level cache while it is compared.
    fn band(
        &self,
        rows: Range<usize>,
        same: &Same,
        (mut left, known): (Left, bool),
        (seen, scratch): (&mut ssim::Seen, &mut Scratch),
    ) -> Found {
        let width = self.test.extent().width as usize;
        let n_columns = if self.windows.is_empty() { width } else { ssim::BLOCK };
        let mut found = Found {
            totals: vec![Default::default(); self.quantities.len()],
            windows: vec![Default::default(); self.windows.len()],
            n_non_finite: 0,
        };
        let most = RUN.min(self.reference.strip().width).div_ceil(TILE);
        for left_column in (0..width).step_by(n_columns) {
            let columns = left_column..width.min(left_column + n_columns);
            let block = (!self.windows.is_empty()).then(|| {
                let images = (self.reference.shown(), self.test);
                ssim::Block::new(images, same, [columns.clone(), rows.clone()], seen)
            });
            for y in rows.clone() {
                let row = (y - rows.start) * width;
                for (is_same, columns) in same.runs(y, columns.clone(), most) {
                    let at = row + columns.start..row + columns.end;
                    let mut run = Run {
                        pass: self,
                        views: block.as_ref().map(ssim::Block::views),
                        y,
                        columns,
                        luma: left.luma.as_mut().map(|luma| &mut luma[at.clone()]),
                        errors: cut(&mut left.errors, at),
                        known,
                    };
                    match is_same {
                        true => run.repeat(&mut found.totals),
                        false => found.n_non_finite += run.compare(scratch, &mut found.totals),
                    }
                }
            }
            for (domain, sums) in self.windows.iter().zip(&mut found.windows) {
                let block = block.as_ref().expect("made for windows");
                block.add(*domain, self.reference.classes(), sums);
            }
        }
        found
    }
}

/// Planes cut into `n_bands` bands of `n` pixels.
fn bands(planes: Option<&mut [Plane; 3]>, n: usize, n_bands: usize) -> Vec<Band<'_>> {
    let Some(planes) = planes else {
        return (0..n_bands).map(|_| None).collect();
    };
    let [r, g, b] = planes.each_mut().map(|plane| plane.chunks_mut(n));
    r.zip(g).zip(b).map(|((r, g), b)| Some([r, g, b])).collect()
}

/// A part of a band.
fn cut<'a>(band: &'a mut Band, at: Range<usize>) -> Band<'a> {
    let planes = band.as_mut()?;
    Some(planes.each_mut().map(|plane| &mut plane[at.clone()]))
}

/// Some columns of a row.
struct Run<'a> {
    pass: &'a Pass<'a>,
    /// What both images show here, where that is known: the reference first.
    views: Option<&'a [View<'a>; 2]>,
    y: usize,
    columns: Range<usize>,
    /// Where its luma is to be kept.
    luma: Option<&'a mut [f64]>,
    /// Where errors are replaced.
    errors: Band<'a>,
    /// Whether there are any yet.
    known: bool,
}

impl Run<'_> {
    /// Where pixels are those of the reference: it is copied, and no error is left.
    fn repeat(&mut self, totals: &mut [ByClass<f64>]) {
        if let Some(luma) = &mut self.luma {
            let row = self.y * self.pass.test.extent().width as usize;
            let reference = &self.pass.reference.luma()[row + self.columns.start..row + self.columns.end];
            luma.copy_from_slice(reference);
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
        let reads_display = self.luma.is_some() || pass.quantities.iter().any(|quantity| quantity.reads_display());
        let [mut reference_shown, mut test_shown] = [[&[][..]; 3]; 2];
        if reads_display {
            [reference_shown, test_shown] = match self.views {
                Some(views) => views.each_ref().map(|view| view.rows(y, columns.clone())),
                None => {
                    let rows = shown.each_mut().map(|row| &mut row[..n]);
                    pass.test.show([columns.clone(), y..y + 1], rows);
                    let reference = pass.reference.shown().rows(y, columns.clone(), reference);
                    [reference, shown.each_ref().map(|row| &row[..n])]
                }
            };
        }
        let (reference, shown) = (reference_shown, test_shown);
        if let Some(kept) = &mut self.luma {
            luma(shown, kept);
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
        match self.views {
            _ if reads_display => count_nan(reference[0], shown[0]),
            Some([_, test]) if pass.reference.is_finite() => {
                let shown = test.row(0, y, columns);
                count_nan(shown, shown)
            }
            _ => pass.test.n_non_finite(pass.reference.picture(), y, columns),
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
        let alone = self.luma.is_none() && self.errors.is_none() && pass.reference.classes().is_none();
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
