//! Several samples, or layers, of each pixel made one: the twin of `shaders/taa/temporal/merge.wgsl`, after Salvi 2016.

use super::{
    color::{Color, F16_MAX, Repaired, repaired},
    real::Real,
    reproject::depth_or_sky,
};
use crate::{
    image::Image,
    sequence::{Frame, Merging, repaired_opacity},
    taa::recipe::Guards,
};

/// Longer than any image, and finite.
const UNUSABLE_PX: f32 = 1e30;

/// The colour of every pixel, and whether any part of it had to be repaired.
pub fn color<R: Real>(frame: &Frame) -> Repaired<R> {
    let first = repaired::<R>(&frame.color, Guards::On);
    let Some(others) = &frame.others else { return first };
    let items: Vec<_> = [first]
        .into_iter()
        .chain(others.color.iter().map(|color| repaired(color, Guards::On)))
        .collect();
    let extent = frame.extent();
    let hostile_opacity = |x, y| {
        others
            .opacity
            .iter()
            .any(|image| !(0.0..=1.0).contains(&image.at(x, y)))
    };
    let hostile = Image::from_fn(extent, |x, y| {
        items.iter().any(|item| item.hostile.at(x, y)) || hostile_opacity(x, y)
    });
    let color = Image::from_fn(extent, |x, y| {
        let colors = items.iter().map(|item| item.color.at(x, y));
        let merged = match others.merging {
            Merging::Samples => {
                let sum = colors.fold(Color::default(), |sum, color| sum + color);
                sum * R::new(1.0 / items.len() as f64)
            }
            Merging::Layers { premultiplied } => {
                let opacities = others.opacity.iter().map(|image| repaired_opacity(image.at(x, y)));
                over(colors.zip(opacities), premultiplied)
            }
        };
        merged.min(Color::splat(F16_MAX))
    });
    Repaired { color, hostile }
}

/// Front to back, black behind all.
fn over<R: Real>(layers: impl Iterator<Item = (Color<R>, f64)>, premultiplied: bool) -> Color<R> {
    let (mut sum, mut transmittance) = (Color::default(), R::new(1.0));
    for (color, opacity) in layers {
        let opacity = R::new(opacity);
        let share = if premultiplied {
            transmittance
        } else {
            transmittance * opacity
        };
        sum = sum + color * share;
        transmittance = transmittance * (R::new(1.0) - opacity);
    }
    sum
}

/// The motion of every pixel; what cannot be used is longer than any image.
pub fn motion_px(frame: &Frame) -> Option<Image<[f32; 2]>> {
    let longest = frame.longest_motion_px();
    let usable = |[x, y]: [f32; 2]| {
        let length2 = f64::from(x) * f64::from(x) + f64::from(y) * f64::from(y);
        if length2 <= longest * longest {
            [x, y]
        } else {
            [UNUSABLE_PX; 2]
        }
    };
    frame.merged_motion_px().map(|motion| motion.map(usable))
}

/// The depth of every pixel; what is none is sky.
pub fn depth(frame: &Frame) -> Option<Image<f32>> {
    let own = frame.depth.as_ref()?;
    Some(Image::from_fn(own.extent(), |x, y| {
        let depth = frame.depth_of(frame.kept_item(x, y)).unwrap_or(own);
        depth_or_sky(depth.at(x, y)) as f32
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.25 of white over 0.5 of mid-grey over black: 0.25 + 0.75 · 0.5 · 0.5 = 0.4375, and behind all nothing.
    #[test]
    fn layers_lie_over_each_other() {
        let layer = |value: f64, opacity: f64| (Color::<f64>::splat(value), opacity);
        let plain = over([layer(1.0, 0.25), layer(0.5, 0.5), layer(0.0, 1.0)].into_iter(), false);
        assert_eq!(plain, Color::splat(0.4375));
        let premultiplied = over([layer(0.25, 0.25), layer(0.25, 0.5), layer(0.0, 1.0)].into_iter(), true);
        assert_eq!(premultiplied, plain);
        let reversed = over([layer(0.5, 0.5), layer(1.0, 0.25), layer(0.0, 1.0)].into_iter(), false);
        assert_eq!(reversed, Color::splat(0.375));
    }
}
