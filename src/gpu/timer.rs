//! GPU timestamps around passes.

use super::{Gpu, GpuError, Readback};

/// Times the passes of one submission.
#[derive(Debug)]
pub struct Timer {
    queries: Option<Queries>,
    /// Nanoseconds a tick.
    period_ns: f32,
    n_timed: u32,
    capacity: u32,
}

#[derive(Debug)]
struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
}

impl Timer {
    /// A timer for up to `capacity` passes a submission. Times nothing where that is 0 or the adapter has no
    /// timestamps.
    pub fn new(gpu: &Gpu, capacity: u32) -> Self {
        let has_timestamps = gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let queries = (has_timestamps && capacity > 0).then(|| Queries {
            set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: capacity * 2,
            }),
            resolved: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("pass times"),
                size: u64::from(capacity) * 16,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
        });
        Self {
            queries,
            period_ns: gpu.queue.get_timestamp_period(),
            n_timed: 0,
            capacity,
        }
    }

    /// The most passes that one timer holds: WebGPU's limit of 4096 queries a set.
    pub const MAX_PASSES: u32 = 2048;

    /// The timestamps of the next pass to be recorded.
    ///
    /// # Panics
    /// When more passes are timed than the capacity.
    pub fn time(&mut self) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let queries = self.queries.as_ref()?;
        let index = self.n_timed;
        assert!(index < self.capacity, "more passes than the timer holds");
        self.n_timed += 1;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &queries.set,
            beginning_of_pass_write_index: Some(index * 2),
            end_of_pass_write_index: Some(index * 2 + 1),
        })
    }

    /// Marks where passes begin that are timed as one.
    ///
    /// # Panics
    /// As [`Timer::time`].
    pub fn begin(&mut self, encoder: &mut wgpu::CommandEncoder) {
        assert!(
            self.queries.is_none() || self.n_timed < self.capacity,
            "more passes than the timer holds"
        );
        self.mark(encoder, Some(2 * self.n_timed), None);
    }

    /// Marks where they end.
    pub fn end(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.mark(encoder, None, Some(2 * self.n_timed + 1));
        self.n_timed += u32::from(self.queries.is_some());
    }

    /// Timestamps belong to passes, so an empty one carries it.
    fn mark(&self, encoder: &mut wgpu::CommandEncoder, beginning: Option<u32>, end: Option<u32>) {
        let Some(queries) = &self.queries else {
            return;
        };
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("time"),
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: &queries.set,
                beginning_of_pass_write_index: beginning,
                end_of_pass_write_index: end,
            }),
        });
    }

    /// Copies the timestamps into `readback`, ends this submission's timing, and returns how to read them.
    pub fn finish(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, readback: &mut Readback) -> Times {
        let n_queries = 2 * std::mem::take(&mut self.n_timed);
        let slot = self.queries.as_ref().filter(|_| n_queries > 0).map(|queries| {
            encoder.resolve_query_set(&queries.set, 0..n_queries, &queries.resolved, 0);
            readback.copy_buffer(gpu, encoder, &queries.resolved, u64::from(n_queries) * 8)
        });
        Times {
            slot,
            period_ns: self.period_ns,
        }
    }
}

/// The times of one submission, once its read-back has arrived.
#[derive(Debug)]
pub struct Times {
    slot: Option<usize>,
    period_ns: f32,
}

impl Times {
    /// Milliseconds of each timed pass, in the order recorded; none where the adapter has no timestamps.
    pub fn read(&self, readback: &Readback) -> Result<Vec<f64>, GpuError> {
        let Some(slot) = self.slot else {
            return Ok(Vec::new());
        };
        let bytes = readback.bytes(slot)?;
        let ticks = |pair: &[u8], at| u64::from_le_bytes(std::array::from_fn(|i| pair[at + i]));
        Ok(bytes
            .chunks_exact(16)
            .map(|pair| ticks(pair, 8).saturating_sub(ticks(pair, 0)) as f64 * f64::from(self.period_ns) * 1e-6)
            .collect())
    }
}
