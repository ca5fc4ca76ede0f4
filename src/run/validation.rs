//! A run's presets held against their twins: after the run itself, so that neither disturbs the other's times.

use super::{
    Observer, RunError, RunSpec, Validate,
    plan::{Plan, System},
};
use crate::{
    gpu::Gpu,
    sequence::Sequence,
    taa::validation::{Bisection, Bounds, FrameAgreement, Overview, Validation, Validator, shown},
};

/// Every preset of the plan, in order.
pub fn validate(
    plan: &Plan,
    spec: &RunSpec,
    sequence: &Sequence,
    gpu: &Gpu,
    observer: &dyn Observer,
) -> Result<Vec<Validation>, RunError> {
    let n_run = plan.systems.len() * plan.n_frames;
    let n_total = n_run + plan.n_validated;
    let one = |(index, system)| {
        let both = Both {
            plan,
            spec,
            system,
            sequence,
            gpu,
            observer,
        };
        let n_before = n_run + index * plan.n_frames;
        let step = |n_frames| observer.progress(n_before + n_frames, n_total);
        let (bounds, frames) = both.frames(None, step)?;
        let mut validation = Validation::new(bounds, frames);
        if spec.validate == Validate::Bisect && !validation.agrees {
            validation.bisection = Some(both.bisection(&validation)?);
        }
        Ok(validation)
    };
    plan.systems.iter().enumerate().map(one).collect()
}

/// One preset on the GPU and on its twin.
struct Both<'a> {
    plan: &'a Plan,
    spec: &'a RunSpec,
    system: &'a System,
    sequence: &'a Sequence,
    gpu: &'a Gpu,
    observer: &'a dyn Observer,
}

/// What is allowed, and what was found.
type Found = ((Bounds, Option<Bounds>), Vec<FrameAgreement>);

impl Both<'_> {
    /// Every frame, the pass `swapped` computed by its twin.
    fn frames(&self, swapped: Option<&str>, step: impl Fn(usize)) -> Result<Found, RunError> {
        let channels = self.system.channels;
        let room = (self.sequence.sizes(), channels);
        let (recipe, history) = (&self.system.recipe, self.spec.history);
        let mut validator = Validator::new(self.gpu, recipe, history, room, swapped, None)?;
        let mut frames = Vec::with_capacity(self.plan.n_frames);
        for index in 0..self.plan.n_frames {
            if self.observer.cancelled() {
                return Err(RunError::Cancelled);
            }
            frames.push(validator.frame(&self.sequence.load(index, channels)?)?);
            step(index + 1);
        }
        Ok((validator.bounds(), frames))
    }

    fn bisection(&self, found: &Validation) -> Result<Bisection, RunError> {
        let first = found.first_fault();
        let swap = |pass: &Overview| {
            let (_, frames) = self.frames(Some(&pass.name), |_| ())?;
            Ok(shown(&pass.name, &frames))
        };
        Ok(Bisection {
            frame: first.map(|(frame, _)| frame),
            pass: first.map(|(_, pass)| pass.to_owned()),
            swaps: found.passes.iter().map(swap).collect::<Result<_, RunError>>()?,
        })
    }
}
