//! What is kept from one frame to the next.

use crate::{
    gpu::{Gpu, Texture},
    image::Extent,
};

/// This frame's and the previous frame's: one is written while the other is read, so that recording a pass again changes
/// nothing.
#[derive(Debug)]
pub struct Carried<T = Texture> {
    both: [T; 2],
    current: usize,
}

impl Carried {
    pub fn new(gpu: &Gpu, label: &str, extent: Extent, format: wgpu::TextureFormat) -> Self {
        Self::of([0, 1].map(|i| Texture::new(gpu, &format!("{label} {i}"), extent, format)))
    }
}

impl<T> Carried<T> {
    pub fn of(both: [T; 2]) -> Self {
        Self { both, current: 0 }
    }

    /// Begins a frame: what was current becomes previous.
    pub fn advance(&mut self) {
        self.current = 1 - self.current;
    }

    pub fn current(&self) -> &T {
        &self.both[self.current]
    }

    pub fn previous(&self) -> &T {
        &self.both[1 - self.current]
    }
}
