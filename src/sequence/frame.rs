//! The canonical form of a frame: what every recipe and metric sees, whatever engine it came from.

use super::several::{Others, Several};
use crate::{
    image::{Extent, Image},
    metrics::Display,
};
use std::fmt;

/// Linear or display-referred RGB.
pub type Rgb = [f32; 3];

/// The images of a frame that a caller wants; the loader decodes no others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Linear view depth.
    pub depth: bool,
    /// Motion vectors.
    pub motion: bool,
    /// Object ids.
    pub object_id: bool,
    /// Unlit colour.
    pub albedo: bool,
    /// Reactive mask.
    pub reactive: bool,
    /// Colour rendered without jitter.
    pub unjittered_color: bool,
    /// Ground truth.
    pub reference: bool,
    /// Several samples or layers of each pixel.
    pub several: Option<Several>,
}

impl Channels {
    /// Everything that either wants. Colour is always loaded.
    pub fn union(self, other: Self) -> Self {
        self.zip(other, |a, b| a | b)
    }

    /// What both have.
    pub fn intersection(self, other: Self) -> Self {
        self.zip(other, |a, b| a & b)
    }

    /// What the images of a frame with all of these take in memory, at the most. Bytes.
    pub fn n_bytes(self, sizes: Sizes) -> u64 {
        let rgb = size_of::<Rgb>();
        let if_read = |is_read: bool, n_bytes: usize| if is_read { n_bytes } else { 0 };
        let of_an_item = rgb + if_read(self.depth, 4) + if_read(self.motion, 8);
        let of_others = self.several.map_or(0, |several| {
            of_an_item * (several.n_items as usize - 1) + 4 * several.n_items as usize
        });
        let of_render = of_an_item
            + of_others
            + if_read(self.object_id, 4)
            + if_read(self.albedo, rgb)
            + if_read(self.reactive, 4)
            + if_read(self.unjittered_color, rgb);
        let of_output = if_read(self.reference, rgb);
        (of_render * sizes.render.n_pixels() + of_output * sizes.output.n_pixels()) as u64
    }

    fn zip(self, other: Self, f: impl Fn(bool, bool) -> bool) -> Self {
        Self {
            depth: f(self.depth, other.depth),
            motion: f(self.motion, other.motion),
            object_id: f(self.object_id, other.object_id),
            albedo: f(self.albedo, other.albedo),
            reactive: f(self.reactive, other.reactive),
            unjittered_color: f(self.unjittered_color, other.unjittered_color),
            reference: f(self.reference, other.reference),
            several: match f(self.several.is_some(), other.several.is_some()) {
                true => self.several.or(other.several),
                false => None,
            },
        }
    }
}

/// What comes in and what is to come out, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Of colour, depth, motion and all other inputs.
    pub render: Extent,
    /// Of history, the shown image and the reference.
    pub output: Extent,
}

impl Sizes {
    /// Nothing is upscaled.
    pub const fn native(extent: Extent) -> Self {
        Self {
            render: extent,
            output: extent,
        }
    }

    /// Output pixels for an input pixel, along x and y.
    pub fn scale(self) -> [f64; 2] {
        [
            f64::from(self.output.width) / f64::from(self.render.width),
            f64::from(self.output.height) / f64::from(self.render.height),
        ]
    }

    /// The input texel that contains the centre of an output pixel. In integers, because centres often lie on a texel's
    /// border, where a rounded quotient may fall to either side.
    pub fn render_texel(self, [x, y]: [u32; 2]) -> [u32; 2] {
        let along = |i: u32, render: u32, output: u32| (2 * i + 1) * render / (2 * output);
        [
            along(x, self.render.width, self.output.width),
            along(y, self.render.height, self.output.height),
        ]
    }
}

impl fmt::Display for Sizes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "from {} to {}", self.render, self.output)
    }
}

