//! What some hazards ask beside agreement with the twin.

use super::{
    device::{CellError, Device, Left},
    difference::{display_of_history, tolerance},
    findings::Findings,
    report::{Bound, Verdict},
    scenario::{Asks, DISPLAY, Frames, Order, Scenario, Segment},
};
use crate::{
    gpu::{Gpu, Variant, Workgroup},
    image::Image,
    sequence::frame::Rgb,
    taa::{
        Recipe, Skip,
        recipe::{Algorithm, Domain, HistoryFilter, InputFilter, Neighbourhood, Rectify, Spatial, Weight},
        reference::{Twin, color::Color},
    },
};

pub fn ask(
    device: Device<'_>,
    scenario: &Scenario,
    segment: &Segment,
    all: &[Left],
    findings: &mut Findings,
) -> Result<(), CellError> {
    match &scenario.asks {
        Asks::Agreement | Asks::Digits { .. } | Asks::Endurance { .. } => {}
        Asks::Recovery {
            undisturbed,
            frame,
            area,
        } => recovery(device, segment, all, undisturbed, *frame, *area, findings)?,
        Asks::Dot { ground } => dot(device.recipe, segment, all, *ground, findings),
        Asks::Noise => noise(device.recipe, all, findings),
        Asks::Order(order) => equal_bits(device, segment, all, *order, findings)?,
    }
    Ok(())
}

/// How far a texel's colour reaches within a frame, texels: through the box, and through the spatial filter before it, across the
/// edges that it finds.
pub fn reach(recipe: &Recipe) -> u32 {
    let of_box = match recipe.neighbourhood {
        Neighbourhood::Variance => (recipe.variance_window / 2).max(1),
        Neighbourhood::Sobel => 2,
        _ => 1,
    };
    let of_filter = match recipe.spatial {
        Spatial::None => 0,
        Spatial::Fxaa => 1,
        // An edge is judged by the two texels beside it, its ends by what crosses them, and the next pixel mixes by its weights.
        Spatial::Smaa => 3,
    };
    of_box + of_filter
}

/// What carries the past of each pixel: history as a display shows it, or where that is something else the image shown.
fn carried(device: Device<'_>, left: &Left) -> Vec<Rgb> {
    let domain = device.recipe.domain;
    match (device.recipe.algorithm, left.kept.first()) {
        (Algorithm::Temporal | Algorithm::Checkerboard, Some((_, kept))) => kept
            .chunks_exact(4)
            .map(|rgba| [rgba[0], rgba[1], rgba[2]].map(|v| display_of_history(v, domain) as f32))
            .collect(),
        _ => left
            .shown
            .pixels()
            .iter()
            .map(|pixel| pixel.map(|v| display_of_history(v, Domain::Linear) as f32))
            .collect(),
    }
}

fn recovery(
    device: Device<'_>,
    segment: &Segment,
    all: &[Left],
    undisturbed: &Frames,
    frame: usize,
    area: [[u32; 2]; 2],
    findings: &mut Findings,
) -> Result<(), CellError> {
    let clean = device.resolve(segment, |index| undisturbed(index))?;
    let limit = tolerance(device.recipe, device.precision);
    let scale = segment.sizes.output.width / segment.sizes.render.width;
    let reach = reach(device.recipe);
    let width = segment.sizes.output.width;
    let is_touched = |i: usize| {
        let texel = [i as u32 % width / scale, i as u32 / width / scale];
        (0..2).all(|axis| texel[axis] + reach >= area[0][axis] && texel[axis] < area[1][axis] + reach)
    };
    let mut last_differing = None;
    let mut inside = 0.0_f64;
    for (index, (disturbed, clean)) in all.iter().zip(&clean).enumerate().skip(frame) {
        let pairs = carried(device, disturbed)
            .into_iter()
            .zip(carried(device, clean))
            .enumerate();
        let (mut worst, mut outside) = (0.0_f64, 0.0_f64);
        for (i, (a, b)) in pairs {
            let d = (0..3)
                .map(|c| f64::from((a[c] - b[c]).abs()))
                .fold(0.0, |d, x| if x.is_nan() { 1.0 } else { x.max(d) });
            worst = worst.max(d);
            if !is_touched(i) {
                outside = outside.max(d);
            }
        }
        inside = worst;
        if worst > limit {
            last_differing = Some(index);
        }
        if index > frame && outside > limit {
            let side = 2 * reach + 1;
            let message = format!("still differs by {outside:.1e} outside the {side}×{side} around what was disturbed");
            findings.add(Verdict::Fails, Some(index), message);
        }
    }
    let recovered = match last_differing {
        None => Some(0),
        Some(last) if last + 1 < all.len() => Some(last + 1 - frame),
        Some(_) => None,
    };
    findings.recovered_after = recovered;
    if recovered.is_none() {
        let n = all.len() - 1 - frame;
        let message = match (device.recipe.algorithm, device.recipe.rectify) {
            (Algorithm::Phlm2016, _) => format!(
                "the texels touched still differ by {inside:.1e} after {n} frames: the mean of frames at rest forgets by 1/N"
            ),
            (_, Rectify::None) => format!(
                "the texels touched still differ by {inside:.1e} after {n} frames: the system rectifies no history, and forgets \
                 by its weight alone"
            ),
            _ => format!("the texels touched still differ by {inside:.1e} after {n} frames"),
        };
        findings.add(Verdict::Degrades, None, message);
    }
    Ok(())
}

