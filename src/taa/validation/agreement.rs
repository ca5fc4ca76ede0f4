//! How far what the GPU wrote is from what the twin says, and how far it may be. Plain data, as reports carry it.

use crate::taa::{
    Precision, Recipe,
    recipe::{Algorithm, HdrWeight, InputFilter, Rectify, Weight},
    reference::Plane,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How far two images may be apart, in shares of a display's range: values without a limit count as `x / (1 + |x|)`,
/// variances by their roots, numbers of samples by the share of each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bounds {
    /// Of a pixel, its worst channel.
    pub max: f64,
    /// On average over the pixels within `max`.
    pub mean: f64,
    /// The share of pixels that may be beyond `max`: those where a decision fell differently (a tie, the edge of a box, a
    /// model's reset), which no bound on rounding covers.
    pub share_beyond: f64,
}

impl Bounds {
    /// Of what each pass writes, given the same inputs; and with 32-bit history, of what is shown.
    pub fn of_passes(recipe: &Recipe) -> Self {
        Self {
            max: if recipe.prefilter_moments { 4e-3 } else { 2e-3 },
            mean: 2e-5,
            share_beyond: 5e-4,
        }
    }

    /// Of what is shown, after any number of frames. GPU and twin may round a 16-bit history to neighbouring steps, and each
    /// frame keeps all but the current colour's weight of the gap: a plain blend is off by at most 2⁻¹¹ over its smallest
    /// weight. Whatever else decides by such a history is measured, and nothing is promised of it: none.
    pub fn of_frames(recipe: &Recipe, precision: Precision) -> Option<Self> {
        let bounds = Self::of_passes(recipe);
        let keeps_history = recipe.algorithm != Algorithm::Temporal || recipe.uses_history();
        if recipe.precision(precision) == Precision::F32 || !keeps_history {
            return Some(bounds);
        }
        let is_plain = recipe.algorithm == Algorithm::Temporal
            && recipe.rectify == Rectify::None
            && recipe.hdr_weight == HdrWeight::None
            && recipe.input_filter != InputFilter::Upsample;
        let smallest = match recipe.weight {
            Weight::Fixed => recipe.current_weight,
            Weight::Count => recipe.count_weight_min,
            Weight::LumaFeedback | Weight::Antiflicker | Weight::Amortized => 0.0,
        };
        (is_plain && smallest > 0.0).then(|| {
            let max = bounds.max.max(1.0 / 2048.0 / smallest);
            Self {
                max,
                mean: max,
                ..bounds
            }
        })
    }
}

/// Two images, or all that a pass writes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Agreement {
    /// Everything is finite, and within the bounds where there are any.
    pub agrees: bool,
    /// The largest distance of a pixel that is finite on both sides.
    pub max: f64,
    /// On average over the pixels that are not beyond; of a pass that writes several images, the largest of them.
    pub mean: f64,
    /// Pixels beyond the largest distance allowed.
    pub n_beyond: u64,
    /// Of all pixels.
    pub share_beyond: f64,
    /// Pixels beyond it that count neither there nor in the mean, because 32-bit arithmetic does not determine them: the
    /// twin in f32 is itself far from the twin in f64.
    pub n_undetermined: u64,
    /// Pixels that are not finite on the GPU.
    pub non_finite_gpu: u64,
    /// Pixels that are not finite in the twin.
    pub non_finite_twin: u64,
    /// The pixel that is farthest off, or the first that is not finite; none where all are equal.
    pub worst: Option<Worst>,
}

/// A pixel of an image that a pass writes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Worst {
    /// The image's name in the pass's shader.
    pub image: String,
    /// Column and row.
    pub pixel: [u32; 2],
}

/// What is compared.
#[derive(Clone, Debug)]
pub struct Compared {
    /// What the GPU wrote.
    pub gpu: Plane<f64>,
    /// What the twin says.
    pub twin: Plane<f64>,
    /// What the twin says in f32, where that was asked.
    pub witness: Option<Plane<f32>>,
}

/// The share of the largest distance allowed that f32 alone must be off by for a pixel to be undetermined: its rounding and the
/// GPU's are alike in size, not in place.
const UNDETERMINED: f64 = 0.125;

