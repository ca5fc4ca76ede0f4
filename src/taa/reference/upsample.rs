//! From the input's grid to the output's: the twin of `shaders/taa/temporal/upsample.wgsl`, after Yang et al. 2020, section 5.

use super::{Pixels, RING, color::Color, real::Real, sampling::Position};
use crate::taa::recipe::InputFilter;

/// How far beyond a limit still counts as on it, in output pixels (squared): places that are fractions of small numbers meet
/// the limits exactly, and rounding would put whole columns of them on either side.
const NEARLY: f64 = 1.0 / 65536.0;

impl<R: Real> Pixels<'_, R> {
    /// The input texel that contains the centre of output pixel `p`.
    pub fn input_texel(&self, p: [i64; 2]) -> [i64; 2] {
        self.sizes.render_texel(p.map(|i| i as u32)).map(i64::from)
    }

    /// Of a position in the output.
    pub fn input_position(&self, q: Position<R>) -> Position<R> {
        [q[0] / self.scale[0], q[1] / self.scale[1]]
    }

    /// The colours of the 3×3 samples around `p`, in the order of [`RING`], and where each lies, in output pixels from the
    /// pixel's centre. Outside the image a sample keeps its place and has the nearest texel's colour.
    fn samples(&self, p: [i64; 2]) -> [(Color<R>, [R; 2]); 9] {
        let under = self.input_texel(p);
        RING.map(|offset| {
            let texel = [under[0] + offset[0], under[1] + offset[1]];
            let place = [0, 1].map(|axis| {
                let sample = R::new(texel[axis] as f64 + 0.5) + self.jitter_px[axis];
                self.scale[axis] * sample - R::new(p[axis] as f64 + 0.5)
            });
            (self.color.clamped(texel[0], texel[1]), place)
        })
    }

    /// The mean of the samples by their distance in output pixels; in input pixels where there is no history to keep.
    pub fn upsampled(&self, p: [i64; 2], has_history: bool) -> Color<R> {
        let (mut sum, mut weights) = (Color::default(), R::new(0.0));
        for (color, place) in self.samples(p) {
            let weight = kernel(if has_history { place } else { self.input_position(place) });
            sum = sum + color * weight;
            weights = weights + weight;
        }
        sum * (R::new(1.0) / weights)
    }

    /// How near the nearest sample is, 0 to 1; 1 where the recipe does not upsample.
    pub fn confidence(&self, p: [i64; 2]) -> R {
        if self.recipe.input_filter != InputFilter::Upsample {
            return R::new(1.0);
        }
        let weights = self.samples(p).map(|(_, place)| kernel(place));
        weights.into_iter().fold(R::new(0.0), R::max)
    }

    /// The colours within 1.5 output pixels of the centre of `p`, and the four that surround it.
    pub fn near_samples(&self, p: [i64; 2]) -> impl Iterator<Item = Color<R>> {
        let samples = self.samples(p);
        // Along an axis the centre lies between the middle sample and one of its neighbours.
        let first = samples[0].1.map(|middle| if middle <= R::new(NEARLY) { 0 } else { -1 });
        let samples = RING.into_iter().zip(samples);
        samples.filter_map(move |(offset, (color, [x, y]))| {
            let surrounds = (0..2).all(|axis| (0..=1).contains(&(offset[axis] - first[axis])));
            (surrounds || x * x + y * y <= R::new(2.25 + NEARLY)).then_some(color)
        })
    }
}

/// `exp(-2.29 |d|²)`
fn kernel<R: Real>([x, y]: [R; 2]) -> R {
    (R::new(-2.29) * (x * x + y * y)).exp()
}

#[cfg(test)]
mod tests {
    use crate::{
        image::{Extent, Image},
        metrics::Display,
        sequence::Frame,
        taa::{Precision, Preset, Recipe, reference::Twin},
    };

    fn recipe(overrides: &str) -> Recipe {
        let taau = &Preset::find("taau").unwrap().recipe;
        taau.with(&serde_json::from_str(overrides).unwrap()).unwrap()
    }

    fn row(colors: &[f32], output_size: Extent, index: usize) -> Frame {
        let extent = Extent::new(colors.len() as u32, 1);
        Frame {
            index,
            reset: false,
            jitter_px: [0.0; 2],
            far: 100.0,
            display: Display::default(),
            output_size,
            parity: None,
            color: Image::from_fn(extent, |x, _| [colors[x as usize]; 3]),
            depth: Some(Image::filled(extent, 1.0)),
            motion_px: Some(Image::filled(extent, [0.0; 2])),
            object_id: None,
            albedo: None,
            reactive: None,
            unjittered_color: None,
            reference: None,
            others: None,
        }
    }

    /// Black and white, from 2×1 to 4×2; pixel (1, 0). Along x its samples lie at -2.5 (the edge again), -0.5 and 1.5, the
    /// nearest along y at 0.5. White's share in input pixels is k(0.75) / (k(1.25) + k(0.25) + k(0.75)), where
    /// k(d) = exp(-2.29 d²); in output pixels k(1.5) / (k(2.5) + k(0.5) + k(1.5)). The second frame counts
    /// 0.1 k(0.5)² = 0.031822.
    #[test]
    fn samples_count_by_their_distance_in_output_pixels() {
        let mut twin = Twin::<f64>::new(recipe(r#"{"domain": "linear"}"#), Precision::F32);
        let mut at = |index| {
            let shown = twin.resolve(&row(&[0.0, 1.0], Extent::new(4, 2), index)).shown;
            shown.at(1, 0)[0]
        };
        let [first, second] = [at(0), at(1)];
        assert!((first - 0.235_643).abs() < 1e-6, "{first}");
        assert!((second - 0.228_467).abs() < 1e-6, "{second}");
    }

    /// From 3×1 to 12×4, pixel (5, 1): samples lie at -3.5, 0.5 and 4.5 along both axes. Those that surround its centre
    /// are black; history was white.
    #[test]
    fn the_box_shrinks_to_the_samples_around_a_pixel() {
        let resolved = |neighbourhood: &str| {
            let overrides = format!(r#"{{"domain": "linear", "neighbourhood": "{neighbourhood}"}}"#);
            let mut twin = Twin::<f64>::new(recipe(&overrides), Precision::F32);
            twin.resolve(&row(&[1.0; 3], Extent::new(12, 4), 0));
            let shown = twin.resolve(&row(&[0.0, 0.0, 1.0], Extent::new(12, 4), 1)).shown;
            shown.at(5, 1)[0]
        };
        assert!(resolved("shrunk") < 1e-3);
        assert!(resolved("box3") > 0.9);
    }
}
