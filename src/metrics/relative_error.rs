//! Errors of linear values relative to their size, so that highlights do not drown the rest: `rel_mse` and `smape`.

use super::{Better, MetricInfo, metric::Definition, quantity::Quantity};

/// Added to R²: keeps dark pixels from dividing by nothing.
pub(super) const REL_MSE_FLOOR: f64 = 0.01;
/// Added to |T| + |R|.
pub(super) const SMAPE_FLOOR: f64 = 1e-3;

pub(super) const REL_MSE: Definition = Definition {
    info: MetricInfo {
        id: "rel_mse",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "Mean of squared errors of linear RGB over the reference squared",
    },
    quantity: Quantity::RelativeSquaredError,
    value: |sums| Some(sums.mean()),
    relative_mse: None,
};

pub(super) const SMAPE: Definition = Definition {
    info: MetricInfo {
        id: "smape",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "Mean of errors of linear RGB over the mean of both images, 0 to 2",
    },
    quantity: Quantity::SymmetricError,
    value: |sums| Some(sums.mean()),
    relative_mse: None,
};

#[inline(always)]
pub(super) fn squared(r: f64, t: f64) -> f64 {
    (t - r) * (t - r) / (r * r + REL_MSE_FLOOR)
}

#[inline(always)]
pub(super) fn symmetric(r: f64, t: f64) -> f64 {
    2.0 * (t - r).abs() / (t.abs() + r.abs() + SMAPE_FLOOR)
}

#[cfg(test)]
mod tests {
    use super::super::{Display, Metric, Picture, Reference};
    use crate::image::{Extent, Image};

    #[test]
    fn constant_images_by_hand() {
        let [reference, test] = [[2.0_f32, 0.0, 1.0], [3.0, 0.0, 0.0]].map(|c| Image::filled(Extent::new(5, 3), c));
        let metrics = [Metric::REL_MSE, Metric::SMAPE];
        let [reference, test] = [reference, test].map(|image| Picture::linear(image, Display::default()));
        let values = Reference::new(reference, &metrics).evaluate(&test).unwrap().values;
        let rel_mse = (1.0 / 4.01 + 1.0 / 1.01) / 3.0;
        let smape = (2.0 / 5.001 + 2.0 / 1.001) / 3.0;
        assert!((values["rel_mse"].0 - rel_mse).abs() < 1e-15, "{values:?}");
        assert!((values["smape"].0 - smape).abs() < 1e-15, "{values:?}");
    }
}
