//! Every hazard, by family. A family is a file with a list; a hazard is an entry in it.

mod color;
mod feedback;
mod inputs;
mod order;
mod resampling;
mod several;
mod shape;
mod texel;
mod variance;

use super::scenario::Hazard;

/// Every hazard, family by family.
pub fn all() -> impl Iterator<Item = &'static Hazard> {
    let families: [&'static [Hazard]; 9] = [
        texel::HAZARDS,
        inputs::HAZARDS,
        several::HAZARDS,
        variance::HAZARDS,
        feedback::HAZARDS,
        resampling::HAZARDS,
        shape::HAZARDS,
        color::HAZARDS,
        order::HAZARDS,
    ];
    families.into_iter().flatten()
}
