//! Frames that need no renderer: noise, and a picture whose every displacement is known.

use crate::{
    image::{Extent, Image},
    metrics::Display,
    random::lattice,
    sequence::{Frame, frame::Rgb},
};

/// How the picture moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shift {
    /// Half a pixel along both axes, to and fro.
    Half,
    /// By offsets drawn anew each frame, within [`MAX_SHIFT_PX`] of where it began.
    Random,
}

/// The furthest that [`Shift::Random`] goes, pixels.
pub const MAX_SHIFT_PX: f64 = 4.0;

/// Independent noise, uniform in 0 to 1, that does not move.
pub fn noise_frame(extent: Extent, index: usize) -> Frame {
    let seed = index as u64 * 3;
    let color = Image::from_fn(extent, |x, y| {
        let at = u64::from(y) << 32 | u64::from(x);
        [0, 1, 2].map(|channel| uniform(at, seed + channel) as f32)
    });
    frame(index, extent, color, [0.0; 2])
}

/// The picture in frame `index` of its walk.
pub fn shifted_frame(extent: Extent, shift: Shift, index: usize) -> Frame {
    let [x, y] = offset_px(shift, index);
    let motion_px = match index {
        0 => [0.0; 2],
        _ => {
            let before = offset_px(shift, index - 1);
            [before[0] - x, before[1] - y]
        }
    };
    let color = picture(extent, [-x, -y]);
    frame(index, extent, color, motion_px.map(|value| value as f32))
}

/// Frames for an output of another size, which move by a fraction of a pixel.
pub fn upscaled_frame(render: Extent, output: Extent, index: usize) -> Frame {
    let t = index as f64;
    let color = picture(render, [0.37 * t, 0.0]);
    Frame {
        output_size: output,
        ..frame(index, render, color, [0.37, 0.0])
    }
}

fn frame(index: usize, extent: Extent, color: Image<Rgb>, motion_px: [f32; 2]) -> Frame {
    Frame {
        index,
        reset: false,
        jitter_px: [0.0; 2],
        far: 100.0,
        display: Display::default(),
        output_size: extent,
        parity: None,
        color,
        depth: Some(Image::filled(extent, 1.0)),
        motion_px: Some(Image::filled(extent, motion_px)),
        object_id: None,
        albedo: None,
        reactive: None,
        unjittered_color: None,
        reference: None,
        others: None,
    }
}

/// Where the picture is in frame `index`.
fn offset_px(shift: Shift, index: usize) -> [f64; 2] {
    match shift {
        Shift::Half => [0.5 * (index % 2) as f64; 2],
        Shift::Random => [0, 1].map(|axis| (2.0 * uniform(index as u64, 1000 + axis) - 1.0) * MAX_SHIFT_PX),
    }
}

/// Waves of all directions, the finest of 3 pixels, the finer the fainter: as photographs have them. Texel `(x, y)` shows the
/// point `(x, y) + offset_px`.
fn picture(extent: Extent, offset_px: [f64; 2]) -> Image<Rgb> {
    const N_WAVES: u64 = 48;
    let waves: Vec<Wave> = (0..N_WAVES).map(|index| Wave::new(extent, offset_px, index)).collect();
    Image::from_fn(extent, |x, y| {
        let mut sums = [0.0; 3];
        for wave in &waves {
            let ([sin_x, cos_x], [sin_y, cos_y]) = (wave.along_x[x as usize], wave.along_y[y as usize]);
            let value = sin_x * cos_y + cos_x * sin_y;
            for (sum, amplitude) in sums.iter_mut().zip(wave.amplitudes) {
                *sum += value * amplitude;
            }
        }
        sums.map(|sum| (0.5 + 0.08 * sum) as f32)
    })
}

/// The sine and cosine of a wave's phase along each axis: the sine of their sum needs no more.
struct Wave {
    along_x: Vec<[f64; 2]>,
    along_y: Vec<[f64; 2]>,
    amplitudes: [f64; 3],
}

impl Wave {
    fn new(extent: Extent, offset_px: [f64; 2], index: u64) -> Self {
        let length_px = 3.0 * libm::exp2(5.0 * uniform(index, 1));
        let angle = std::f64::consts::TAU * uniform(index, 2);
        let along = |n: u32, offset_px: f64, direction: f64, phase: f64| -> Vec<[f64; 2]> {
            let at = |i| std::f64::consts::TAU * ((f64::from(i) + offset_px) * direction / length_px + phase);
            (0..n).map(|i| [libm::sin(at(i)), libm::cos(at(i))]).collect()
        };
        Self {
            along_x: along(extent.width, offset_px[0], libm::cos(angle), uniform(index, 3)),
            along_y: along(extent.height, offset_px[1], libm::sin(angle), 0.0),
            amplitudes: [4, 5, 6].map(|stream| uniform(index, stream) * libm::sqrt(length_px / 96.0)),
        }
    }
}

/// A repeatable number in 0 to 1 for each pair.
fn uniform(index: u64, stream: u64) -> f64 {
    lattice(index as i64, stream as i64, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_leads_back_to_where_the_picture_was() {
        let extent = Extent::new(64, 64);
        let (before, now) = (offset_px(Shift::Random, 6), offset_px(Shift::Random, 7));
        let frame = shifted_frame(extent, Shift::Random, 7);
        let [mx, my] = frame.motion_px.as_ref().unwrap().at(0, 0).map(f64::from);
        let one = Extent::new(1, 1);
        let here = picture(one, [20.0 - now[0], 30.0 - now[1]]).at(0, 0);
        let there = picture(one, [20.0 + mx - before[0], 30.0 + my - before[1]]).at(0, 0);
        for i in 0..3 {
            assert!((here[i] - there[i]).abs() < 1e-6 && (here[i] - frame.color.at(20, 30)[i]).abs() < 1e-6);
        }
        assert!((here[0] - frame.color.at(21, 30)[0]).abs() > 1e-4);
    }

    #[test]
    fn the_picture_stays_within_display_range_and_has_detail() {
        let image = shifted_frame(Extent::new(192, 192), Shift::Half, 0).color;
        let values = || image.pixels().iter().flatten().copied();
        assert!(values().all(|value| (0.0..=1.0).contains(&value)));
        let neighbours = image.row(50).windows(2).map(|pair| (pair[0][0] - pair[1][0]).abs());
        assert!(neighbours.fold(0.0, f32::max) > 0.05);
    }

    #[test]
    fn noise_is_uniform_and_new_in_each_frame() {
        let [a, b] = [0, 1].map(|index| noise_frame(Extent::new(64, 64), index).color);
        let mean = a.pixels().iter().flatten().sum::<f32>() / (3.0 * 64.0 * 64.0);
        assert!((mean - 0.5).abs() < 0.01, "{mean}");
        assert_ne!(a, b);
    }
}
