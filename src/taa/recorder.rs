//! Where a recipe's passes are recorded.

use crate::gpu::{Dispatch, Gpu, GpuError, Kept, Timer};

/// How often the passes of a submission run.
#[derive(Clone, Copy, Debug)]
pub enum Repeat {
    /// A corner of each, untimed: drivers compile a pass at its first dispatch, whatever its size.
    WarmUp,
    /// In full so many times, each timed.
    Timed(u32),
}

/// Sees every pass as soon as it is recorded, before the next one is.
pub trait Watch: std::fmt::Debug {
    /// `encoder` holds what was recorded since it last was submitted; the watch may submit it and leave another. `cleared` is
    /// the buffer that was cleared before the pass.
    fn recorded(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        cleared: Option<&wgpu::Buffer>,
    ) -> Result<(), GpuError>;
}

/// A pass of a frame, kept to be recorded whenever one like it comes again.
#[derive(Clone, Debug)]
pub struct Step {
    pass: Kept,
    cleared: Option<wgpu::Buffer>,
}

impl Step {
    /// Records it, untimed.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(buffer) = &self.cleared {
            encoder.clear_buffer(buffer, 0, None);
        }
        self.pass.record(encoder);
    }
}

/// Keeps what is recorded.
impl Watch for Vec<Step> {
    fn recorded(
        &mut self,
        _gpu: &Gpu,
        _encoder: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        cleared: Option<&wgpu::Buffer>,
    ) -> Result<(), GpuError> {
        self.push(Step {
            pass: dispatch.keep(),
            cleared: cleared.cloned(),
        });
        Ok(())
    }
}

/// Records passes into one submission.
#[derive(Debug)]
pub struct Recorder<'a> {
    /// Where they will run.
    pub gpu: &'a Gpu,
    /// What they are recorded into.
    pub encoder: &'a mut wgpu::CommandEncoder,
    /// What times them.
    pub timer: &'a mut Timer,
    /// How often they run.
    pub repeat: Repeat,
    /// Who looks at what they write.
    pub watch: Option<&'a mut dyn Watch>,
}

impl Recorder<'_> {
    /// Records a pass.
    pub fn record(&mut self, dispatch: &Dispatch<'_>) -> Result<(), GpuError> {
        self.record_after(dispatch, None)
    }

    /// Records a pass that adds to `sum`, which is cleared before each time.
    pub fn record_from_zero(&mut self, dispatch: &Dispatch<'_>, sum: &wgpu::Buffer) -> Result<(), GpuError> {
        self.record_after(dispatch, Some(sum))
    }

    fn record_after(&mut self, dispatch: &Dispatch<'_>, cleared: Option<&wgpu::Buffer>) -> Result<(), GpuError> {
        match self.repeat {
            Repeat::WarmUp => dispatch.record_corner(self.encoder),
            Repeat::Timed(n) => {
                for _ in 0..n {
                    if let Some(buffer) = cleared {
                        self.encoder.clear_buffer(buffer, 0, None);
                    }
                    dispatch.record(self.encoder, self.timer.time());
                }
            }
        }
        match &mut self.watch {
            Some(watch) => watch.recorded(self.gpu, self.encoder, dispatch, cleared),
            None => Ok(()),
        }
    }
}
