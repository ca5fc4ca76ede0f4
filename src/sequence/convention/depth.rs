//! Stored depth into linear view depth.

use super::Projector;
use crate::sequence::{frame::SKY_DEPTH, manifest::DepthKind};
use glam::DVec2;

/// Turns one frame's stored depth into distance along the view axis.
#[derive(Clone, Copy, Debug)]
pub struct DepthDecoder<'a> {
    /// What the values measure.
    pub kind: DepthKind,
    /// Device depth is 1 at the near plane.
    pub reversed: bool,
    /// Near plane; used by device depth only.
    pub near: f64,
    /// Far plane, perhaps infinite; used by device depth only.
    pub far: f64,
    /// Where sky begins; see `DepthSource::sky_value`.
    pub sky_value: f64,
    /// Multiplies the stored value.
    pub scale: f64,
    /// Added after `scale`.
    pub bias: f64,
    /// The frame's camera; used by ray distance only.
    pub camera: Option<&'a Projector>,
}

impl DepthDecoder<'_> {
    /// Linear view depth of the sample at `position_px`, jitter included; [`SKY_DEPTH`] for sky.
    pub fn decode(&self, stored: f32, position_px: DVec2) -> f32 {
        let value = f64::from(stored) * self.scale + self.bias;
        let (z, distance) = match self.kind {
            DepthKind::LinearViewZ => (value, value),
            DepthKind::RayDistance => {
                let length = self.camera.map_or(1.0, |camera| camera.ray_length(position_px));
                (value / length, value)
            }
            DepthKind::Device => {
                let z = device_to_linear(value, self.near, self.far, self.reversed);
                (z, z)
            }
        };
        // Compared as f32, so that device depth of exactly the far plane meets a sky value of the far plane.
        if z.is_infinite() || distance as f32 >= self.sky_value as f32 {
            SKY_DEPTH
        } else {
            z as f32
        }
    }
}

fn device_to_linear(d: f64, near: f64, far: f64, reversed: bool) -> f64 {
    match (far.is_finite(), reversed) {
        (true, false) => near * far / (far - d * (far - near)),
        (true, true) => near * far / (near + d * (far - near)),
        (false, false) => near / (1.0 - d),
        (false, true) => near / d,
    }
}

#[cfg(test)]
mod tests {
    use super::{super::camera::tests as cameras, *};

    const LINEAR: DepthDecoder<'static> = DepthDecoder {
        kind: DepthKind::LinearViewZ,
        reversed: false,
        near: 0.1,
        far: 100.0,
        sky_value: 1e10,
        scale: 1.0,
        bias: 0.0,
        camera: None,
    };

    /// Device depth from first principles: the projection's third row over clip w, which is −z of OpenGL's view space.
    fn device(z: f64, near: f64, far: f64, reversed: bool) -> f64 {
        let (a, b) = match (far.is_finite(), reversed) {
            (true, false) => (far / (near - far), near * far / (near - far)),
            (true, true) => (near / (far - near), near * far / (far - near)),
            (false, false) => (-1.0, -near),
            (false, true) => (0.0, near),
        };
        (a * -z + b) / z
    }

    #[test]
    fn device_depth_of_every_kind_comes_out_linear() {
        for far in [100.0, f64::INFINITY] {
            for reversed in [false, true] {
                for z in [0.1, 0.15, 1.0, 7.0] {
                    let stored = device(z, 0.1, far, reversed);
                    let decoded = device_to_linear(stored, 0.1, far, reversed);
                    assert!((decoded / z - 1.0).abs() < 1e-9, "{far} {reversed} {z}: {decoded}");
                }
            }
        }
    }

    #[test]
    fn the_signed_range_is_a_scale_and_a_bias() {
        let decoder = DepthDecoder {
            kind: DepthKind::Device,
            scale: 0.5,
            bias: 0.5,
            ..LINEAR
        };
        let signed = 2.0 * device(0.75, 0.1, 100.0, false) - 1.0;
        assert!((decoder.decode(signed as f32, DVec2::ZERO) - 0.75).abs() < 1e-5);
        assert_eq!(decoder.decode(-1.0, DVec2::ZERO), 0.1);
    }

    #[test]
    fn sky_is_what_lies_at_or_beyond_its_value_or_nowhere() {
        assert_eq!(LINEAR.decode(1e10, DVec2::ZERO), SKY_DEPTH);
        assert_eq!(LINEAR.decode(f32::INFINITY, DVec2::ZERO), SKY_DEPTH);
        assert_eq!(LINEAR.decode(99.0, DVec2::ZERO), 99.0);
        let near_sky = DepthDecoder {
            sky_value: 50.0,
            ..LINEAR
        };
        assert_eq!(near_sky.decode(50.0, DVec2::ZERO), SKY_DEPTH);
        assert_eq!(near_sky.decode(49.9, DVec2::ZERO), 49.9);
        let infinite = DepthDecoder {
            kind: DepthKind::Device,
            far: f64::INFINITY,
            reversed: true,
            ..LINEAR
        };
        assert_eq!(infinite.decode(0.0, DVec2::ZERO), SKY_DEPTH);
        let at_far = DepthDecoder {
            kind: DepthKind::Device,
            sky_value: 100.0,
            ..LINEAR
        };
        assert_eq!(at_far.decode(1.0, DVec2::ZERO), SKY_DEPTH);
    }

    #[test]
    fn what_is_no_depth_stays_so() {
        assert!(LINEAR.decode(f32::NAN, DVec2::ZERO).is_nan());
        assert_eq!(LINEAR.decode(-2.0, DVec2::ZERO), -2.0);
    }

    #[test]
    fn ray_distance_is_measured_from_the_eye() {
        let camera = Projector::new(&cameras::camera(0.3, 0.2), cameras::SIZE).unwrap();
        let decoder = DepthDecoder {
            kind: DepthKind::RayDistance,
            camera: Some(&camera),
            ..LINEAR
        };
        let eye = camera.unproject(DVec2::new(5.0, 6.0), 0.0);
        let position = DVec2::new(11.25, 3.5);
        let distance = (camera.unproject(position, 6.5) - eye).length();
        assert!((decoder.decode(distance as f32, position) - 6.5).abs() < 1e-5);
        assert_eq!(decoder.decode(1e10, position), SKY_DEPTH);
    }
}
