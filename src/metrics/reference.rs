//! A reference frame, and the scores of the images that are compared with it.

use super::{
    Metric, MetricError, Value, Values,
    flip::{self, Exposures, SeenImage},
    mask::{self, ByClass, ByMask, Classes, by_mask, sum_rows},
    ms_ssim::{self, Pyramid},
    picture::Picture,
    plane::{Plane, Pool},
    quantity::{Domain, Quantity, Sums, quantities},
    rows::{Pass, Rows},
    same::Same,
    shown::{Shown, Strip},
    ssim,
    temporal::{Change, Past, Step},
};
use crate::image::{Extent, Image};
use std::{
    collections::BTreeMap,
    sync::{Arc, OnceLock},
};

/// The scores of one test image.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScores {
    /// By metric id.
    pub values: Values,
    /// Pixels of test or reference with a NaN or an infinity. Any at all makes every metric that saw it NaN.
    pub non_finite_pixels: u64,
}

/// A reference frame, prepared once and shared by every image that is compared with it. What follows from it alone is
/// computed when a metric first asks for it.
pub struct Reference {
    picture: Picture,
    metrics: Arc<[Metric]>,
    pool: Pool,
    /// Where a metric reads display values.
    shown: Option<Shown>,
    /// How those are cut.
    strip: Strip,
    is_finite: bool,
    step: Option<Step>,
    luma: OnceLock<Arc<Plane>>,
    energy: OnceLock<ByClass<f64>>,
    seen: OnceLock<SeenImage>,
    exposures: OnceLock<Exposures>,
    pyramid: OnceLock<Pyramid>,
}

impl Reference {
    /// Prepares `picture` for `metrics`.
    pub fn new(picture: Picture, metrics: &[Metric]) -> Self {
        Self::with(picture, metrics.into(), Pool::default())
    }

    /// The next frame after a cut, for the same metrics.
    pub fn restart(&self, picture: Picture) -> Self {
        Self::with(picture, Arc::clone(&self.metrics), self.pool.clone())
    }

    /// The next frame, with its motion where that is known: what [`super::Track`] needs.
    pub fn follow(&self, picture: Picture, motion_px: Option<&Arc<Image<[f32; 2]>>>) -> Self {
        let mut next = self.restart(picture);
        let wanted = self.metrics.iter().any(|metric| metric.needs_motion());
        next.step = Some(Step::new(self, &next, motion_px.filter(|_| wanted)));
        next
    }

    fn with(picture: Picture, metrics: Arc<[Metric]>, pool: Pool) -> Self {
        // Masks are told by luma, whatever is measured within them.
        let reads_display = quantities(&metrics).into_iter().any(Quantity::reads_display)
            || metrics.iter().any(|metric| metric.needs_motion());
        let has_windows = quantities(&metrics)
            .into_iter()
            .any(|quantity| quantity.windows().is_some());
        let strip = match has_windows {
            true => ssim::STRIP,
            false => Strip {
                width: picture.extent().width as usize,
                beyond: 0,
            },
        };
        let (shown, is_finite) = match reads_display {
            true => {
                let (shown, is_finite) = Shown::new(&picture, strip, &pool);
                (Some(shown), is_finite)
            }
            false => (None, picture.is_finite()),
        };
        Self {
            shown,
            is_finite,
            strip,
            picture,
            metrics,
            pool,
            step: None,
            luma: OnceLock::new(),
            energy: OnceLock::new(),
            seen: OnceLock::new(),
            exposures: OnceLock::new(),
            pyramid: OnceLock::new(),
        }
    }

    /// Frees what only scores need: the frame has none to come, and serves as the past of the next.
    pub fn retire(&mut self) {
        if self.metrics.iter().any(|metric| metric.is_temporal()) && self.shown.is_some() {
            self.luma();
        }
        self.shown = None;
        self.seen = OnceLock::new();
        self.pyramid = OnceLock::new();
    }

    /// Scores `test`.
    pub fn evaluate(&self, test: &Picture) -> Result<FrameScores, MetricError> {
        match self.metrics.iter().find(|metric| metric.is_temporal()) {
            Some(metric) => Err(MetricError::NeedsSequence { metric: metric.id() }),
            None => self.score(test, &mut Past::default()),
        }
    }

