//! Frames that have several colours for each pixel: samples, or layers one behind the other. A pixel has one motion and one
//! depth all the same, those of one of them.

use super::{Frame, frame::Rgb};
use crate::image::Image;
use std::iter;

/// How the colours of a pixel become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merging {
    /// Samples: their mean.
    Samples,
    /// Layers, front to back: each over what lies behind it, black in the end.
    Layers {
        /// Colours are multiplied by their layer's opacity already.
        premultiplied: bool,
    },
}

/// How many colours a pixel has, and how they become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Several {
    /// Which way.
    pub merging: Merging,
    /// At least 2.
    pub n_items: u32,
}

/// What a frame has beside the images of its first sample, or of its nearest layer.
#[derive(Clone, Debug)]
pub struct Others {
    /// How they become one.
    pub merging: Merging,
    /// Colour of the others, in their order; linear RGB.
    pub color: Vec<Image<Rgb>>,
    /// Opacity of all layers, the nearest first: 0 to 1. None of samples.
    pub opacity: Vec<Image<f32>>,
    /// Motion of the others, as the frame's own; none where all share that.
    pub motion_px: Vec<Image<[f32; 2]>>,
    /// Depth of the others, as the frame's own; none where all share that.
    pub depth: Vec<Image<f32>>,
}

/// What is not within 0 to 1 is the nearest of both; NaN is 0.
pub fn repaired_opacity(opacity: f32) -> f64 {
    f64::from(if opacity.is_nan() { 0.0 } else { opacity.clamp(0.0, 1.0) })
}

impl Frame {
    /// How many colours its pixels have; none where it is one.
    pub fn several(&self) -> Option<Several> {
        self.others.as_ref().map(|others| Several {
            merging: others.merging,
            n_items: 1 + others.color.len() as u32,
        })
    }

    /// Which sample's or layer's motion and depth are those of the pixel (x, y): the sample that moves farthest, the layer that
    /// takes most of the light from behind it. The first of equals. Unusable vectors count as none.
    pub fn kept_item(&self, x: u32, y: u32) -> usize {
        let Some(others) = &self.others else { return 0 };
        let mut kept = (0, -1.0);
        let mut transmittance = 1.0;
        for item in 0..=others.color.len() {
            let score = match others.merging {
                Merging::Samples => self.length2_of(item, x, y),
                Merging::Layers { .. } => {
                    let opacity = repaired_opacity(others.opacity[item].at(x, y));
                    let change = transmittance * opacity;
                    transmittance *= 1.0 - opacity;
                    change
                }
            };
            if score > kept.1 {
                kept = (item, score);
            }
        }
        kept.0
    }

    /// Squared length of an item's motion; 0 where there is none that can be used.
    fn length2_of(&self, item: usize, x: u32, y: u32) -> f64 {
        let Some(motion) = self.motion_of(item) else { return 0.0 };
        let [mx, my] = motion.at(x, y).map(f64::from);
        let length2 = mx * mx + my * my;
        let longest = self.longest_motion_px();
        if length2 <= longest * longest { length2 } else { 0.0 }
    }

    /// Motion of a sample or layer, pixels.
    pub fn motion_of(&self, item: usize) -> Option<&Image<[f32; 2]>> {
        let others = self.others.as_ref().map_or(&[][..], |others| &others.motion_px);
        item.checked_sub(1)
            .and_then(|i| others.get(i))
            .or(self.motion_px.as_ref())
    }

    /// Depth of a sample or layer.
    pub fn depth_of(&self, item: usize) -> Option<&Image<f32>> {
        let others = self.others.as_ref().map_or(&[][..], |others| &others.depth);
        item.checked_sub(1).and_then(|i| others.get(i)).or(self.depth.as_ref())
    }

    /// How much each sample or layer of the pixel (x, y) counts in its colour; one weight of 1 where it has one colour.
    pub(super) fn weights(&self, x: u32, y: u32) -> Vec<f64> {
        let Some(others) = &self.others else { return vec![1.0] };
        let n_items = 1 + others.color.len();
        let Merging::Layers { premultiplied } = others.merging else {
            return vec![1.0 / n_items as f64; n_items];
        };
        let mut transmittance = 1.0;
        let opacities = others.opacity.iter().map(|image| repaired_opacity(image.at(x, y)));
        opacities
            .map(|opacity| {
                let weight = transmittance * if premultiplied { 1.0 } else { opacity };
                transmittance *= 1.0 - opacity;
                weight
            })
            .collect()
    }

