//! Metrics over masks, against values by hand, and against each other.

use crate::support::{noise, perfect};
use afterimage::{
    image::{Extent, Image},
    metrics::{Display, FrameScores, LateValue, Mask, Metric, Picture, Reference, Track, display::linear_from_srgb},
    sequence::frame::Rgb,
};
use std::sync::Arc;

/// Wide enough for MS-SSIM.
const EXTENT: Extent = Extent::new(320, 168);
/// Pixels on the left of this column move a pixel a frame to the right.
const STANDS_FROM: u32 = 160;
/// The columns of a square that moves over a flat ground, in the first frame.
const SQUARE: [u32; 2] = [20, 36];

fn metric(id: &str) -> Metric {
    id.parse().unwrap()
}

fn picture(display: impl Fn(u32, u32) -> f64 + Sync) -> Picture {
    let linear: Image<Rgb> = Image::from_fn(EXTENT, |x, y| [linear_from_srgb(display(x, y)) as f32; 3]);
    Picture::linear(linear, Display::default())
}

/// A ground of 0.3 on which a square of 0.7 moves right by a pixel a frame; still texture on the right.
fn reference(frame: u32) -> impl Fn(u32, u32) -> f64 + Sync + Copy {
    move |x, y| match x >= STANDS_FROM {
        true => 0.2 + 0.6 * f64::from(noise(x / 2, y / 2, 3)),
        false if (SQUARE[0] + frame..SQUARE[1] + frame).contains(&x) && (40..100).contains(&y) => 0.7,
        false => 0.3,
    }
}

/// Only the square's pixels and the ground around it on the left move.
fn motion_px() -> Arc<Image<[f32; 2]>> {
    Arc::new(Image::from_fn(EXTENT, |x, _| {
        [if x < STANDS_FROM { -1.0 } else { 0.0 }, 0.0]
    }))
}

/// Scores two frames; the error of the second is `error(x)`.
fn second_frame(metrics: &[Metric], error: impl Fn(u32) -> f64 + Sync + Copy) -> (FrameScores, Vec<LateValue>) {
    let mut track = Track::new(metrics);
    let first = Reference::new(picture(reference(0)), metrics);
    track.score(&first, &picture(reference(0)), true).unwrap();
    let second = first.follow(picture(reference(1)), Some(&motion_px()));
    let test = picture(move |x, y| reference(1)(x, y) + error(x));
    let scores = track.score(&second, &test, true).unwrap();
    (scores, track.finish())
}

#[test]
fn masked_errors_by_hand() {
    let metrics = [
        "mse.static",
        "mse.moving",
        "mse.disoccluded",
        "mse",
        "flicker.static",
        "flicker.moving",
    ]
    .map(metric);
    let (scores, _) = second_frame(&metrics, |x| match x {
        0 => 0.05,
        x if x < STANDS_FROM => 0.01,
        _ => -0.02,
    });
    let value = |id: &str| scores.values[id].0;
    let near = |id: &str, expected: f64| {
        assert!(
            (value(id) - expected).abs() < 1e-8,
            "{id}: {}, not {expected}",
            value(id)
        )
    };
    let [width, n_moving] = [EXTENT.width, STANDS_FROM].map(f64::from);
    let moving = (0.05 * 0.05 + (n_moving - 1.0) * 0.01 * 0.01) / n_moving;
    near("mse.static", 4e-4);
    near("mse.moving", moving);
    near("mse", (moving * n_moving + 4e-4 * (width - n_moving)) / width);
    // The motion leads out of the image from the first column alone: the square's edges move with it.
    near("mse.disoccluded", 0.05 * 0.05);
    near("flicker.static", 0.02);
    near("flicker.moving", (0.05 + (n_moving - 1.0) * 0.01) / n_moving);
}

/// Where vectors say that nothing moves, what the square leaves behind is not found again.
#[test]
fn what_the_reference_uncovers_is_disoccluded() {
    let metrics = ["mse.disoccluded", "psnr.moving"].map(metric);
    let first = Reference::new(picture(reference(0)), &metrics);
    let mut track = Track::new(&metrics);
    track.score(&first, &picture(reference(0)), true).unwrap();
    let still = Arc::new(Image::filled(EXTENT, [0.0, 0.009]));
    let second = first.follow(picture(reference(1)), Some(&still));
    // Wrong in the two columns of the square's edges, 60 rows each, and nowhere else.
    let edges = |x: u32| x == SQUARE[0] || x == SQUARE[1];
    let test = picture(move |x, y| reference(1)(x, y) + if edges(x) && (40..100).contains(&y) { 0.1 } else { 0.0 });
    let scores = track.score(&second, &test, true).unwrap();
    // A last row of vectors leads out of the image.
    let n = 2.0 * 60.0 + f64::from(EXTENT.width);
    let expected = 2.0 * 60.0 * 0.1 * 0.1 / n;
    let actual = scores.values["mse.disoccluded"].0;
    assert!((actual - expected).abs() < 1e-8, "{actual}, not {expected}");
    assert!(!scores.values.contains_key("psnr.moving"), "nothing moves: {scores:?}");
}

