//! Everything a well-formed manifest can still get wrong. Each check names its field.

use super::{
    Camera, ColorSource, DepthKind, DepthSource, FarPlane, FrameEntry, Manifest, ManifestError, MotionSource, SCHEMA,
    Section, item_names,
};
use crate::{
    image::Extent,
    sequence::convention::{Projector, jitter_px},
};

const MAX_SIDE: u32 = 16384;
/// More samples or layers than any engine writes.
const MAX_ITEMS: u32 = 16;
const MAX_NAME: usize = 120;
/// Jitter written as f32 in another unit may come out a little past half a pixel.
const MAX_JITTER_PX: f64 = 0.5 + 1e-6;

type Checked = Result<(), ManifestError>;

fn ensure(holds: bool, field: impl Into<String>, problem: impl FnOnce() -> String) -> Checked {
    match holds {
        true => Ok(()),
        false => Err(ManifestError::field(field, problem())),
    }
}

fn positive(value: f64, field: impl Into<String>) -> Checked {
    ensure(value.is_finite() && value > 0.0, field, || {
        format!("{value} must be a number above 0")
    })
}

pub(super) fn check(manifest: &Manifest) -> Checked {
    ensure(manifest.schema == SCHEMA, "schema", || {
        format!("`{}` is unknown; this version reads `{SCHEMA}`", manifest.schema)
    })?;
    let name = &manifest.name;
    let printable = !name.trim().is_empty() && !name.chars().any(char::is_control);
    ensure(printable && name.chars().count() <= MAX_NAME, "name", || {
        format!("must be 1 to {MAX_NAME} printable characters")
    })?;
    positive(manifest.fps, "fps")?;
    size(manifest.render_size, "render_size")?;
    size(manifest.output_size, "output_size")?;
    positive(manifest.display.exposure, "display.exposure")?;
    several(manifest)?;
    if let Some(checkerboard) = &manifest.checkerboard {
        let alternates = !checkerboard.parity.is_empty() && checkerboard.parity.iter().all(|parity| *parity <= 1);
        ensure(alternates, "checkerboard.parity", || {
            "must be a list of 0 and 1, one a frame, repeated; such as [0, 1]".to_owned()
        })?;
    }
    colors(manifest)?;
    if let Some(source) = &manifest.depth {
        depth(source)?;
    }
    if let Some(source) = &manifest.motion {
        motion(source, manifest.depth.is_some())?;
    }
    ensure(!manifest.frames.is_empty(), "frames", || {
        "is empty; a sequence has at least one frame".to_owned()
    })?;
    manifest
        .frames
        .iter()
        .enumerate()
        .try_for_each(|(i, entry)| frame(manifest, i, entry))
}

/// Samples or layers: how many, and that what differs between them has a name for each.
fn several(manifest: &Manifest) -> Checked {
    let (samples, layers) = (manifest.samples.as_ref(), manifest.layers.as_ref());
    ensure(samples.is_none() || layers.is_none(), "layers", || {
        "a sequence has `samples` or `layers`, not both".to_owned()
    })?;
    let declared = samples.map(|samples| ("samples", "sample", samples.count));
    let declared = declared.or(layers.map(|layers| ("layers", "layer", layers.count)));
    if let Some((field, _, count)) = declared {
        ensure((2..=MAX_ITEMS).contains(&count), format!("{field}.count"), || {
            format!("{count} must be 2 to {MAX_ITEMS}")
        })?;
        ensure(manifest.checkerboard.is_none(), field, || {
            "frames of a checkerboard have one colour a pixel; leave out one of both".to_owned()
        })?;
    }
    let is_own = |section| {
        matches!(
            section,
            Section::Color | Section::Depth | Section::Motion | Section::Opacity
        )
    };
    for (section, path, channels) in manifest.sections() {
        for held in item_names(path, channels) {
            ensure(
                declared.is_some_and(|(_, name, _)| name == held),
                section.to_string(),
                || format!("holds {{{held}}}, and the manifest has no `{held}s`"),
            )?;
            ensure(is_own(section), section.to_string(), || {
                format!("cannot differ by {{{held}}}; color, depth and motion can")
            })?;
        }
    }
    let Some((_, name, _)) = declared else {
        return Ok(());
    };
    let needed: &[Section] = match layers {
        Some(_) => &[Section::Color, Section::Motion, Section::Opacity],
        None => &[Section::Color],
    };
    let sections = manifest.sections().into_iter();
    for (section, path, channels) in sections.filter(|(section, ..)| needed.contains(section)) {
        ensure(!item_names(path, channels).is_empty(), section.to_string(), || {
            format!("is the same for every {name}; put {{{name}}} into its path or channels")
        })?;
    }
    ensure(layers.is_none() || manifest.motion.is_some(), "motion", || {
        "missing, and every layer has a motion of its own".to_owned()
    })
}

