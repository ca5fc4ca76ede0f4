//! Salvi, "An Excursion in Temporal Supersampling", GDC 2016: what the slides say of boxes, windows, vectors and jitter.

use super::{
    contest::{Claim, Contest},
    lab::Shot,
    subject::Subject,
};
use crate::metrics::{Mask, Metric};

fn salvi(label: &str) -> Subject {
    Subject::new(label, "salvi2016")
}

/// With the 3×3 minimum and maximum as the box.
fn minmax(label: &str) -> Subject {
    salvi(label).with("neighbourhood", "box3")
}

fn over(metric: Metric, mask: Mask) -> Metric {
    metric.over(mask).expect("a metric of pixels")
}

pub fn contests() -> Vec<Contest> {
    let sphere = Shot::of("sphere");
    let pipes = Shot::of("pipe");
    let wires = Shot::of("fence").at_rest();
    let alpha = Shot::of("stochastic_alpha").at_rest();
    vec![
        Contest {
            id: "salvi.variance",
            title: "The box of variance against that of minimum and maximum",
            source: "slides “Variance clipping”",
            setup: "Scene `sphere`: an object passes and uncovers what is behind it.",
            entries: vec![
                (sphere.clone(), salvi("mean ± deviation")),
                (sphere.clone(), minmax("minimum and maximum")),
            ],
            claims: vec![
                Claim::new("a box of variance leaves less ghosting", Metric::GHOST, 0.0005, &[0, 1]),
                Claim::new(
                    "so what was uncovered is nearer to the reference",
                    over(Metric::PSNR, Mask::Disoccluded),
                    0.02,
                    &[0, 1],
                ),
            ],
            also: vec![Metric::PSNR, Metric::FLICKER_LOCAL],
            pictured: true,
        },
        Contest {
            id: "salvi.gamma",
            title: "Wider and narrower boxes",
            source: "slides “Variance clipping”",
            setup: "Scene `fence` at rest for what flickers under jitter, scene `sphere` for what trails behind motion.",
            entries: [(&wires, "at rest"), (&sphere, "moving")]
                .into_iter()
                .flat_map(|(shot, name)| {
                    [0.75, 1.0, 1.25].map(|gamma| {
                        let subject = salvi(&format!("γ = {gamma}, {name}"));
                        (shot.clone(), subject.with("variance_gamma", gamma))
                    })
                })
                .collect(),
            claims: vec![
                Claim::new("a larger γ is steadier", Metric::FLICKER_LOCAL, 1e-5, &[2, 1, 0]),
                Claim::new("a larger γ leaves more ghosting", Metric::GHOST, 1e-4, &[3, 4, 5]),
            ],
            also: vec![Metric::PSNR],
            pictured: false,
        },
        Contest {
            id: "salvi.window",
            title: "Windows of 3×3 and of 7×7 texels on stochastic transparency",
            source: "slides “Noise reduction for stochastic rendering”",
            setup: "Scene `stochastic_alpha` at rest: three of four texels are discarded at random, anew each frame.",
            entries: vec![
                (alpha.clone(), Subject::new("7×7", "salvi2016_wide")),
                (alpha.clone(), salvi("3×3")),
            ],
            claims: vec![
                Claim::new("a larger window leaves less noise", Metric::PSNR, 0.05, &[0, 1]),
                Claim::new(
                    "and less of it from frame to frame",
                    Metric::FLICKER_LOCAL,
                    1e-5,
                    &[0, 1],
                ),
            ],
            also: vec![Metric::SSIM],
            pictured: true,
        },
        Contest {
            id: "salvi.window_ghosting",
            title: "What the larger window costs where things move",
            source: "slides “Noise reduction for stochastic rendering”",
            setup: "Scene `sphere`.",
            entries: vec![
                (sphere.clone(), salvi("3×3")),
                (sphere.clone(), Subject::new("7×7", "salvi2016_wide")),
            ],
            claims: vec![Claim::new(
                "a larger window leaves more ghosting",
                Metric::GHOST,
                1e-4,
                &[0, 1],
            )],
            also: vec![Metric::PSNR],
            pictured: false,
        },
        Contest {
            id: "salvi.longest",
            title: "The longest of nine motion vectors",
            source: "slides “Motion vectors must track silhouettes”",
            setup: "Scene `pipe`, whose edges slide, and scene `sphere`, whose ball turns as it passes.",
            entries: vec![
                (pipes.clone(), salvi("longest of 3×3, sliding")),
                (pipes, salvi("the texel's own, sliding").with("dilation", "none")),
                (sphere.clone(), salvi("longest of 3×3, turning")),
                (sphere, salvi("the texel's own, turning").with("dilation", "none")),
            ],
            claims: vec![
                Claim::new(
                    "the longest vector improves silhouettes that slide",
                    over(Metric::PSNR, Mask::Moving),
                    0.02,
                    &[0, 1],
                ),
                Claim::new("and trails less", Metric::GHOST, 1e-4, &[0, 1]),
                Claim::new(
                    "the longest vector improves the silhouette of a ball that turns",
                    over(Metric::PSNR, Mask::Moving),
                    0.02,
                    &[2, 3],
                )
                .because(super::TURNING),
            ],
            also: vec![Metric::PSNR, over(Metric::PSNR, Mask::Static)],
            pictured: true,
        },
        Contest {
            id: "salvi.jitter_amplitude",
            title: "Less jitter, less flicker, more aliasing",
            source: "slides “Sub-pixel details can cause color flickering”, “More or better samples”",
            setup: "Scene `fence` at rest.",
            entries: [0.25, 0.5, 1.0]
                .map(|scale| {
                    let shot = Shot {
                        jitter_scale: scale,
                        ..wires.clone()
                    };
                    (shot, salvi(&format!("jitter × {scale}")))
                })
                .into(),
            claims: vec![
                Claim::new(
                    "a smaller amplitude flickers less",
                    Metric::FLICKER_LOCAL,
                    1e-5,
                    &[0, 1, 2],
                ),
                Claim::new("and leaves edges more aliased", Metric::PSNR, 0.05, &[2, 1, 0]),
            ],
            also: vec![Metric::SSIM],
            pictured: false,
        },
        Contest {
            id: "salvi.samples",
            title: "More samples, less flicker",
            source: "slide “More or better samples reduce color flickering”",
            setup: "Scene `fence` at rest; four samples are resolved before the temporal pass.",
            entries: [4, 1]
                .map(|n| {
                    let shot = Shot {
                        n_samples: n,
                        ..wires.clone()
                    };
                    (shot, salvi(&format!("{n} samples")))
                })
                .into(),
            claims: vec![Claim::new(
                "four samples a pixel flicker less than one",
                Metric::FLICKER_LOCAL,
                1e-5,
                &[0, 1],
            )],
            also: vec![Metric::PSNR],
            pictured: false,
        },
    ]
}
