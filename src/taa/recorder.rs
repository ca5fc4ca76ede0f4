//! Where a recipe's passes are recorded.

use crate::gpu::{Dispatch, Gpu, Timer};

/// How often the passes of a submission run.
#[derive(Clone, Copy, Debug)]
pub enum Repeat {
    /// A corner of each, untimed: drivers compile a pass at its first dispatch, whatever its size.
    WarmUp,
    /// In full so many times, each timed.
    Timed(u32),
}

/// Records passes into one submission.
#[derive(Debug)]
pub struct Recorder<'a> {
    pub gpu: &'a Gpu,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub timer: &'a mut Timer,
    pub repeat: Repeat,
}

impl Recorder<'_> {
    pub fn record(&mut self, dispatch: &Dispatch<'_>) {
        self.record_after(dispatch, |_| ());
    }

    /// Records a pass that adds to `sum`, which is cleared before each time.
    pub fn record_from_zero(&mut self, dispatch: &Dispatch<'_>, sum: &wgpu::Buffer) {
        self.record_after(dispatch, |encoder| encoder.clear_buffer(sum, 0, None));
    }

    fn record_after(&mut self, dispatch: &Dispatch<'_>, before: impl Fn(&mut wgpu::CommandEncoder)) {
        match self.repeat {
            Repeat::WarmUp => dispatch.record_corner(self.encoder),
            Repeat::Timed(n) => {
                for _ in 0..n {
                    before(self.encoder);
                    dispatch.record(self.encoder, self.timer.time());
                }
            }
        }
    }
}
