//! What the tests themselves hang on: tables 4.1 and 5.1.

use super::{METRICS, N_FILLING_FRAMES, PSNR, ROWS, SSIM, TIE_DB, TIE_SSIM, ranked, still};
use crate::paper::{
    PaperError,
    finding::{Cell, Finding, Ordering, Table},
    lab::{Lab, Shot},
    subject::Subject,
};

/// Table 5.1: both systems with either sharpening.
pub fn sharpening(lab: &Lab<'_>) -> Result<Finding, PaperError> {
    const VARIANTS: [(&str, &str, &str); 4] = [
        ("Uncharted 4, its own", "uncharted4", "xu"),
        ("Uncharted 4, normalised", "uncharted4", "normalised"),
        ("thesis, not normalised", "sobel2018", "xu"),
        ("thesis, its own", "sobel2018", "normalised"),
    ];
    const PUBLISHED: [[f64; 4]; 5] = [
        [149.271, 8.835, 148.036, 8.224],
        [12.218, 2.972, 12.167, 2.868],
        [26.391, 38.669, 26.427, 38.980],
        [16.245, 28.522, 16.281, 28.833],
        [0.932, 0.992, 0.933, 0.992],
    ];
    let extent = lab.effort.still_extent;
    let subjects = VARIANTS.map(|(label, preset, sharpen)| Subject::new(label, preset).with("sharpen", sharpen));
    let stills = lab.settle(still("atrium"), extent, &subjects, &METRICS)?.stills;
    let rows = ROWS.iter().zip(PUBLISHED).map(|(row, published)| {
        let cells = stills.iter().zip(published);
        let cells = cells.map(|(still, published)| Cell::beside(row.factor * still.value(row.metric), published));
        (row.name.to_owned(), cells.collect())
    });
    let order = |claim: &str, which: &[usize], row: usize, tie| Ordering {
        claim: claim.to_owned(),
        measure: ROWS[row].name,
        higher_is_better: true,
        tie,
        entries: ranked(which.iter().map(|&index| {
            let still = &stills[index];
            (
                still.label.as_str(),
                still.value(ROWS[row].metric),
                PUBLISHED[row][index],
            )
        })),
        trials: vec![],
        reason: "",
    };
    Ok(Finding {
        id: "thesis.sharpening",
        title: "The four variants of sharpening",
        source: "table 5.1",
        setup: format!("Scene `atrium` at rest, {extent}, frame {N_FILLING_FRAMES}."),
        tables: vec![Table {
            caption: "In parentheses what was published".to_owned(),
            columns: VARIANTS.map(|(label, ..)| label.to_owned()).into(),
            rows: rows.collect(),
        }],
        charts: vec![],
        strips: vec![],
        orderings: vec![
            order("the order of the table", &[0, 1, 2, 3], PSNR, TIE_DB),
            order("the order of the table", &[0, 1, 2, 3], SSIM, TIE_SSIM),
            order("the milder kernel, with Uncharted 4", &[0, 1], PSNR, TIE_DB),
            order("the milder kernel, with the thesis", &[2, 3], PSNR, TIE_DB),
            order("the thesis, both with the milder kernel", &[1, 3], PSNR, TIE_DB),
            order("the thesis, both with the stronger kernel", &[0, 2], PSNR, TIE_DB),
        ],
    })
}

/// Table 4.1: what a reference of fewer samples makes of the errors.
pub fn reference_samples(lab: &Lab<'_>) -> Result<Finding, PaperError> {
    const SYSTEMS: [(&str, &str); 2] = [("temporal", "uncharted4"), ("no AA", "none")];
    /// Of each system, [`ROWS`] with 16 and with 128 samples.
    const PUBLISHED: [[[f64; 2]; 5]; 2] = [
        [
            [40.647863, 38.947297],
            [6.375568, 6.240777],
            [32.040426, 32.22603],
            [30.30596, 30.492374],
            [0.993302, 0.993451],
        ],
        [
            [24.872104, 24.524992],
            [4.987194, 4.952271],
            [34.173678, 34.234715],
            [32.439212, 32.501058],
            [0.996826, 0.996891],
        ],
    ];
    const N_SAMPLES: [u32; 2] = [16, 128];
    let extent = lab.effort.extent;
    let subjects = SYSTEMS.map(|(label, preset)| Subject::new(label, preset));
    let mut stills = Vec::new();
    for n in N_SAMPLES {
        let shot = Shot {
            reference_samples: Some(n),
            ..still("atrium")
        };
        stills.push(lab.settle(shot, extent, &subjects, &METRICS)?.stills);
    }
    let value = |n: usize, system: usize, row: usize| ROWS[row].factor * stills[n][system].value(ROWS[row].metric);
    let mut rows = Vec::new();
    for (system, (label, _)) in SYSTEMS.into_iter().enumerate() {
        for (row, published) in PUBLISHED[system].into_iter().enumerate() {
            let cells = [0, 1].map(|n| Cell::beside(value(n, system, row), published[n]));
            rows.push((format!("{label}: {}", ROWS[row].name), cells.into()));
        }
    }
    let order = |(system, (label, _)): (usize, (&str, &str))| Ordering {
        claim: format!("against the reference of more samples the error of {label} is smaller"),
        measure: ROWS[PSNR].name,
        higher_is_better: true,
        tie: 0.005,
        entries: ranked(
            [(1, "128 samples"), (0, "16 samples")]
                .into_iter()
                .map(|(n, name)| (name, value(n, system, PSNR), PUBLISHED[system][PSNR][n])),
        ),
        trials: vec![],
        reason: "",
    };
    Ok(Finding {
        id: "thesis.reference_samples",
        title: "References of 16 and of 128 samples",
        source: "table 4.1, test D",
        setup: format!("Scene `atrium` at rest, {extent}, frame {N_FILLING_FRAMES}."),
        tables: vec![Table {
            caption: "In parentheses what was published".to_owned(),
            columns: N_SAMPLES.map(|n| format!("{n} samples")).into(),
            rows,
        }],
        charts: vec![],
        strips: vec![],
        orderings: SYSTEMS.into_iter().enumerate().map(order).collect(),
    })
}
