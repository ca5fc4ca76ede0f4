//! An image that is kept from one frame to the next.

use crate::{
    gpu::{Gpu, Texture},
    image::Extent,
};

/// This frame's image and the previous frame's: one is written while the other is read, so that recording a pass again
/// changes nothing.
#[derive(Debug)]
pub struct Carried {
    textures: [Texture; 2],
    current: usize,
}

impl Carried {
    pub fn new(gpu: &Gpu, label: &str, extent: Extent, format: wgpu::TextureFormat) -> Self {
        Self {
            textures: [0, 1].map(|i| Texture::new(gpu, &format!("{label} {i}"), extent, format)),
            current: 0,
        }
    }

    /// Begins a frame: what was current becomes previous.
    pub fn advance(&mut self) {
        self.current = 1 - self.current;
    }

    pub fn current(&self) -> &Texture {
        &self.textures[self.current]
    }

    pub fn previous(&self) -> &Texture {
        &self.textures[1 - self.current]
    }
}
