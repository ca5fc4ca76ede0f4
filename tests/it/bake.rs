//! Baked sequences: geometry against matrices in f64, references against statistics, folders against accidents.

use crate::support::gpu;
use afterimage::{
    image::{
        Extent, Image,
        files::{Backend, FileReader, Limits},
    },
    scene::{
        BakeError, BakeObserver, BakeSettings, BakedFrame, Baker, Cache, Clip, Pattern, SCENES, bake,
        builtin::{checker_color, sphere_center, sphere_radius},
    },
    sequence::{Sequence, jitter::JitterSequence},
};
use glam::{DMat4, DVec2, DVec3};
use std::{fs, path::Path};

const SIZE: Extent = Extent::new(160, 90);

fn settings(scene: &str) -> BakeSettings {
    BakeSettings {
        n_frames: 2,
        render_size: SIZE,
        output_size: SIZE,
        reference_samples: 0,
        ..BakeSettings::new(scene)
    }
}

fn frame_of(settings: &BakeSettings, index: usize) -> BakedFrame {
    Baker::new(gpu(), settings).unwrap().frame(index).unwrap()
}

/// The point that pixel `(x, y)` shows, in the world.
fn unproject(camera: &Clip, sample_px: DVec2, depth: f64) -> DVec3 {
    let size = DVec2::new(SIZE.width.into(), SIZE.height.into());
    let ndc = DVec2::new(2.0, -2.0) * sample_px / size + DVec2::new(-1.0, 1.0);
    let [axis, x, y] = camera.rays();
    camera.eye() + (axis + x * ndc.x + y * ndc.y) * depth
}

/// Where a point of the world appears, and its depth.
fn project(camera: &Clip, point: DVec3) -> (DVec2, f64) {
    let clip = camera.from_world() * point.extend(1.0);
    let size = DVec2::new(SIZE.width.into(), SIZE.height.into());
    let ndc = DVec2::new(clip.x, clip.y) / clip.w;
    ((ndc * DVec2::new(0.5, -0.5) + 0.5) * size, clip.w)
}

fn sample_px(frame: &BakedFrame, x: u32, y: u32, sign: f64) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) + sign * DVec2::from_array(frame.jitter_px)
}

/// Largest error of the motion of pixels whose surface rests, told from depth and both cameras.
fn error_of_resting_motion(scene: &str, index: usize, sign: f64) -> f64 {
    let mut baker = Baker::new(gpu(), &settings(scene)).unwrap();
    let before = baker.frame(index - 1).unwrap().camera;
    let frame = baker.frame(index).unwrap();
    let mut worst: f64 = 0.0;
    for y in 0..SIZE.height {
        for x in 0..SIZE.width {
            let depth = f64::from(frame.depth.at(x, y));
            if depth >= 1e9 {
                continue;
            }
            let here = sample_px(&frame, x, y, sign);
            let (then, _) = project(&before, unproject(&frame.camera, here, depth));
            let stored = DVec2::from_array(frame.motion_px.at(x, y).map(f64::from));
            worst = worst.max((stored - (then - here)).length());
        }
    }
    worst
}

#[test]
fn motion_of_resting_surfaces_is_what_depth_and_cameras_say() {
    for scene in ["atrium", "far_edges", "text", "checker", "zoom", "pan"] {
        let error = error_of_resting_motion(scene, 3, 1.0);
        assert!(error < 1e-3, "{scene}: {error} px");
    }
}

/// The control: the jitter's sign, and the wrong frame.
#[test]
fn the_comparison_of_motion_can_fail() {
    let error = error_of_resting_motion("pan", 3, -1.0);
    assert!(error > 0.05, "the sign of jitter goes unnoticed: {error} px");
    let frame = frame_of(&settings("atrium"), 3);
    let other = frame_of(&settings("atrium"), 5);
    assert!(frame.motion_px != other.motion_px);
}