    /// Scores `test` as the frame after `past`, which it becomes.
    pub(super) fn score(&self, test: &Picture, past: &mut Past) -> Result<FrameScores, MetricError> {
        check_sizes(&self.metrics, self.extent(), test.extent())?;
        let wanted = quantities(&self.metrics);
        let (pointwise, others): (Vec<_>, Vec<_>) = wanted.iter().partition(|quantity| quantity.is_pointwise());
        let follows = self.step.is_some() && past.is_known();
        let pass = Pass {
            reference: self,
            test,
            quantities: pointwise,
            windows: wanted.iter().filter_map(|quantity| quantity.windows()).collect(),
            keeps_luma: others.iter().any(|quantity| quantity.reads_luma()),
        };
        let keeps_errors = wanted.contains(&Quantity::Change(Change::Step));
        let rows = pass.run(keeps_errors.then(|| past.errors(self, follows)));
        let Rows { sums, n_non_finite, .. } = &rows;
        let (sums, n_non_finite) = (sums.clone(), *n_non_finite);
        let is_finite = n_non_finite == 0;
        let follows_finite = is_finite && past.is_finite() && self.step.as_ref().is_some_and(|step| step.is_finite);
        let measure = |pair: &Pair, quantity: &Quantity| -> Option<ByMask<Sums>> {
            match quantity {
                Quantity::ErrorDeviation | Quantity::Convergence => None,
                Quantity::Change(_) if !follows => None,
                Quantity::Change(_) if !follows_finite => Some(Sums::unknown()),
                _ if !is_finite => Some(Sums::unknown()),
                _ => match sums.get(quantity) {
                    Some(sums) => Some(by_mask(sums)),
                    None => Some(pair.measure(*quantity, past)),
                },
            }
        };
        let pair = Pair::new(self, test, rows);
        let measured = wanted
            .iter()
            .filter_map(|quantity| Some((*quantity, measure(&pair, quantity)?)));
        let measured: BTreeMap<_, _> = measured.collect();
        let mut values = values(&self.metrics, &measured, self.classes().is_some());
        if is_finite && wanted.contains(&Quantity::HdrFlip) {
            let exposures = self.exposures();
            values.insert(flip::START_EXPOSURE, Value(exposures.start));
            values.insert(flip::STOP_EXPOSURE, Value(exposures.stop));
        }
        past.remember(pair.luma, measured.get(&SHOWN_ERROR), is_finite);
        Ok(FrameScores {
            values,
            non_finite_pixels: n_non_finite,
        })
    }

    pub(super) fn extent(&self) -> Extent {
        self.picture.extent()
    }

    pub(super) fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    pub(super) fn picture(&self) -> &Picture {
        &self.picture
    }

    pub(super) fn shown(&self) -> &Shown {
        self.shown.as_ref().expect("made for the quantities that read it")
    }

    pub(super) fn strip(&self) -> Strip {
        self.strip
    }

    /// Whether every pixel is.
    pub(super) fn is_finite(&self) -> bool {
        self.is_finite
    }

    pub(super) fn step(&self) -> Option<&Step> {
        self.step.as_ref()
    }

    /// What each pixel is, where a mask asks for it.
    pub(super) fn classes(&self) -> Option<&Classes> {
        self.step.as_ref()?.classes.as_ref()
    }

    /// Of each class.
    pub(super) fn n_pixels(&self) -> ByClass<f64> {
        match self.classes() {
            Some(classes) => classes.n_pixels,
            None => mask::all(self.extent().n_pixels()),
        }
    }

    pub(super) fn new_plane(&self) -> Plane {
        self.pool.plane(self.extent().n_pixels())
    }

    /// Room for what windows see; for nothing, where there are none.
    pub(super) fn room_for_windows(&self, has_windows: bool) -> ssim::Seen {
        let n = if has_windows { ssim::N_SEEN } else { 0 };
        [(); 2].map(|()| [(); 3].map(|()| self.pool.plane(n)))
    }

    pub(super) fn luma(&self) -> &Arc<Plane> {
        self.luma.get_or_init(|| {
            let mut plane = self.new_plane();
            self.shown().luma(&mut plane);
            Arc::new(plane)
        })
    }

