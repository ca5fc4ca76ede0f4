//! Where a recipe's passes are recorded.

use super::tiles::List;
use crate::{
    gpu::{Dispatch, Gpu, GpuError, Invocation, Kept, Pass, Timer},
    image::Extent,
};

/// How often the passes of a submission run.
#[derive(Clone, Copy, Debug)]
pub enum Repeat {
    /// A corner of each, untimed: drivers compile a pass at its first dispatch, whatever its size.
    WarmUp,
    /// In full so many times, each timed.
    Timed(u32),
}

/// A pass that may leave out tiles: over every pixel, and over the tiles of a list where there is ever one.
#[derive(Debug)]
pub(super) struct TiledPass {
    pub every_pixel: Pass,
    pub listed: Option<Pass>,
    /// How many pixels of a column an invocation of either takes.
    pub rows: u32,
}

/// Which tiles of a frame a pass must run over.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cover<'a> {
    pub list: &'a List,
    /// Or whether running over every pixel is faster than reading the list.
    pub is_worth_listing: bool,
}

/// Sees every pass as soon as it is recorded, before the next one is.
pub trait Watch: std::fmt::Debug {
    /// `encoder` holds what was recorded since it last was submitted; the watch may submit it and leave another. `counters` are
    /// the buffers that were set to 0 before the pass.
    fn recorded(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        counters: &[&wgpu::Buffer],
    ) -> Result<(), GpuError>;
}

/// A pass of a frame, kept to be recorded whenever one like it comes again.
#[derive(Clone, Debug)]
pub struct Step {
    label: String,
    pass: Kept,
    counters: Vec<wgpu::Buffer>,
}

impl Step {
    /// The label of its pass.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Records it, timed.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, timer: &mut Timer) {
        for counter in &self.counters {
            encoder.clear_buffer(counter, 0, None);
        }
        let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(&self.label),
            timestamp_writes: timer.time(),
        });
        self.pass.record(&mut compute);
    }

    /// Records steps one after the other, untimed, in as few passes as their counters allow: a driver's pool keeps every command
    /// buffer that a submission ever took, and looks at each of them whenever it is used again.
    pub fn record_all<'s>(steps: impl Iterator<Item = &'s Self>, encoder: &mut wgpu::CommandEncoder) {
        let mut steps = steps.peekable();
        while let Some(first) = steps.next() {
            for counter in &first.counters {
                encoder.clear_buffer(counter, 0, None);
            }
            let mut compute = encoder.begin_compute_pass(&Default::default());
            first.pass.record(&mut compute);
            while let Some(next) = steps.next_if(|step| step.counters.is_empty()) {
                next.pass.record(&mut compute);
            }
        }
    }
}

/// Keeps what is recorded.
impl Watch for Vec<Step> {
    fn recorded(
        &mut self,
        _gpu: &Gpu,
        _encoder: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        counters: &[&wgpu::Buffer],
    ) -> Result<(), GpuError> {
        self.push(Step {
            label: dispatch.label().to_owned(),
            pass: dispatch.keep(),
            counters: counters.iter().map(|&counter| counter.clone()).collect(),
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
        self.record_counting(dispatch, &[])
    }

    /// Records a pass over listed tiles where that is worth it and the list is for such a pass, otherwise over every pixel; to warm
    /// up, over both. `bind` is called for each pass that is recorded.
    pub(super) fn record_tiled<'p>(
        &mut self,
        pass: &'p TiledPass,
        cover: Option<Cover<'p>>,
        extent: Extent,
        counters: &[&wgpu::Buffer],
        bind: impl Fn(&'p Pass) -> Invocation<'p>,
    ) -> Result<(), GpuError> {
        let listed = pass.listed.as_ref().zip(cover);
        let listed = listed.filter(|(listed, cover)| cover.list.fits(listed, pass.rows));
        let is_worth_listing = listed.is_some_and(|(_, cover)| cover.is_worth_listing);
        let warms_up = matches!(self.repeat, Repeat::WarmUp);
        if let Some((listed, cover)) = listed.filter(|_| is_worth_listing || warms_up) {
            self.record_listed(bind(listed), cover.list, counters)?;
        }
        if !is_worth_listing || warms_up {
            let invocations = Extent::new(extent.width, extent.height.div_ceil(pass.rows));
            let dispatch = bind(&pass.every_pixel).over(self.gpu, invocations)?;
            self.record_counting(&dispatch, counters)?;
        }
        Ok(())
    }

    /// Records a pass over the tiles of a list.
    pub(super) fn record_listed(
        &mut self,
        pass: Invocation<'_>,
        list: &List,
        counters: &[&wgpu::Buffer],
    ) -> Result<(), GpuError> {
        let (workgroups, offset) = list.dispatch();
        let dispatch = pass
            .bind("tile_list", list.tiles())
            .indirect(self.gpu, workgroups, offset)?;
        self.record_counting(&dispatch, counters)
    }

    /// Records a pass whose results depend on the frame's images alone: over nothing where the frame repeats the one before,
    /// and they are there already.
    pub(super) fn record_unless(&mut self, is_repeat: bool, dispatch: &Dispatch<'_>) -> Result<(), GpuError> {
        match (is_repeat, self.repeat) {
            (true, Repeat::Timed(n)) => {
                for _ in 0..n {
                    if let Some(timestamps) = self.timer.time() {
                        dispatch.record_nothing(self.encoder, timestamps);
                    }
                }
                Ok(())
            }
            _ => self.record(dispatch),
        }
    }

    /// Records a pass that counts in `counters`, which are set to 0 before each time.
    pub fn record_counting(&mut self, dispatch: &Dispatch<'_>, counters: &[&wgpu::Buffer]) -> Result<(), GpuError> {
        match self.repeat {
            Repeat::WarmUp => dispatch.record_corner(self.encoder),
            Repeat::Timed(n) => {
                for _ in 0..n {
                    for counter in counters {
                        self.encoder.clear_buffer(counter, 0, None);
                    }
                    dispatch.record(self.encoder, self.timer.time());
                }
            }
        }
        match &mut self.watch {
            Some(watch) => watch.recorded(self.gpu, self.encoder, dispatch, counters),
            None => Ok(()),
        }
    }
}
