//! Whether depth is what is declared: its order by what hides what, its values by the motion that cameras make of them.

mod cameras;
mod derived;
mod mistakes;
mod readings;
mod vectors;

use super::{
    Belief,
    observe::pairs,
    report::{Finding, Report},
    stored,
};
use crate::{
    image::Extent,
    sequence::{
        Section, SequenceError,
        convention::DepthDecoder,
        manifest::{DepthKind, DepthSource, FarPlane},
    },
};
use glam::DVec2;
use rayon::prelude::*;

const MAX_PAIRS: usize = 4;
/// Depths that differ by less are the same surface.
const SAME: f64 = 0.1;
/// Pixels that must speak before anything is said.
const MIN_PIXELS: usize = 40;

/// What one pair of frames knows: stored depths, motion, and where each pixel was.
struct Depths {
    index: usize,
    size: Extent,
    stored: Vec<f32>,
    stored_before: Vec<f32>,
    motion: Option<Vec<[f64; 2]>>,
    jitter: [[f64; 2]; 2],
}

pub fn examine(belief: &mut Belief, report: &mut Report) -> Result<(), SequenceError> {
    mistakes::shape(belief, report);
    let Some(mut declared) = belief.manifest().depth.clone() else {
        return Ok(());
    };
    // Depths of all pairs are in memory at once.
    let is_large = belief.sequence.render_size().n_pixels() > 4_000_000;
    let frames = pairs(&belief.sequence, if is_large { MAX_PAIRS / 2 } else { MAX_PAIRS });
    if frames.is_empty() {
        report.cannot_tell("depth", "no frame has a predecessor without a reset");
        return Ok(());
    }
    let depths = frames
        .par_iter()
        .map(|&index| Depths::load(belief, index))
        .collect::<Result<Vec<_>, SequenceError>>()?;
    let depths: Vec<Depths> = depths.into_iter().flatten().collect();
    if let Some(mended) = range(report, &declared, &depths) {
        declared = mended.clone();
        belief.change(|manifest| manifest.depth = Some(mended));
    }
    let flipped = order(belief, report, &declared, &depths);
    if !flipped {
        cameras::examine(belief, report, &declared, &depths)?;
    }
    vectors::dilated(belief, report, &depths);
    vectors::missing(belief, report, &depths)
}

/// How often vectors lead to another depth than their pixel's, of how often unrelated places have another. None without depth
/// and motion, and where one depth is hardly told from another.
pub fn misled(belief: &Belief, index: usize) -> Result<Option<f64>, SequenceError> {
    const MIN_UNRELATED: f64 = 0.25;
    let Some(source) = &belief.manifest().depth else {
        return Ok(None);
    };
    let Some(depths) = Depths::load(belief, index)? else {
        return Ok(None);
    };
    let Some(motion) = &depths.motion else {
        return Ok(None);
    };
    let [now, before] = depths.linear(belief, source);
    let (width, height) = (depths.width(), depths.size.height as usize);
    let before_at = |place: DVec2| {
        let is_inside = place.x >= 0.0 && place.y >= 0.0 && place.x < width as f64 && place.y < height as f64;
        is_inside.then(|| before[place.y as usize * width + place.x as usize])
    };
    let [mut n, mut misled, mut unrelated] = [0.0; 3];
    for (i, vector) in motion.iter().enumerate() {
        let place = depths.sample(i) + DVec2::from_array(*vector) - DVec2::from_array(depths.jitter[1]);
        let Some(there) = before_at(place) else { continue };
        let far = [(i % width + width / 3) % width, (i / width + height / 3) % height];
        let differs = |other: f64| f64::from(u8::from(libm::log(now[i] / other).abs() > SAME));
        n += 1.0;
        misled += differs(there);
        unrelated += differs(before[far[1] * width + far[0]]);
    }
    Ok((unrelated > MIN_UNRELATED * n).then(|| misled / unrelated))
}

impl Depths {
    fn load(belief: &Belief, index: usize) -> Result<Option<Self>, SequenceError> {
        let sequence = &belief.sequence;
        let read = |index: usize| {
            let planes = stored::planes(sequence, index, Section::Depth)?;
            Ok::<_, SequenceError>(planes.and_then(|mut planes| planes.pop()))
        };
        let (Some(stored), Some(stored_before)) = (read(index)?, read(index - 1)?) else {
            return Ok(None);
        };
        let motion = belief.motion_px(index)?;
        Ok(Some(Self {
            index,
            size: sequence.render_size(),
            stored,
            stored_before,
            motion,
            jitter: [sequence.jitter_px[index], sequence.jitter_px[index - 1]],
        }))
    }

