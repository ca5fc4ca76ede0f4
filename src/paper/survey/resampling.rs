//! Section 6.1.1: what is left of an image that is resampled again and again.

use crate::{
    image::{Extent, Image},
    metrics::Display,
    paper::{
        PaperError,
        finding::{Cell, Entry, Finding, Ordering, Table},
        lab::Lab,
        pattern, picture,
        stage::Stage,
        subject::Subject,
    },
    sequence::frame::Rgb,
    taa::Precision,
};

/// Figure 8: what is left of an image after 100 resamplings.
pub fn resampling(lab: &Lab<'_>) -> Result<Finding, PaperError> {
    const FILTERS: [(&str, &str); 5] = [
        ("quasi-interpolator", "quasi_cubic"),
        ("Catmull-Rom", "catmull_rom"),
        ("Catmull-Rom, 5 taps", "catmull_rom_5"),
        ("bilinear with BFECC", "bfecc"),
        ("bilinear", "bilinear"),
    ];
    const N_FRAMES: usize = 101;
    let extent = Extent::new(192, 192);
    let cases = [
        ("half a pixel, not blended", pattern::Shift::Half, 1e-9),
        ("random, not blended", pattern::Shift::Random, 1e-9),
        ("random, α = 0.1", pattern::Shift::Random, 0.1),
    ];
    let mut columns = Vec::new();
    let mut strips = Vec::new();
    let mut by_filter = vec![Vec::new(); FILTERS.len()];
    for (name, shift, weight) in cases {
        columns.push(format!("{name}, dB"));
        let subjects = FILTERS.map(|(label, filter)| {
            let subject = Subject::new(label, "ema");
            subject.with("history_filter", filter).with("current_weight", weight)
        });
        let first = pattern::shifted_frame(extent, shift, 0);
        let mut stage = Stage::new(lab.gpu, &subjects, Precision::F32, &first)?;
        stage.resolve(&first, 0..FILTERS.len())?;
        for index in 1..N_FRAMES {
            stage.resolve(&pattern::shifted_frame(extent, shift, index), 0..FILTERS.len())?;
        }
        let last = pattern::shifted_frame(extent, shift, N_FRAMES - 1).color;
        let shown = (0..FILTERS.len())
            .map(|index| stage.shown(index))
            .collect::<Result<Vec<_>, _>>()?;
        for (psnrs_db, image) in by_filter.iter_mut().zip(&shown) {
            psnrs_db.push(inner_psnr_db(&last, image));
        }
        let labelled = FILTERS.iter().map(|(label, _)| *label).zip(&shown);
        // The blurriest leads, so that the crop shows what all others keep of it.
        let images: Vec<_> = [("original", &last)].into_iter().chain(labelled.rev()).collect();
        let file = format!("survey_resampling_{}", strips.len() + 1);
        strips.push(picture::strip(&file, &format!("{name}."), Display::default(), &images));
    }
    let order = |case: usize, filters: &[usize], claim: String| Ordering {
        claim,
        measure: "PSNR of linear colour, dB",
        higher_is_better: true,
        tie: 0.1,
        entries: filters
            .iter()
            .map(|&index| Entry {
                system: FILTERS[index].0.to_owned(),
                ours: by_filter[index][case],
                published: None,
            })
            .collect(),
        trials: vec![],
        reason: "",
    };
    let mut orderings = Vec::new();
    for (case, (name, ..)) in cases.iter().enumerate() {
        orderings.push(order(
            case,
            &[0, 1, 4],
            format!("quasi-interpolator, Catmull-Rom, bilinear ({name})"),
        ));
        orderings.push(order(case, &[3, 4], format!("BFECC improves on bilinear ({name})")));
    }
    // What is better comes first, each a name and its place in `CASES`.
    let pair = |claim: String, index: usize, entries: [(usize, &str); 2]| Ordering {
        claim,
        measure: "PSNR of linear colour, dB",
        higher_is_better: true,
        tie: 0.1,
        entries: entries
            .map(|(case, name)| Entry {
                system: name.to_owned(),
                ours: by_filter[index][case],
                published: None,
            })
            .into(),
        trials: vec![],
        reason: "",
    };
    for (index, (label, _)) in FILTERS.iter().enumerate().skip(1) {
        let claim = format!("new input in every frame makes up for some of the blur of {label}");
        orderings.push(pair(claim, index, [(2, "α = 0.1"), (1, "not blended")]));
    }
    for (index, (label, _)) in FILTERS.iter().enumerate() {
        let claim = format!("half a pixel is the worst case of {label}");
        orderings.push(pair(claim, index, [(1, "random"), (0, "half a pixel")]));
    }
    let rows = FILTERS.iter().zip(&by_filter);
    let rows = rows.map(|((label, _), values)| ((*label).to_owned(), values.iter().copied().map(Cell::ours).collect()));
    Ok(Finding {
        id: "survey.resampling",
        title: "A hundred resamplings",
        source: "section 6.1.1, figure 8",
        setup: format!(
            "An analytic picture of {extent} moves to and fro by half a pixel, or at random, along both axes, for a hundred \
             frames; its border is left out. Compared with the picture where it then is. The publication shows crops."
        ),
        tables: vec![Table {
            caption: "PSNR after 100 resamplings".to_owned(),
            columns,
            rows: rows.collect(),
        }],
        charts: vec![],
        strips,
        orderings,
    })
}

/// PSNR of linear colour with peak 1, without the border that the picture's motion brings in.
fn inner_psnr_db(reference: &Image<Rgb>, test: &Image<Rgb>) -> f64 {
    let Extent { width, height } = reference.extent();
    let border = pattern::MAX_SHIFT_PX as u32 + 8;
    let (mut sum, mut n) = (0.0, 0.0);
    for y in border..height - border {
        for x in border..width - border {
            let (r, t) = (reference.at(x, y), test.at(x, y));
            sum += (0..3).map(|i| f64::from(r[i] - t[i]).powi(2)).sum::<f64>();
            n += 3.0;
        }
    }
    -10.0 * libm::log10(sum / n)
}
