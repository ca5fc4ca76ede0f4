//! Section 3.3: what an exponential average is worth.

use crate::{
    image::{Extent, Image},
    paper::{
        PaperError,
        finding::{Cell, Chart, Entry, Finding, Ordering, Table},
        lab::Lab,
        pattern,
        stage::Stage,
        subject::Subject,
    },
    sequence::frame::Rgb,
    taa::Precision,
};

/// Figure 4: how many samples an exponential average of n frames is worth.
pub fn effective_samples(lab: &Lab<'_>) -> Result<Finding, PaperError> {
    const WEIGHTS: [f64; 4] = [0.05, 0.1, 0.2, 0.4];
    const N_FRAMES: usize = 60;
    /// What the text prints for a weight of 0.1.
    const PUBLISHED: [(usize, f64); 3] = [(5, 2.2), (10, 5.1), (15, 9.8)];
    /// And for ever.
    const PUBLISHED_LIMIT: f64 = 19.0;
    let extent = Extent::new(128, 128);
    let mut curves = Vec::new();
    let mut measured = Vec::new();
    for weight in WEIGHTS {
        let subject = Subject::new("", "ema").with("current_weight", weight);
        let mut counts = Vec::new();
        let input = variance(&pattern::noise_frame(extent, 0).color);
        let first = pattern::noise_frame(extent, 0);
        let mut stage = Stage::new(lab.gpu, &[subject], Precision::F32, &first)?;
        for index in 0..N_FRAMES {
            stage.resolve(&pattern::noise_frame(extent, index), [0])?;
            counts.push(input / variance(&stage.shown(0)?));
        }
        let analytic = (1..=N_FRAMES).map(|n| [n as f64, n_effective(weight, n)]);
        curves.push((format!("α = {weight}, analytic"), analytic.collect()));
        let points = counts
            .iter()
            .enumerate()
            .map(|(index, count)| [index as f64 + 1.0, *count]);
        curves.push((format!("α = {weight}, measured"), points.collect()));
        measured.push(counts);
    }
    let row = |name: String, n: usize, published: f64| {
        let cells = vec![
            Cell::beside(n_effective(0.1, n), published),
            Cell::ours(measured[1][n - 1]),
        ];
        (format!("α = 0.1, {name}"), cells)
    };
    let mut rows: Vec<_> = PUBLISHED
        .into_iter()
        .map(|(n, published)| row(format!("{n} frames"), n, published))
        .collect();
    rows.push(row(
        format!("{N_FRAMES} frames (there: any number)"),
        N_FRAMES,
        PUBLISHED_LIMIT,
    ));
    let at = |n: usize, order: &[usize], claim: &str| Ordering {
        claim: claim.to_owned(),
        measure: "effective samples",
        higher_is_better: true,
        tie: 0.1,
        entries: order
            .iter()
            .map(|&index| Entry {
                system: format!("α = {}", WEIGHTS[index]),
                ours: measured[index][n - 1],
                published: None,
            })
            .collect(),
        trials: vec![],
        reason: "",
    };
    Ok(Finding {
        id: "survey.effective_samples",
        title: "Effective samples of an exponential average",
        source: "section 3.3, figure 4",
        setup: format!(
            "Noise that is new in each of {N_FRAMES} frames, {extent}, through `ema`: the variance of the input over that of the \
             output. Analytic: one over the sum of the squared weights."
        ),
        tables: vec![Table {
            caption: "In parentheses what was published".to_owned(),
            columns: vec!["analytic".to_owned(), "measured".to_owned()],
            rows,
        }],
        charts: vec![Chart {
            name: "survey_effective_samples".to_owned(),
            caption: "Effective samples against frames".to_owned(),
            x: "frames".to_owned(),
            y: "effective samples".to_owned(),
            curves,
        }],
        strips: vec![],
        orderings: vec![
            at(5, &[2, 1, 0], "after 5 frames the larger of three weights is ahead"),
            at(N_FRAMES, &[0, 1, 2, 3], "after 60 frames the smaller weight is ahead"),
        ],
    })
}

/// One over the sum of squared weights of `n` frames, of which the first started the average.
fn n_effective(weight: f64, n: usize) -> f64 {
    let keep = 1.0 - weight;
    let later: f64 = (0..n - 1).map(|age| (weight * keep.powi(age as i32)).powi(2)).sum();
    1.0 / (later + keep.powi(n as i32 - 1).powi(2))
}

fn variance(image: &Image<Rgb>) -> f64 {
    let values = || image.pixels().iter().flatten().map(|&value| f64::from(value));
    let n = 3.0 * image.pixels().len() as f64;
    let mean = values().sum::<f64>() / n;
    values().map(|value| (value - mean).powi(2)).sum::<f64>() / n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effective_samples_are_those_printed() {
        // Section 3.3 prints 2.2, 5.1 and 9.8, and 19 for ever.
        for (n, published) in [(5, 2.2), (10, 5.1), (15, 9.8), (1000, 19.0)] {
            assert!(
                (n_effective(0.1, n) - published).abs() < 0.05,
                "{n}: {}",
                n_effective(0.1, n)
            );
        }
        assert_eq!(n_effective(0.3, 1), 1.0);
    }
}
