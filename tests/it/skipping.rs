//! Skipping tiles changes no bit of any image: every preset both ways, on scenes that move, stand still, cut, and stand still
//! in part; and it does skip where there is nothing to do.

use crate::{
    gpu_vs_reference::{scene, still},
    support::{frame, gpu, noise, resolve_between, resolve_skipping, resolve_with},
};
use afterimage::{
    gpu::{Variant, Workgroup},
    image::{Extent, Image},
    sequence::{Frame, frame::Rgb},
    taa::{Options, PRESETS, Precision, Preset, Recipe, Skip},
};

/// Not a multiple of a tile along either axis.
const EXTENT: Extent = Extent::new(75, 53);

fn options(precision: Precision, skip: Skip) -> Options {
    Options { precision, skip }
}

fn bits(image: &Image<Rgb>) -> Vec<[u32; 3]> {
    image.pixels().iter().map(|pixel| pixel.map(f32::to_bits)).collect()
}

/// Resolves `frames` both ways, which must show the same bits and repair as many texels; the share of tiles kept in each frame.
fn same_both_ways(recipe: &Recipe, precision: Precision, frames: impl Iterator<Item = Frame> + Clone) -> Vec<f64> {
    let off = resolve_skipping(recipe, options(precision, Skip::Off), frames.clone());
    let exact = resolve_skipping(recipe, options(precision, Skip::Exact), frames);
    for (index, (off, exact)) in off.iter().zip(&exact).enumerate() {
        assert_eq!(off.1, exact.1, "repaired texels of frame {index}");
        let n_different = bits(&off.0).iter().zip(bits(&exact.0)).filter(|(a, b)| *a != b).count();
        assert_eq!(
            n_different,
            0,
            "pixels of frame {index} differ; {:.0} % were kept",
            100.0 * exact.2
        );
    }
    exact.into_iter().map(|(.., kept)| kept).collect()
}

/// What pixels read in common comes from a workgroup's memory on a GPU, and is read by an invocation for two pixels on a CPU: here
/// both, over every pixel and over listed tiles, in groups that end within the image and beyond it: both dilations, three boxes,
/// and the input filter.
#[test]
fn workgroups_share_what_they_read_to_the_bit() {
    for preset in ["smaa1tx", "inside", "karis2014", "salvi2016"] {
        let recipe = &Preset::find(preset).unwrap().recipe;
        for skip in [Skip::Off, Skip::Exact] {
            let with = |workgroup_memory, shape| {
                let gpu = gpu().with(Variant {
                    workgroup: Some(shape),
                    workgroup_memory: Some(workgroup_memory),
                    cache: None,
                });
                let frames = (6..14).map(|index| Frame {
                    index: index - 6,
                    ..partly_still(index, true)
                });
                let resolved = resolve_with(&gpu, recipe, options(Precision::F16, skip), frames);
                resolved.iter().map(|(image, ..)| bits(image)).collect::<Vec<_>>()
            };
            let alone = with(false, Workgroup::new(64, 1));
            // Of listed tiles a group takes a part, a whole one, four or eight.
            for (x, y) in [(4, 2), (8, 8), (64, 4), (128, 2)] {
                let shape = Workgroup::new(x, y);
                assert!(with(true, shape) == alone, "{preset} {skip:?} {shape}");
            }
            // Groups of a tile's size leave each invocation one pixel.
            assert!(with(false, Workgroup::new(16, 16)) == alone, "{preset} {skip:?}");
        }
    }
}

/// Benchmarks of several shapes prepare a frame once for all: what was listed for one shape, or for invocations of two pixels, must
/// not be read as if for another.
#[test]
fn workgroups_of_another_shape_leave_nothing_out() {
    let recipe = &Preset::find("sobel2018").unwrap().recipe;
    let frames = (0..8).map(|index| partly_still(index, false));
    let off = resolve_skipping(recipe, options(Precision::F16, Skip::Off), frames.clone());
    let with = |(x, y, workgroup_memory)| {
        gpu().with(Variant {
            workgroup: Some(Workgroup::new(x, y)),
            workgroup_memory: Some(workgroup_memory),
            cache: None,
        })
    };
    for shapes in [
        [(64, 1, false), (8, 8, false)],
        [(8, 8, false), (64, 1, false)],
        [(64, 1, false), (64, 1, true)],
        [(64, 1, true), (64, 1, false)],
    ] {
        let [preparing, gpu] = shapes.map(with);
        let options = options(Precision::F16, Skip::Exact);
        let exact = resolve_between(&preparing, &gpu, recipe, options, frames.clone());
        for (index, (off, exact)) in off.iter().zip(&exact).enumerate() {
            assert!(bits(&off.0) == bits(&exact.0), "{shapes:?}: frame {index}");
        }
        assert!(exact[7].2 > 0.2, "{shapes:?}: {:.2} kept", exact[7].2);
    }
}

