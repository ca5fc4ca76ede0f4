//! Stored motion vectors into pixels from now to then, jitter removed.

use super::downwards;
use crate::{
    image::Extent,
    sequence::manifest::{InvalidMotion, MotionDirection, MotionSource, MotionUnits},
};

/// Turns one frame's stored motion into where a surface was minus where it is, in pixels with y down.
#[derive(Clone, Copy, Debug)]
pub struct MotionDecoder {
    scale: [f64; 2],
    bias: [f64; 2],
    /// Pixels, with the signs of y and direction.
    unit_px: [f64; 2],
    /// Change of jitter that the vectors contain.
    jitter_px: [f64; 2],
    invalid: Option<InvalidMotion>,
}

impl MotionDecoder {
    /// For a frame with the sample offset `jitter_px`, whose predecessor had `previous_jitter_px`.
    pub fn new(
        source: &MotionSource,
        render_size: Extent,
        output_size: Extent,
        jitter_px: [f64; 2],
        previous_jitter_px: [f64; 2],
    ) -> Self {
        let render = [f64::from(render_size.width), f64::from(render_size.height)];
        let output = [f64::from(output_size.width), f64::from(output_size.height)];
        let unit_px = match source.units {
            MotionUnits::PixelsRender => [1.0, 1.0],
            MotionUnits::PixelsOutput => [render[0] / output[0], render[1] / output[1]],
            MotionUnits::Uv => render,
            MotionUnits::Ndc => [0.5 * render[0], 0.5 * render[1]],
        };
        let to_previous = match source.direction {
            MotionDirection::CurrentToPrevious => 1.0,
            MotionDirection::PreviousToCurrent => -1.0,
        };
        // A sample's place in a jittered image is its position minus the jitter; so a jittered vector holds
        // (then − J_then) − (now − J_now), and this is what it lacks.
        let jitter_px = match source.jittered {
            true => [
                previous_jitter_px[0] - jitter_px[0],
                previous_jitter_px[1] - jitter_px[1],
            ],
            false => [0.0, 0.0],
        };
        Self {
            scale: source.scale,
            bias: source.bias,
            unit_px: [unit_px[0] * to_previous, unit_px[1] * to_previous * downwards(source.y)],
            jitter_px,
            invalid: source.invalid_value,
        }
    }

    /// The motion in pixels; none where the stored value says that it comes from depth and the cameras.
    pub fn decode(&self, stored: [f32; 2]) -> Option<[f32; 2]> {
        let is = |stored: f32, invalid: f64| stored == invalid as f32;
        let invalid = match self.invalid {
            None => false,
            Some(InvalidMotion::X(x)) => is(stored[0], x),
            Some(InvalidMotion::Xy([x, y])) => is(stored[0], x) && is(stored[1], y),
        };
        let axis = |i: usize| {
            let value = f64::from(stored[i]) * self.scale[i] + self.bias[i];
            // Adding zero turns −0 into 0.
            (value * self.unit_px[i] + self.jitter_px[i] + 0.0) as f32
        };
        (!invalid).then(|| [axis(0), axis(1)])
    }
}

#[cfg(test)]
mod tests {
    use super::{super::Projector, super::camera::tests as cameras, *};
    use crate::sequence::manifest::{PathTemplate, YAxis};
    use glam::{DVec2, DVec3};

    const RENDER: Extent = cameras::SIZE;
    const OUTPUT: Extent = Extent::new(128, 144);
    const J: [f64; 2] = [0.25, -0.375];
    const J_PREVIOUS: [f64; 2] = [-0.4375, 0.1];

    fn source(units: MotionUnits, direction: MotionDirection, y: YAxis, jittered: bool) -> MotionSource {
        MotionSource {
            path: PathTemplate::parse("motion.exr").unwrap(),
            channels: ["X".to_owned(), "Y".to_owned()],
            units,
            direction,
            y,
            scale: [1.0, 1.0],
            bias: [0.0, 0.0],
            jittered,
            dilated: false,
            invalid_value: None,
        }
    }