    fn width(&self) -> usize {
        self.size.width as usize
    }

    fn sample(&self, i: usize) -> DVec2 {
        let (x, y) = (i % self.width(), i / self.width());
        DVec2::new(x as f64 + 0.5 + self.jitter[0][0], y as f64 + 0.5 + self.jitter[0][1])
    }

    /// Linear depths of the frame and of the one before, by a reading.
    fn linear(&self, belief: &Belief, source: &DepthSource) -> [Vec<f64>; 2] {
        let frame = |index: usize, stored: &[f32], jitter: [f64; 2]| {
            let decoder = decoder(belief, source, index);
            let decode = |(i, &value): (usize, &f32)| {
                let (x, y) = (i % self.width(), i / self.width());
                f64::from(decoder.decode(
                    value,
                    DVec2::new(x as f64 + 0.5 + jitter[0], y as f64 + 0.5 + jitter[1]),
                ))
            };
            stored.iter().enumerate().map(decode).collect::<Vec<f64>>()
        };
        [
            frame(self.index, &self.stored, self.jitter[0]),
            frame(self.index - 1, &self.stored_before, self.jitter[1]),
        ]
    }
}

impl Depths {
    /// Distances from the camera, which a turn leaves as they are; depths along the axis where there is no camera. `back` is 0
    /// for the frame, 1 for the one before.
    fn distances(&self, belief: &Belief, back: usize, linear: &[f64]) -> Vec<f64> {
        let Some(camera) = belief.sequence.projectors.get(self.index - back) else {
            return linear.to_vec();
        };
        let [jx, jy] = self.jitter[back];
        let distance = |(i, z): (usize, &f64)| {
            let (x, y) = (i % self.width(), i / self.width());
            z * camera.ray_length(DVec2::new(x as f64 + 0.5 + jx, y as f64 + 0.5 + jy))
        };
        linear.iter().enumerate().map(distance).collect()
    }
}

fn decoder<'a>(belief: &'a Belief, source: &DepthSource, index: usize) -> DepthDecoder<'a> {
    let entry = &belief.manifest().frames[index];
    DepthDecoder {
        kind: source.kind,
        reversed: source.reversed,
        near: entry.near(source).unwrap_or(0.1),
        far: match entry.far(Some(source)) {
            FarPlane::At(far) => far,
            FarPlane::Infinite | FarPlane::Undeclared => f64::INFINITY,
        },
        sky_value: source.sky_value,
        scale: source.scale,
        bias: source.bias,
        camera: belief.sequence.projectors.get(index),
    }
}

/// Values that the declared kind cannot have. Gives the reading that can have them, where there is one.
fn range(report: &mut Report, declared: &DepthSource, depths: &[Depths]) -> Option<DepthSource> {
    let values = || {
        let all = depths.iter().flat_map(|depth| &depth.stored);
        all.map(|&stored| f64::from(stored) * declared.scale + declared.bias)
            .filter(|value| value.is_finite())
    };
    let n = values().count().max(1) as f64;
    let share = |outside: &dyn Fn(f64) -> bool| values().filter(|value| outside(*value)).count() as f64 / n;
    let mut mended = declared.clone();
    match declared.kind {
        DepthKind::Device => {
            let outside = share(&|value| !(-1e-4..=1.0001).contains(&value));
            let signed = share(&|value| (-1.0001..-1e-4).contains(&value));
            if outside <= 0.01 {
                return None;
            }
            let message = format!(
                "{:.0} % of the depths lie outside [0, 1], where device depth lies",
                100.0 * outside
            );
            let finding = Finding::warning("depth.kind", message).with("outside", outside);
            if share(&|value| value > 1.0001) > 0.01 {
                mended.kind = DepthKind::LinearViewZ;
                report.findings.push(finding.suggest("depth.kind", "linear_view_z"));
                return Some(mended);
            }
            if signed > 0.01 {
                (mended.scale, mended.bias) = (0.5 * declared.scale, 0.5 * declared.bias + 0.5);
                report.findings.push(
                    finding
                        .suggest("depth.scale", mended.scale)
                        .suggest("depth.bias", mended.bias),
                );
                return Some(mended);
            }
            report.findings.push(finding);
        }
        DepthKind::LinearViewZ | DepthKind::RayDistance => {
            let behind = share(&|value| value <= 0.0);
            let below_one = share(&|value| (0.0..=1.0).contains(&value));
            if below_one >= 0.999 {
                let message = "all depths lie in [0, 1]: this looks like device depth".to_owned();
                let finding = Finding::warning("depth.kind", message).with("within_0_and_1", below_one);
                report.findings.push(finding.suggest("depth.kind", "device"));
                mended.kind = DepthKind::Device;
                return Some(mended);
            }
            if behind > 0.01 {
                let message = format!("{:.0} % of the depths are not above 0", 100.0 * behind);
                report
                    .findings
                    .push(Finding::warning("depth.range", message).with("not_above_0", behind));
            }
        }
    }
    None
}

