//! Section 7: what a frame costs.

use crate::{
    image::Extent,
    paper::{
        PaperError,
        finding::{Cell, Entry, Finding, Ordering, Table},
        lab::Lab,
        pattern,
        stage::Stage,
        subject::Subject,
    },
    taa::Precision,
};

/// Table 1: the cost of a frame at three sizes.
pub fn cost(lab: &Lab<'_>) -> Result<Finding, PaperError> {
    const N_FRAMES: usize = 4;
    const SYSTEMS: [(&str, &str, u32); 2] = [("TAA", "karis2014", 1), ("TAAU, 2×", "taau", 2)];
    const PUBLISHED_MS: [[f64; 3]; 2] = [[0.14, 0.24, 0.52], [0.15, 0.24, 0.50]];
    let mut rows = Vec::new();
    let mut per_pixel_ns = Vec::new();
    for (system, (label, preset, scale)) in SYSTEMS.into_iter().enumerate() {
        let mut cells = Vec::new();
        for (size, output) in lab.effort.cost_extents.into_iter().enumerate() {
            let render = Extent::new(output.width / scale, output.height / scale);
            // It has no history, and starts the pipelines: its time does not count.
            let first = pattern::upscaled_frame(render, output, 0);
            let mut stage = Stage::new(lab.gpu, &[Subject::new(label, preset)], Precision::F16, &first)?;
            stage.resolve(&first, [0])?;
            let mut times_ms = [0.0; N_FRAMES - 1];
            for (time_ms, index) in times_ms.iter_mut().zip(1..) {
                *time_ms = stage.resolve(&pattern::upscaled_frame(render, output, index), [0])?;
            }
            times_ms.sort_by(f64::total_cmp);
            let median_ms = times_ms[times_ms.len() / 2];
            cells.push(Cell::beside(median_ms, PUBLISHED_MS[system][size]));
            per_pixel_ns.push((label, output, median_ms * 1e6 / output.n_pixels() as f64));
        }
        rows.push((label.to_owned(), cells));
    }
    let order = |(system, label): (usize, &str)| Ordering {
        claim: format!("{label}: the larger the output, the longer"),
        measure: "ms",
        higher_is_better: false,
        tie: 0.0,
        entries: rows[system]
            .1
            .iter()
            .zip(lab.effort.cost_extents)
            .map(|(cell, extent): (&Cell, Extent)| Entry {
                system: extent.to_string(),
                ours: cell.ours.unwrap_or(f64::NAN),
                published: cell.published,
            })
            .collect(),
        trials: vec![],
        reason: "",
    };
    let orderings = SYSTEMS
        .iter()
        .map(|(label, ..)| *label)
        .enumerate()
        .map(order)
        .collect();
    let rates = per_pixel_ns
        .iter()
        .map(|(label, output, ns)| (format!("{label}, {output}"), vec![Cell::ours(*ns)]));
    Ok(Finding {
        id: "survey.cost",
        title: "The cost of a frame",
        source: "section 7, table 1",
        setup: format!(
            "`karis2014` and `taau` with f16 history on {}, passes by their timestamps (on a CPU by the clock), median of {} frames; there Unreal Engine \
             4 on an RTX 2080 Ti. Times of different adapters say nothing of each other.",
            lab.gpu.info().name,
            N_FRAMES - 1
        ),
        tables: vec![
            Table {
                caption: "Milliseconds; in parentheses what was published".to_owned(),
                columns: lab.effort.cost_extents.iter().map(Extent::to_string).collect(),
                rows,
            },
            Table {
                caption: "The same by pixels: the cost follows the output's size".to_owned(),
                columns: vec!["ns a pixel".to_owned()],
                rows: rates.collect(),
            },
        ],
        charts: vec![],
        strips: vec![],
        orderings,
    })
}
