//! The run's threads: decoders, each a frame ahead; the GPU's, which uploads and submits; the scorer, which waits for a
//! submission and reads it back while the next one runs; and the writer, which hands images to the observer. Bounded
//! channels between them keep few frames in memory.

use super::{
    MetricsOn, Observer, RunError, RunSpec,
    plan::Plan,
    report::Report,
    scoring::{Scorer, Shown, Submitted},
    times::{milliseconds_since, thread_cpu_ms, timed},
};
use crate::{
    gpu::{Gpu, Readback, ReadbackPool, Timer},
    image::Image,
    metrics::gpu::{GpuMetrics, Recorded, Recording, ScoredFrame},
    sequence::{Frame, Sequence, SequenceError, frame::Rgb},
    taa::{Inputs, Options, Repeat, Resolver, Skip},
};
use rayon::prelude::*;
use std::{
    sync::Arc,
    sync::mpsc::{Receiver, SyncSender, sync_channel},
    thread::{self, ScopedJoinHandle},
    time::Instant,
};

/// A frame and the milliseconds its decoding took.
type Decoded = Result<(Frame, f64), SequenceError>;

pub fn run(
    plan: &Plan,
    spec: &RunSpec,
    sequence: &Sequence,
    gpu: &Gpu,
    observer: &dyn Observer,
) -> Result<Report, RunError> {
    let start = Instant::now();
    let frame_bytes = plan.channels.n_bytes(sequence.sizes());
    let n_decoders = decoders(plan.n_frames, frame_bytes, DECODED_BYTES);
    thread::scope(|scope| {
        let hash = scope.spawn(|| sequence.hash());
        let frames: Vec<_> = (0..n_decoders)
            .map(|first| {
                let (send, receive) = sync_channel(1);
                scope.spawn(move || decode(plan, sequence, first, n_decoders, &send));
                receive
            })
            .collect();
        let (send, submitted) = sync_channel(1);
        let (keep, kept) = sync_channel(plan.systems.len());
        let keep = observer.wants_output().then_some(keep);
        let writer = scope.spawn(move || write(&kept, observer));
        let on_device = scores_on_device(spec, gpu) && !plan.metrics.is_empty();
        let reads_images = observer.wants_output() || !on_device;
        let scorer =
            scope.spawn(move || Scorer::new(plan, on_device, sequence, gpu, observer, keep).score_all(&submitted));
        let resolved = Stage::new(plan, spec, sequence, gpu, on_device, reads_images)
            .and_then(|mut stage| stage.resolve_all(&frames, observer, &send));
        // Each thread ends when the channel before it closes, or the one after it.
        drop(send);
        drop(frames);
        let scored = joined(scorer, "scoring")?;
        let output_ms = joined(writer, "writing")?;
        let hash = joined(hash, "hashing")?;
        // Where several fail, the last in line is the cause: those before it only saw its channel close.
        let output_ms = output_ms?;
        let scored = scored?;
        resolved?;
        Ok(scored.into_report(hash?, n_decoders, output_ms, milliseconds_since(start)))
    })
}

fn joined<T>(thread: ScopedJoinHandle<'_, T>, work: &str) -> Result<T, RunError> {
    thread
        .join()
        .map_err(|_| RunError::Internal(format!("the {work} thread panicked")))
}

/// Hands shown images to the observer until the channel closes; the milliseconds that took.
fn write(kept: &Receiver<Shown>, observer: &dyn Observer) -> Result<f64, RunError> {
    let mut total_ms = 0.0;
    for shown in kept {
        let (written, ms) = timed(|| {
            observer.output(shown.preset_index, shown.frame_index, &shown.image)?;
            for (trace, image) in &shown.traces {
                observer.trace(shown.preset_index, shown.frame_index, *trace, image)?;
            }
            match &shown.pictures {
                Some([reference, test]) => observer.compared(shown.preset_index, shown.frame_index, reference, test),
                None => Ok(()),
            }
        });
        written.map_err(|error| RunError::Internal(format!("writing frame {}: {error}", shown.frame_index)))?;
        total_ms += ms;
    }
    Ok(total_ms)
}

/// Whether the adapter computes the metrics.
fn scores_on_device(spec: &RunSpec, gpu: &Gpu) -> bool {
    match spec.metrics_on {
        MetricsOn::Auto => !gpu.is_cpu(),
        MetricsOn::Cpu => false,
        MetricsOn::Gpu => true,
    }
}

