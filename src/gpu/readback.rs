//! Results on their way back to the host. Buffers are mapped while the device goes on with the next frame, read on any
//! thread, and reused: fresh ones would cost a page fault every 4 KiB.

use super::{Bound, Gpu, GpuError, Texture};
use crate::image::Image;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// Host-visible buffers waiting to be used again.
#[derive(Clone, Debug, Default)]
pub struct ReadbackPool {
    free: Arc<Mutex<Vec<wgpu::Buffer>>>,
}

/// What one submission copies back. Record copies, submit, [`Readback::map`], wait for the submission, read.
#[derive(Debug)]
pub struct Readback {
    buffers: Vec<wgpu::Buffer>,
    pool: ReadbackPool,
}

impl ReadbackPool {
    /// An empty read-back.
    pub fn begin(&self) -> Readback {
        Readback {
            buffers: Vec::new(),
            pool: self.clone(),
        }
    }

    fn take(&self, gpu: &Gpu, size: u64) -> wgpu::Buffer {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        match free.iter().position(|buffer| buffer.size() == size) {
            Some(index) => free.swap_remove(index),
            None => gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("read-back"),
                size,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            }),
        }
    }
}

/// Rows of a texture copied to a buffer start at multiples of this many bytes.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

fn padded_row_bytes(width: u32, texel_bytes: u32) -> u32 {
    (width * texel_bytes).next_multiple_of(ROW_ALIGNMENT)
}

/// Where to read the floats of a texture or buffer, and how they lie there.
#[derive(Clone, Copy, Debug)]
pub struct Floats {
    slot: usize,
    is_f16: bool,
    /// Of one row, with and without what pads it; of a buffer, all.
    row_bytes: [usize; 2],
}

/// Bytes of an `rgba32float` texel.
const RGBA_SIZE: u32 = 16;

impl Readback {
    /// Records the copy of a texture, or buffer, of floats.
    pub fn copy_floats(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, source: Bound<'_>) -> Floats {
        match source {
            Bound::Texture(texture) => {
                let (width, texel_bytes) = (texture.extent().width, texture.texel_bytes());
                Floats {
                    slot: self.copy_texture(gpu, encoder, texture),
                    is_f16: texture.format() == wgpu::TextureFormat::Rgba16Float,
                    row_bytes: [padded_row_bytes(width, texel_bytes), width * texel_bytes].map(|n| n as usize),
                }
            }
            Bound::Buffer(buffer) => Floats {
                slot: self.copy_buffer(gpu, encoder, buffer, buffer.size()),
                is_f16: false,
                row_bytes: [buffer.size() as usize; 2],
            },
        }
    }

    /// The floats of a copy, row by row, channels side by side.
    pub fn values(&self, at: Floats) -> Result<Vec<f32>, GpuError> {
        let bytes = self.bytes(at.slot)?;
        let [padded, used] = at.row_bytes;
        let rows = bytes.chunks_exact(padded).map(|row| &row[..used]);
        Ok(match at.is_f16 {
            true => rows
                .flat_map(|row| row.chunks_exact(2))
                .map(|two| half::f16::from_le_bytes([two[0], two[1]]).to_f32())
                .collect(),
            false => rows
                .flat_map(|row| row.chunks_exact(4))
                .map(bytemuck::pod_read_unaligned)
                .collect(),
        })
    }

