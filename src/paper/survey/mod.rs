//! Yang, Liu and Salvi, "A Survey of Temporal Antialiasing Techniques", 2020: figures 4, 8, 9 and 11, table 1.

mod accumulation;
mod cost;
mod resampling;

pub use accumulation::effective_samples;
pub use cost::cost;
pub use resampling::resampling;

use super::{
    contest::{Claim, Contest},
    lab::Shot,
    subject::Subject,
};
use crate::metrics::Metric;

/// Figures 9 and 11.
pub fn contests() -> Vec<Contest> {
    let average = |label: &str| Subject::new(label, "ema");
    let clamped = |label: &str| average(label).with("neighbourhood", "box3").with("rectify", "clamp");
    let wires = Shot::of("fence").at_rest();
    let checker = Shot::of("checker").at_rest();
    vec![
        Contest {
            id: "survey.thin_lines",
            title: "Thin lines lost to clamping",
            source: "section 6.1.2, figure 9",
            setup: "Scene `fence` at rest: lines narrower than a pixel that some frames miss.",
            entries: vec![
                (wires.clone(), average("not clamped")),
                (wires, clamped("clamped to 3×3")),
            ],
            claims: vec![Claim::new(
                "clamping loses lines that the frame misses",
                Metric::PSNR,
                0.05,
                &[0, 1],
            )],
            also: vec![Metric::SSIM, Metric::BLUR],
            pictured: true,
        },
        Contest {
            id: "survey.moire",
            title: "Moiré turns history off",
            source: "section 6.3, figure 11",
            setup: "Scene `checker` at rest: a floor to the horizon.",
            entries: vec![
                (checker.clone(), average("not clamped")),
                (checker.clone(), clamped("clamped to 3×3")),
                (checker, average("input").with("current_weight", 1.0)),
            ],
            claims: vec![
                Claim::new(
                    "without rectification the image is steady, with it little steadier than the input",
                    Metric::FLICKER_LOCAL,
                    1e-5,
                    &[0, 1, 2],
                ),
                Claim::new("and less aliased", Metric::PSNR, 0.05, &[0, 1]),
            ],
            also: vec![Metric::SSIM],
            pictured: true,
        },
    ]
}
