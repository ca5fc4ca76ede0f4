//! What the device found about one preset's frame, once it is back: sums by quantity.

use super::{
    super::{
        Value, Values,
        flip::{Exposures, START_EXPOSURE, STOP_EXPOSURE},
        mask::{ByClass, ByMask, N_CLASSES, by_mask},
        ms_ssim::N_SCALES,
        quantity::{Domain, Quantity, Sums},
        temporal::{Change, sums},
    },
    flip::FlipSums,
    sums::Copied,
    temporal::Changes,
};
use crate::gpu::{GpuError, Readback};
use std::{array, collections::BTreeMap};

/// What [`super::GpuMetrics::record`] asked for, to be read once its submission is done.
#[derive(Debug)]
pub struct Recorded {
    pub(super) follows: bool,
    pub(super) knows_classes: bool,
    pub(super) pixels: Copied<9>,
    pub(super) ssim: Vec<(Domain, Copied<2>)>,
    /// Of each scale, from the finest on.
    pub(super) multi_scale: Option<Vec<Copied<2>>>,
    pub(super) flip: FlipSums,
    pub(super) hdr_flip: Option<(Exposures, Copied<1>)>,
    pub(super) changes: Changes,
}

/// The same, read.
pub struct Measured {
    pub quantities: BTreeMap<Quantity, ByMask<Sums>>,
    pub n_non_finite: u64,
    /// By place: the mean so far of the pixels' deviations over time, where any counted twice.
    pub deviations: Vec<(usize, Option<f64>)>,
}

/// One whose samples are pixels.
const PIXELS: Quantity = Quantity::SquaredError(Domain::Luma);

impl Recorded {
    pub(super) fn read(&self, readback: &Readback) -> Result<Measured, GpuError> {
        let mut by_class: BTreeMap<Quantity, ByClass<Sums>> = BTreeMap::new();
        let totals = self.pixels.totals(readback, self.knows_classes)?;
        let [n, non_finite, linear, display, luma, u8, energy, relative, symmetric] = totals;
        let none = [0.0; N_CLASSES];
        for (quantity, n_channels, terms) in [
            (Quantity::SquaredError(Domain::Linear), 3.0, [linear, none]),
            (Quantity::SquaredError(Domain::Display), 3.0, [display, energy]),
            (Quantity::SquaredError(Domain::Luma), 1.0, [luma, none]),
            (Quantity::SquaredError(Domain::U8), 3.0, [u8, none]),
            (Quantity::RelativeSquaredError, 3.0, [relative, none]),
            (Quantity::SymmetricError, 3.0, [symmetric, none]),
        ] {
            by_class.insert(quantity, sums(n.map(|n| n * n_channels), terms));
        }
        for (domain, windows) in &self.ssim {
            let [indices, n] = windows.totals(readback, self.knows_classes)?;
            by_class.insert(Quantity::Ssim(*domain), sums(n, [indices]));
        }
        if let Some(scales) = &self.multi_scale {
            by_class.insert(Quantity::MsSsim, self.read_scales(readback, scales)?);
        }
        if let Some(map) = &self.flip.mean {
            let totals = map.totals(readback, self.knows_classes)?;
            by_class.insert(Quantity::Flip, sums(n, totals));
        }
        if let Some((_, map)) = &self.hdr_flip {
            let totals = map.totals(readback, self.knows_classes)?;
            by_class.insert(Quantity::HdrFlip, sums(n, totals));
        }
        self.read_changes(readback, n, &mut by_class)?;
        let by_mask = by_class.iter().map(|(quantity, sums)| (*quantity, by_mask(sums)));
        let mut quantities: BTreeMap<_, _> = by_mask.collect();
        if let Some(histogram) = &self.flip.histogram {
            let percentiles = histogram.percentiles_95(readback, &n, self.knows_classes)?;
            let mut sums = quantities[&PIXELS];
            sums.iter_mut()
                .zip(percentiles)
                .for_each(|(sums, percentile)| sums.terms[0] = percentile);
            quantities.insert(Quantity::FlipPercentile, sums);
        }
        Ok(Measured {
            quantities,
            n_non_finite: non_finite.iter().sum::<f64>() as u64,
            deviations: self.read_deviations(readback)?,
        })
    }

    /// Values that stand beside those of metrics.
    pub(super) fn exposures(&self) -> Values {
        let exposures = self.hdr_flip.iter().map(|(exposures, _)| {
            [
                (START_EXPOSURE, Value(exposures.start)),
                (STOP_EXPOSURE, Value(exposures.stop)),
            ]
        });
        exposures.flatten().collect()
    }

    fn read_scales(&self, readback: &Readback, scales: &[Copied<2>]) -> Result<ByClass<Sums>, GpuError> {
        let mut by_class = ByClass::<Sums>::default();
        for (i, windows) in scales.iter().enumerate() {
            let [indices, weights] = windows.totals(readback, self.knows_classes)?;
            for (class, sums) in by_class.iter_mut().enumerate() {
                (sums.terms[i], sums.terms[N_SCALES + i]) = (indices[class], weights[class]);
                sums.n = weights[class];
            }
        }
        Ok(by_class)
    }

    fn read_changes(
        &self,
        readback: &Readback,
        n: ByClass<f64>,
        by_class: &mut BTreeMap<Quantity, ByClass<Sums>>,
    ) -> Result<(), GpuError> {
        if let Some(change) = &self.changes.change {
            let [squared, luma] = change.totals(readback, self.knows_classes)?;
            by_class.insert(Quantity::Change(Change::Step), sums(n.map(|n| 3.0 * n), [squared]));
            by_class.insert(Quantity::Change(Change::MeanError), sums(n, [luma]));
        }
        if let Some(along_motion) = &self.changes.along_motion {
            let [n, squared, excess] = along_motion.totals(readback, self.knows_classes)?;
            by_class.insert(Quantity::Change(Change::WarpedStep), sums(n, [squared]));
            by_class.insert(Quantity::Change(Change::WarpExcess), sums(n, [excess]));
        }
        if let Some(fit) = &self.changes.fit {
            let totals = fit.totals(readback, self.knows_classes)?;
            by_class.insert(Quantity::Change(Change::Fit), sums(n, totals));
        }
        Ok(())
    }

    fn read_deviations(&self, readback: &Readback) -> Result<Vec<(usize, Option<f64>)>, GpuError> {
        let read = |(place, copied): &(usize, Copied<3>)| {
            let totals = copied.totals(readback, self.knows_classes)?;
            let [deviation, n, n_bad]: [f64; 3] = array::from_fn(|term| totals[term].iter().sum());
            let mean = if n_bad > 0.0 { f64::NAN } else { deviation / n };
            Ok((*place, (n > 0.0).then_some(mean)))
        };
        self.changes.deviations.iter().map(read).collect()
    }
}