/// A sky over a textured ground that stands still, and a box that slides over both, waits for ten frames and slides on.
fn partly_still(index: usize, jitters: bool) -> Frame {
    let at = if index < 10 { index } else { index.clamp(19, 24) - 9 } as u32;
    let on_box = move |x: u32, y: u32| (x.wrapping_sub(2 + 3 * at) < 14) && (20..38).contains(&y);
    let still = still(EXTENT, index, move |x, y| match (on_box(x, y), y < 28) {
        (true, _) => [0.9, noise(x, y, 5), 0.1],
        (_, true) => [0.35, 0.5, 0.8],
        _ => [noise(x, y, 1), noise(x, y, 2), 4.0 * noise(x, y, 3)],
    });
    let moves = index > 0 && (index < 10 || (20..25).contains(&index));
    Frame {
        jitter_px: if jitters {
            frame(EXTENT, index).jitter_px
        } else {
            [0.0; 2]
        },
        depth: Some(Image::from_fn(EXTENT, |x, y| match (on_box(x, y), y < 28) {
            (true, _) => 2.0,
            (_, true) => 1e10,
            _ => 5.0 + 0.1 * noise(x, y, 4),
        })),
        motion_px: Some(Image::from_fn(EXTENT, |x, y| {
            [if moves && on_box(x, y) { -3.0 } else { 0.0 }, 0.0]
        })),
        object_id: Some(Image::from_fn(EXTENT, |x, y| u32::from(on_box(x, y)))),
        albedo: Some(Image::from_fn(EXTENT, |x, y| {
            if y < 28 { [1.0; 3] } else { [noise(x, y, 1); 3] }
        })),
        reactive: Some(Image::filled(EXTENT, 0.0)),
        reset: index == 15,
        ..still
    }
}

#[test]
fn every_preset_is_the_same_where_all_moves() {
    for preset in &PRESETS {
        let kept = same_both_ways(&preset.recipe, Precision::F16, scene(EXTENT).take(24));
        assert!(kept.iter().all(|&kept| kept < 0.5), "{}: {kept:?}", preset.id);
    }
}

fn every_preset_is_the_same(precision: Precision, jitters: bool) {
    for preset in &PRESETS {
        let frames = (0..34).map(|index| partly_still(index, jitters));
        same_both_ways(&preset.recipe, precision, frames);
    }
}

#[test]
fn every_preset_is_the_same_where_some_stands_still() {
    every_preset_is_the_same(Precision::F16, false);
}

#[test]
fn every_preset_is_the_same_where_some_stands_still_with_f32_history() {
    every_preset_is_the_same(Precision::F32, false);
}

#[test]
fn every_preset_is_the_same_where_jitter_moves_some() {
    every_preset_is_the_same(Precision::F16, true);
}

/// What keeps tiles keeps all of them once nothing changes, and those of the sky while the camera jitters. Where history is
/// clipped towards the centre of a box on whose surface it lies, its last bit may never come to rest: such tiles are computed.
#[test]
fn a_still_scene_costs_nothing_once_it_has_settled() {
    let comes_to_rest = ["none", "unjitter_only", "ema", "smaa1tx"];
    for id in comes_to_rest
        .into_iter()
        .chain(["inside", "inside_ycocg", "karis2014", "salvi2016"])
    {
        let recipe = &Preset::find(id).unwrap().recipe;
        let kept = same_both_ways(
            recipe,
            Precision::F16,
            (0..40).map(|index| Frame {
                index,
                reset: index == 0,
                ..partly_still(index.max(26), false)
            }),
        );
        assert_eq!(kept[0], 0.0, "{id}: nothing came before");
        println!("{id}: {:.2} of a still scene", kept[39]);
        let least = if comes_to_rest.contains(&id) { 0.95 } else { 0.2 };
        assert!(kept[39] > least, "{id}: {kept:?}");
        let kept = same_both_ways(recipe, Precision::F16, (0..34).map(|index| partly_still(index, true)));
        assert!(kept[33] > 0.2 && kept[33] < 0.9, "{id}: {kept:?}");
        assert_eq!(kept[15], 0.0, "{id}: a reset drops history");
    }
}

/// A sky above ground, both of which move by fractions of a pixel while the camera jitters; and in frame 20 a cloud.
fn moving_sky(index: usize, vector: [f32; 2]) -> Frame {
    let extent = Extent::new(166, 101);
    let shift = [0, 1].map(|axis| (index as f32 * vector[axis]).round() as u32);
    let scene = still(extent, index, move |x, y| match y < 72 {
        true if index == 20 && x == 90 && y == 30 => [1.0; 3],
        true => [0.35, 0.5, 0.8],
        false => [noise(x + shift[0], y + shift[1], 1), noise(x, y, 2), noise(x, y, 3)],
    });
    Frame {
        jitter_px: frame(extent, index).jitter_px,
        depth: Some(Image::from_fn(extent, |x, y| {
            if y < 72 { 1e10 } else { 5.0 + 0.1 * noise(x, y, 4) }
        })),
        motion_px: Some(Image::from_fn(extent, |x, y| {
            [vector[0] + 1e-3 * x as f32, vector[1] - 1e-3 * y as f32]
        })),
        object_id: Some(Image::from_fn(extent, |_, y| u32::from(y < 72))),
        albedo: Some(Image::filled(extent, [1.0; 3])),
        reactive: Some(Image::filled(extent, 0.0)),
        ..scene
    }
}