impl Agreement {
    /// Of all that a pass wrote. Pixels beyond `counted` are counted; within the bounds `promised`, if any, they agree.
    pub fn of(compared: &[Compared], counted: Bounds, promised: Option<Bounds>) -> Self {
        let mut all = Self::default();
        for compared in compared {
            let one = compared.agreement(promised.unwrap_or(counted));
            let is_worse = one.spoilt() > all.spoilt() || one.spoilt() == all.spoilt() && one.max > all.max;
            all = Self {
                agrees: false,
                max: all.max.max(one.max),
                mean: all.mean.max(one.mean),
                n_beyond: all.n_beyond.max(one.n_beyond),
                share_beyond: all.share_beyond.max(one.share_beyond),
                n_undetermined: all.n_undetermined.max(one.n_undetermined),
                non_finite_gpu: all.non_finite_gpu.max(one.non_finite_gpu),
                non_finite_twin: all.non_finite_twin.max(one.non_finite_twin),
                worst: if is_worse { one.worst } else { all.worst },
            };
        }
        let within = |bounds: Bounds| all.mean <= bounds.mean && all.share_beyond <= bounds.share_beyond;
        all.agrees = all.spoilt() == 0 && promised.is_none_or(within);
        all
    }

    fn spoilt(&self) -> u64 {
        self.non_finite_gpu + self.non_finite_twin
    }
}

impl Compared {
    fn agreement(&self, bounds: Bounds) -> Agreement {
        let Self { gpu, twin, witness } = self;
        let shape = (gpu.extent, gpu.scales.len());
        assert_eq!(shape, (twin.extent, twin.scales.len()), "{}", gpu.name);
        let (width, n_channels) = (gpu.extent.width as usize, gpu.scales.len());
        let mut found = Agreement::default();
        let (mut sum, mut n_within) = (0.0, 0_u64);
        let (mut farthest, mut first_bad) = (None, None);
        let pixels = gpu
            .values
            .chunks_exact(n_channels)
            .zip(twin.values.chunks_exact(n_channels));
        for (index, (a, b)) in pixels.enumerate() {
            let [bad_a, bad_b] = [a, b].map(|pixel| !pixel.iter().all(|value| value.is_finite()));
            found.non_finite_gpu += u64::from(bad_a);
            found.non_finite_twin += u64::from(bad_b);
            if bad_a || bad_b {
                first_bad = first_bad.or(Some(index));
                continue;
            }
            let distance = self.distance(a.iter().copied(), b);
            if distance > bounds.max
                && let Some(witness) = witness
            {
                let in_f32 = witness.values[index * n_channels..].iter().copied().map(f64::from);
                if self.distance(in_f32, b) > UNDETERMINED * bounds.max {
                    found.n_undetermined += 1;
                    continue;
                }
            }
            if distance > found.max {
                (found.max, farthest) = (distance, Some(index));
            }
            if distance > bounds.max {
                found.n_beyond += 1;
            } else {
                sum += distance;
                n_within += 1;
            }
        }
        found.mean = sum / n_within.max(1) as f64;
        found.share_beyond = found.n_beyond as f64 / gpu.extent.n_pixels() as f64;
        found.worst = first_bad.or(farthest).map(|index| Worst {
            image: gpu.name.to_owned(),
            pixel: [(index % width) as u32, (index / width) as u32],
        });
        found
    }

