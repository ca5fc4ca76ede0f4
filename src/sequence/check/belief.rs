//! What the check believes so far: the sequence as declared, with each convention that was found wrong mended, so that one
//! mistake does not hide the next.

use super::{observe::Guide, plane::Tone};
use crate::sequence::{Channels, Manifest, Sequence, SequenceError};

pub struct Belief {
    /// The same files, read by the conventions believed.
    pub sequence: Sequence,
    /// What jitter and motion are compared with.
    pub guide: Guide,
    /// How colours are compared.
    pub tone: Tone,
}

impl Belief {
    pub fn new(declared: &Sequence) -> Result<Self, SequenceError> {
        let sequence = declared.redeclared(|_| ());
        let guide = Guide::of(sequence.manifest());
        let tone = Self::tone(&sequence)?;
        Ok(Self { sequence, guide, tone })
    }

    fn tone(sequence: &Sequence) -> Result<Tone, SequenceError> {
        let frame = sequence.load(sequence.n_frames() / 2, Channels::default())?;
        Ok(Tone::of(&frame.merged_color()))
    }

    pub fn manifest(&self) -> &Manifest {
        self.sequence.manifest()
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
