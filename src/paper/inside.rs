//! Pedersen, "Temporal Reprojection Anti-Aliasing in INSIDE", GDC 2016: the choices that the slides show side by side.

use super::{
    contest::{Claim, Contest},
    lab::Shot,
    subject::Subject,
};
use crate::{
    metrics::{Mask, Metric},
    sequence::jitter::JitterSequence,
};

/// The system, showing what it resolved instead of motion blur.
fn inside(label: &str) -> Subject {
    Subject::new(label, "inside").with("motion_blur", false)
}

/// Why five taps lead where things move.
const SMALLER_BOX: &str = "In motion history is resampled and blurred, so what the smaller box throws away is worth less; at rest the \
    ordering holds. That does not explain all of it: with sharper history filters (`--set history_filter=catmull_rom`, \
    `quasi_cubic`, tried by hand) the two come nearer and do not change places.";

/// Its first version's neighbourhood.
fn five_taps(subject: Subject) -> Subject {
    subject.with("rectify", "clamp").with("neighbourhood", "cross")
}

/// A system on the three sequences that the slides draw.
fn sequences(system: impl Fn(&str) -> Subject, suffix: &str) -> Vec<(Shot, Subject)> {
    let tested = [
        ("halton(2,3) × 16", JitterSequence::Halton23(16)),
        ("halton(2,3) × 8", JitterSequence::Halton23(8)),
        ("uniform4 helix", JitterSequence::Uniform4Helix),
    ];
    let entry = |(name, jitter): (&str, JitterSequence)| {
        let shot = Shot {
            jitter,
            ..Shot::of("pipe_tilted").at_rest()
        };
        (shot, system(&format!("{name}{suffix}")))
    };
    tested.map(entry).into()
}

pub fn contests() -> Vec<Contest> {
    let sphere = Shot::of("sphere");
    let pipes = Shot::of("pipe");
    let still = Shot::of("pipe_tilted").at_rest();
    let still_pixels = Metric::PSNR.over(Mask::Static).expect("a metric of pixels");
    let moving = Metric::PSNR.over(Mask::Moving).expect("a metric of pixels");
    let foliage = Shot::of("foliage").with_few_reference_samples();
    vec![
        Contest {
            id: "inside.closest",
            title: "Motion of the closest of nine texels",
            source: "slides “Reprojection and edge motion”",
            setup: "Scene `pipe`, whose edges slide, and scene `sphere`, whose ball turns as it passes.",
            entries: vec![
                (pipes.clone(), inside("closest of 3×3, sliding")),
                (pipes, inside("the texel's own, sliding").with("dilation", "none")),
                (sphere.clone(), inside("closest of 3×3, turning")),
                (
                    sphere.clone(),
                    inside("the texel's own, turning").with("dilation", "none"),
                ),
            ],
            claims: vec![
                Claim::new(
                    "the closest texel's motion makes nicer edges where they slide",
                    moving,
                    0.02,
                    &[0, 1],
                ),
                Claim::new("and trails less", Metric::GHOST, 1e-4, &[0, 1]),
                Claim::new(
                    "the closest texel's motion makes nicer edges of a ball that turns",
                    moving,
                    0.02,
                    &[2, 3],
                )
                .because(super::TURNING),
            ],
            also: vec![Metric::PSNR, still_pixels],
            pictured: true,
        },
        Contest {
            id: "inside.clip",
            title: "Clipping against clamping",
            source: "slides “Neighbourhood clamping, now clipping”",
            setup: "Scene `foliage`, the camera and the leaves move; scene `pipe_tilted` at rest.",
            entries: [(&foliage, "moving"), (&still, "at rest")]
                .into_iter()
                .flat_map(|(shot, name)| {
                    [
                        inside(&format!("clip, rounded 3×3, {name}")),
                        inside(&format!("clamp, rounded 3×3, {name}")).with("rectify", "clamp"),
                        five_taps(inside(&format!("clamp, five taps, {name}"))),
                    ]
                    .map(|subject| (shot.clone(), subject))
                })
                .collect(),
            claims: vec![
                Claim::new(
                    "at rest, the rounded box with clipping gives the better image than five taps with clamping",
                    Metric::PSNR,
                    0.05,
                    &[3, 5],
                ),
                Claim::new(
                    "in motion, the rounded box with clipping gives the better image than five taps with clamping",
                    Metric::PSNR,
                    0.05,
                    &[0, 2],
                )
                .because(SMALLER_BOX),
                Claim::new(
                    "in motion, clipping gives the better image than clamping to the same box",
                    Metric::PSNR,
                    0.05,
                    &[0, 1],
                ),
            ],
            also: vec![Metric::SSIM, Metric::GHOST, Metric::FLICKER_LOCAL],
            pictured: true,
        },
        Contest {
            id: "inside.sequences",
            title: "Sequences of samples",
            source: "slides “Some of the sequences tested”, “Closing remarks on sample distributions”",
            setup: "Scene `pipe_tilted` at rest, with the rounded 3×3 and clipping, and with the first version's five taps and clamping.",
            entries: sequences(inside, "")
                .into_iter()
                .chain(sequences(|label| five_taps(inside(label)), ", five taps"))
                .collect(),
            claims: vec![
                Claim::new(
                    "with 3×3 and clipping, sixteen points make nicer edges than four",
                    Metric::PSNR,
                    0.02,
                    &[0, 2],
                ),
                Claim::new(
                    "with five taps, the helix is steadier than sixteen points",
                    Metric::FLICKER_LOCAL,
                    1e-6,
                    &[5, 3],
                ),
                Claim::new("with five taps, the helix gives the better image", Metric::PSNR, 0.02, &[5, 3]).because(
                    "The slides prefer the helix by eye, for its short cycle. That shows in flicker.local, where it is steadier; four \
                     points cover a pixel less well than sixteen with either box, and that is what PSNR at rest counts.",
                ),
            ],
            also: vec![Metric::SSIM, Metric::FLICKER_LOCAL],
            pictured: false,
        },
        Contest {
            id: "inside.motion_blur",
            title: "Falling back to motion blur",
            source: "slides “Trailing artefacts”, “Final blend with motion blur fallback”",
            setup: "Scene `sphere`; the reference is sharp, so that blur counts as error.",
            entries: vec![
                (sphere.clone(), Subject::new("with fallback", "inside")),
                (sphere, inside("without")),
            ],
            claims: vec![
                Claim::new(
                    "the fallback hides what trails beside fast objects",
                    still_pixels,
                    0.02,
                    &[0, 1],
                ),
                Claim::new("the fallback leaves less of the frame before", Metric::GHOST, 1e-4, &[0, 1]).because(
                    "Blur along the motion puts much of itself where the object was a frame ago, and `ghost` cannot tell it from a \
                     trail. What stands still beside the ball, where trails would be seen, is nearer to the reference with the \
                     fallback (psnr.static).",
                ),
            ],
            also: vec![Metric::PSNR, moving, Metric::BLUR],
            pictured: true,
        },
    ]
}
