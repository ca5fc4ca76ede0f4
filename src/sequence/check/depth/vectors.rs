//! Vectors against depth: spread over silhouettes, or missing where the camera moves.

use super::{Depths, MIN_PIXELS, SAME, decoder};
use crate::sequence::{
    SequenceError,
    check::{
        Belief,
        motion::Pair,
        observe::Guide,
        report::{Finding, Report},
    },
    frame::SKY_DEPTH,
    manifest::DepthSource,
};
use glam::DVec2;
use serde_json::json;

/// Whether vectors of near surfaces were spread over what lies behind their silhouettes.
pub fn dilated(belief: &Belief, report: &mut Report, depths: &[Depths]) {
    let (Some(motion), Some(source)) = (&belief.manifest().motion, &belief.manifest().depth) else {
        return;
    };
    let [mut spread, mut own] = [0_u32; 2];
    for depth in depths {
        let Some(vectors) = &depth.motion else { continue };
        let [z, _] = depth.linear(belief, source);
        let (width, height) = (depth.width(), depth.size.height as usize);
        let at = |x: usize, y: usize| (z[y * width + x], DVec2::from_array(vectors[y * width + x]));
        for y in 2..height.saturating_sub(2) {
            for x in 2..width.saturating_sub(2) {
                let here = at(x, y);
                for (near, inner, outer) in [
                    (at(x - 1, y), at(x - 2, y), at(x + 2, y)),
                    (at(x + 1, y), at(x + 2, y), at(x - 2, y)),
                    (at(x, y - 1), at(x, y - 2), at(x, y + 2)),
                    (at(x, y + 1), at(x, y + 2), at(x, y - 2)),
                ] {
                    let is_edge = near.0 < 0.8 * here.0
                        && (inner.0 / near.0 - 1.0).abs() < SAME
                        && outer.0 > 0.9 * here.0
                        && near.0 > 0.0;
                    let gap = (inner.1 - outer.1).length();
                    if !is_edge || gap.is_nan() || gap < 0.3 {
                        continue;
                    }
                    if (here.1 - inner.1).length() < 0.25 * gap {
                        spread += 1;
                    } else if (here.1 - outer.1).length() < 0.25 * gap {
                        own += 1;
                    }
                }
            }
        }
    }
    if ((spread + own) as usize) < MIN_PIXELS {
        report.cannot_tell("motion.dilated", "too few silhouettes move against what is behind them");
        return;
    }
    let share = f64::from(spread) / f64::from(spread + own);
    let looks = if share > 0.75 {
        true
    } else if share < 0.25 {
        false
    } else {
        report.cannot_tell("motion.dilated", "silhouettes say neither clearly");
        return;
    };
    if looks == motion.dilated {
        report.confirm("motion.dilated");
        return;
    }
    let message = if looks {
        format!(
            "motion looks dilated: {:.0} % of the pixels beside a silhouette have its vector",
            100.0 * share
        )
    } else {
        format!(
            "motion does not look dilated: only {:.0} % of the pixels beside a silhouette have its vector",
            100.0 * share
        )
    };
    report.findings.push(
        Finding::warning("motion.dilated", message)
            .with("share", share)
            .with("silhouette_pixels", f64::from(spread + own))
            .suggest("motion.dilated", looks),
    );
}

/// Vectors that are zero although the camera moves: of the sky, and of surfaces.
pub fn missing(belief: &Belief, report: &mut Report, depths: &[Depths]) -> Result<(), SequenceError> {
    let (Some(source), false) = (&belief.manifest().depth, belief.sequence.projectors.is_empty()) else {
        return Ok(());
    };
    let (mut sky, mut surfaces) = (Group::default(), Group::default());
    for depth in depths {
        gather(belief, source, depth, &mut sky, &mut surfaces)?;
    }
    let share = sky.share();
    if share > 0.5 && sky.n > 50 {
        let message = format!(
            "{:.0} % of the sky has no motion, although the camera moves it by {:.1} px",
            100.0 * share,
            sky.speed()
        );
        // A flat sky does not show whether it moves; one that is painted on the camera rests in the image.
        if sky.moved < 0.7 * sky.still {
            report
                .findings
                .push(sky.describe(Finding::warning("motion.sky", message)));
        } else if sky.still < 0.005 * sky.n_zero as f64 {
            let message = format!("{message}; it is flat, so that only its silhouettes can suffer");
            report.findings.push(sky.describe(Finding::note("motion.sky", message)));
        }
    }
    let share = surfaces.share();
    if share > 0.05 && surfaces.moved < 0.8 * surfaces.still && belief.guide != Guide::Color {
        let message = format!(
            "{:.0} % of the surfaces' pixels have no motion, although the camera moves them by {:.1} px",
            100.0 * share,
            surfaces.speed()
        );
        report
            .findings
            .push(surfaces.describe(Finding::warning("motion.static", message)));
    }
    Ok(())
}