/// What decoded frames that wait for the GPU may take in memory. Bytes.
const DECODED_BYTES: u64 = 2 << 30;

/// Each decoder also decompresses in parallel, so a few are enough to hide the gaps; and each has two frames of `frame_bytes`
/// that wait. One must work whatever the budget.
fn decoders(n_frames: usize, frame_bytes: u64, budget_bytes: u64) -> usize {
    let n_cores = thread::available_parallelism().map_or(1, usize::from);
    let n_affordable = (budget_bytes / (2 * frame_bytes)).max(1);
    (n_cores / 2).clamp(1, 4).min(n_frames).min(n_affordable as usize)
}

/// Loads every `step`-th frame from `first` until the end, an error, or nobody listens.
fn decode(plan: &Plan, sequence: &Sequence, first: usize, step: usize, send: &SyncSender<Decoded>) {
    for index in (first..plan.n_frames).step_by(step) {
        let (frame, decode_ms) = timed(|| sequence.load(index, plan.channels));
        let failed = frame.is_err();
        if send.send(frame.map(|frame| (frame, decode_ms))).is_err() || failed {
            return;
        }
    }
}

/// The GPU's thread.
struct Stage<'a> {
    plan: &'a Plan,
    gpu: &'a Gpu,
    inputs: Inputs,
    resolvers: Vec<Resolver>,
    /// Where metrics are computed on the adapter.
    metrics: Option<GpuMetrics>,
    reads_images: bool,
    timer: Timer,
    pool: ReadbackPool,
    warmup_frames: usize,
    /// Frames since the last reset.
    age: usize,
}

impl<'a> Stage<'a> {
    fn new(
        plan: &'a Plan,
        spec: &RunSpec,
        sequence: &Sequence,
        gpu: &'a Gpu,
        on_device: bool,
        reads_images: bool,
    ) -> Result<Self, RunError> {
        let sizes = sequence.sizes();
        for extent in [sizes.render, sizes.output] {
            if extent.width.max(extent.height) > gpu.max_side() {
                let (name, limit) = (gpu.info().name, gpu.max_side());
                let message = format!("frames of {extent} are too large for `{name}`: at most {limit} a side");
                return Err(RunError::Input(message));
            }
        }
        let options = Options {
            precision: spec.history,
            skip: plan.skip,
        };
        let resolvers = plan
            .systems
            .par_iter()
            .map(|system| Resolver::new(gpu, system.recipe.clone(), options, sizes))
            .collect::<Result<_, _>>()?;
        let skips = plan.skip != Skip::Off;
        let reach_px = plan
            .systems
            .iter()
            .filter(|_| skips)
            .map(|system| system.recipe.reach_px())
            .max();
        let inputs = Inputs::tracking(gpu, sizes, plan.channels, &plan.prepared, reach_px, None)?;
        let metrics = on_device
            .then(|| GpuMetrics::new(gpu, sizes.output, sequence.display(), &plan.metrics, plan.systems.len()))
            .transpose()?;
        let mut stage = Self {
            plan,
            gpu,
            inputs,
            resolvers,
            reads_images,
            metrics,
            timer: Timer::new(gpu, 0),
            pool: ReadbackPool::default(),
            warmup_frames: sequence.warmup_frames(),
            age: 0,
        };
        // What this leaves in histories, the first frame does not read.
        let mut encoder = stage.encoder();
        stage.record(&mut encoder, Repeat::WarmUp)?;
        gpu.wait(gpu.queue.submit([encoder.finish()]))?;
        // All metrics of a frame are timed as one pass.
        stage.timer = Timer::new(gpu, plan.n_timed_passes() + 1);
        Ok(stage)
    }

