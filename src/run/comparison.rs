//! Images that another system made of a stored sequence, held against its references. The same metrics as a run's, on the
//! CPU; no adapter takes part.

use super::{
    Observer, RunError,
    report::{AdapterInfo, FrameReport, PresetReport, Report, SequenceInfo, note_of_broken},
    scoring::{offset_note, summaries},
    times::{milliseconds_since, timed},
};
use crate::{
    metrics::{Metric, Picture, Reference, Track},
    sequence::{Channels, Output, Sequence},
    taa::reference::{color::Color, display::linear},
};
use std::{collections::BTreeMap, path::PathBuf, sync::Arc, time::Instant};

/// What to compare.
#[derive(Debug)]
pub struct Comparison {
    /// The system's name.
    pub system: String,
    /// Its settings.
    pub parameters: serde_json::Value,
    /// What rendered the images.
    pub adapter: AdapterInfo,
    /// Each frame's image, from the first frame on.
    pub images: Vec<PathBuf>,
    /// What to measure.
    pub metrics: Vec<Metric>,
}

/// Compares every image with its frame's reference.
pub fn compare_outputs(
    comparison: &Comparison,
    sequence: &Sequence,
    observer: &dyn Observer,
) -> Result<Report, RunError> {
    let start = Instant::now();
    super::validate_comparison(&comparison.metrics, sequence)?;
    let n_frames = comparison.images.len().min(sequence.n_frames());
    let mut scorer = Scorer::new(comparison, sequence);
    for index in 0..n_frames {
        if observer.cancelled() {
            return Err(RunError::Cancelled);
        }
        scorer.frame(index, index + 1 == n_frames, observer)?;
        observer.progress(index + 1, n_frames);
    }
    let (frames, notes) = scorer.finish();
    let versions = comparison
        .metrics
        .iter()
        .map(|metric| (metric.id().to_owned(), metric.info().version));
    Ok(Report {
        sequence: SequenceInfo {
            name: sequence.name().to_owned(),
            hash: sequence.hash()?,
            render_size: sequence.render_size(),
            output_size: sequence.output_size(),
            n_frames,
        },
        adapter: comparison.adapter.clone(),
        revision: env!("AFTERIMAGE_REVISION").to_owned(),
        metric_versions: versions.collect(),
        stages_ms: BTreeMap::from([("total".to_owned(), milliseconds_since(start))]),
        reports: vec![PresetReport {
            preset: comparison.system.clone(),
            parameters: comparison.parameters.clone(),
            notes,
            summary: summaries(&comparison.metrics, &frames),
            times_ms: BTreeMap::new(),
            validation: None,
            skipped: None,
            frames,
        }],
    })
}

struct Scorer<'a> {
    comparison: &'a Comparison,
    sequence: &'a Sequence,
    channels: Channels,
    track: Track,
    /// Of the previous frame.
    reference: Option<Reference>,
    /// Frames since the last reset.
    age: usize,
    frames: Vec<FrameReport>,
    offset: Option<String>,
    /// Some image was not linear.
    has_codes: bool,
}

impl<'a> Scorer<'a> {
    fn new(comparison: &'a Comparison, sequence: &'a Sequence) -> Self {
        Self {
            comparison,
            sequence,
            channels: Channels {
                reference: true,
                motion: comparison.metrics.iter().any(|metric| metric.needs_motion()),
                ..Channels::default()
            },
            track: Track::new(&comparison.metrics),
            reference: None,
            age: 0,
            frames: Vec::new(),
            offset: None,
            has_codes: false,
        }
    }

    fn frame(&mut self, index: usize, is_last: bool, observer: &dyn Observer) -> Result<(), RunError> {
        let mut frame = self.sequence.load(index, self.channels)?;
        let missing = || RunError::Input(format!("frame {index} has no reference"));
        let truth = frame.reference.take().ok_or_else(missing)?;
        let display = self.sequence.display();
        let output = Arc::new(
            match self.sequence.load_output(index, &self.comparison.images[index])? {
                Output::Linear(image) => image,
                Output::Shown(image) => {
                    self.has_codes = true;
                    image.map(|pixel| linear(Color(pixel), &display).0)
                }
            },
        );
        if observer.wants_output() {
            let kept = observer.output(0, index, &output);
            kept.map_err(|error| RunError::Internal(error.to_string()))?;
        }
        self.age = if frame.reset { 0 } else { self.age + 1 };
        let (truth, shown) = (Picture::linear(truth, display), Picture::linear(output, display));
        let motion_px = frame.take_output_motion_px().map(Arc::new);
        let reference = match &self.reference {
            Some(previous) if self.age > 0 => previous.follow(truth.clone(), motion_px.as_ref()),
            Some(previous) => previous.restart(truth.clone()),
            None => Reference::new(truth.clone(), &self.comparison.metrics),
        };
        let warmup = self.age < self.sequence.warmup_frames();
        let (scores, metrics_ms) = timed(|| self.track.score(&reference, &shown, !warmup));
        let scores = scores.map_err(|error| RunError::Input(error.to_string()))?;
        if is_last {
            self.offset = offset_note(&truth, &shown);
        }
        self.reference = Some(reference);
        let values = scores.values.into_iter().map(|(id, value)| (id.to_owned(), value));
        self.frames.push(FrameReport {
            reset: frame.reset,
            warmup,
            non_finite_pixels: scores.non_finite_pixels,
            metrics: values.collect(),
            times_ms: BTreeMap::from([("metrics".to_owned(), metrics_ms)]),
            ..FrameReport::empty(index)
        });
        Ok(())
    }

    fn finish(self) -> (Vec<FrameReport>, Vec<String>) {
        let mut frames = self.frames;
        for late in self.track.finish() {
            frames[late.frame].metrics.insert(late.id.to_owned(), late.value);
        }
        let codes = "8- or 16-bit images beside a linear reference were taken for what a display is sent: sRGB, tone mapping and exposure were undone";
        let codes = self.has_codes.then(|| codes.to_owned());
        let notes = self
            .offset
            .into_iter()
            .chain(note_of_broken(&frames))
            .chain(codes)
            .collect();
        (frames, notes)
    }
}