fn size(size: Extent, field: &str) -> Checked {
    let side = 1..=MAX_SIDE;
    ensure(side.contains(&size.width) && side.contains(&size.height), field, || {
        format!("{size} must be 1 to {MAX_SIDE} pixels either way")
    })
}

fn colors(manifest: &Manifest) -> Checked {
    let reference = manifest.reference.as_ref();
    let reference_color = reference.map(|reference| reference.color());
    let color = |source: Option<&ColorSource>, field: &str| match source {
        Some(source) => positive(source.nits_per_unit, format!("{field}.nits_per_unit")),
        None => Ok(()),
    };
    color(Some(&manifest.color), "color")?;
    color(manifest.albedo.as_ref(), "albedo")?;
    color(manifest.unjittered_color.as_ref(), "unjittered_color")?;
    color(reference_color.as_ref(), "reference")?;
    if let Some(radius) = reference.and_then(|reference| reference.filter_radius_px) {
        positive(radius, "reference.filter_radius_px")?;
    }
    ensure(
        reference.and_then(|reference| reference.spp) != Some(0),
        "reference.spp",
        || "0 must be at least 1".to_owned(),
    )
}

fn scale_and_bias(scale: f64, bias: f64, section: &str) -> Checked {
    ensure(scale.is_finite() && scale != 0.0, format!("{section}.scale"), || {
        format!("{scale} must be finite and not 0")
    })?;
    ensure(bias.is_finite(), format!("{section}.bias"), || {
        format!("{bias} must be finite")
    })
}

fn depth(source: &DepthSource) -> Checked {
    scale_and_bias(source.scale, source.bias, "depth")?;
    positive(source.sky_value, "depth.sky_value")?;
    ensure(
        !source.reversed || source.kind == DepthKind::Device,
        "depth.reversed",
        || "only device depth can be reversed".to_owned(),
    )?;
    planes(source.near, source.far, "depth")
}

fn planes(near: Option<f64>, far: FarPlane, section: &str) -> Checked {
    if let Some(near) = near {
        positive(near, format!("{section}.near"))?;
    }
    match far {
        FarPlane::At(far) => {
            let near = near.unwrap_or(0.0);
            ensure(far.is_finite() && far > near, format!("{section}.far"), || {
                format!("{far} must lie beyond the near plane at {near}; null, -1 or \"inf\" stand for none")
            })
        }
        FarPlane::Undeclared | FarPlane::Infinite => Ok(()),
    }
}

fn motion(source: &MotionSource, has_depth: bool) -> Checked {
    for axis in 0..2 {
        scale_and_bias(source.scale[axis], source.bias[axis], "motion")?;
    }
    ensure(
        source.invalid_value.is_none() || has_depth,
        "motion.invalid_value",
        || "motion can only be derived where there is `depth`; add it, or set this to null".to_owned(),
    )
}

