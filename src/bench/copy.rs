//! How fast an adapter moves an image when it does nothing else: the floor under every pass. And what keeps a GPU from dozing
//! off between measurements.

use super::clock::{Clock, cost};
use crate::{
    gpu::{Gpu, GpuError, Pass, Texture, Timer},
    image::Extent,
    statistics::median,
};
use std::time::{Duration, Instant};

/// 64 MiB each way: more than most caches hold.
const EXTENT: Extent = Extent::new(2048, 2048);
const N_TRIES: usize = 9;

/// A copy is as fast as ever within this.
const AWAKE_WITHIN: f64 = 1.03;
/// Copies between two looks at the clock.
const N_TOGETHER: usize = 8;
/// How long waking up may take; the first time, when nobody knows how fast a copy can be, it takes as long as that.
const PATIENCE: Duration = Duration::from_secs(1);

/// An image, its copy, and the pass between them.
pub struct Copy<'a> {
    pub gpu: &'a Gpu,
    pass: Pass,
    source: Texture,
    destination: Texture,
    timer: Timer,
    least_ms: Option<f64>,
}

impl<'a> Copy<'a> {
    pub fn new(gpu: &'a Gpu) -> Result<Self, GpuError> {
        let texture = |label| Texture::new(gpu, label, EXTENT, wgpu::TextureFormat::Rgba32Float);
        let [source, destination] = gpu.scope("making room for a copy", || ["source", "destination"].map(texture))?;
        // Not zeros: some devices compress those.
        let n_values = 4 * EXTENT.n_pixels() as u32;
        let values: Vec<_> = (0..n_values).map(|n| n.wrapping_mul(0x9e37_79b9) as f32).collect();
        gpu.scope("uploading an image to copy", || source.write_floats(gpu, &values))?;
        Ok(Self {
            gpu,
            pass: Pass::new(gpu, "copy", &[include_str!("../../shaders/bench/copy.wgsl")], &[])?,
            source,
            destination,
            timer: Timer::new(gpu, 1),
            least_ms: None,
        })
    }

    /// Bytes read and written a millisecond, the median of several tries.
    pub fn bytes_per_ms(&mut self) -> Result<f64, GpuError> {
        self.wake()?;
        let times_ms = (0..=N_TRIES).map(|_| self.copy_ms(1)).collect::<Result<Vec<_>, _>>()?;
        // The first waits for the upload where nothing was to be woken.
        Ok(2.0 * self.source.n_bytes() as f64 / median(&times_ms[1..]))
    }

    /// A GPU that waits for frames lowers its clocks, to a third on some, and takes a while to raise them: copies until a copy
    /// is as fast as ever. Nothing on a CPU, where times are of another kind.
    pub fn wake(&mut self) -> Result<(), GpuError> {
        if Clock::of(self.gpu) == Clock::ProcessCpu {
            return Ok(());
        }
        let start = Instant::now();
        let known_ms = self.least_ms;
        loop {
            let ms = self.copy_ms(N_TOGETHER)?;
            self.least_ms = Some(self.least_ms.map_or(ms, |least| least.min(ms)));
            let is_awake = known_ms.is_some_and(|least| ms <= AWAKE_WITHIN * least);
            if is_awake || start.elapsed() > PATIENCE {
                return Ok(());
            }
        }
    }

    /// The last of `n` copies.
    fn copy_ms(&mut self, n: usize) -> Result<f64, GpuError> {
        let images = self
            .pass
            .bind("source", &self.source)
            .bind("destination", &self.destination);
        let copy = images.over(self.gpu, EXTENT)?;
        let (cost, ()) = cost(self.gpu, &mut self.timer, |encoder, timer, _| {
            for _ in 1..n {
                copy.record(encoder, None);
            }
            copy.record(encoder, timer.time());
            Ok(())
        })?;
        Ok(cost.ms)
    }
}
