//! Rectification: the twin of `shaders/common/rectify.wgsl`.

use super::{color::Color, neighbourhood::ColorBox, real::Real};
use crate::taa::recipe::Domain;

/// Towards the box's centre until inside. Half extents are kept above f16's own step, or the rounding of one flat
/// channel would collapse all three.
pub fn clip_centre<R: Real>(history: Color<R>, bounds: &ColorBox<R>, domain: Domain, guarded: bool) -> Color<R> {
    let step = R::new(1.0 / 2048.0);
    let centre = (bounds.lo + bounds.hi) * R::new(0.5);
    let smallest = match domain {
        _ if !guarded => Color::default(),
        Domain::Linear => centre.max(Color::splat(1.0)) * step,
        Domain::Tonemapped | Domain::Display => Color::splat(1.0) * step,
    };
    let half_extent = ((bounds.hi - bounds.lo) * R::new(0.5)).max(smallest);
    let offset = history - centre;
    let u = offset.zip(half_extent, |o, e| o.abs() / e).max3();
    if u > R::new(1.0) {
        centre + offset * (R::new(1.0) / u)
    } else {
        history
    }
}

/// The nearest point inside the box on the segment that ends at `current`, or at the box's mean where `current` is
/// outside.
pub fn clip_current<R: Real>(history: Color<R>, current: Color<R>, bounds: &ColorBox<R>, guarded: bool) -> Color<R> {
    let is_inside = beyond(current, bounds, guarded) == Color::default();
    let end = if is_inside { current } else { bounds.mean };
    let direction = end - history;
    let excess = beyond(history, bounds, guarded);
    let mut travel = R::new(0.0);
    for i in 0..3 {
        // A channel inside need not move; only there can its direction be 0.
        if excess.0[i] != R::new(0.0) {
            travel = travel.max(-excess.0[i] / direction.0[i]);
        }
    }
    (history + direction * travel.min(R::new(1.0))).clamp(bounds.lo, bounds.hi)
}

/// How far each channel of `c` lies outside the box; 0 within rounding of it. Without the allowance, a channel that is
/// flat but for the last bit would drag all three the whole way, in f32 and not in f64.
fn beyond<R: Real>(c: Color<R>, bounds: &ColorBox<R>, guarded: bool) -> Color<R> {
    let excess = c - c.clamp(bounds.lo, bounds.hi);
    let largest = bounds.lo.map(R::abs).max(bounds.hi.map(R::abs)).max(Color::splat(1.0));
    let rounding = largest * R::new(if guarded { 1.0 / 1_048_576.0 } else { 0.0 });
    excess.zip(
        rounding,
        |excess, rounding| if excess.abs() > rounding { excess } else { R::new(0.0) },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(lo: [f64; 3], hi: [f64; 3]) -> ColorBox<f64> {
        let (lo, hi) = (Color(lo), Color(hi));
        ColorBox {
            lo,
            hi,
            mean: (lo + hi) * 0.5,
        }
    }

    #[test]
    fn clip_centre_keeps_the_direction_from_the_centre() {
        let unit = bounds([0.0; 3], [1.0; 3]);
        let clipped = clip_centre(Color([2.5, 1.5, 0.5]), &unit, Domain::Tonemapped, true);
        assert_eq!(clipped, Color([1.0, 0.75, 0.5]));
    }

    #[test]
    fn clip_centre_spares_a_flat_channel_within_one_f16_step() {
        let flat = bounds([0.0, 0.5, 0.0], [1.0, 0.5, 1.0]);
        let history = Color([0.9, 0.5 + 1.0 / 4096.0, 0.1]);
        assert_eq!(clip_centre(history, &flat, Domain::Tonemapped, true), history);
    }

    #[test]
    fn clip_current_walks_towards_the_current_colour() {
        let unit = bounds([0.0; 3], [1.0; 3]);
        let clipped = clip_current(Color([2.0, 0.5, 0.5]), Color([0.0, 0.5, 1.0]), &unit, true);
        assert_eq!(clipped, Color([1.0, 0.5, 0.75]));
    }

    #[test]
    fn clip_current_takes_rounding_for_inside() {
        let flat = bounds([0.0, 0.5, 0.0], [1.0, 0.5, 1.0]);
        let clipped = clip_current(Color([0.9, 0.5 + 1e-9, 0.1]), Color([0.2, 0.5, 0.8]), &flat, true);
        assert_eq!(clipped, Color([0.9, 0.5, 0.1]));
    }

    #[test]
    fn clip_current_ends_at_the_mean_where_the_current_colour_is_outside() {
        let unit = bounds([0.0; 3], [1.0; 3]);
        let clipped = clip_current(Color([1.5, 0.5, 0.5]), Color([3.0, 0.5, 0.5]), &unit, true);
        assert_eq!(clipped, Color([1.0, 0.5, 0.5]));
    }
}
