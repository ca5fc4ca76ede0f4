//! What the check believes so far: the sequence as declared, with each convention that was found wrong mended, so that one
//! mistake does not hide the next.

use super::{
    observe::{Guide, StoredMotion, motion_decoder},
    plane::Tone,
    stored,
};
use crate::sequence::{Channels, Manifest, Sequence, SequenceError};

pub struct Belief {
    /// The same files, read by the conventions believed.
    pub sequence: Sequence,
    /// What jitter and motion are compared with.
    pub guide: Guide,
    /// How colours are compared.
    pub tone: Tone,
    /// Frames after which, in the files, a frame's vectors come: no field of a manifest says so.
    pub motion_lag: isize,
}

impl Belief {
    pub fn new(declared: &Sequence) -> Result<Self, SequenceError> {
        let sequence = declared.redeclared(|_| ());
        let guide = Guide::of(sequence.manifest());
        let tone = Self::tone(&sequence)?;
        Ok(Self {
            sequence,
            guide,
            tone,
            motion_lag: 0,
        })
    }

    fn tone(sequence: &Sequence) -> Result<Tone, SequenceError> {
        let frame = sequence.load(sequence.n_frames() / 2, Channels::default())?;
        Ok(Tone::of(&frame.merged_color()))
    }

    pub fn manifest(&self) -> &Manifest {
        self.sequence.manifest()
    }

    /// The motion of every pixel of a frame, in pixels: not a number where vectors of another file have none. Nothing where that file is
    /// missing, at the ends.
    pub fn motion_px(&self, index: usize) -> Result<Option<Vec<[f64; 2]>>, SequenceError> {
        if self.motion_lag == 0 {
            return stored::motion_px(&self.sequence, index);
        }
        let file = index.checked_add_signed(self.motion_lag);
        let file = file.filter(|file| *file < self.sequence.n_frames());
        let (Some(file), Some(source)) = (file, &self.manifest().motion) else {
            return Ok(None);
        };
        let decoder = motion_decoder(&self.sequence, source, index);
        let vectors = StoredMotion::load(&self.sequence, file)?;
        Ok(vectors.map(|vectors| {
            let stored = vectors.x.iter().zip(&vectors.y);
            let decode = |(&x, &y)| {
                decoder
                    .decode([x, y])
                    .map_or([f64::NAN; 2], |motion| motion.map(f64::from))
            };
            stored.map(decode).collect()
        }))
    }

    /// Believes something else from now on.
    pub fn change(&mut self, change: impl FnOnce(&mut Manifest)) {
        self.sequence = self.sequence.redeclared(change);
    }

    /// The same, and colours mean something else.
    pub fn change_color(&mut self, change: impl FnOnce(&mut Manifest)) -> Result<(), SequenceError> {
        self.change(change);
        self.tone = Self::tone(&self.sequence)?;
        Ok(())
    }
}