    /// The colour of every pixel, of its samples or layers, as they are: nothing is repaired.
    pub(super) fn merged_color(&self) -> Image<Rgb> {
        let Some(others) = &self.others else {
            return self.color.clone();
        };
        Image::from_fn(self.extent(), |x, y| {
            let items = iter::once(&self.color).chain(&others.color);
            let mut sum = [0.0; 3];
            for (weight, image) in self.weights(x, y).into_iter().zip(items) {
                let color = image.at(x, y);
                (0..3).for_each(|i| sum[i] += weight * f64::from(color[i]));
            }
            sum.map(|channel| channel as f32)
        })
    }

    /// The motion of every pixel, that of its sample or layer kept.
    pub fn merged_motion_px(&self) -> Option<Image<[f32; 2]>> {
        let own = self.motion_px.as_ref()?;
        let motion = |x, y| self.motion_of(self.kept_item(x, y)).unwrap_or(own).at(x, y);
        Some(Image::from_fn(own.extent(), motion))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{image::Extent, metrics::Display};

    const EXTENT: Extent = Extent::new(1, 1);

    fn frame(motions: &[[f32; 2]], opacity: &[f32]) -> Frame {
        let scalar = |value: f32| Image::filled(EXTENT, value);
        Frame {
            index: 0,
            reset: true,
            jitter_px: [0.0; 2],
            far: 100.0,
            output_size: EXTENT,
            parity: None,
            display: Display::default(),
            color: Image::filled(EXTENT, [0.5; 3]),
            depth: None,
            motion_px: Some(Image::filled(EXTENT, motions[0])),
            object_id: None,
            albedo: None,
            reactive: None,
            unjittered_color: None,
            reference: None,
            others: Some(Others {
                merging: match opacity {
                    [] => Merging::Samples,
                    _ => Merging::Layers { premultiplied: false },
                },
                color: vec![Image::filled(EXTENT, [0.5; 3]); motions.len() - 1],
                opacity: opacity.iter().map(|&value| scalar(value)).collect(),
                motion_px: motions[1..].iter().map(|&m| Image::filled(EXTENT, m)).collect(),
                depth: Vec::new(),
            }),
        }
    }

    #[test]
    fn the_longest_motion_among_samples_is_kept() {
        let kept = |motions: &[[f32; 2]]| frame(motions, &[]).merged_motion_px().unwrap().at(0, 0);
        assert_eq!(kept(&[[1.0, 0.0], [0.0, -2.0], [0.5, 0.5]]), [0.0, -2.0]);
        assert_eq!(kept(&[[1.0, 0.0], [0.0, 1.0]]), [1.0, 0.0], "the first of equals");
        // Longer than four images, or no number.
        assert_eq!(
            kept(&[[0.0, 0.0], [9.0, 0.0], [f32::NAN, 0.0], [0.25, 0.0]]),
            [0.25, 0.0]
        );
    }

    #[test]
    fn colours_merge_by_their_weights() {
        let mut merged = frame(&[[0.0; 2]; 3], &[0.25, 0.5, 1.0]);
        assert_eq!(merged.weights(0, 0), [0.25, 0.375, 0.375]);
        merged.color = Image::filled(EXTENT, [1.0, 0.0, 2.0]);
        assert_eq!(merged.merged_color().at(0, 0), [0.625, 0.375, 0.875]);
        assert_eq!(frame(&[[0.0; 2]; 4], &[]).weights(0, 0), [0.25; 4]);
    }

    /// Layers take 0.25, 0.75 · 0.6 = 0.45 and 0.75 · 0.4 = 0.3 of the light.
    #[test]
    fn the_layer_that_takes_most_light_is_kept() {
        let motions = [[9.0, 0.0], [1.0, 0.0], [2.0, 0.0]];
        let kept = |opacity: &[f32]| frame(&motions, opacity).kept_item(0, 0);
        assert_eq!(kept(&[0.25, 0.6, 1.0]), 1);
        assert_eq!(kept(&[0.25, 0.25, 1.0]), 2);
        assert_eq!(kept(&[0.5, 1.0, 1.0]), 0, "the first of equals");
        assert_eq!(kept(&[f32::NAN, -3.0, f32::INFINITY]), 2);
    }
}
