//! Section 5.2, where nothing moves: tables 5.2 to 5.8, 5.10 and 5.11.

use super::{METRICS, N_FILLING_FRAMES, PSNR, ROWS, SSIM, TIE_DB, TIE_SSIM, ranked, still, systems};
use crate::paper::{
    PaperError,
    finding::{Cell, Entry, Finding, Ordering, Table, Trial},
    lab::{Lab, Settled, Still},
    picture,
};

/// A test of section 5.2 in which nothing moves.
pub struct StaticTest {
    pub(super) id: &'static str,
    pub(super) title: &'static str,
    pub(super) source: &'static str,
    pub(super) scene: &'static str,
    /// [`ROWS`] of no AA, FXAA, SMAA, Uncharted 4 and the thesis.
    pub(super) published: [[f64; 5]; 5],
    /// Why the orders by PSNR and by SSIM do not hold.
    pub(super) reasons: [&'static str; 2],
}

/// Which of the systems sharpen.
const SHARPENED: [usize; 2] = [3, 4];

impl StaticTest {
    pub fn id(&self) -> &'static str {
        self.id
    }

    pub fn run(&self, lab: &Lab<'_>) -> Result<Finding, PaperError> {
        let systems = systems();
        let unsharpened = SHARPENED.map(|index| {
            let subject = systems[index].clone().with("sharpen", "none");
            subject.labelled(&format!("{}, not sharpened", systems[index].label))
        });
        let subjects: Vec<_> = systems.into_iter().chain(unsharpened).collect();
        let extent = lab.effort.still_extent;
        let settled = lab.settle(still(self.scene), extent, &subjects, &METRICS)?;
        let (shown, unsharpened) = settled.stills.split_at(self.published[0].len());
        let rows = ROWS.iter().zip(self.published).map(|(row, published)| {
            let value = |still: &Still| row.factor * still.value(row.metric);
            let theirs = shown
                .iter()
                .zip(published)
                .map(|(still, published)| Cell::beside(value(still), published));
            let ours = unsharpened.iter().map(|still| Cell::ours(value(still)));
            (row.name.to_owned(), theirs.chain(ours).collect())
        });
        let table = Table {
            caption: format!("Frame {N_FILLING_FRAMES}; in parentheses what was published"),
            columns: settled.stills.iter().map(|still| still.label.clone()).collect(),
            rows: rows.collect(),
        };
        Ok(Finding {
            id: self.id,
            title: self.title,
            source: self.source,
            setup: format!(
                "Scene `{}`, {extent}, nothing moves, {N_FILLING_FRAMES} frames jittered by halton23(16); `none`, `fxaa` and \
                 `smaa` read the frame without jitter. Reference: {} samples.",
                self.scene, lab.effort.reference_samples
            ),
            tables: vec![table],
            charts: vec![],
            strips: vec![self.strip(&settled)],
            orderings: vec![
                self.table_order(&settled, PSNR, TIE_DB, self.reasons[0]),
                self.table_order(&settled, SSIM, TIE_SSIM, self.reasons[1]),
                self.over_uncharted(shown),
            ],
        })
    }

    /// The order of one row of the table.
    fn table_order(&self, settled: &Settled, row: usize, tie: f64, reason: &'static str) -> Ordering {
        let (shown, unsharpened) = settled.stills.split_at(self.published[0].len());
        let entries = |of: &dyn Fn(usize) -> f64| {
            let numbers = shown.iter().enumerate().zip(self.published[row]);
            ranked(numbers.map(|((index, still), published)| (still.label.as_str(), of(index), published)))
        };
        let metric = ROWS[row].metric;
        let trial = |change: &str, changed: &[usize]| Trial {
            change: change.to_owned(),
            entries: entries(&|index| match SHARPENED.iter().position(|it| *it == index) {
                Some(at) if changed.contains(&index) => unsharpened[at].value(metric),
                _ => shown[index].value(metric),
            }),
        };
        Ordering {
            claim: "the order of the table".to_owned(),
            measure: ROWS[row].name,
            higher_is_better: true,
            tie,
            entries: entries(&|index| shown[index].value(metric)),
            trials: vec![
                trial("the thesis is not sharpened", &SHARPENED[1..]),
                trial("neither is sharpened", &SHARPENED),
            ],
            reason,
        }
    }

    fn over_uncharted(&self, shown: &[Still]) -> Ordering {
        let entry = |index: usize| Entry {
            system: shown[index].label.clone(),
            ours: shown[index].value(ROWS[PSNR].metric),
            published: Some(self.published[PSNR][index]),
        };
        Ordering {
            claim: "the thesis over what it improves".to_owned(),
            measure: ROWS[PSNR].name,
            higher_is_better: true,
            tie: TIE_DB,
            entries: [4, 3].map(entry).into(),
            trials: vec![],
            reason: "",
        }
    }

    fn strip(&self, settled: &Settled) -> crate::paper::finding::Strip {
        let stills = settled.stills.iter().map(|still| (still.label.as_str(), &still.image));
        let images: Vec<_> = [("reference", &settled.reference)].into_iter().chain(stills).collect();
        let caption = "Where the first differs most from the reference.";
        picture::strip(self.id, caption, settled.display, &images)
    }
}
