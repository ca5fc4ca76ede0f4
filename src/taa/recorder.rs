//! Where a recipe's passes are recorded.

use crate::gpu::{Dispatch, Gpu, Timer};

/// Records passes into one submission, each `repeat` times and timed.
#[derive(Debug)]
pub struct Recorder<'a> {
    pub gpu: &'a Gpu,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub timer: &'a mut Timer,
    pub repeat: u32,
}

impl Recorder<'_> {
    pub fn record(&mut self, dispatch: &Dispatch<'_>) {
        for _ in 0..self.repeat {
            dispatch.record(self.encoder, self.timer.time());
        }
    }

    /// Records a pass that adds to `sum`, which is cleared before each time.
    pub fn record_from_zero(&mut self, dispatch: &Dispatch<'_>, sum: &wgpu::Buffer) {
        for _ in 0..self.repeat {
            self.encoder.clear_buffer(sum, 0, None);
            dispatch.record(self.encoder, self.timer.time());
        }
    }
}
