//! The list of temporal metrics.

use super::{
    super::{
        Better, Definition, Domain, MetricInfo, Quantity, Sums,
        squared_error::{psnr_db, relative_mse},
    },
    Change,
};

pub(in super::super) const TPSNR: Definition = psnr(
    "tpsnr",
    "PSNR between the changes of display RGB from frame to frame",
    Change::Step,
    |sums| psnr_db(sums.mean(), Domain::Display.peak()),
);

pub(in super::super) const WARPED_TPSNR: Definition = psnr(
    "warped_tpsnr",
    "PSNR between the changes of luma along the motion",
    Change::WarpedStep,
    |sums| psnr_db(sums.mean(), Domain::Luma.peak()),
);

pub(in super::super) const WARP_EXCESS: Definition = change(
    "warp_excess",
    "How much more luma changes along the motion than the reference's; below 0 means blurred",
    Change::WarpExcess,
    Sums::mean,
);

pub(in super::super) const FLICKER: Definition = change(
    "flicker",
    "Change of the mean luma error from frame to frame; RMS over a sequence",
    Change::MeanError,
    |sums| sums.mean().abs(),
);

pub(in super::super) const GHOST: Definition = change(
    "ghost",
    "Share of the previous reference frame left in the image, fitted jointly with blur",
    Change::Fit,
    |sums| sums.total,
);

pub(in super::super) const BLUR: Definition = change(
    "blur",
    "Share of a 3×3 box blur in the image, fitted jointly with ghost",
    Change::Fit,
    |sums| sums.reference,
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

const fn change(id: &'static str, description: &'static str, change: Change, value: fn(&Sums) -> f64) -> Definition {
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

const fn psnr(id: &'static str, description: &'static str, measured: Change, value: fn(&Sums) -> f64) -> Definition {
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
        value: Sums::mean,
        relative_mse: None,
    }
}
