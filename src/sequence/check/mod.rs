//! The convention check: from pixels alone, whether what a manifest declares can be true.
//!
//! Each convention is judged by holding all its readings against the images: the one declared must explain them about as
//! well as the best. What is found wrong is believed mended from then on, so that one mistake does not hide the next.
//! Nothing is written.

mod belief;
mod color;
mod depth;
mod fit;
mod jitter;
mod missing;
mod motion;
mod observe;
mod plane;
mod report;
mod stored;
mod timeline;

pub use report::{Finding, Report, Severity, Suggestion, Undecided};

use super::{Sequence, SequenceError};
use belief::Belief;

/// Rises when the same pixels are judged otherwise.
pub const VERSION: u32 = 2;

/// Looks at some of the sequence's frames and reports what does not fit.
pub fn check(sequence: &Sequence) -> Result<Report, SequenceError> {
    let mut report = Report {
        sequence: sequence.name().to_owned(),
        ..Report::default()
    };
    let mut belief = Belief::new(sequence)?;
    color::examine(&mut belief, &mut report)?;
    jitter::examine(&mut belief, &mut report)?;
    timeline::reference_frame(&belief, &mut report)?;
    if report.findings.iter().any(|finding| finding.id == "reference.frame") {
        report.findings.retain(|finding| {
            !["jitter.", "grid."].iter().any(|of| finding.id.starts_with(of)) && finding.id != "reference.color"
        });
        report
            .confirmed
            .retain(|field| !field.starts_with("jitter") && field != "grid");
        report.cannot_tell("jitter", "colour and reference are of different frames");
        report.cannot_tell("motion", "colour and reference are of different frames");
        return Ok(report);
    }
    motion::examine(&mut belief, &mut report)?;
    depth::examine(&mut belief, &mut report)?;
    missing::examine(&mut belief, &mut report)?;
    timeline::cuts(&belief, &mut report)?;
    report.findings.sort_by_key(|finding| finding.severity);
    Ok(report)
}