    /// A point seen by a panning camera in two frames, written down in each of the 32 conventions as an engine would:
    /// from its clip-space positions, with the jitter in the projection or without.
    #[test]
    fn a_pan_is_the_same_in_every_convention() {
        use {MotionDirection::*, MotionUnits::*, YAxis::*};
        let [current, previous] =
            [(0.2, 0.05), (0.0, 0.0)].map(|(x, yaw)| Projector::new(&cameras::camera(x, yaw), RENDER).unwrap());
        let point = DVec3::new(0.8, 1.1, -5.0);
        let now = current.project(point).unwrap();
        let then = previous.project(point).unwrap();
        let expected = then - now;
        assert!(expected.length() > 2.0, "the pan must be seen");
        let render = DVec2::new(64.0, 48.0);
        for (units, unit_px) in [
            (PixelsRender, DVec2::ONE),
            (PixelsOutput, DVec2::new(0.5, 1.0 / 3.0)),
            (Uv, render),
            (Ndc, render / 2.0),
        ] {
            for direction in [CurrentToPrevious, PreviousToCurrent] {
                for y in [Down, Up] {
                    for jittered in [false, true] {
                        let seen = |at: DVec2, jitter: [f64; 2]| match jittered {
                            true => at - DVec2::from_array(jitter),
                            false => at,
                        };
                        let mut stored = (seen(then, J_PREVIOUS) - seen(now, J)) / unit_px;
                        if direction == PreviousToCurrent {
                            stored = -stored;
                        }
                        if y == Up {
                            stored.y = -stored.y;
                        }
                        let source = source(units, direction, y, jittered);
                        let decoder = MotionDecoder::new(&source, RENDER, OUTPUT, J, J_PREVIOUS);
                        let [x, y] = decoder.decode([stored.x as f32, stored.y as f32]).unwrap();
                        let error = DVec2::new(x.into(), y.into()) - expected;
                        assert!(error.length() < 1e-5, "{source:?}: {error}");
                    }
                }
            }
        }
        // The same from depth alone, for which the surface's depth is needed: clip w of the current camera.
        let derived = current.motion_px(&previous, now, clip_w(point));
        assert!((derived - expected).length() < 1e-9);
    }

    /// Depth of `point` in the pan's current camera, from its view matrix: −z of view space.
    fn clip_w(point: DVec3) -> f64 {
        let [_, _, row, _] = cameras::camera(0.2, 0.05).view;
        -(row[0] * point.x + row[1] * point.y + row[2] * point.z + row[3])
    }

    #[test]
    fn scale_and_bias_come_before_units() {
        let mut source = source(MotionUnits::Uv, MotionDirection::CurrentToPrevious, YAxis::Down, false);
        source.scale = [2.0, 4.0];
        source.bias = [-1.0, -2.0];
        let decoder = MotionDecoder::new(&source, RENDER, OUTPUT, J, J_PREVIOUS);
        assert_eq!(decoder.decode([0.5, 0.5]), Some([0.0, 0.0]));
        assert_eq!(decoder.decode([0.75, 0.75]), Some([32.0, 48.0]));
    }

    #[test]
    fn invalid_vectors_are_found_before_scale_and_bias() {
        let mut source = source(MotionUnits::Ndc, MotionDirection::PreviousToCurrent, YAxis::Up, false);
        source.bias = [0.5, 0.5];
        source.invalid_value = Some(InvalidMotion::X(0.0));
        let decoder = MotionDecoder::new(&source, RENDER, OUTPUT, J, J_PREVIOUS);
        assert_eq!(decoder.decode([0.0, 0.3]), None);
        assert!(decoder.decode([0.3, 0.0]).is_some());
        source.invalid_value = Some(InvalidMotion::Xy([0.0, 0.1]));
        let decoder = MotionDecoder::new(&source, RENDER, OUTPUT, J, J_PREVIOUS);
        assert!(decoder.decode([0.0, 0.3]).is_some());
        assert_eq!(decoder.decode([0.0, 0.1]), None);
    }

    #[test]
    fn non_finite_motion_stays_so() {
        let source = source(MotionUnits::Uv, MotionDirection::CurrentToPrevious, YAxis::Up, false);
        let decoder = MotionDecoder::new(&source, RENDER, OUTPUT, J, J_PREVIOUS);
        let [x, y] = decoder.decode([f32::NAN, f32::INFINITY]).unwrap();
        assert!(x.is_nan() && y.is_infinite());
    }
}
