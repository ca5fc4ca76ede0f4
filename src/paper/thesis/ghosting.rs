//! Section 5.2, where something moves: tables 5.9, 5.12 and 5.13.

use super::{METRICS, MSE, PSNR, ROWS, SSIM, TIE_DB, TIE_SSIM, systems};
use crate::{
    metrics::Metric,
    paper::{
        PaperError,
        finding::{Cell, Entry, Finding, Ordering, Table},
        lab::{self, Lab, Shot},
        per_frame_chart, picture,
        subject::Outcome,
    },
};

/// A test of section 5.2 in which something moves.
pub struct GhostingTest {
    pub(super) id: &'static str,
    pub(super) title: &'static str,
    pub(super) source: &'static str,
    pub(super) scene: &'static str,
    /// Best, worst and mean MSE, PSNR, SNR and SSIM of Uncharted 4 and of the thesis; none where infinite.
    pub(super) published: [[[Option<f64>; 3]; 4]; 2],
}

/// Which of [`ROWS`] these tables have.
const PRINTED: [usize; 4] = [0, 2, 3, 4];

impl GhostingTest {
    pub fn id(&self) -> &'static str {
        self.id
    }

    pub fn run(&self, lab: &Lab<'_>) -> Result<Finding, PaperError> {
        let sequence = lab.bake(Shot::of(self.scene))?;
        let last = sequence.n_frames() - 1;
        let [.., uncharted, thesis] = systems();
        let outcomes = lab.run(&sequence, &[uncharted, thesis], &METRICS, Some(last))?;
        let mut rows = Vec::new();
        for (index, row) in PRINTED.map(|row| &ROWS[row]).into_iter().enumerate() {
            let spreads: Vec<[f64; 3]> = outcomes.iter().map(|outcome| spread(outcome, row.metric)).collect();
            for (which, word) in ["best", "worst", "mean"].into_iter().enumerate() {
                let cells = spreads.iter().zip(&self.published).map(|(spread, published)| Cell {
                    ours: Some(row.factor * spread[which]),
                    published: published[index][which],
                });
                rows.push((format!("{word} {}", row.name), cells.collect()));
            }
        }
        let reference = lab::reference(&sequence, last)?;
        let pictures = outcomes
            .iter()
            .filter_map(|outcome| Some((outcome.label.as_str(), outcome.picture.as_ref()?)));
        let images: Vec<_> = [("reference", &reference)].into_iter().chain(pictures).collect();
        let caption = "The last frame, where the first differs most from the reference.";
        Ok(Finding {
            id: self.id,
            title: self.title,
            source: self.source,
            setup: format!(
                "Scene `{}`, {}, {} frames jittered by halton23(16); there 100 frames of 1600×900. Frames after warm-up.",
                self.scene, lab.effort.extent, lab.effort.n_frames
            ),
            tables: vec![Table {
                caption: "In parentheses what was published".to_owned(),
                columns: outcomes.iter().map(|outcome| outcome.label.clone()).collect(),
                rows,
            }],
            charts: vec![per_frame_chart(self.id, "PSNR of each frame", &outcomes, Metric::PSNR)],
            strips: vec![picture::strip(self.id, caption, sequence.display(), &images)],
            orderings: vec![
                self.order(&outcomes, MSE, 0.05),
                self.order(&outcomes, PSNR, TIE_DB),
                self.order(&outcomes, SSIM, TIE_SSIM),
            ],
        })
    }

    /// The thesis over Uncharted 4 by the mean of a row.
    fn order(&self, outcomes: &[Outcome], row: usize, tie: f64) -> Ordering {
        let printed = PRINTED.iter().position(|it| *it == row).expect("a printed row");
        let row = &ROWS[row];
        let entry = |system: usize| Entry {
            system: outcomes[system].label.clone(),
            ours: row.factor * spread(&outcomes[system], row.metric)[2],
            published: self.published[system][printed][2],
        };
        Ordering {
            claim: "the thesis over Uncharted 4 on the mean of all frames".to_owned(),
            measure: row.name,
            higher_is_better: row.metric != Metric::MSE,
            tie,
            entries: [1, 0].map(entry).into(),
            trials: vec![],
            reason: "",
        }
    }
}

/// Best, worst and mean of a metric's frames; the mean of the finite ones.
fn spread(outcome: &Outcome, metric: Metric) -> [f64; 3] {
    let values: Vec<f64> = outcome.each(metric).into_iter().map(|(_, value)| value).collect();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (best, worst) = if metric == Metric::MSE {
        (low, high)
    } else {
        (high, low)
    };
    [best, worst, outcome.mean(metric)]
}