    /// Σ R² of display values.
    pub(super) fn energy(&self) -> ByClass<f64> {
        *self.energy.get_or_init(|| {
            let [sums] = sum_rows(self.extent(), self.classes(), |y, [squares]| {
                let mut scratch = Default::default();
                for columns in self.shown().columns() {
                    let rows = self.shown().rows(y, columns.clone(), &mut scratch);
                    for (x, square) in squares[columns].iter_mut().enumerate() {
                        *square = rows.iter().map(|row| row[x] * row[x]).sum();
                    }
                }
            });
            sums
        })
    }

    pub(super) fn seen(&self) -> &SeenImage {
        self.seen.get_or_init(|| SeenImage::new(&self.picture, &self.pool))
    }

    pub(super) fn exposures(&self) -> Exposures {
        *self.exposures.get_or_init(|| Exposures::of(&self.picture))
    }

    pub(super) fn pyramid(&self) -> &Pyramid {
        self.pyramid
            .get_or_init(|| Pyramid::new(self.luma(), self.extent(), self.classes()))
    }
}

/// The quantity that a reset's PSNR is made of.
const SHOWN_ERROR: Quantity = Quantity::SquaredError(Domain::Display);

/// A reference and an image under test, as metrics whose samples need neighbours see them.
pub(super) struct Pair<'a> {
    pub reference: &'a Reference,
    pub test: &'a Picture,
    luma: Option<Arc<Plane>>,
    pub same: Same,
    flip: OnceLock<Image<f32>>,
}

impl<'a> Pair<'a> {
    fn new(reference: &'a Reference, test: &'a Picture, rows: Rows) -> Self {
        Self {
            reference,
            test,
            luma: rows.luma.map(Arc::new),
            same: rows.same,
            flip: OnceLock::new(),
        }
    }

    fn measure(&self, quantity: Quantity, past: &Past) -> ByMask<Sums> {
        match quantity {
            Quantity::MsSsim => by_mask(&ms_ssim::measure(self)),
            Quantity::Flip => by_mask(&flip::sums(self.flip(), self.reference.classes())),
            Quantity::FlipPercentile => flip::percentiles_95(self.flip(), self.reference.classes()),
            Quantity::HdrFlip => by_mask(&flip::sums(&flip::hdr_map(self), self.reference.classes())),
            Quantity::Change(change) => by_mask(&change.measure(self, past)),
            _ => unreachable!("measured in passing, or over many frames"),
        }
    }

    pub fn luma(&self) -> &[f64] {
        self.luma.as_ref().expect("kept for the quantities that read it")
    }

    fn flip(&self) -> &Image<f32> {
        self.flip.get_or_init(|| flip::map(self))
    }
}

/// Maps are made of pairs as well: `f` may ask for what `quantity` reads.
pub(super) fn with_pair<R>(
    reference: &Reference,
    test: &Picture,
    quantity: Quantity,
    f: impl FnOnce(&Pair) -> R,
) -> Result<R, MetricError> {
    check_sizes(&reference.metrics, reference.extent(), test.extent())?;
    let pass = Pass {
        reference,
        test,
        quantities: Vec::new(),
        windows: Vec::new(),
        keeps_luma: quantity.reads_luma(),
    };
    let rows = pass.run(None);
    Ok(f(&Pair::new(reference, test, rows)))
}

impl Sums {
    /// Of images that cannot be measured: every metric becomes NaN.
    pub(super) fn unknown() -> ByMask<Self> {
        [Self {
            n: 1.0,
            terms: [f64::NAN; 10],
        }; _]
    }
}

pub(super) fn check_sizes(metrics: &[Metric], reference: Extent, test: Extent) -> Result<(), MetricError> {
    if reference != test {
        return Err(MetricError::SizeMismatch { reference, test });
    }
    metrics.iter().try_for_each(|metric| metric.check_size(test))
}

/// The value of each of `metrics` whose quantity was measured on at least one pixel.
pub(super) fn values(metrics: &[Metric], measured: &BTreeMap<Quantity, ByMask<Sums>>, has_masks: bool) -> Values {
    let value = |metric: &Metric| {
        let definition = metric.definition();
        let sums = &measured.get(&definition.quantity)?[mask::place(metric.mask())];
        let known = sums.n > 0.0 && (metric.mask().is_none() || has_masks);
        Some((metric.id(), Value(known.then(|| (definition.value)(sums))??)))
    };
    metrics.iter().filter_map(value).collect()
}