/// A surface that was hidden was hidden by something nearer, so the other order cannot be. Gives whether it is.
fn order(belief: &mut Belief, report: &mut Report, declared: &DepthSource, depths: &[Depths]) -> bool {
    let count = |source: &DepthSource| {
        let counts: Vec<[usize; 2]> = depths.par_iter().map(|depth| hidden(belief, source, depth)).collect();
        [0, 1].map(|i| counts.iter().map(|count| count[i]).sum::<usize>())
    };
    let n_pixels: usize = depths.iter().map(|depth| depth.stored.len()).sum();
    let enough = MIN_PIXELS.max(n_pixels / 1000);
    let [mut hidden, mut through] = count(declared);
    if declared.kind == DepthKind::Device && hidden + through < enough {
        // Read in the wrong order, nearly all of the range may be at one plane, where nothing is seen to differ.
        let [nearer, farther] = count(&DepthSource {
            reversed: !declared.reversed,
            ..declared.clone()
        });
        (hidden, through) = (farther, nearer);
    }
    if hidden + through < enough {
        report.cannot_tell("depth.order", "too little is uncovered between frames");
        return false;
    }
    if through <= 2 * hidden {
        if hidden > 4 * through {
            report.confirm("depth.order");
        } else {
            report.cannot_tell("depth.order", "what is uncovered says neither clearly");
        }
        return false;
    }
    let message = format!(
        "depth looks reversed: {through} uncovered pixels were hidden by what is declared farther, {hidden} by what is nearer"
    );
    let finding = Finding::warning("depth.reversed", message)
        .with("hidden_by_nearer", hidden as f64)
        .with("hidden_by_farther", through as f64);
    let finding = match declared.kind {
        DepthKind::Device => finding.suggest("depth.reversed", !declared.reversed),
        _ => finding.suggest("depth.kind", "device").suggest("depth.reversed", true),
    };
    report.findings.push(finding);
    if declared.kind == DepthKind::Device {
        let reversed = !declared.reversed;
        belief.change(|manifest| {
            if let Some(depth) = manifest.depth.as_mut() {
                depth.reversed = reversed;
            }
        });
    }
    true
}

/// How many pixels were hidden in the frame before by something nearer, and how many by something farther.
fn hidden(belief: &Belief, source: &DepthSource, depth: &Depths) -> [usize; 2] {
    let Some(motion) = &depth.motion else {
        return [0; 2];
    };
    let (width, height) = (depth.width(), depth.size.height as usize);
    let linear = depth.linear(belief, source);
    let has_cameras = !belief.sequence.projectors.is_empty();
    let [now, before] = [0, 1].map(|back| depth.distances(belief, back, &linear[back]));
    // A turning camera changes the depth along its axis, by up to this vector's share of the width where the view is 90° wide.
    let longest = if has_cameras {
        f64::INFINITY
    } else {
        width as f64 * SAME / 4.0
    };
    let mut counts = [0; 2];
    for (i, &z) in now.iter().enumerate() {
        if DVec2::from_array(motion[i]).length() > longest {
            continue;
        }
        let at = depth.sample(i) + DVec2::from_array(motion[i]) - DVec2::from_array(depth.jitter[1]);
        let (x, y) = (at.x.floor(), at.y.floor());
        let inside = |x: f64, y: f64| x >= 1.0 && y >= 1.0 && x + 1.0 < width as f64 && y + 1.0 < height as f64;
        let own = [i % width, i / width];
        if !(inside(x, y) && inside(own[0] as f64, own[1] as f64) && z > 0.0) {
            continue;
        }
        let around = |plane: &[f64], x: usize, y: usize| {
            let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
            for row in y - 1..=y + 1 {
                for value in &plane[row * width + x - 1..=row * width + x + 1] {
                    (low, high) = (low.min(*value), high.max(*value));
                }
            }
            (low, high)
        };
        // Thin things come and go between frames by themselves.
        let (own_low, own_high) = around(&now, own[0], own[1]);
        if own_low < z * (1.0 - SAME) || own_high > z * (1.0 + SAME) {
            continue;
        }
        let (low, high) = around(&before, x as usize, y as usize);
        if high < z * (1.0 - SAME) {
            counts[0] += 1;
        } else if low > z * (1.0 + SAME) {
            counts[1] += 1;
        }
    }
    counts
}