/// Pixels of one kind, and those without motion among them.
#[derive(Default)]
struct Group {
    n: usize,
    n_zero: usize,
    /// Sum of the camera's motion, pixels.
    speeds: f64,
    /// Sums of errors: as they are, and moved as the camera does.
    still: f64,
    moved: f64,
}

impl Group {
    fn share(&self) -> f64 {
        self.n_zero as f64 / self.n.max(1) as f64
    }

    fn mean(&self, sum: f64) -> f64 {
        sum / self.n_zero.max(1) as f64
    }

    fn speed(&self) -> f64 {
        self.mean(self.speeds)
    }

    fn describe(&self, finding: Finding) -> Finding {
        finding
            .with("share", self.share())
            .with("camera_motion_px", self.speed())
            .with("error_without_motion", self.mean(self.still))
            .with("error_with_camera_motion", self.mean(self.moved))
            .suggest("motion.invalid_value", json!([0, 0]))
    }
}

fn gather(
    belief: &Belief,
    source: &DepthSource,
    depth: &Depths,
    sky: &mut Group,
    surfaces: &mut Group,
) -> Result<(), SequenceError> {
    let Some(motion) = &depth.motion else { return Ok(()) };
    let projectors = &belief.sequence.projectors;
    let pair = Pair::load(belief, depth.index)?;
    let (current, previous) = (&projectors[depth.index], &projectors[depth.index - 1]);
    let (now, before) = (
        decoder(belief, source, depth.index),
        decoder(belief, source, depth.index - 1),
    );
    let (width, height) = (depth.width() as f64, f64::from(depth.size.height));
    // Whether the frame before saw sky there and all around.
    let was_sky = |at: DVec2| {
        [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .iter()
            .all(|[dx, dy]| {
                let (x, y) = ((at.x + dx).floor(), (at.y + dy).floor());
                let inside = x >= 0.0 && y >= 0.0 && x < width && y < height;
                inside && before.decode(depth.stored_before[y as usize * depth.width() + x as usize], at) >= SKY_DEPTH
            })
    };
    for i in (0..motion.len()).step_by(3).filter(|&i| !pair.is_derived(i)) {
        let sample = depth.sample(i);
        let z = now.decode(depth.stored[i], sample);
        let derived = current.motion_px(previous, sample, f64::from(z));
        let is_sky = z >= SKY_DEPTH;
        // Silhouettes would tell of what stands before the sky.
        if is_sky && !(was_sky(sample) && was_sky(sample + derived)) {
            continue;
        }
        let group = if is_sky { &mut *sky } else { &mut *surfaces };
        group.n += 1;
        let is_zero = pair.is_zero(i) || DVec2::from_array(motion[i]).length() < 0.01;
        if !is_zero || derived.is_nan() || derived.length() < 0.3 {
            continue;
        }
        let pixel = [i % depth.width(), i / depth.width()];
        let shown = pair.shown(pixel);
        let error = |motion: DVec2| (shown - pair.before().value(pair.place(pixel, motion.to_array()))).abs();
        let (still, moved) = (error(DVec2::ZERO), error(derived));
        if still.is_finite() && moved.is_finite() {
            group.n_zero += 1;
            group.speeds += derived.length();
            group.still += still;
            group.moved += moved;
        }
    }
    Ok(())
}