    fn encoder(&self) -> wgpu::CommandEncoder {
        self.gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    fn resolve_all(
        &mut self,
        frames: &[Receiver<Decoded>],
        observer: &dyn Observer,
        send: &SyncSender<Submitted>,
    ) -> Result<(), RunError> {
        for index in 0..self.plan.n_frames {
            if observer.cancelled() {
                return Err(RunError::Cancelled);
            }
            let decoded = frames[index % frames.len()].recv();
            let (frame, decode_ms) =
                decoded.map_err(|_| RunError::Internal(format!("the decoder of frame {index} panicked")))??;
            let submitted = self.submit(frame, decode_ms)?;
            if send.send(submitted).is_err() {
                // The scorer may have seen enough; if it failed, its own error is the run's.
                if self.plan.until.is_some() {
                    return Ok(());
                }
                return Err(RunError::Internal("the scorer stopped".to_owned()));
            }
        }
        Ok(())
    }

    /// Uploads a frame, and submits every preset's passes and the copies back.
    fn submit(&mut self, mut frame: Frame, decode_ms: f64) -> Result<Submitted, RunError> {
        let (uploaded, upload_ms) = timed(|| self.inputs.upload(self.gpu, &frame));
        uploaded?;
        self.age = match frame.index == 0 || frame.reset {
            true => 0,
            false => self.age + 1,
        };
        let cpu_before = thread_cpu_ms();
        let mut encoder = self.encoder();
        self.record(&mut encoder, Repeat::Timed(self.plan.repeat))?;
        let mut readback = self.pool.begin();
        let reference = frame.reference.take().map(Arc::new);
        let recorded = self.record_metrics(&mut encoder, &mut readback, reference.as_ref(), &mut frame)?;
        let gpu = self.gpu;
        let (shown, repaired) = gpu.scope("reading a frame back", || {
            let mut copy = |resolver: &Resolver| readback.copy_texture(gpu, &mut encoder, resolver.shown());
            // The last one is always read: the report says where it lies.
            let shown: Vec<_> = match self.reads_images || frame.index + 1 == self.plan.n_frames {
                true => self.resolvers.iter().map(&mut copy).collect(),
                false => Vec::new(),
            };
            let mut copy = |counter: &wgpu::Buffer| readback.copy_buffer(gpu, &mut encoder, counter, 4);
            let prepared = self.plan.prepared.iter();
            let repaired: Vec<_> = prepared
                .map(|&preparation| copy(self.inputs.repaired_texels(preparation)))
                .collect();
            (shown, repaired)
        })?;
        let kept = self
            .resolvers
            .iter()
            .map(|resolver| resolver.copy_kept(gpu, &mut encoder, &mut readback))
            .collect();
        let times = self.timer.finish(gpu, &mut encoder, &mut readback);
        let submission = gpu.scope("submitting a frame", || gpu.queue.submit([encoder.finish()]))?;
        readback.map();
        Ok(Submitted {
            frame,
            reference,
            age: self.age,
            submission,
            readback,
            times,
            shown,
            recorded,
            repaired,
            kept,
            decode_ms,
            upload_ms,
            host_cpu_ms: thread_cpu_ms() - cpu_before,
        })
    }

    fn record(&mut self, encoder: &mut wgpu::CommandEncoder, repeat: Repeat) -> Result<(), RunError> {
        self.inputs.prepare(self.gpu, encoder, &mut self.timer, repeat)?;
        for resolver in &mut self.resolvers {
            resolver.resolve(self.gpu, encoder, &self.inputs, &mut self.timer, repeat)?;
        }
        Ok(())
    }

    /// Records the metrics of every preset, where the adapter computes them.
    fn record_metrics(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        readback: &mut Readback,
        reference: Option<&Arc<Image<Rgb>>>,
        frame: &mut Frame,
    ) -> Result<Vec<Recorded>, RunError> {
        let (Some(metrics), Some(reference)) = (&mut self.metrics, reference) else {
            return Ok(Vec::new());
        };
        let needs_motion = self.plan.metrics.iter().any(|metric| metric.needs_motion());
        let motion_px = needs_motion.then(|| frame.take_output_motion_px()).flatten();
        let mut recording = Recording {
            gpu: self.gpu,
            encoder,
            readback,
        };
        let frame = ScoredFrame {
            reference,
            motion_px: motion_px.as_ref(),
            follows: self.age > 0,
            settled: self.age >= self.warmup_frames,
        };
        let shown: Vec<_> = self.resolvers.iter().map(Resolver::shown).collect();
        Ok(metrics.record(&mut recording, &mut self.timer, frame, &shown)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decoders_keep_to_their_budget() {
        let [one, many] = [3, 1000].map(|n_frames| decoders(n_frames, 100, u64::MAX));
        assert!((1..=3).contains(&one) && (one..=4).contains(&many));
        assert_eq!(decoders(1000, 100, 399), 1, "two frames each");
        assert_eq!(decoders(1000, 100, 0), 1, "one must work");
        assert_eq!(decoders(1000, 100, 200 * many as u64), many);
    }
}
