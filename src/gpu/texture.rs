//! Textures: every image on the device, 2-D; all but those of scenes with one level.

use super::Gpu;
use crate::image::{Extent, Image};
use half::f16;
use rayon::prelude::*;

/// A 2-D texture and its only view.
#[derive(Debug)]
pub struct Texture {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    extent: Extent,
}

impl Texture {
    /// A texture that passes read, write, and that is uploaded to or read back.
    pub fn new(gpu: &Gpu, label: &str, extent: Extent, format: wgpu::TextureFormat) -> Self {
        Self::with_levels(gpu, label, extent, format, 1, usages(format))
    }

    /// A texture that raster passes draw to, and that passes read or is read back.
    pub fn target(gpu: &Gpu, label: &str, extent: Extent, format: wgpu::TextureFormat) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        Self::with_levels(gpu, label, extent, format, 1, usage)
    }

    /// An image with its smaller levels, each half of the one before (rounded down, at least 1).
    ///
    /// # Panics
    /// When there is no level.
    pub fn mipmapped(gpu: &Gpu, label: &str, levels: &[Image<[f16; 4]>]) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let format = wgpu::TextureFormat::Rgba16Float;
        let made = Self::with_levels(gpu, label, levels[0].extent(), format, levels.len() as u32, usage);
        for (level, image) in levels.iter().enumerate() {
            let Extent { width, height } = image.extent();
            let halves: Vec<_> = image
                .pixels()
                .as_flattened()
                .iter()
                .map(|value| value.to_bits())
                .collect();
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    mip_level: level as u32,
                    ..made.texture.as_image_copy()
                },
                bytemuck::cast_slice(&halves),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(8 * width),
                    rows_per_image: None,
                },
                wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
            );
        }
        made
    }

    /// So many images of one size, which shaders see as one `texture_2d_array`.
    pub fn stack(gpu: &Gpu, label: &str, extent: Extent, n_layers: u32, format: wgpu::TextureFormat) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: extent.width,
                height: extent.height,
                depth_or_array_layers: n_layers,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        Self { texture, view, extent }
    }

    /// One image of a stack.
    pub fn layer(&self, index: usize) -> Layer<'_> {
        Layer {
            texture: self,
            index: index as u32,
        }
    }

    fn with_levels(
        gpu: &Gpu,
        label: &str,
        extent: Extent,
        format: wgpu::TextureFormat,
        n_levels: u32,
        usage: wgpu::TextureUsages,
    ) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: extent.width,
                height: extent.height,
                depth_or_array_layers: 1,
            },
            mip_level_count: n_levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        });
        Self {
            view: texture.create_view(&wgpu::TextureViewDescriptor::default()),
            texture,
            extent,
        }
    }

    /// Width and height.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// How its texels are stored.
    pub fn format(&self) -> wgpu::TextureFormat {
        self.texture.format()
    }

    /// Bytes of a texel.
    pub fn texel_bytes(&self) -> u32 {
        self.format()
            .block_copy_size(None)
            .expect("colour formats have blocks of one texel")
    }

    /// Size in memory, without the driver's padding.
    pub fn n_bytes(&self) -> u64 {
        self.extent.n_pixels() as u64 * u64::from(self.texel_bytes())
    }

    /// For binding, and for drawing to.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// For copies.
    pub(super) fn raw(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// Uploads RGB as `rgba32float`. The textures have no three-channel format.
    pub fn write_rgb(&self, gpu: &Gpu, image: &Image<[f32; 3]>) {
        self.layer(0).write_rgb(gpu, image);
    }

    /// Uploads pairs as `rg32float`.
    pub fn write_vec2(&self, gpu: &Gpu, image: &Image<[f32; 2]>) {
        self.layer(0).write_vec2(gpu, image);
    }

    /// Uploads scalars as `r32float`.
    pub fn write_scalar(&self, gpu: &Gpu, image: &Image<f32>) {
        self.layer(0).write_scalar(gpu, image);
    }

    /// Uploads integers as `r32uint`.
    pub fn write_u32(&self, gpu: &Gpu, image: &Image<u32>) {
        self.write(gpu, bytemuck::cast_slice(image.pixels()));
    }

    /// Uploads floats, all channels of a texel after each other, in the texture's own format: 16-bit ones round.
    pub fn write_floats(&self, gpu: &Gpu, values: &[f32]) {
        match self.format() {
            wgpu::TextureFormat::Rgba16Float => {
                let halves: Vec<_> = values.iter().map(|&value| f16::from_f32(value).to_bits()).collect();
                self.write(gpu, bytemuck::cast_slice(&halves));
            }
            wgpu::TextureFormat::R32Uint => {
                let numbers: Vec<_> = values.iter().map(|&value| value as u32).collect();
                self.write(gpu, bytemuck::cast_slice(&numbers));
            }
            _ => self.write(gpu, bytemuck::cast_slice(values)),
        }
    }

    fn write(&self, gpu: &Gpu, bytes: &[u8]) {
        self.layer(0).write(gpu, bytes);
    }
}

/// One image of a [`Texture::stack`], or the only one of a texture.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    texture: &'a Texture,
    index: u32,
}

impl Layer<'_> {
    /// Uploads RGB as `rgba32float`.
    pub fn write_rgb(self, gpu: &Gpu, image: &Image<[f32; 3]>) {
        let mut rgba = Vec::with_capacity(image.pixels().len());
        image
            .pixels()
            .par_iter()
            .with_min_len(4096)
            .map(|&[r, g, b]| [r, g, b, 1.0])
            .collect_into_vec(&mut rgba);
        self.write(gpu, bytemuck::cast_slice(&rgba));
    }

    /// Uploads pairs as `rg32float`.
    pub fn write_vec2(self, gpu: &Gpu, image: &Image<[f32; 2]>) {
        self.write(gpu, bytemuck::cast_slice(image.pixels()));
    }

    /// Uploads scalars as `r32float`.
    pub fn write_scalar(self, gpu: &Gpu, image: &Image<f32>) {
        self.write(gpu, bytemuck::cast_slice(image.pixels()));
    }

    fn write(self, gpu: &Gpu, bytes: &[u8]) {
        let Extent { width, height } = self.texture.extent;
        let all = self.texture.texture.as_image_copy();
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                origin: wgpu::Origin3d {
                    z: self.index,
                    ..all.origin
                },
                ..all
            },
            bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some((bytes.len() / height as usize) as u32),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
        );
    }
}

/// Two-channel floats cannot be written by every adapter's passes, and none of ours writes one.
fn usages(format: wgpu::TextureFormat) -> wgpu::TextureUsages {
    let common = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC;
    if format == wgpu::TextureFormat::Rg32Float {
        common
    } else {
        common | wgpu::TextureUsages::STORAGE_BINDING
    }
}