/// Of the ball that passes: depth by intersecting rays, motion by moving points back.
#[test]
fn depth_and_motion_of_a_moving_ball_are_exact() {
    let settings = settings("sphere");
    let frame = frame_of(&settings, 9);
    let ball = frame.object_id.pixels().iter().copied().max().unwrap();
    let (now, before) = (sphere_center(9.0), sphere_center(8.0));
    let turn = DMat4::from_rotation_y(-0.12);
    let (mut n, mut n_depths, mut worst_depth, mut worst_motion) = (0, 0, 0.0_f64, 0.0_f64);
    for y in 0..SIZE.height {
        for x in 0..SIZE.width {
            if frame.object_id.at(x, y) != ball {
                continue;
            }
            n += 1;
            let here = sample_px(&frame, x, y, 1.0);
            let depth = f64::from(frame.depth.at(x, y));
            let ray = unproject(&frame.camera, here, 1.0) - frame.camera.eye();
            let to = frame.camera.eye() - now;
            let (a, b, c) = (
                ray.length_squared(),
                to.dot(ray),
                to.length_squared() - sphere_radius().powi(2),
            );
            let root = b * b - a * c;
            // Facets stray farthest in depth where the ray grazes them.
            if root > 0.2 * a * sphere_radius().powi(2) {
                n_depths += 1;
                worst_depth = worst_depth.max((depth - (-b - root.sqrt()) / a).abs());
            }
            let point = unproject(&frame.camera, here, depth);
            let then = before + turn.transform_vector3(point - now);
            let stored = DVec2::from_array(frame.motion_px.at(x, y).map(f64::from));
            worst_motion = worst_motion.max((stored - (project(&frame.camera, then).0 - here)).length());
        }
    }
    assert!(n > 300, "{n} pixels of the ball");
    assert!(n_depths > n / 2, "{n_depths} of {n} compared");
    assert!(worst_depth < 4e-3 && worst_depth > 0.0, "{worst_depth}");
    assert!(worst_motion < 1e-3, "{worst_motion} px");
    let still = project(&frame.camera, now).0 - project(&frame.camera, before).0;
    assert!(still.length() > 2.0, "the control: motion that is left out would show");
}

/// What the ball uncovers: a point of the wall is hidden where the ray to it met the ball a frame ago.
#[test]
fn the_mask_of_disocclusion_is_the_crescent_behind_the_ball() {
    let settings = BakeSettings {
        disocclusion: true,
        ..settings("sphere")
    };
    let frame = frame_of(&settings, 9);
    let mask = frame.disoccluded.as_ref().unwrap();
    let ball = frame.object_id.pixels().iter().copied().max().unwrap();
    let before = sphere_center(8.0);
    let (mut n_hidden, mut n_wrong, mut n_edge) = (0, 0, 0);
    for y in 0..SIZE.height {
        for x in 0..SIZE.width {
            if frame.object_id.at(x, y) == ball {
                continue;
            }
            let ray = unproject(&frame.camera, sample_px(&frame, x, y, 1.0), 1.0) - frame.camera.eye();
            let to = before - frame.camera.eye();
            let off = to.cross(ray.normalize()).length();
            let said = mask.at(x, y);
            n_edge += u32::from(said == 0.5);
            // Within a facet's height of the rim either answer is right.
            if (off - sphere_radius()).abs() < 0.01 || said == 0.5 {
                continue;
            }
            let hidden = off < sphere_radius();
            n_hidden += u32::from(hidden);
            n_wrong += u32::from(hidden != (said == 1.0));
        }
    }
    assert!(n_hidden > 60, "{n_hidden}");
    assert_eq!(n_wrong, 0, "of {n_hidden}");
    assert!(n_edge < 120, "{n_edge}");
    let still = frame_of(
        &BakeSettings {
            scene: "static".to_owned(),
            ..settings
        },
        1,
    );
    let n = still
        .disoccluded
        .unwrap()
        .pixels()
        .iter()
        .filter(|mask| **mask == 1.0)
        .count();
    assert_eq!(n, 0, "nothing is uncovered where nothing moves");
}

