//! What the check reads of a frame, and which frames it reads.

use super::{
    plane::{Plane, Tone},
    stored,
};
use crate::{
    image::Image,
    sequence::{
        Channels, Section, Sequence, SequenceError,
        convention::MotionDecoder,
        frame::Rgb,
        manifest::{Manifest, MotionSource},
    },
};

/// Samples of a frame that are compared: more make the check slower and no surer.
pub const MAX_SAMPLES: usize = 120_000;
/// Tiles of a frame, along each axis. Errors within a tile are taken for dependent.
pub const TILES: [usize; 2] = [8, 6];
pub const N_TILES: usize = TILES[0] * TILES[1];

/// Positions of a frame that are looked at: every pixel, or every few along both axes.
#[derive(Clone, Copy)]
pub struct Grid {
    pub width: usize,
    pub height: usize,
    stride: usize,
    /// Where only every other pixel counts: the parity of those that do.
    parity: Option<usize>,
}

impl Grid {
    pub fn new(sequence: &Sequence, index: usize) -> Self {
        Self::limited(sequence, index, MAX_SAMPLES)
    }

    pub fn limited(sequence: &Sequence, index: usize, max_samples: usize) -> Self {
        let size = sequence.render_size();
        let mut stride = 1;
        while size.n_pixels() / (stride * stride) > max_samples {
            stride += 1;
        }
        let checkerboard = sequence.manifest().checkerboard.as_ref();
        Self {
            width: size.width as usize,
            height: size.height as usize,
            stride,
            parity: checkerboard.map(|mask| mask.parity_of(index) as usize),
        }
    }

    /// Pixels that are looked at.
    pub fn pixels(self) -> Vec<[usize; 2]> {
        let (columns, rows) = (self.width.div_ceil(self.stride), self.height.div_ceil(self.stride));
        let mut pixels = Vec::with_capacity(columns * rows);
        for y in (0..self.height).step_by(self.stride) {
            for x in (0..self.width).step_by(self.stride) {
                // Every second of an even stride would be of one parity only.
                let x = if self.stride.is_multiple_of(2) {
                    (x + y / self.stride % 2).min(self.width - 1)
                } else {
                    x
                };
                if self.parity.is_none_or(|parity| (x + y) % 2 == parity) {
                    pixels.push([x, y]);
                }
            }
        }
        pixels
    }

    pub fn tile_of(self, [x, y]: [usize; 2]) -> usize {
        y * TILES[1] / self.height * TILES[0] + x * TILES[0] / self.width
    }
}

/// What motion and jitter are compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guide {
    /// The reference, at output size.
    Reference,
    /// Colour without jitter, at render size.
    Unjittered,
    /// Only the jittered colour itself.
    Color,
}

impl Guide {
    pub fn of(manifest: &Manifest) -> Self {
        match (&manifest.reference, &manifest.unjittered_color) {
            (Some(_), _) => Self::Reference,
            (None, Some(_)) => Self::Unjittered,
            (None, None) => Self::Color,
        }
    }

    pub fn channels(self) -> Channels {
        Channels {
            reference: self == Self::Reference,
            unjittered_color: self == Self::Unjittered,
            ..Channels::default()
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Unjittered => "un-jittered colour",
            Self::Color => "colour",
        }
    }
}

/// A frame as the check compares it.
pub struct View {
    /// The engine's jittered colour.
    pub input: Plane,
    /// What the guide shows.
    pub guide: Option<Plane>,
    /// Guide pixels for an input pixel, along x and y.
    pub scale: [f64; 2],
}

impl View {
    pub fn load(sequence: &Sequence, index: usize, guide: Guide, tone: Tone) -> Result<Self, SequenceError> {
        let mut frame = sequence.load(index, guide.channels())?;
        let shown: Option<Image<Rgb>> = match guide {
            Guide::Reference => frame.reference.take(),
            Guide::Unjittered => frame.unjittered_color.take(),
            Guide::Color => None,
        };
        Ok(Self {
            scale: match guide {
                Guide::Reference => frame.sizes().scale(),
                _ => [1.0; 2],
            },
            input: Plane::new(&frame.merged_color(), tone),
            guide: shown.map(|image| Plane::new(&image, tone)),
        })
    }
}

impl View {
    /// The image that is followed from frame to frame, smoothed: between pixels it can then be read alike at every position.
    pub fn smoothed(mut self) -> Self {
        match &mut self.guide {
            Some(guide) => *guide = guide.smoothed(),
            None => self.input = self.input.smoothed(),
        }
        self
    }
}

/// Stored vectors of one frame, and what turns them into pixels.
pub struct StoredMotion {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
}

impl StoredMotion {
    pub fn load(sequence: &Sequence, index: usize) -> Result<Option<Self>, SequenceError> {
        Ok(stored::planes(sequence, index, Section::Motion)?.map(|planes| {
            let mut planes = planes.into_iter();
            let (x, y) = (planes.next().unwrap_or_default(), planes.next().unwrap_or_default());
            Self { x, y }
        }))
    }
}

/// A decoder of `source` for the frame at `index`.
pub fn motion_decoder(sequence: &Sequence, source: &MotionSource, index: usize) -> MotionDecoder {
    let jitter = |index: usize| sequence.jitter_px[index];
    MotionDecoder::new(
        source,
        sequence.render_size(),
        sequence.output_size(),
        jitter(index),
        jitter(index.saturating_sub(1)),
    )
}

/// At most `max` of `0..n`, spread evenly and with both ends.
pub fn spread(n: usize, max: usize) -> Vec<usize> {
    if n <= max {
        return (0..n).collect();
    }
    (0..max).map(|i| i * (n - 1) / (max - 1).max(1)).collect()
}

/// At most `max` frames that have a predecessor of the same shot.
pub fn pairs(sequence: &Sequence, max: usize) -> Vec<usize> {
    let frames = &sequence.manifest().frames;
    let all: Vec<usize> = (1..frames.len()).filter(|&index| !frames[index].reset).collect();
    spread(all.len(), max).into_iter().map(|i| all[i]).collect()
}
