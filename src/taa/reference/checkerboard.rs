//! The pixels that a frame did not shade: the twin of `shaders/taa/checkerboard`, after Yang et al. 2020, section 5.3.

use super::{Pixels, color::Color, neighbourhood::minmax, real::Real};
use crate::image::Image;

const HORIZONTAL: [[i64; 2]; 2] = [[-1, 0], [1, 0]];
const VERTICAL: [[i64; 2]; 2] = [[0, -1], [0, 1]];
/// The neighbours of the other parity, row by row.
const SIDES: [[i64; 2]; 4] = [[0, -1], [-1, 0], [1, 0], [0, 1]];

impl<R: Real> Pixels<'_, R> {
    /// The algorithm on the whole frame; in the working domain, not rounded.
    pub fn checkerboard(&self) -> Image<Color<R>> {
        let parity = self.frame.parity.expect("validated: the recipe fills a checkerboard");
        Image::from_fn(self.color.extent(), |x, y| {
            let color = if (x + y) % 2 == parity {
                self.color.at(x, y)
            } else {
                self.filled([x.into(), y.into()])
            };
            self.saturated(color)
        })
    }

    /// A pixel that was not shaded.
    fn filled(&self, p: [i64; 2]) -> Color<R> {
        let interpolated = self.interpolated(p);
        let sides: Vec<_> = SIDES
            .into_iter()
            .filter(|side| self.shaded(p, *side).is_some())
            .collect();
        let motion = self.dilated(p, &sides);
        match motion
            .and_then(|motion| self.reproject_by(p, motion))
            .zip(self.previous)
        {
            None => interpolated,
            Some((at, previous)) => {
                let colors = sides.iter().filter_map(|side| self.shaded(p, *side));
                let bounds = minmax(colors.map(|color| color.to_space(self.recipe.space)));
                self.rectified(p, self.filtered(previous.history(), at.q), interpolated, &bounds)
            }
        }
    }

    /// The mean of the sides; opposite ones count by how alike they are. One outside the image does not count, and the other
    /// of its pair as if they differed by 1. Black where there is no side at all.
    fn interpolated(&self, p: [i64; 2]) -> Color<R> {
        let (mut sum, mut weights) = (Color::default(), R::new(0.0));
        for pair in [HORIZONTAL, VERTICAL] {
            let colors = pair.map(|side| self.shaded(p, side));
            let difference = match colors {
                [Some(a), Some(b)] => (a.luma() - b.luma()).abs(),
                _ => R::new(1.0),
            };
            let weight = R::new(1.0) / (difference + R::new(1e-3));
            for color in colors.into_iter().flatten() {
                sum = sum + color * weight;
                weights = weights + weight;
            }
        }
        if weights > R::new(0.0) {
            sum * (R::new(1.0) / weights)
        } else {
            Color::default()
        }
    }

    /// The colour beside `p`, which is not shaded itself; none outside the image.
    fn shaded(&self, [x, y]: [i64; 2], [i, j]: [i64; 2]) -> Option<Color<R>> {
        let extent = self.color.extent();
        let x = u32::try_from(x + i).ok().filter(|x| *x < extent.width)?;
        let y = u32::try_from(y + j).ok().filter(|y| *y < extent.height)?;
        Some(self.color.at(x, y))
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        image::{Extent, Image},
        metrics::Display,
        sequence::Frame,
        taa::{Precision, Preset, reference::Twin},
    };

    const EXTENT: Extent = Extent::new(3, 3);

    fn frame(index: usize, gray: [[f32; 3]; 3]) -> Frame {
        Frame {
            index,
            reset: false,
            jitter_px: [0.0; 2],
            far: 100.0,
            display: Display::default(),
            output_size: EXTENT,
            parity: Some(1 - index as u32),
            color: Image::from_fn(EXTENT, |x, y| [gray[y as usize][x as usize]; 3]),
            depth: Some(Image::filled(EXTENT, 1.0)),
            motion_px: Some(Image::filled(EXTENT, [0.0; 2])),
            object_id: None,
            albedo: None,
            reactive: None,
            unjittered_color: None,
            reference: None,
            others: None,
        }
    }

    /// The first frame shades the sides of the middle. Left and right are alike and weigh 1000, up and down differ by 0.4 and
    /// weigh 1 / 0.401 = 2.4938: (1000 · 1.0 + 2.4938 · 0.8) / (2 · 1002.4938) = 0.499751. A corner has one side of each
    /// pair, which weigh alike. The second frame shades the others: history 0.2 above the middle lies within 0.1 and 0.4 and
    /// stays; history 0.6 below it does not, and comes to the nearer end of 0.3 to 0.4.
    #[test]
    fn gaps_are_interpolated_first_and_history_afterwards() {
        let recipe = Preset::find("checkerboard")
            .unwrap()
            .recipe
            .with(&serde_json::from_str(r#"{"domain": "linear"}"#).unwrap());
        let mut twin = Twin::<f64>::new(recipe.unwrap(), Precision::F32);
        let first = twin
            .resolve(&frame(0, [[9.0, 0.2, 9.0], [0.5, 9.0, 0.5], [9.0, 0.6, 9.0]]))
            .shown;
        let second = twin
            .resolve(&frame(1, [[0.1, 9.0, 0.4], [9.0, 0.3, 9.0], [0.4, 9.0, 0.4]]))
            .shown;
        for (found, expected) in [
            (first.at(1, 1), 0.499_751),
            (first.at(0, 0), 0.35),
            (first.at(1, 0), 0.2),
            (second.at(1, 1), 0.3),
            (second.at(1, 0), 0.2),
            (second.at(1, 2), 0.4),
        ] {
            assert!((found[0] - expected).abs() < 1e-6, "{found:?}, not {expected}");
        }
    }
}
