//! Published results beside our own: every ordering that the papers print, tried on like scenes, and whether it holds.
//!
//! [`experiments`] lists them by publication; each renders its scenes, runs its systems, and returns a [`Finding`]; [`page`] writes
//! them down. Nothing here tunes a parameter: an ordering that does not hold says so, with what was tried to find out why.

mod chart;
mod contest;
pub mod finding;
mod inside;
mod lab;
pub mod page;
mod pattern;
mod phlm;
mod picture;
mod salvi;
mod stage;
mod subject;
mod survey;
mod thesis;

pub use finding::Finding;
pub use lab::{Effort, Lab};

use crate::{gpu::GpuError, metrics::Metric, run::RunError, scene::BakeError, sequence::SequenceError};
use finding::Chart;
use subject::Outcome;

/// Why an experiment gave no finding.
#[derive(Debug, thiserror::Error)]
pub enum PaperError {
    /// A scene could not be baked.
    #[error(transparent)]
    Scene(#[from] BakeError),
    /// A baked sequence could not be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A system could not run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The adapter failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

type Run = dyn Fn(&Lab<'_>) -> Result<Finding, PaperError>;

/// A published result that can be tried here.
pub struct Experiment {
    /// Publication and name, such as `thesis.pipe`.
    pub id: &'static str,
    run: Box<Run>,
}

impl Experiment {
    fn new(id: &'static str, run: impl Fn(&Lab<'_>) -> Result<Finding, PaperError> + 'static) -> Self {
        Self { id, run: Box::new(run) }
    }

    /// Makes it.
    pub fn run(&self, lab: &Lab<'_>) -> Result<Finding, PaperError> {
        (self.run)(lab)
    }
}

/// Every experiment, by publication.
pub fn experiments() -> Vec<Experiment> {
    let contest = |contest: contest::Contest| Experiment::new(contest.id, move |lab| contest.run(lab));
    let mut all = vec![
        Experiment::new("thesis.reference_samples", thesis::reference_samples),
        Experiment::new("thesis.sharpening", thesis::sharpening),
    ];
    all.extend(
        thesis::STATIC_TESTS
            .iter()
            .map(|test| Experiment::new(test.id(), |lab| test.run(lab))),
    );
    all.extend(
        thesis::GHOSTING_TESTS
            .iter()
            .map(|test| Experiment::new(test.id(), |lab| test.run(lab))),
    );
    all.extend(
        phlm::SCENES
            .iter()
            .map(|scene| Experiment::new(scene.id(), |lab| scene.run(lab))),
    );
    all.push(Experiment::new("phlm.rendering_strategies", phlm::rendering_strategies));
    all.push(Experiment::new("survey.effective_samples", survey::effective_samples));
    all.push(Experiment::new("survey.resampling", survey::resampling));
    all.extend(survey::contests().into_iter().map(contest));
    all.push(Experiment::new("survey.cost", survey::cost));
    all.extend(salvi::contests().into_iter().map(contest));
    all.extend(inside::contests().into_iter().map(contest));
    all
}

/// Why another texel's vector does not help the ball of scene `sphere`.
const TURNING: &str = "Most of what is lost is lost on the ball itself (psnr.moving), little beside it (psnr.static). The ball turns by \
    0.12 rad a frame, so its vectors differ by about a tenth of a pixel from texel to texel: a neighbour's vector fetches history \
    beside the point that the texel shows, in every frame anew. Where edges slide without turning, the ordering holds.";

/// A metric over frames, a curve a system.
fn per_frame_chart(id: &str, caption: &str, outcomes: &[Outcome], metric: Metric) -> Chart {
    let curve = |outcome: &Outcome| {
        let points = outcome
            .each(metric)
            .into_iter()
            .map(|(index, value)| [index as f64, value]);
        (outcome.label.clone(), points.collect())
    };
    Chart {
        name: id.replace('.', "_"),
        caption: caption.to_owned(),
        x: "frame".to_owned(),
        y: format!("{}, {}", metric.id(), metric.info().unit),
        curves: outcomes.iter().map(curve).collect(),
    }
}