#[test]
fn a_flat_surface_is_kept_while_it_moves() {
    let kept = |id: &str, precision, vector| {
        let recipe = &Preset::find(id).unwrap().recipe;
        same_both_ways(recipe, precision, (0..26).map(|index| moving_sky(index, vector)))
    };
    for id in [
        "ema",
        "uncharted4",
        "inside",
        "inside_ycocg",
        "salvi2016",
        "salvi2016_wide",
    ] {
        for precision in [Precision::F16, Precision::F32] {
            // Without rounding the way to YCoCg and back moves the last bit, so that nothing settles.
            if (id, precision) == ("inside_ycocg", Precision::F32) {
                continue;
            }
            let kept = kept(id, precision, [1.3, -0.4]);
            println!("{id} {precision:?}: {kept:.2?}");
            assert!(kept[19] > 0.2, "{id} {precision:?}: {kept:?}");
            assert!(
                kept[20] < kept[19],
                "{id} {precision:?}: a cloud must be seen: {kept:?}"
            );
        }
    }
    // Motion blur shows more of fast motion, and the weight of the others follows the vector, which varies.
    assert_eq!(kept("inside", Precision::F16, [3.1, -0.4]), [0.0; 26]);
    for id in ["karis2014", "smaa1tx"] {
        assert_eq!(kept(id, Precision::F16, [1.3, -0.4]), [0.0; 26], "{id}");
    }
}

/// Where few tiles may be kept, reading the list costs more than they do: all are computed. A recipe without a box needs more.
#[test]
fn few_tiles_are_not_worth_a_list() {
    let kept = |id: &str, sky: [u32; 2]| {
        let recipe = &Preset::find(id).unwrap().recipe;
        let extent = Extent::new(166, 101);
        let frames = (0..8).map(|index| Frame {
            albedo: Some(Image::filled(extent, [1.0; 3])),
            object_id: Some(Image::filled(extent, 1)),
            ..still(extent, index, move |x, y| match x < sky[0] && y < sky[1] {
                true => [0.35, 0.5, 0.8],
                false => [noise(x + 7 * index as u32, y, 1); 3],
            })
        });
        let kept = same_both_ways(recipe, Precision::F16, frames);
        (77.0 * kept[7]).round() as u32
    };
    for (id, sky, n_kept) in [
        ("inside", [166, 20], 11),
        ("inside", [52, 20], 0),
        ("ema", [166, 20], 0),
        ("ema", [166, 36], 22),
    ] {
        assert_eq!(kept(id, sky), n_kept, "{id} {sky:?}");
    }
}

/// The comparison can fail: one texel that changes after all has settled must be seen, wherever it lies in its tile.
#[test]
fn one_texel_that_changes_is_seen_everywhere() {
    let recipe = &Preset::find("karis2014").unwrap().recipe;
    for at in [[0, 0], [15, 15], [16, 16], [74, 52], [33, 47]] {
        let frames = |changes: bool| {
            (0..8).map(move |index| {
                still(EXTENT, index, move |x, y| match (changes && index == 6, [x, y] == at) {
                    (true, true) => [1.0, 0.0, 0.0],
                    _ => [0.35, 0.5, 0.8],
                })
            })
        };
        let kept = same_both_ways(recipe, Precision::F16, frames(true));
        assert!(kept[5] == 1.0 && kept[6] < 1.0, "{at:?}: {kept:?}");
        let exact = options(Precision::F16, Skip::Exact);
        let [with, without] = [true, false].map(|changes| resolve_skipping(recipe, exact, frames(changes)));
        assert_ne!(bits(&with[6].0), bits(&without[6].0), "{at:?}");
    }
}

/// Texels that are repaired are counted in every frame, whether what is made of their tile is there already or not.
#[test]
fn hostile_texels_are_counted_where_they_stand_still() {
    for id in ["none", "ema", "inside", "sobel2018"] {
        let recipe = &Preset::find(id).unwrap().recipe;
        let extent = Extent::new(166, 101);
        let frames = (0..8).map(|index| Frame {
            albedo: Some(Image::filled(extent, [1.0; 3])),
            object_id: Some(Image::filled(extent, 1)),
            ..still(extent, index, move |x, y| match (x, y) {
                (40, 40) => [f32::NAN, 0.5, -1.0],
                // So that no frame repeats the one before.
                (100, 70) => [0.1 * index as f32; 3],
                _ => [0.35, 0.5, 0.8],
            })
        });
        let exact = options(Precision::F16, Skip::Exact);
        let repaired: Vec<_> = resolve_skipping(recipe, exact, frames.clone())
            .into_iter()
            .map(|(_, n_repaired, _)| n_repaired)
            .collect();
        assert_eq!(repaired, [1; 8], "{id}");
        let kept = same_both_ways(recipe, Precision::F16, frames);
        assert!(kept[7] > 0.8 && kept[7] < 1.0, "{id}: {kept:?}");
    }
}
