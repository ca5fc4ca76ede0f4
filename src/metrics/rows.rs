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
    shown::{Area, View},
    ssim,
    temporal::Change,
    vector::vectorised,
};
use crate::image::Extent;
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

/// What a thread leaves of its block: the rows of planes, and none where a plane is not wanted.
#[derive(Default)]
struct Left<'a> {
    luma: Vec<&'a mut [f64]>,
    errors: [Vec<&'a mut [f64]>; 3],
}

/// What a thread found in its block.
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
    pub fn run(self, errors: Option<Errors>) -> Rows {
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
        // What is converted for windows stays in the second-level cache while it is compared.
        let size = match self.windows.is_empty() {
            true => [width, TILE],
            false => [ssim::BLOCK, ssim::BAND],
        };
        let blocks = blocks(extent, size);
        let mut left: Vec<Left> = blocks.iter().map(|_| Left::default()).collect();
        if let Some(plane) = &mut luma {
            cut(plane, width, size, |block, row| left[block].luma.push(row));
        }
        for (channel, plane) in errors.into_iter().flat_map(|errors| errors.planes).enumerate() {
            cut(plane, width, size, |block, row| left[block].errors[channel].push(row));
        }
        let work: Vec<(Area, Left)> = blocks.into_iter().zip(left).collect();
        let has_windows = !self.windows.is_empty();
        let room = || (self.reference.room_for_windows(has_windows), Scratch::new());
        let found = work.into_par_iter().map_init(room, |(seen, scratch), (block, left)| {
            self.block(block, &same, (left, known), (seen, scratch))
        });
        let found: Vec<Found> = found.collect();
        let n_non_finite = found.iter().map(|block| block.n_non_finite).sum();
        let pointwise = self.quantities.iter().enumerate();
        let pointwise = pointwise.map(|(i, quantity)| {
            let totals = found.iter().map(|block| &block.totals[i]);
            (*quantity, self.sums(*quantity, totals))
        });
        let windows = self.windows.iter().enumerate().map(|(i, domain)| {
            let blocks = found.iter().map(|block| &block.windows[i]);
            let all = blocks.fold(Default::default(), |all: ByClass<Sums>, block| {
                std::array::from_fn(|class| all[class].plus(&block[class]))
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

    /// The sums of all blocks, one after the other, so that they do not depend on the number of threads.
    fn sums<'b>(&self, quantity: Quantity, blocks: impl Iterator<Item = &'b ByClass<f64>>) -> ByClass<Sums> {
        let n_channels = quantity.pointwise_domain().n_channels() as f64;
        let mut sums = self.reference.n_pixels().map(|n| Sums::new(n * n_channels, []));
        for block in blocks {
            for (sums, total) in sums.iter_mut().zip(block) {
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

    fn block(
        &self,
        [columns, rows]: Area,
        same: &Same,
        (mut left, known): (Left, bool),
        (seen, scratch): (&mut ssim::Seen, &mut Scratch),
    ) -> Found {
        let mut found = Found {
            totals: vec![Default::default(); self.quantities.len()],
            windows: vec![Default::default(); self.windows.len()],
            n_non_finite: 0,
        };
        let windows = (!self.windows.is_empty()).then(|| {
            let images = (self.reference.shown(), self.test);
            ssim::Block::new(images, same, [columns.clone(), rows.clone()], seen)
        });
        let most = RUN.min(self.reference.strip().width).div_ceil(TILE);
        for (i, y) in rows.enumerate() {
            for (is_same, run) in same.runs(y, columns.clone(), most) {
                let at = run.start - columns.start..run.end - columns.start;
                let mut run = Run {
                    pass: self,
                    views: windows.as_ref().map(ssim::Block::views),
                    y,
                    columns: run,
                    luma: part(&mut left.luma, i, at.clone()),
                    errors: left.errors.each_mut().map(|rows| part(rows, i, at.clone())),
                    known,
                };
                match is_same {
                    true => run.repeat(&mut found.totals),
                    false => found.n_non_finite += run.compare(scratch, &mut found.totals),
                }
            }
        }
        for (domain, sums) in self.windows.iter().zip(&mut found.windows) {
            let windows = windows.as_ref().expect("made for all domains");
            windows.add(*domain, self.reference.classes(), sums);
        }
        found
    }
}

/// An image cut into blocks of `size` pixels, row by row.
fn blocks(extent: Extent, size: [usize; 2]) -> Vec<Area> {
    let [columns, rows] = [(extent.width, size[0]), (extent.height, size[1])].map(|(side, size)| {
        let side = side as usize;
        (0..side).step_by(size).map(move |start| start..side.min(start + size))
    });
    rows.flat_map(|rows| columns.clone().map(move |columns| [columns, rows.clone()]))
        .collect()
}

/// Calls `f` with the number of a block and a row of `plane` in it, from its first row on.
fn cut<'a>(plane: &'a mut Plane, width: usize, size: [usize; 2], mut f: impl FnMut(usize, &'a mut [f64])) {
    for (y, row) in plane.chunks_mut(width).enumerate() {
        let first = y / size[1] * width.div_ceil(size[0]);
        for (x, row) in row.chunks_mut(size[0]).enumerate() {
            f(first + x, row);
        }
    }
}

/// A part of the `i`-th row, where there are any.
fn part<'a>(rows: &'a mut [&mut [f64]], i: usize, columns: Range<usize>) -> Option<&'a mut [f64]> {
    Some(&mut rows.get_mut(i)?[columns])
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
    errors: [Option<&'a mut [f64]>; 3],
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
        let alone = self.luma.is_none() && self.errors[0].is_none() && pass.reference.classes().is_none();
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