/// An error that lies where things move leaves every metric perfect where nothing does, as far as its window sees.
#[test]
fn every_metric_keeps_to_its_mask() {
    let spatial = Metric::ALL.into_iter().filter(|metric| !metric.is_temporal());
    let all: Vec<Metric> = spatial
        .flat_map(|metric| [metric.over(Mask::Static), metric.over(Mask::Moving)])
        .flatten()
        .collect();
    let (scores, _) = second_frame(&all, |x| if x < STANDS_FROM - 20 { 0.1 } else { 0.0 });
    for metric in all {
        let value = scores.values[metric.id()].0;
        match metric.mask() {
            // Coarse scales see further than 20 pixels.
            Some(Mask::Static) if metric.id() == "ms_ssim.y.static" => assert!(value > 0.98 && value < 1.0, "{value}"),
            Some(Mask::Static) => assert_eq!(value, perfect(metric), "{metric}"),
            _ => assert_ne!(value, perfect(metric), "{metric}"),
        }
    }
}

/// All pixels are either still or moving, so a mean over all lies between theirs, at their share.
#[test]
fn masks_add_up() {
    for id in ["mse", "rel_mse", "smape", "flip", "hdr_flip"] {
        let ids = [id.to_owned(), format!("{id}.static"), format!("{id}.moving")];
        let (scores, _) = second_frame(&ids.each_ref().map(|id| metric(id)), |x| {
            0.1 * f64::from(noise(x, 1, 1))
        });
        let [all, still, moving] = ids.each_ref().map(|id| scores.values[&**id].0);
        let share = f64::from(STANDS_FROM) / f64::from(EXTENT.width);
        let expected = share * moving + (1.0 - share) * still;
        assert!((all - expected).abs() < 1e-7 * all, "{id}: {all}, not {expected}");
    }
}

#[test]
fn a_reset_has_no_masks_and_late_values_keep_to_theirs() {
    let metrics = [
        "psnr.static",
        "flicker.local.static",
        "flicker.local.moving",
        "converge_frames.static",
    ]
    .map(metric);
    let mut track = Track::new(&metrics);
    let mut previous: Option<Reference> = None;
    for frame in 0..36 {
        let reference_picture = picture(reference(0));
        let next = match &previous {
            None => Reference::new(reference_picture, &metrics),
            Some(previous) => previous.follow(reference_picture, Some(&motion_px())),
        };
        // Still pixels flicker by ±0.02 and are settled from the third frame on; moving ones are right.
        let error = match frame {
            0..3 => 0.1,
            frame if frame % 2 == 0 => 0.02,
            _ => -0.02,
        };
        let test = picture(move |x, y| reference(0)(x, y) + if x < STANDS_FROM { 0.0 } else { error });
        let scores = track.score(&next, &test, frame >= 4).unwrap();
        assert_eq!(scores.values.contains_key("psnr.static"), frame > 0, "frame {frame}");
        previous = Some(next);
    }
    let late = track.finish();
    let value = |id: &str| late.iter().find(|late| late.id == id).unwrap().value.0;
    assert!((value("flicker.local.static") - 0.02).abs() < 1e-6);
    assert!(value("flicker.local.moving") < 1e-12);
    assert_eq!(value("converge_frames.static"), 3.0);
}

/// Images of two frames apart; the same but for the last bit of every pixel of `nudged` are scored without any skipping.
#[test]
fn skipping_equal_tiles_changes_nothing() {
    // What differs is less than a twentieth of the image, and `flip.p95` does not see it.
    let is_seen = |metric: &Metric| !metric.is_temporal() && *metric != Metric::FLIP_P95;
    let metrics: Vec<Metric> = Metric::ALL.into_iter().filter(is_seen).collect();
    let extent = Extent::new(320, 176);
    let base = Image::from_fn(extent, |x, y| [noise(x / 3, y / 3, 1), noise(x, y, 2), 0.4]);
    let test = Image::from_fn(extent, |x, y| match (200..230).contains(&x) && (90..130).contains(&y) {
        true => base.at(x, y).map(|c| 0.7 * c),
        false => base.at(x, y),
    });
    let nudged = Image::from_fn(extent, |x, y| match (x + y) % 2 {
        0 => test.at(x, y).map(f32::next_up),
        _ => test.at(x, y).map(f32::next_down),
    });
    let [base, test, nudged] = [base, test, nudged].map(|image| Picture::linear(image, Display::default()));
    let reference = Reference::new(base, &metrics);
    let [skipped, whole] = [test, nudged].map(|test| reference.evaluate(&test).unwrap().values);
    for metric in metrics {
        let [skipped, whole] = [&skipped, &whole].map(|values| values[metric.id()].0);
        // FLIP's exponents raise a last bit to about 1e-4.
        let tolerance = if metric.id().contains("flip") { 2e-4 } else { 2e-5 };
        let near = (skipped - whole).abs() < tolerance * whole.abs().max(1.0);
        assert!(near, "{metric}: {skipped} and {whole}");
        assert_ne!(skipped, perfect(metric), "{metric}");
    }
}