/// Energy and place of the dot: of what is shown, against the frame's own.
fn dot(recipe: &Recipe, segment: &Segment, all: &[Left], ground: f64, findings: &mut Findings) {
    if recipe.fills_checkerboard() {
        return;
    }
    let scale = f64::from(segment.sizes.output.width) / f64::from(segment.sizes.render.width);
    let (mut worst_energy, mut worst_place) = (0.0_f64, 0.0_f64);
    for (index, left) in all.iter().enumerate().skip(1) {
        let truth = Dot::of(&(segment.frames)(index).color, recipe.domain, ground);
        let found = Dot::of(&left.shown, recipe.domain, ground);
        worst_energy = worst_energy.max((found.energy / (scale * scale) / truth.energy - 1.0).abs());
        let place = [0, 1].map(|axis| found.place[axis] / scale - truth.place[axis]);
        worst_place = worst_place.max(place[0].hypot(place[1]));
    }
    let words = format!(
        "the dot's energy is off by {:.1} %, its place by {worst_place:.2} px",
        100.0 * worst_energy
    );
    if worst_energy.is_nan() || worst_energy > 0.5 || worst_place > 0.5 {
        findings.add(Verdict::Fails, None, words);
    } else if worst_energy > 0.15 || worst_place > 0.25 {
        findings.add(Verdict::Degrades, None, words);
    } else {
        findings.remark(words);
    }
}

struct Dot {
    energy: f64,
    /// Pixels.
    place: [f64; 2],
}

impl Dot {
    fn of(image: &Image<Rgb>, domain: Domain, ground: f64) -> Self {
        let value = |rgb: Rgb| Color(rgb.map(f64::from)).to_domain(domain, &DISPLAY).luma();
        let ground = Color::<f64>::splat(ground).to_domain(domain, &DISPLAY).luma();
        let (mut energy, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
        for (i, rgb) in image.pixels().iter().enumerate() {
            let v = value(*rgb) - ground;
            let width = image.extent().width as usize;
            energy += v;
            x_sum += v * ((i % width) as f64 + 0.5);
            y_sum += v * ((i / width) as f64 + 0.5);
        }
        Self {
            energy,
            place: [x_sum / energy, y_sum / energy],
        }
    }
}

/// Of a plain blend w/(2 - w) of the noise's variance is left.
fn noise(recipe: &Recipe, all: &[Left], findings: &mut Findings) {
    let plain = recipe.rectify == Rectify::None
        && recipe.weight == Weight::Fixed
        && recipe.algorithm == Algorithm::Temporal
        && recipe.history_filter != HistoryFilter::None
        && recipe.input_filter == InputFilter::Texel
        && recipe.domain == Domain::Linear;
    let Some(last) = all.last().filter(|_| plain) else {
        return;
    };
    let values = || last.shown.pixels().iter().map(|c| f64::from(c[0]));
    let n = last.shown.pixels().len() as f64;
    let mean = values().sum::<f64>() / n;
    let variance = values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
    let weight = recipe.current_weight;
    let expected = weight / (2.0 - weight);
    let measured = variance * 12.0;
    findings.bound = Some(Bound {
        value: expected,
        formula: format!("w/(2 - w), w = {weight}"),
        measured,
    });
    if !(0.75..1.33).contains(&(measured / expected)) {
        let message = format!("{measured:.3} of the noise's variance is left, not {expected:.3}");
        findings.add(Verdict::Fails, None, message);
    }
}

fn equal_bits(
    device: Device<'_>,
    segment: &Segment,
    all: &[Left],
    order: Order,
    findings: &mut Findings,
) -> Result<(), CellError> {
    let again = |device: Device<'_>| device.resolve(segment, |index| (segment.frames)(index));
    let shaped = |workgroup, workgroup_memory| {
        device.gpu.with(Variant {
            workgroup: Some(workgroup),
            workgroup_memory: Some(workgroup_memory),
            cache: Some(Default::default()),
        })
    };
    let mut compare = |what: &str, found: &[Left]| {
        let unequal = all.iter().zip(found).position(|(a, b)| !a.has_the_bits_of(b));
        if let Some(frame) = unequal {
            findings.add(
                Verdict::Fails,
                Some(frame),
                format!("is not bit for bit the same {what}"),
            );
        }
    };
    match order {
        Order::Repeat => compare("when run again", &again(device)?),
        Order::Skip => {
            let skipping = Device {
                skip: Skip::Exact,
                ..device
            };
            compare("where what repeats is skipped", &again(skipping)?);
        }
        Order::Tiles => {
            for (x, y, shares) in [(8, 8, true), (64, 1, false), (4, 16, true)] {
                let shape = Workgroup::new(x, y);
                let gpu: Gpu = shaped(shape, shares);
                let found = again(Device { gpu: &gpu, ..device })?;
                let how = if shares { " that share what they read" } else { "" };
                compare(&format!("with workgroups of {shape}{how}"), &found);
            }
        }
        Order::Threads => {
            let pool = |n| {
                rayon::ThreadPoolBuilder::new()
                    .num_threads(n)
                    .build()
                    .expect("a few threads can be had")
            };
            let twin = || {
                let mut twin = Twin::<f64>::new(device.recipe.clone(), device.precision);
                let frames = (0..segment.n_frames).map(|index| segment.frame(index, device.recipe));
                frames
                    .map(|frame| twin.resolve(&frame).shown.into_pixels())
                    .collect::<Vec<_>>()
            };
            compare("with one thread", &pool(1).install(|| again(device))?);
            compare("with five threads", &pool(5).install(|| again(device))?);
            let bits = |shown: Vec<Vec<[f64; 3]>>| {
                shown
                    .into_iter()
                    .flatten()
                    .flatten()
                    .map(f64::to_bits)
                    .collect::<Vec<_>>()
            };
            if bits(pool(1).install(twin)) != bits(pool(5).install(twin)) {
                findings.add(
                    Verdict::Fails,
                    None,
                    "the twin depends on the number of threads".to_owned(),
                );
            }
        }
    }
    Ok(())
}