/// The floor's colour in closed form: texel (x, y) holds the scene at its centre plus the jitter, and at no other place.
#[test]
fn a_texel_holds_the_scene_at_its_centre_plus_the_jitter() {
    let frame = frame_of(&settings("checker"), 2);
    assert_ne!(frame.jitter_px, [0.0; 2]);
    let wrong = |sign: f64| {
        let (mut n, mut n_wrong) = (0, 0);
        for y in 60..SIZE.height {
            for x in 0..SIZE.width {
                let point = unproject(&frame.camera, sample_px(&frame, x, y, sign), 1.0) - frame.camera.eye();
                let on_floor = frame.camera.eye() + point * (frame.camera.eye().y / -point.y);
                n += 1;
                n_wrong += u32::from((frame.color.at(x, y)[0] - checker_color(on_floor)).abs() > 0.01);
            }
        }
        f64::from(n_wrong) / f64::from(n)
    };
    // Texels exactly on a line between two squares may fall to either side.
    assert!(wrong(1.0) < 0.002, "{}", wrong(1.0));
    assert!(wrong(-1.0) > 0.02, "the control: {}", wrong(-1.0));
    assert!(wrong(0.0) > 0.01, "the control: {}", wrong(0.0));
}

#[test]
fn nothing_moves_in_the_static_scene_and_its_ids_stay() {
    let settings = settings("static");
    let mut baker = Baker::new(gpu(), &settings).unwrap();
    let [a, b] = [0, 1].map(|index| baker.frame(index).unwrap());
    assert!(b.motion_px.pixels().iter().all(|motion| *motion == [0.0; 2]));
    assert_eq!(a.unjittered_color, b.unjittered_color);
    assert_ne!(a.color, b.color, "jitter moves the samples");
    assert!(a.object_id.pixels().iter().any(|id| *id > 1));
}

