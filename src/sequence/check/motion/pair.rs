//! Two frames in a row, and where the motion says that the second was in the first.

use super::readings::Reading;
use crate::sequence::{
    SequenceError,
    check::{
        Belief,
        fit::{self, Apart, Errors},
        jitter::Measured,
        observe::{self, Grid, N_TILES, StoredMotion, View, motion_decoder},
        plane::Plane,
    },
    convention::MotionDecoder,
};

/// Samples of a pair. Every reading looks each of them up.
const MAX_SAMPLES: usize = 40_000;

/// Vectors whose difference is at most this share of the longer are of one surface.
const ALIKE: f32 = 0.25;

/// One pair of frames, ready to be compared under any reading.
pub struct Pair<'a> {
    belief: &'a Belief,
    index: usize,
    current: View,
    previous: View,
    /// Of the frame before, the frame, and the frame after.
    stored: [Option<StoredMotion>; 3],
}

impl<'a> Pair<'a> {
    pub fn load(belief: &'a Belief, index: usize) -> Result<Self, SequenceError> {
        let view = |index| {
            let view = View::load(&belief.sequence, index, belief.guide, belief.tone)?;
            Ok::<_, SequenceError>(view.smoothed())
        };
        Ok(Self {
            belief,
            index,
            current: view(index)?,
            previous: view(index - 1)?,
            stored: [None, StoredMotion::load(&belief.sequence, index)?, None],
        })
    }

    /// With the vectors of the frames before and after, for readings that are a frame off.
    pub fn with_neighbours(belief: &'a Belief, index: usize) -> Result<Self, SequenceError> {
        let mut pair = Self::load(belief, index)?;
        pair.stored[0] = StoredMotion::load(&belief.sequence, index - 1)?;
        if index + 1 < belief.sequence.n_frames() {
            pair.stored[2] = StoredMotion::load(&belief.sequence, index + 1)?;
        }
        Ok(pair)
    }

    /// What the frame shows at a pixel's sample.
    pub fn shown(&self, [x, y]: [usize; 2]) -> f64 {
        match &self.current.guide {
            None => self.current.input.at(x, y),
            Some(guide) => {
                let [jx, jy] = self.belief.sequence.jitter_px[self.index];
                let [sx, sy] = self.current.scale;
                guide.value([(x as f64 + 0.5 + jx) * sx, (y as f64 + 0.5 + jy) * sy])
            }
        }
    }

    /// Where that was in the frame before, in pixels of the image that is compared.
    pub fn place(&self, [x, y]: [usize; 2], motion: [f64; 2]) -> [f64; 2] {
        let jitter = |index: usize| self.belief.sequence.jitter_px[index];
        let ([jx, jy], [px, py]) = (jitter(self.index), jitter(self.index - 1));
        let at = [x as f64 + 0.5 + jx + motion[0], y as f64 + 0.5 + jy + motion[1]];
        match &self.previous.guide {
            None => [at[0] - px, at[1] - py],
            Some(_) => [at[0] * self.previous.scale[0], at[1] * self.previous.scale[1]],
        }
    }

    /// The image of the frame before that is compared.
    pub fn before(&self) -> &Plane {
        self.previous.guide.as_ref().unwrap_or(&self.previous.input)
    }

    pub fn grid(&self, max_samples: usize) -> Grid {
        Grid::limited(&self.belief.sequence, self.index, max_samples)
    }

    /// The frame's motion as believed, in pixels.
    pub fn motion(&self) -> Result<Option<Vec<[f64; 2]>>, SequenceError> {
        self.belief.motion_px(self.index)
    }

    /// Whether a pixel's motion comes from depth and the cameras.
    pub fn is_derived(&self, i: usize) -> bool {
        let source = self.belief.manifest().motion.as_ref();
        let decoder = source.map(|source| motion_decoder(&self.belief.sequence, source, self.index));
        let stored = self.stored[1].as_ref();
        decoder
            .zip(stored)
            .is_some_and(|(decoder, stored)| decoder.decode([stored.x[i], stored.y[i]]).is_none())
    }

    /// Whether nothing is stored for a pixel.
    pub fn is_zero(&self, i: usize) -> bool {
        self.stored[1]
            .as_ref()
            .is_some_and(|stored| stored.x[i] == 0.0 && stored.y[i] == 0.0)
    }

