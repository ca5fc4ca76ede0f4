//! Anti-aliasing of each frame by itself (`shaders/taa/spatial`). What it makes stands for the frame's colour in all passes
//! of the recipe that follow.

mod smaa;

use super::{inputs::View, recipe::Spatial, recorder::Recorder, temporal::Builder};
use crate::gpu::{GpuError, Pass, Texture};
use smaa::Smaa;

const FXAA: &str = include_str!("../../shaders/taa/spatial/fxaa.wgsl");

/// The passes of a spatial filter, and the image that they make.
#[derive(Debug)]
pub struct Antialiasing {
    filter: Filter,
    antialiased: Texture,
}

#[derive(Debug)]
enum Filter {
    Fxaa(Pass),
    Smaa(Box<Smaa>),
}

impl Antialiasing {
    /// The names of the passes, in the order recorded.
    pub fn passes(spatial: Spatial) -> &'static [&'static str] {
        match spatial {
            Spatial::None => &[],
            Spatial::Fxaa => &["fxaa"],
            Spatial::Smaa => &Smaa::PASSES,
        }
    }

    /// None where the recipe has no spatial filter.
    pub fn new(builder: Builder<'_>) -> Result<Option<Self>, GpuError> {
        let filter = match builder.recipe.spatial {
            Spatial::None => return Ok(None),
            Spatial::Fxaa => Filter::Fxaa(builder.pass("fxaa", FXAA, &[])?),
            Spatial::Smaa => Filter::Smaa(Box::new(Smaa::new(builder)?)),
        };
        builder.gpu.scope("making room for the anti-aliased colour", || {
            Some(Self {
                filter,
                antialiased: builder.color("antialiased", builder.sizes.render),
            })
        })
    }

    pub fn record(&self, recorder: &mut Recorder<'_>, view: View<'_>) -> Result<(), GpuError> {
        match &self.filter {
            Filter::Fxaa(pass) => {
                let fxaa = view
                    .bind_to(pass)
                    .bind("antialiased", &self.antialiased)
                    .over(recorder.gpu, view.sizes().render)?;
                recorder.record(&fxaa)
            }
            Filter::Smaa(smaa) => smaa.record(recorder, view, &self.antialiased),
        }
    }

    /// The colour in the recipe's domain, and in alpha what the frame's has there.
    pub fn antialiased(&self) -> &Texture {
        &self.antialiased
    }
}