/// Largest and root mean square difference of two images.
fn difference(a: &Image<[f32; 3]>, b: &Image<[f32; 3]>) -> (f64, f64) {
    let differences = a.pixels().iter().flatten().zip(b.pixels().iter().flatten());
    let squares: Vec<f64> = differences
        .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
        .collect();
    let largest = squares.iter().copied().fold(0.0, f64::max).sqrt();
    (largest, (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

fn reference_of(scene: &str, n: u32, seed: u64, pattern: Pattern) -> (Image<[f32; 3]>, f64) {
    let settings = BakeSettings {
        reference_samples: n,
        reference_pattern: pattern,
        seed,
        ..settings(scene)
    };
    let mut baker = Baker::new(gpu(), &settings).unwrap();
    let frame = baker.frame(1).unwrap();
    (frame.reference.unwrap(), baker.noise_floor().unwrap().rms_linear)
}

/// Against four times the samples with another seed; the scenes do not depend on it.
#[test]
fn the_noise_floor_is_honest_and_falls_with_more_samples() {
    for pattern in [Pattern::Stratified, Pattern::Halton23] {
        let (truth, noise_of_truth) = reference_of("checker", 256, 77, pattern);
        let (reference, floor) = reference_of("checker", 64, 5, pattern);
        let (_, rms) = difference(&reference, &truth);
        let expected = (floor * floor + noise_of_truth * noise_of_truth).sqrt();
        assert!(
            (0.7..1.4).contains(&(rms / expected)),
            "{pattern:?}: {rms} is not about {expected}"
        );
        let (few, noise_of_few) = reference_of("checker", 8, 5, pattern);
        assert!(
            noise_of_few > 2.0 * floor && noise_of_truth < floor,
            "{noise_of_few} {floor} {noise_of_truth}"
        );
        assert!(difference(&few, &truth).1 > 2.0 * rms);
    }
}

/// An independent mean: renders without jitter sequence or accumulation, at frames that all show the same.
#[test]
fn a_reference_is_the_mean_of_jittered_frames() {
    let jittered = BakeSettings {
        jitter: JitterSequence::Halton23(64),
        ..settings("static")
    };
    let mut baker = Baker::new(gpu(), &jittered).unwrap();
    let mut sum = vec![[0.0_f64; 3]; SIZE.n_pixels()];
    for index in 0..64 {
        let frame = baker.frame(index).unwrap();
        for (sum, color) in sum.iter_mut().zip(frame.color.pixels()) {
            (0..3).for_each(|i| sum[i] += f64::from(color[i]) / 64.0);
        }
    }
    let mean = Image::from_pixels(SIZE, sum.into_iter().map(|c| c.map(|c| c as f32)).collect());
    let (reference, noise) = reference_of("static", 64, 1, Pattern::Stratified);
    let (_, rms) = difference(&mean, &reference);
    assert!(rms < 3.0 * noise, "{rms} beside a noise of {noise}");
    let unjittered = baker.frame(0).unwrap().unjittered_color;
    assert!(
        difference(&mean, &unjittered).1 > 5.0 * rms,
        "the control: a frame without anti-aliasing"
    );
}

/// A view of colour alone finds what is in front, and cuts holes, before it shades: it shows what one pass over everything shows.
#[test]
fn colour_alone_is_the_colour_of_a_frame() {
    let share_apart = |scene: &str, jitter_scale: f64| {
        let frame = frame_of(
            &BakeSettings {
                jitter_scale,
                ..settings(scene)
            },
            1,
        );
        let pairs = frame.color.pixels().iter().zip(frame.unjittered_color.pixels());
        let apart = pairs.filter(|(a, b)| a.iter().zip(b.iter()).any(|(a, b)| (a - b).abs() > 1e-3 * (1.0 + b)));
        apart.count() as f64 / SIZE.n_pixels() as f64
    };
    for scene in ["foliage", "flowers", "atrium"] {
        // Where a leaf ends, the two may round a texture's coordinates apart.
        let apart = share_apart(scene, 0.0);
        assert!(apart < 1e-3, "{scene}: {apart}");
        assert!(
            share_apart(scene, 1.0) > 0.2,
            "{scene}: the control, half a pixel aside"
        );
    }
}

/// Chance must be averaged: the mean of stochastic alpha is the same whichever frame it is drawn in, a frame is not.
#[test]
fn stochastic_alpha_is_drawn_anew() {
    let settings = BakeSettings {
        reference_samples: 64,
        ..settings("stochastic_alpha")
    };
    let frame = frame_of(&settings, 0);
    let reference = frame.reference.unwrap();
    let (_, rms) = difference(&frame.color, &reference);
    assert!(rms > 0.05, "{rms}");
    assert_ne!(frame.color, frame.unjittered_color);
}

#[test]
fn layers_without_vectors_leave_geometry_alone_and_mark_the_mask() {
    let frame = frame_of(&settings("particles"), 1);
    let marked = frame.reactive.pixels().iter().filter(|mask| **mask > 0.0).count();
    assert!(marked > 300, "{marked}");
    assert!(frame.reactive.pixels().iter().all(|mask| (0.0..=1.0).contains(mask)));
    let ids = frame.object_id.pixels().iter().copied().max().unwrap();
    assert!(ids <= 6, "only what is opaque has an id, not {ids}");
}

#[test]
fn mipmaps_and_their_bias_matter() {
    let detail = |mipmaps, mip_bias| {
        let frame = frame_of(
            &BakeSettings {
                mipmaps,
                mip_bias,
                ..settings("text")
            },
            0,
        );
        let luma: Vec<f64> = frame.color.pixels().iter().map(|c| f64::from(c[1])).collect();
        luma.windows(2).map(|pair| (pair[0] - pair[1]).abs()).sum::<f64>()
    };
    let (off, biased, plain, blurred) = (
        detail(false, 0.0),
        detail(true, -1.0),
        detail(true, 0.0),
        detail(true, 1.5),
    );
    assert!(
        off > biased && biased > plain && plain > blurred,
        "{off} {biased} {plain} {blurred}"
    );
}

#[test]
fn four_samples_lie_closer_to_the_reference_than_one() {
    let error = |samples| {
        let settings = BakeSettings {
            samples,
            reference_samples: 64,
            jitter: JitterSequence::None,
            ..settings("fence")
        };
        let frame = frame_of(&settings, 1);
        let others = frame.others.iter().flat_map(|others| &others.color);
        let samples: Vec<_> = [&frame.color].into_iter().chain(others).collect();
        let mean = Image::from_fn(SIZE, |x, y| {
            let sum = |i: usize| samples.iter().map(|image| image.at(x, y)[i]).sum::<f32>();
            [0, 1, 2].map(|i| sum(i) / samples.len() as f32)
        });
        let reference = frame.reference.as_ref().unwrap();
        [&mean, &frame.unjittered_color].map(|image| difference(image, reference).1)
    };
    let (four, one) = (error(4), error(1));
    assert!(four[0] < 0.7 * one[0] && four[1] < 0.7 * one[1], "{four:?} {one:?}");
}

#[test]
fn four_samples_are_written_with_their_own_depth_and_motion() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("baked");
    let settings = BakeSettings {
        samples: 4,
        ..settings("sphere")
    };
    bake(gpu(), &settings, &place, &()).unwrap();
    let sequence = Sequence::open(&place, &FileReader::new(Backend::Native, Limits::default())).unwrap();
    let frame = sequence.load(1, sequence.available()).unwrap();
    let baked = frame_of(&settings, 1).others.unwrap();
    let others = frame.others.unwrap();
    assert_eq!(
        (others.color.len(), others.depth.len(), others.motion_px.len()),
        (3, 3, 3)
    );
    for i in 0..3 {
        assert_eq!(others.depth[i], baked.depth[i]);
        assert_eq!(others.motion_px[i], baked.motion_px[i]);
        assert!(difference(&others.color[i], &baked.color[i]).1 < 1e-3, "half floats");
    }
    assert_ne!(others.depth[0], others.depth[2], "samples lie apart");
}

#[test]
fn a_scene_at_rest_moves_only_its_samples() {
    let settings = BakeSettings {
        at_rest: true,
        jitter_scale: 0.5,
        reference_samples: 4,
        ..settings("sphere")
    };
    let mut baker = Baker::new(gpu(), &settings).unwrap();
    let [first, second] = [0, 1].map(|index| baker.frame(index).unwrap());
    assert_eq!(first.unjittered_color, second.unjittered_color);
    assert_eq!(first.reference, second.reference);
    assert!(second.motion_px.pixels().iter().all(|motion| *motion == [0.0; 2]));
    assert_ne!(first.color, second.color, "jitter moves the samples");
    let whole = settings.jitter.offset_px(1);
    assert_eq!(second.jitter_px, whole.map(|offset| 0.5 * offset));
}

#[test]
fn every_scene_shows_something_finite_in_every_channel() {
    let small = Extent::new(64, 36);
    for scene in SCENES {
        let settings = BakeSettings {
            render_size: small,
            output_size: small,
            ..settings(scene.id)
        };
        let frame = frame_of(&settings, 1);
        let colors = frame.color.pixels();
        assert!(
            colors.iter().flatten().all(|c| c.is_finite() && *c >= 0.0),
            "{}",
            scene.id
        );
        assert!(
            frame.motion_px.pixels().iter().flatten().all(|m| m.is_finite()),
            "{}",
            scene.id
        );
        assert!(frame.depth.pixels().iter().all(|z| *z > 0.0), "{}", scene.id);
        let differs = colors.iter().filter(|color| **color != colors[0]).count();
        assert!(
            differs > small.n_pixels() / 10,
            "{}: {differs} pixels differ from the first",
            scene.id
        );
    }
}

fn tiny(scene: &str) -> BakeSettings {
    let size = Extent::new(48, 27);
    BakeSettings {
        render_size: size,
        output_size: size,
        reference_samples: 4,
        karis: true,
        ..settings(scene)
    }
}

fn open(path: &Path) -> afterimage::sequence::Sequence {
    let reader = afterimage::image::files::FileReader::new(Default::default(), Default::default());
    afterimage::sequence::Sequence::open(path, &reader).unwrap()
}

#[test]
fn a_bake_is_a_sequence_and_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::new(folder.path().join("cache"));
    let first = cache.get(gpu(), &tiny("foliage"), false, &()).unwrap();
    assert!(first.summary.is_some());
    let again = cache.get(gpu(), &tiny("foliage"), false, &()).unwrap();
    assert!(
        again.summary.is_none() && again.path == first.path,
        "it was in the cache"
    );
    let other = folder.path().join("other");
    bake(gpu(), &tiny("foliage"), &other, &()).unwrap();
    let [a, b] = [first.path.as_path(), &other].map(open);
    a.verify_files().unwrap();
    assert_eq!(a.hash().unwrap(), b.hash().unwrap());
    let seeded = BakeSettings {
        seed: 2,
        ..tiny("foliage")
    };
    let seeded = cache.get(gpu(), &seeded, false, &()).unwrap();
    assert_ne!(a.hash().unwrap(), open(&seeded.path).hash().unwrap());
    let loaded = a.load(1, a.available()).unwrap();
    let baked = frame_of(&tiny("foliage"), 1);
    assert_eq!(loaded.jitter_px, baked.jitter_px);
    assert_eq!(loaded.depth.as_ref(), Some(&baked.depth));
    assert_eq!(loaded.motion_px.as_ref(), Some(&baked.motion_px));
    assert_eq!(loaded.object_id.as_ref(), Some(&baked.object_id));
    assert_eq!(loaded.reference.as_ref(), baked.reference.as_ref());
    let floor = a.manifest().reference.as_ref().unwrap().noise_floor.unwrap();
    assert!(floor.rms_linear > 0.0);
    let karis = open(&first.path.join("manifest-karis.json"));
    let karis = karis.load(1, karis.available()).unwrap();
    assert_eq!(karis.reference, baked.reference_karis);
    assert_ne!(karis.reference, loaded.reference);
}

#[test]
fn what_cannot_be_baked_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let refused = |settings: &BakeSettings| bake(gpu(), settings, &out, &()).unwrap_err().to_string();
    assert!(refused(&tiny("atrum")).contains("did you mean `atrium`"));
    let with = |change: fn(&mut BakeSettings)| {
        let mut settings = tiny("static");
        change(&mut settings);
        refused(&settings)
    };
    assert!(with(|s| s.n_frames = 0).contains("--frames must be from 1"));
    assert!(with(|s| s.render_size = Extent::new(0, 5)).contains("--size 0×5 has no pixels"));
    assert!(
        with(|s| (s.render_size, s.output_size) = (Extent::new(90_000, 1), Extent::new(90_000, 1))).contains("beyond")
    );
    assert!(with(|s| s.output_size = Extent::new(20, 20)).contains("--output-size"));
    assert!(with(|s| s.samples = 3).contains("--samples must be 1 or 4"));
    assert!(with(|s| s.reference_samples = 7).contains("even"));
    assert!(with(|s| s.mip_bias = f64::NAN).contains("--mip-bias"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);

    fs::create_dir(&out).unwrap();
    fs::write(out.join("precious"), "mine").unwrap();
    assert!(matches!(
        bake(gpu(), &tiny("static"), &out, &()),
        Err(BakeError::NotEmpty(_))
    ));
    assert_eq!(fs::read_to_string(out.join("precious")).unwrap(), "mine");
}

struct Stop;

impl BakeObserver for Stop {
    fn cancelled(&self) -> bool {
        true
    }
}

#[test]
fn a_cancelled_bake_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("deeper").join("out");
    assert!(matches!(
        bake(gpu(), &tiny("static"), &out, &Stop),
        Err(BakeError::Cancelled)
    ));
    assert_eq!(fs::read_dir(out.parent().unwrap()).unwrap().count(), 0);
}