    /// Errors of every reading by tile, then of no motion at all.
    pub fn errors(&self, readings: &[Reading]) -> Errors {
        let grid = self.grid(MAX_SAMPLES);
        let n = readings.len() + 1;
        let mut tiles = vec![(vec![0.0; n], vec![Apart::default(); n], 0); N_TILES];
        let decoders: Vec<(MotionDecoder, &Reading)> = readings
            .iter()
            .map(|reading| {
                (
                    motion_decoder(&self.belief.sequence, &reading.source, self.index),
                    reading,
                )
            })
            .collect();
        for pixel in self.of_one_motion(grid, &decoders[0].0) {
            let shown = self.shown(pixel);
            let i = pixel[1] * grid.width + pixel[0];
            let own = self.vector(&decoders[0].0, decoders[0].1, i);
            if !shown.is_finite() || own.is_none_or(|own| own.iter().any(|axis| axis.is_nan())) {
                continue;
            }
            let (sums, aparts, n_samples) = &mut tiles[grid.tile_of(pixel)];
            let predicted = |motion: [f64; 2]| self.before().value(self.place(pixel, motion));
            let by_declared = predicted(own.unwrap_or_default());
            let mut add = |i: usize, motion: [f64; 2]| {
                let other = predicted(motion);
                let (error, apart) = ((shown - other).abs(), (other - by_declared).abs());
                sums[i] += if error.is_nan() { 0.5 } else { error };
                aparts[i].add(if apart.is_nan() { 0.5 } else { apart });
            };
            for (index, (decoder, reading)) in decoders.iter().enumerate() {
                // Where another frame's vector is none, this frame's tells nothing of it.
                add(index, self.vector(decoder, reading, i).or(own).unwrap_or_default());
            }
            add(n - 1, [0.0; 2]);
            *n_samples += 1;
        }
        let mut errors = Errors::default();
        tiles
            .into_iter()
            .filter(|(.., n)| *n > 0)
            .for_each(|(sums, aparts, n)| errors.push_apart(sums, &aparts, n));
        errors
    }

    /// Pixels whose neighbours move alike. Where bars stand before a bright sky, an image that is averaged shows what the bars
    /// do, and half of the vectors are the sky's. All pixels where hardly any are such.
    fn of_one_motion(&self, grid: Grid, decoder: &MotionDecoder) -> Vec<[usize; 2]> {
        let pixels = grid.pixels();
        let Some(stored) = &self.stored[1] else { return pixels };
        let vector = |x: usize, y: usize| {
            let i = y * grid.width + x;
            decoder.decode([stored.x[i], stored.y[i]])
        };
        let moves_alike = |&[x, y]: &[usize; 2]| {
            let Some([own_x, own_y]) = vector(x, y) else {
                return true;
            };
            (y.saturating_sub(1)..(y + 2).min(grid.height)).all(|row| {
                (x.saturating_sub(1)..(x + 2).min(grid.width)).all(|column| {
                    vector(column, row).is_none_or(|[other_x, other_y]| {
                        let gap = (own_x - other_x).hypot(own_y - other_y);
                        // NaN, which a checkerboard leaves out, is no neighbour.
                        gap.is_nan() || gap <= ALIKE * own_x.hypot(own_y).max(other_x.hypot(other_y))
                    })
                })
            })
        };
        let alike: Vec<[usize; 2]> = pixels.iter().copied().filter(moves_alike).collect();
        if alike.len() * 20 < pixels.len() { pixels } else { alike }
    }

    fn vector(&self, decoder: &MotionDecoder, reading: &Reading, i: usize) -> Option<[f64; 2]> {
        let stored = self.stored[reading.lag.saturating_add(1) as usize].as_ref()?;
        let [x, y] = if reading.swapped {
            [stored.y[i], stored.x[i]]
        } else {
            [stored.x[i], stored.y[i]]
        };
        decoder.decode([x, y]).map(|motion| motion.map(f64::from))
    }

    /// By how much the frame before must be shifted once more, over all pixels.
    pub fn left_over(&self) -> Option<Measured> {
        let grid = self.grid(observe::MAX_SAMPLES);
        let pixels = grid.pixels();
        let source = self.belief.manifest().motion.as_ref()?;
        let decoder = motion_decoder(&self.belief.sequence, source, self.index);
        let stored = self.stored[1].as_ref()?;
        let (scale, before) = (self.previous.scale, self.before());
        let samples: Vec<(f64, [f64; 2])> = pixels
            .iter()
            .map(|&pixel| {
                let i = pixel[1] * grid.width + pixel[0];
                let motion = decoder
                    .decode([stored.x[i], stored.y[i]])
                    .map_or([f64::NAN; 2], |m| m.map(f64::from));
                (self.shown(pixel), self.place(pixel, motion))
            })
            .collect();
        let residual = |i: usize, d: [f64; 2]| {
            let (shown, [x, y]) = samples[i];
            let (value, slope) = before.spline([x + d[0] * scale[0], y + d[1] * scale[1]])?;
            let error = shown - value;
            // Disoccluded pixels show something else altogether.
            (error.abs() < 0.25).then_some((error, [slope[0] * scale[0], slope[1] * scale[1]]))
        };
        let shift = fit::shift(pixels.len(), N_TILES, |i| grid.tile_of(pixels[i]), residual, [0.0; 2])?;
        Some(Measured {
            index: self.index,
            shift,
        })
    }
}
