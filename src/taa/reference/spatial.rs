//! Anti-aliasing of each frame by itself: the twin of `shaders/taa/spatial`.

use super::{
    color::Color,
    display::{srgb_decode, srgb_encode},
    real::Real,
};
use crate::{
    image::Image,
    taa::{Recipe, recipe::Domain},
};

/// Lumas in steps of 2⁻¹⁶: their sums and differences are exact in f32 and in f64, and so the same decisions follow.
pub fn edge_lumas<R: Real>(color: &Image<Color<R>>) -> Image<R> {
    let steps = R::new(65_536.0);
    color.map(|c| (c.luma() * steps + R::new(0.5)).floor() / steps)
}

/// What colours are mixed in.
#[derive(Clone, Copy)]
pub struct Light {
    is_encoded: bool,
}

impl Light {
    /// As the recipe wants it.
    pub fn of(recipe: &Recipe) -> Self {
        Self {
            is_encoded: recipe.spatial_decodes && recipe.domain == Domain::Display,
        }
    }

    /// Ready to be mixed.
    pub fn decoded<R: Real>(self, c: Color<R>) -> Color<R> {
        if self.is_encoded { c.map(srgb_decode) } else { c }
    }

    /// A mixture in the domain again.
    pub fn encoded<R: Real>(self, c: Color<R>) -> Color<R> {
        if self.is_encoded { c.map(srgb_encode) } else { c }
    }
}