fn frame(manifest: &Manifest, i: usize, entry: &FrameEntry) -> Checked {
    let at = |field: &str| format!("frames[{i}].{field}");
    ensure(entry.index == i, at("index"), || {
        format!("{} must be {i}: frames are listed in order, from 0", entry.index)
    })?;
    for image in manifest.images() {
        ensure(
            image.path.for_frame(entry, image.item).is_some(),
            at("file_frame"),
            || format!("missing, and {}.path is `{}`", image.section, image.path),
        )?;
    }
    jitter(manifest, entry, &at("jitter"))?;
    if let Some(exposure) = entry.exposure {
        positive(exposure, at("exposure"))?;
    }
    if let Some(section) = pre_exposed(manifest) {
        ensure(entry.exposure.is_some(), at("exposure"), || {
            format!("missing, and {section}.pre_exposed is true; add it, or set that to false")
        })?;
    }
    if let Some(camera) = &entry.camera {
        check_camera(camera, &at("camera"))?;
    }
    device_planes(manifest, entry, &at("camera"))?;
    if let Some(why) = needs_camera(manifest) {
        let usable = entry
            .camera
            .as_ref()
            .map(|camera| Projector::new(camera, manifest.render_size).is_some());
        ensure(usable.is_some(), at("camera"), || {
            format!("missing, and {why} needs it")
        })?;
        ensure(usable == Some(true), at("camera"), || {
            format!("`view` and `projection` must be invertible and perspective: {why} needs them")
        })?;
    }
    Ok(())
}

fn jitter(manifest: &Manifest, entry: &FrameEntry, field: &str) -> Checked {
    let Some(convention) = manifest.jitter else {
        return ensure(entry.jitter == [0.0; 2], field, || {
            "the manifest has no `jitter` that says what this means".to_owned()
        });
    };
    let jitter = jitter_px(convention, entry.jitter, manifest.render_size);
    ensure(jitter.iter().all(|axis| axis.abs() <= MAX_JITTER_PX), field, || {
        let [x, y] = jitter;
        format!("is ({x}, {y}) pixels and must lie within half a pixel; check jitter.units")
    })
}

fn check_camera(camera: &Camera, field: &str) -> Checked {
    for (matrix, name) in [(&camera.view, "view"), (&camera.projection, "projection")] {
        let finite = matrix.iter().flatten().all(|element| element.is_finite());
        ensure(finite, format!("{field}.{name}"), || "must be finite".to_owned())?;
    }
    planes(camera.near, camera.far, field)
}

/// Device depth has no meaning without both planes.
fn device_planes(manifest: &Manifest, entry: &FrameEntry, field: &str) -> Checked {
    let Some(depth) = manifest.depth.as_ref().filter(|depth| depth.kind == DepthKind::Device) else {
        return Ok(());
    };
    let near = entry.near(depth);
    ensure(near.is_some(), format!("{field}.near"), || {
        "missing, and device depth needs it; give this or depth.near".to_owned()
    })?;
    let far = entry.far(Some(depth));
    ensure(far != FarPlane::Undeclared, format!("{field}.far"), || {
        "missing, and device depth needs it; give this or depth.far (\"inf\" for none)".to_owned()
    })?;
    planes(near, far, field)
}

/// The first section that divides by the frame's exposure.
fn pre_exposed(manifest: &Manifest) -> Option<Section> {
    let is = |source: Option<&ColorSource>| source.is_some_and(|source| source.pre_exposed);
    let reference = manifest.reference.as_ref().is_some_and(|source| source.pre_exposed);
    [
        (Section::Color, manifest.color.pre_exposed),
        (Section::Albedo, is(manifest.albedo.as_ref())),
        (Section::UnjitteredColor, is(manifest.unjittered_color.as_ref())),
        (Section::Reference, reference),
    ]
    .into_iter()
    .find_map(|(section, pre_exposed)| pre_exposed.then_some(section))
}

/// What needs every frame's camera, if anything does.
fn needs_camera(manifest: &Manifest) -> Option<&'static str> {
    let is_ray = manifest
        .depth
        .as_ref()
        .is_some_and(|depth| depth.kind == DepthKind::RayDistance);
    let derives = manifest
        .motion
        .as_ref()
        .is_some_and(|motion| motion.invalid_value.is_some());
    match (is_ray, derives) {
        (true, _) => Some("depth.kind ray_distance"),
        (_, true) => Some("motion.invalid_value"),
        _ => None,
    }
}
