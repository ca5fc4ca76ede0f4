//! What a bake can be asked for.

use super::{BakeError, builtin, gltf::GltfScene, model::Scene, pattern::Pattern, renderer::Texturing};
use crate::{gpu::Gpu, image::Extent, sequence::jitter::JitterSequence};
use serde::Serialize;
use std::sync::Arc;

/// A sequence to bake.
#[derive(Clone, Debug, Serialize)]
pub struct BakeSettings {
    /// Id of a built-in scene, or the name of the file's.
    pub scene: String,
    /// A scene from a file, in place of a built-in one.
    pub gltf: Option<GltfScene>,
    /// Number of frames.
    pub n_frames: usize,
    /// Size of the inputs.
    pub render_size: Extent,
    /// Size of the reference.
    pub output_size: Extent,
    /// Let time stand still at the first frame: only jitter and chance differ from frame to frame.
    pub at_rest: bool,
    /// Where each frame's sample lies.
    pub jitter: JitterSequence,
    /// Factor on every jitter, 0 to 1.
    pub jitter_scale: f64,
    /// Shaded samples a pixel of the inputs: 1, or 4 on a rotated grid around the jitter, each with its depth and motion.
    pub samples: u32,
    /// Samples a pixel of the reference; even. 0 for none.
    pub reference_samples: u32,
    /// Where those lie.
    pub reference_pattern: Pattern,
    /// Also average the reference in Karis's c / (1 + luma).
    pub karis: bool,
    /// Seed of the scene's chance and of the reference's samples.
    pub seed: u64,
    /// Whether textures have smaller levels.
    pub mipmaps: bool,
    /// Added to the level, for inputs and reference alike.
    pub mip_bias: f64,
    /// Also write which pixels' surfaces the frame before did not see.
    pub disocclusion: bool,
}

impl BakeSettings {
    /// Most frames of a bake.
    pub const MAX_FRAMES: usize = 100_000;
    /// Most samples a pixel of a reference.
    pub const MAX_REFERENCE_SAMPLES: u32 = 1 << 16;

    /// 16 frames of `scene` at 640×360, halton23(16), with 128 samples a pixel of reference.
    pub fn new(scene: &str) -> Self {
        let size = Extent::new(640, 360);
        Self {
            scene: scene.to_owned(),
            gltf: None,
            n_frames: 16,
            render_size: size,
            output_size: size,
            at_rest: false,
            jitter: JitterSequence::Halton23(16),
            jitter_scale: 1.0,
            samples: 1,
            reference_samples: 128,
            reference_pattern: Pattern::default(),
            karis: false,
            seed: 1,
            mipmaps: true,
            mip_bias: 0.0,
            disocclusion: false,
        }
    }

    /// The scene, built where it is one of ours.
    pub(super) fn build(&self) -> Result<Arc<Scene>, BakeError> {
        match &self.gltf {
            Some(gltf) => Ok(gltf.scene()),
            None => Ok(Arc::new((builtin::find(&self.scene)?.build)(self.seed))),
        }
    }

    /// What the scene is, and under which licence.
    pub(super) fn description(&self) -> Result<(String, Option<String>), BakeError> {
        match &self.gltf {
            Some(gltf) => Ok((format!("{}, from glTF", self.scene), gltf.copyright.clone())),
            None => Ok((
                builtin::find(&self.scene)?.purpose.to_owned(),
                Some("CC0-1.0".to_owned()),
            )),
        }
    }

    pub(super) fn texturing(&self) -> Texturing {
        Texturing {
            mipmaps: self.mipmaps,
            mip_bias: self.mip_bias,
        }
    }

    /// Pixels of a reference's renders for one of the reference, along each axis. Small triangles cost by the block of pixels
    /// that they touch and by their corners, so that a few finer renders are cheaper than many; a grid can be had of them,
    /// Halton's points cannot.
    pub(super) fn reference_fineness(&self, gpu: &Gpu) -> u32 {
        let longest = self.output_size.width.max(self.output_size.height);
        // Both halves in renders of four samples a pixel.
        let divides = self.reference_samples.is_multiple_of(8);
        match self.reference_pattern {
            Pattern::Stratified if divides && 2 * longest <= gpu.max_side() => 2,
            _ => 1,
        }
    }

    /// Checks what does not need a device.
    ///
    /// # Errors
    /// [`BakeError::UnknownScene`] or [`BakeError::Setting`].
    pub fn validate(&self) -> Result<(), BakeError> {
        if self.gltf.is_none() {
            builtin::find(&self.scene)?;
        }
        let setting = |field, problem: String| Err(BakeError::Setting { field, problem });
        if !(1..=Self::MAX_FRAMES).contains(&self.n_frames) {
            return setting(
                "frames",
                format!("must be from 1 to {}, not {}", Self::MAX_FRAMES, self.n_frames),
            );
        }
        for (field, size) in [("size", self.render_size), ("output-size", self.output_size)] {
            if size.width == 0 || size.height == 0 {
                return setting(field, format!("{size} has no pixels"));
            }
        }
        let scale = |output: u32, render: u32| f64::from(output) / f64::from(render);
        let scales = [
            scale(self.output_size.width, self.render_size.width),
            scale(self.output_size.height, self.render_size.height),
        ];
        if scales.iter().any(|scale| !(1.0..=4.0).contains(scale)) {
            let problem = format!("must be 1 to 4 times the size along each axis: {}", self.output_size);
            return setting("output-size", problem);
        }
        if ![1, 4].contains(&self.samples) {
            return setting("samples", format!("must be 1 or 4, not {}", self.samples));
        }
        if !self.reference_samples.is_multiple_of(2) || self.reference_samples > Self::MAX_REFERENCE_SAMPLES {
            let problem = format!(
                "must be even, for there are two halves, and at most {}, not {}",
                Self::MAX_REFERENCE_SAMPLES,
                self.reference_samples
            );
            return setting("reference-samples", problem);
        }
        if !(0.0..=1.0).contains(&self.jitter_scale) {
            return setting("jitter-scale", format!("must be 0 to 1, not {}", self.jitter_scale));
        }
        if !self.mip_bias.is_finite() || self.mip_bias.abs() > 16.0 {
            return setting("mip-bias", format!("must be from -16 to 16, not {}", self.mip_bias));
        }
        Ok(())
    }

    /// Checks what depends on the device.
    pub(super) fn validate_on(&self, gpu: &Gpu) -> Result<(), BakeError> {
        let longest = |size: Extent| size.width.max(size.height);
        let max = gpu.max_side();
        // A sum has 16 bytes a pixel.
        let max_pixels = gpu.max_buffer() / 16;
        for (field, size) in [("size", self.render_size), ("output-size", self.output_size)] {
            if longest(size) > max || size.n_pixels() as u64 > max_pixels {
                return Err(BakeError::Setting {
                    field,
                    problem: format!(
                        "{size} is beyond this adapter, which has at most {max} pixels a side and {max_pixels} in all"
                    ),
                });
            }
        }
        Ok(())
    }
}