    /// Records the copy of a texture's first level; returns the slot to read it from.
    ///
    /// # Panics
    /// When the format is compressed or has several planes.
    pub fn copy_texture(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, texture: &Texture) -> usize {
        let extent = texture.extent();
        let row_bytes = padded_row_bytes(extent.width, texture.texel_bytes());
        let buffer = self.pool.take(gpu, u64::from(row_bytes) * u64::from(extent.height));
        encoder.copy_texture_to_buffer(
            texture.raw().as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row_bytes),
                    rows_per_image: None,
                },
            },
            texture.raw().size(),
        );
        self.push(buffer)
    }

    /// Records the copy of the first `size` bytes of a buffer; returns the slot to read them from.
    pub fn copy_buffer(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::Buffer,
        size: u64,
    ) -> usize {
        let buffer = self.pool.take(gpu, size);
        encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, size);
        self.push(buffer)
    }

    fn push(&mut self, buffer: wgpu::Buffer) -> usize {
        self.buffers.push(buffer);
        self.buffers.len() - 1
    }

    /// Asks for everything to be mapped once the submission is done. Call between submitting and waiting.
    pub fn map(&self) {
        for buffer in &self.buffers {
            // A failure shows itself when the bytes are read.
            buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        }
    }

    /// The bytes of a slot.
    pub fn bytes(&self, slot: usize) -> Result<wgpu::BufferView, GpuError> {
        self.buffers[slot]
            .slice(..)
            .get_mapped_range()
            .map_err(|error| GpuError::Device {
                activity: "reading a result back".to_owned(),
                message: error.to_string(),
            })
    }

    /// The texels of a slot that [`Readback::copy_texture`] returned for `texture`'s extent, as `T`, row by row.
    pub fn texels<T: bytemuck::AnyBitPattern>(
        &self,
        slot: usize,
        extent: crate::image::Extent,
    ) -> Result<Vec<T>, GpuError> {
        let bytes = self.bytes(slot)?;
        let texel_bytes = size_of::<T>();
        let row_bytes = padded_row_bytes(extent.width, texel_bytes as u32) as usize;
        let rows = bytes.chunks_exact(row_bytes);
        let texels = rows.flat_map(|row| row[..extent.width as usize * texel_bytes].chunks_exact(texel_bytes));
        Ok(texels.map(bytemuck::pod_read_unaligned).collect())
    }

    /// The texels of a slot that [`Readback::copy_texture`] returned for `texture`: all channels of the first, all of the
    /// next. Integers, below 2²⁴, become floats.
    pub fn floats(&self, slot: usize, texture: &Texture) -> Result<Vec<f32>, GpuError> {
        let extent = texture.extent();
        Ok(match (texture.format(), texture.texel_bytes()) {
            (wgpu::TextureFormat::Rgba16Float, _) => {
                let texels = self.texels::<[u16; 4]>(slot, extent)?.into_flattened();
                texels
                    .into_iter()
                    .map(|bits| half::f16::from_bits(bits).to_f32())
                    .collect()
            }
            (wgpu::TextureFormat::R32Uint, _) => {
                let texels: Vec<u32> = self.texels(slot, extent)?;
                texels.into_iter().map(|value| value as f32).collect()
            }
            (_, 4) => self.texels(slot, extent)?,
            (_, 8) => self.texels::<[f32; 2]>(slot, extent)?.into_flattened(),
            _ => self.texels::<[f32; 4]>(slot, extent)?.into_flattened(),
        })
    }

    /// The colour of a slot that [`Readback::copy_texture`] returned for an `rgba32float` texture of this extent.
    pub fn rgb(&self, slot: usize, extent: crate::image::Extent) -> Result<Image<[f32; 3]>, GpuError> {
        let bytes = self.bytes(slot)?;
        let bytes: &[u8] = &bytes;
        let width = extent.width as usize;
        let mut pixels = vec![[0.0; 3]; extent.n_pixels()];
        pixels
            .par_chunks_exact_mut(width)
            .zip(bytes.par_chunks_exact(padded_row_bytes(extent.width, RGBA_SIZE) as usize))
            .for_each(|(row, padded)| {
                for (pixel, rgba) in row.iter_mut().zip(padded.chunks_exact(RGBA_SIZE as usize)) {
                    *pixel = bytemuck::pod_read_unaligned(&rgba[..12]);
                }
            });
        Ok(Image::from_pixels(extent, pixels))
    }

    /// The alpha of the same.
    pub fn alpha(&self, slot: usize, extent: crate::image::Extent) -> Result<Image<f32>, GpuError> {
        let texels = self.texels::<[f32; 4]>(slot, extent)?;
        Ok(Image::from_pixels(
            extent,
            texels.into_iter().map(|rgba| rgba[3]).collect(),
        ))
    }
}

impl Drop for Readback {
    fn drop(&mut self) {
        for buffer in &self.buffers {
            buffer.unmap();
        }
        self.pool
            .free
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .append(&mut self.buffers);
    }
}