/// One frame with all conventions normalised. Values are as the engine wrote them otherwise: non-finite and negative
/// ones are still there, because repairing them is the recipe's work and is counted.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the sequence, from 0.
    pub index: usize,
    /// History is dropped before this frame (camera cut).
    pub reset: bool,
    /// Texel `(x, y)` holds the scene at `(x + 0.5 + jitter_px[0], y + 0.5 + jitter_px[1])`; y down.
    pub jitter_px: [f64; 2],
    /// Distance of the far plane in depth units; infinite where the engine has none.
    pub far: f64,
    /// How a viewer is shown it, for recipes that work on display values.
    pub display: Display,
    /// Size of what is to be made of the frame.
    pub output_size: Extent,
    /// Where the frame shades every other pixel: those whose x + y is even (0) or odd (1). At the others colour and albedo
    /// are 0, depth is sky and motion is NaN, whatever the engine left there.
    pub parity: Option<u32>,
    /// Linear RGB at render size.
    pub color: Image<Rgb>,
    /// Distance along the view axis; sky is [`SKY_DEPTH`].
    pub depth: Option<Image<f32>>,
    /// Where this pixel's surface was last frame, minus where it is now; pixels, y down, jitter removed.
    pub motion_px: Option<Image<[f32; 2]>>,
    /// Object ids, compared for equality only.
    pub object_id: Option<Image<u32>>,
    /// Unlit colour, linear RGB.
    pub albedo: Option<Image<Rgb>>,
    /// How little history may be trusted, 0 to 1.
    pub reactive: Option<Image<f32>>,
    /// The colour rendered without jitter, linear RGB.
    pub unjittered_color: Option<Image<Rgb>>,
    /// Ground truth at output size, linear RGB.
    pub reference: Option<Image<Rgb>>,
    /// Where each pixel has several samples or layers: those behind the first, whose colour, depth and motion stand above.
    pub others: Option<Others>,
}

/// The depth that stands for "nothing was hit".
pub const SKY_DEPTH: f32 = 1e10;

impl Frame {
    /// Render size.
    pub fn extent(&self) -> Extent {
        self.color.extent()
    }

    /// Render and output size.
    pub fn sizes(&self) -> Sizes {
        Sizes {
            render: self.extent(),
            output: self.output_size,
        }
    }

    /// The length of a vector beyond which it is a mistake, pixels.
    pub fn longest_motion_px(&self) -> f64 {
        4.0 * f64::from(self.extent().width.max(self.extent().height))
    }

    /// Takes the motion, for every output pixel and in output pixels: that of the input texel that contains its centre.
    pub fn take_output_motion_px(&mut self) -> Option<Image<[f32; 2]>> {
        let motion = match &self.others {
            Some(_) => self.merged_motion_px(),
            None => self.motion_px.take(),
        }?;
        let sizes = self.sizes();
        if sizes == Sizes::native(self.extent()) {
            return Some(motion);
        }
        let scale = sizes.scale().map(|scale| scale as f32);
        Some(Image::from_fn(self.output_size, |x, y| {
            let [x, y] = sizes.render_texel([x, y]);
            let [mx, my] = motion.at(x, y);
            [mx * scale[0], my * scale[1]]
        }))
    }

    /// The far plane's distance, 1000 where the engine has none.
    pub fn finite_far(&self) -> f64 {
        if self.far.is_finite() { self.far } else { 1000.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_what_its_images_take() {
        let sizes = Sizes {
            render: Extent::new(10, 10),
            output: Extent::new(20, 20),
        };
        assert_eq!(Channels::default().n_bytes(sizes), 1200, "colour");
        let channels = Channels {
            depth: true,
            motion: true,
            reference: true,
            ..Channels::default()
        };
        assert_eq!(channels.n_bytes(sizes), 1200 + 400 + 800 + 4800);
        let several = Some(Several {
            merging: crate::sequence::several::Merging::Samples,
            n_items: 3,
        });
        let layered = Channels { several, ..channels };
        assert_eq!(layered.n_bytes(sizes), 3 * 2400 + 3 * 400 + 4800);
    }

    #[test]
    fn output_pixels_lie_in_the_texel_under_their_centre() {
        let texels = |render, output| {
            let sizes = Sizes {
                render: Extent::new(render, 1),
                output: Extent::new(output, 1),
            };
            (0..output).map(|x| sizes.render_texel([x, 0])[0]).collect::<Vec<_>>()
        };
        assert_eq!(texels(3, 3), [0, 1, 2]);
        assert_eq!(texels(2, 4), [0, 0, 1, 1]);
        // The centre of pixel 1 lies at 1.5 / 1.5 = 1, on the border: the texel beyond it begins there.
        assert_eq!(texels(2, 3), [0, 1, 1]);
        // 18.5 / 3.7 = 5, which a rounded scale misses.
        assert_eq!(texels(10, 37)[17..20], [4, 5, 5]);
    }
}
