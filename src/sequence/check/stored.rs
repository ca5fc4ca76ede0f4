//! What files hold before any convention is applied, one value a pixel, or for each sample or layer of it.

use crate::{
    image::Image,
    sequence::{Channels, Frame, Merging, Section, Sequence, SequenceError, frame::Rgb, loader::FrameFiles},
};
use std::borrow::Cow;

/// A frame's colour as it is stored.
pub struct StoredColor<'a> {
    /// Of each sample or layer.
    items: Vec<Vec<Cow<'a, [f32]>>>,
    opacity: Vec<Image<f32>>,
    /// How much each counts, pixel by pixel; none where there is one.
    weights: Option<Vec<Vec<f64>>>,
}

impl<'a> StoredColor<'a> {
    pub fn new(files: &'a FrameFiles, sequence: &Sequence) -> Self {
        let several = sequence.manifest().several();
        let n_items = several.map_or(1, |several| several.n_items as usize);
        let frame = several.map(|_| files.convert(Channels::default()));
        let size = sequence.render_size();
        Self {
            items: (0..n_items)
                .filter_map(|item| files.stored(Section::Color, item))
                .collect(),
            weights: frame.as_ref().map(|frame| {
                let rows = (0..size.height).flat_map(|y| (0..size.width).map(move |x| [x, y]));
                rows.map(|[x, y]| frame.weights(x, y)).collect()
            }),
            opacity: frame
                .and_then(|frame| frame.others)
                .map_or_else(Vec::new, |others| others.opacity),
        }
    }

    /// Everything that differs where the colour does.
    pub fn planes(&self) -> Vec<&[f32]> {
        let colors = self.items.iter().flatten().map(|plane| &**plane);
        colors.chain(self.opacity.iter().map(Image::pixels)).collect()
    }

    /// The stored colours of the pixel at `i`, and how much each counts.
    pub fn at(&self, i: usize) -> Vec<(Rgb, f64)> {
        let colors = self.items.iter().enumerate();
        colors
            .map(|(item, planes)| {
                let weight = self.weights.as_ref().map_or(1.0, |weights| weights[i][item]);
                ([planes[0][i], planes[1][i], planes[2][i]], weight)
            })
            .collect()
    }
}

/// Whose vector and depth are held against the images: those of the layer that takes most of the light; of samples the first,
/// because all have the same conventions.
pub fn speaker(frame: &Frame, x: u32, y: u32) -> usize {
    match frame.several() {
        Some(several) if several.merging != Merging::Samples => frame.kept_item(x, y),
        _ => 0,
    }
}

/// A section's stored channels, at each pixel those of its [`speaker`].
pub fn planes(sequence: &Sequence, index: usize, section: Section) -> Result<Option<Vec<Vec<f32>>>, SequenceError> {
    let channels = Channels {
        depth: section == Section::Depth,
        motion: section == Section::Motion,
        ..Channels::default()
    };
    let files = sequence.frame_files(index, channels)?;
    let Some(first) = files.stored(section, 0) else {
        return Ok(None);
    };
    let mut planes: Vec<Vec<f32>> = first.into_iter().map(Cow::into_owned).collect();
    let Some(several) = sequence.manifest().several() else {
        return Ok(Some(planes));
    };
    let frame = files.convert(Channels::default());
    let width = frame.extent().width as usize;
    for item in 1..several.n_items as usize {
        let Some(behind) = files.stored(section, item) else {
            continue;
        };
        for i in 0..planes[0].len() {
            if speaker(&frame, (i % width) as u32, (i / width) as u32) == item {
                planes
                    .iter_mut()
                    .zip(&behind)
                    .for_each(|(plane, behind)| plane[i] = behind[i]);
            }
        }
    }
    Ok(Some(planes))
}

/// The motion of every pixel, that of its [`speaker`], along x and y in pixels.
pub fn motion_px(sequence: &Sequence, index: usize) -> Result<Option<Vec<[f64; 2]>>, SequenceError> {
    let channels = Channels {
        motion: true,
        ..Channels::default()
    };
    let frame = sequence.load(index, channels)?;
    let motion = frame.motion_px.as_ref().map(|own| {
        Image::from_fn(own.extent(), |x, y| {
            let motion = frame.motion_of(speaker(&frame, x, y)).unwrap_or(own);
            motion.at(x, y).map(f64::from)
        })
    });
    Ok(motion.map(Image::into_pixels))
}
