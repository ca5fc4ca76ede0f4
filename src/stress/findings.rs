//! What is found of a cell, and the verdict that it comes to.

use super::{
    difference::Difference,
    growth::Growth,
    report::{Bound, ErrorAt, Verdict},
};
use crate::metrics::Value;

/// How much of what makes a verdict is said.
const MAX_REASONS: usize = 3;

/// Gathered while a cell runs.
#[derive(Debug, Default)]
pub struct Findings {
    found: Vec<(Verdict, Option<usize>, String)>,
    remarks: Vec<String>,
    /// Display units, of all frames.
    pub max: f64,
    pub max_ulps: f64,
    max_frame: Option<usize>,
    /// Of each frame looked at.
    pub errors: Vec<ErrorAt>,
    pub recovered_after: Option<usize>,
    pub growth: Option<Growth>,
    pub bound: Option<Bound>,
    pub n_frames: usize,
    pub digest: String,
}

impl Findings {
    /// Something that is not as it should be.
    pub fn add(&mut self, verdict: Verdict, frame: Option<usize>, message: String) {
        // The same again says nothing new.
        if !self.found.iter().any(|(_, _, known)| *known == message) {
            self.found.push((verdict, frame, message));
        }
    }

    /// Something worth to know.
    pub fn remark(&mut self, message: String) {
        self.remarks.push(message);
    }

    /// Notes the error of a frame; whether it is the largest yet.
    pub fn note_error(&mut self, frame: usize, of_frame: &Difference) -> bool {
        self.errors.push(ErrorAt {
            frame,
            error: Value(of_frame.max),
            error_ulps: Value(of_frame.max_ulps),
        });
        self.max_ulps = self.max_ulps.max(of_frame.max_ulps);
        let is_largest = self.max_frame.is_none() || of_frame.max > self.max;
        if is_largest {
            self.max = of_frame.max;
            self.max_frame = Some(frame);
        }
        is_largest
    }

    /// The worst that was found.
    pub fn verdict(&self) -> Verdict {
        let verdicts = self.found.iter().map(|(verdict, ..)| *verdict);
        verdicts.max().unwrap_or(Verdict::Pass)
    }

    /// What was found that makes the verdict, then what else is worth to know.
    pub fn reason(&self) -> String {
        let verdict = self.verdict();
        let found: Vec<_> = self.found.iter().filter(|(of, ..)| *of == verdict).collect();
        let n_more = found.len().saturating_sub(MAX_REASONS);
        let more = (n_more > 0).then(|| format!("and {n_more} more"));
        let words = found
            .into_iter()
            .take(MAX_REASONS)
            .map(|(_, frame, message)| match frame {
                Some(frame) => format!("frame {frame} {message}"),
                None => message.clone(),
            });
        words
            .chain(more)
            .chain(self.remarks.iter().cloned())
            .collect::<Vec<_>>()
            .join("; ")
    }

    /// Where it failed, else where the error was largest.
    pub fn frame(&self) -> Option<usize> {
        let failed = self.found.iter().filter(|(verdict, ..)| *verdict == Verdict::Fails);
        failed.filter_map(|(_, frame, _)| *frame).min().or(self.max_frame)
    }
}
