//! The list of temporal metrics.

use super::{
    super::{
        Better, MetricInfo,
        metric::Definition,
        quantity::{Domain, Quantity, Sums},
        squared_error::{psnr_db, relative_mse},
    },
    Change,
};

/// Below this share of its largest possible value the fit's determinant is rounding: both patterns are one.
const SINGULAR: f64 = 1e-12;

pub(in super::super) const TPSNR: Definition = psnr(
    "tpsnr",
    "PSNR between the changes of display RGB from frame to frame",
    Change::Step,
    |sums| Some(psnr_db(sums.mean(), Domain::Display.peak())),
);

pub(in super::super) const WARPED_TPSNR: Definition = psnr(
    "warped_tpsnr",
    "PSNR between the changes of luma along the motion",
    Change::WarpedStep,
    |sums| Some(psnr_db(sums.mean(), Domain::Luma.peak())),
);

pub(in super::super) const WARP_EXCESS: Definition = change(
    "warp_excess",
    "How much more luma changes along the motion than the reference's; below 0 means blurred",
    Change::WarpExcess,
    |sums| Some(sums.mean()),
);

pub(in super::super) const FLICKER: Definition = change(
    "flicker",
    "Change of the mean luma error from frame to frame; RMS over a sequence",
    Change::MeanError,
    |sums| Some(sums.mean().abs()),
);

pub(in super::super) const GHOST: Definition = change(
    "ghost",
    "Share of the previous reference frame left in the image, fitted jointly with blur",
    Change::Fit,
    |sums| Some(fit(sums)?[0]),
);

pub(in super::super) const BLUR: Definition = change(
    "blur",
    "Share of a 3×3 box blur in the image, fitted jointly with ghost",
    Change::Fit,
    |sums| Some(fit(sums)?[1]),
);

pub(in super::super) const FLICKER_LOCAL: Definition = whole(
    "flicker.local",
    "Mean over pixels of the standard deviation over time of the luma error",
    Quantity::ErrorDeviation,
);

pub(in super::super) const CONVERGE_FRAMES: Definition = whole(
    "converge_frames",
    "Frames after a reset until PSNR stays within 0.5 dB of its value 32 frames after the reset",
    Quantity::Convergence,
);

const fn change(
    id: &'static str,
    description: &'static str,
    change: Change,
    value: fn(&Sums) -> Option<f64>,
) -> Definition {
    Definition {
        info: MetricInfo {
            id,
            unit: "",
            better: Better::Lower,
            version: 1,
            description,
        },
        quantity: Quantity::Change(change),
        value,
        relative_mse: None,
    }
}

const fn psnr(
    id: &'static str,
    description: &'static str,
    measured: Change,
    value: fn(&Sums) -> Option<f64>,
) -> Definition {
    let Definition { info, .. } = change(id, description, measured, value);
    Definition {
        info: MetricInfo {
            unit: "dB",
            better: Better::Higher,
            ..info
        },
        quantity: Quantity::Change(measured),
        value,
        relative_mse: Some(relative_mse),
    }
}

/// One that is known only once a sequence, or a stretch of it, has ended.
const fn whole(id: &'static str, description: &'static str, quantity: Quantity) -> Definition {
    Definition {
        info: MetricInfo {
            id,
            unit: "",
            better: Better::Lower,
            version: 1,
            description,
        },
        quantity,
        value: |sums| Some(sums.mean()),
        relative_mse: None,
    }
}

/// The factors of ghosting and blur that explain the luma error best. `None` where the reference does not change, or is
/// flat, and they are undefined.
fn fit(sums: &Sums) -> Option<[f64; 2]> {
    let [gg, bb, gb, ge, be, ..] = sums.terms;
    let determinant = gg * bb - gb * gb;
    // NaN is not undefined but unknown, and goes through.
    let undefined = determinant <= SINGULAR * gg * bb;
    (!undefined).then(|| [(bb * ge - gb * be) / determinant, (gg * be - gb * ge) / determinant])
}