    /// Of the channel that is farthest off.
    fn distance(&self, found: impl Iterator<Item = f64>, expected: &[f64]) -> f64 {
        let channels = found.zip(expected).zip(&self.twin.scales);
        channels.fold(0.0, |worst, ((a, &b), scale)| f64::max(worst, scale.distance(a, b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        image::Extent,
        taa::{Preset, reference::Scale},
    };

    fn plane(scale: Scale, values: &[f64]) -> Plane<f64> {
        Plane {
            name: "history",
            extent: Extent::new(values.len() as u32 / 2, 2),
            scales: vec![scale],
            values: values.to_vec(),
        }
    }

    fn bounds() -> Bounds {
        Bounds {
            max: 2e-3,
            mean: 2e-5,
            share_beyond: 0.25,
        }
    }

    fn agreement(scale: Scale, gpu: &[f64], twin: &[f64]) -> Agreement {
        Agreement::of(&[compared(scale, gpu, twin)], bounds(), Some(bounds()))
    }

    fn compared(scale: Scale, gpu: &[f64], twin: &[f64]) -> Compared {
        Compared {
            gpu: plane(scale, gpu),
            twin: plane(scale, twin),
            witness: None,
        }
    }

    #[test]
    fn what_f32_does_not_determine_is_not_held_against_the_gpu() {
        let wrong = compared(Scale::Range, &[0.5, 0.9, 0.5, 0.9], &[0.5; 4]);
        let witness = |values: &[f32]| Plane {
            name: "history",
            extent: Extent::new(2, 2),
            scales: vec![Scale::Range],
            values: values.to_vec(),
        };
        for (values, agrees, n_undetermined) in [([0.5, 0.501, 0.5, 0.6], true, 2), ([0.5; 4], false, 0)] {
            let compared = Compared {
                witness: Some(witness(&values)),
                ..wrong.clone()
            };
            let found = Agreement::of(&[compared], bounds(), Some(bounds()));
            assert_eq!(
                (found.agrees, found.n_undetermined),
                (agrees, n_undetermined),
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_pixel_may_decide_otherwise_and_all_may_round() {
        let twin = [0.5; 4];
        let same = agreement(Scale::Range, &twin, &twin);
        assert!(same.agrees && same.worst.is_none(), "{same:?}");
        let one = agreement(Scale::Range, &[0.5, 0.5, 0.5, 0.9], &twin);
        assert!(one.agrees && one.n_beyond == 1, "{one:?}");
        assert_eq!(one.worst.unwrap().pixel, [1, 1]);
        let two = agreement(Scale::Range, &[0.5, 0.9, 0.5, 0.9], &twin);
        assert!(!two.agrees && two.share_beyond == 0.5, "{two:?}");
        // Nowhere beyond, and off on average.
        let all = agreement(Scale::Range, &[0.5001; 4], &twin);
        assert!(!all.agrees && all.n_beyond == 0, "{all:?}");
    }

    #[test]
    fn what_is_not_finite_never_agrees() {
        for bad in [f64::NAN, f64::INFINITY] {
            for (gpu, twin) in [([0.5, bad], [0.5; 2]), ([0.5; 2], [bad, 0.5]), ([bad; 2], [bad; 2])] {
                let found = agreement(Scale::Open, &gpu, &twin);
                assert!(!found.agrees && found.max == 0.0, "{found:?}");
                let found = Agreement::of(&[compared(Scale::Open, &gpu, &twin)], bounds(), None);
                assert!(!found.agrees, "{found:?}");
            }
        }
    }

    #[test]
    fn distances_are_shares_of_what_is_seen() {
        assert!((Scale::Open.distance(1.0, 3.0) - 0.25).abs() < 1e-15);
        assert!((Scale::Open.distance(-1.0, 1.0) - 1.0).abs() < 1e-15);
        assert!((Scale::Count.distance(4.0, 5.0) - 0.05).abs() < 1e-15);
        assert!((Scale::Variance { open: false }.distance(0.04, 0.01) - 0.1).abs() < 1e-15);
    }

    #[test]
    fn half_precision_is_promised_for_blends_alone() {
        let of = |preset: &str, precision| Bounds::of_frames(&Preset::find(preset).unwrap().recipe, precision);
        assert_eq!(of("ema", Precision::F16).unwrap().max, 10.0 / 2048.0);
        assert_eq!(of("none", Precision::F16).unwrap().max, 2e-3);
        assert_eq!(
            of("accumulate", Precision::F16).unwrap().max,
            2e-3,
            "its history is 32-bit"
        );
        for preset in ["inside", "amortized", "phlm2016", "checkerboard", "taau"] {
            assert!(of(preset, Precision::F16).is_none(), "{preset}");
            assert_eq!(of(preset, Precision::F32).unwrap().max, 2e-3, "{preset}");
        }
    }
}
