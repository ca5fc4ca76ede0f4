//! One frame from files to canonical form: which files to read, each once, and which conversion each image takes.

use super::{
    Channels, Frame, ImageProblem, Manifest, Others, Section, Sequence, SequenceError, Several,
    convention::{ColorDecoder, DepthDecoder, MotionDecoder, Projector, jitter_px},
    frame::{Rgb, SKY_DEPTH},
    manifest::{AlphaMeaning, ColorSource, DepthSource, FarPlane, FrameEntry, ImageSource, Transfer},
};
use crate::image::{
    Extent, Image,
    files::{Plane, Planes, SampleType},
};
use glam::DVec2;
use std::{borrow::Cow, collections::BTreeMap, path::Path};

/// An image of another system's output.
pub enum Output {
    /// Linear RGB.
    Linear(Image<Rgb>),
    /// What a display is sent, 0 to 1.
    Shown(Image<Rgb>),
}

/// Every frame's sample offset.
pub(super) fn jitters_px(manifest: &Manifest) -> Vec<[f64; 2]> {
    manifest
        .frames
        .iter()
        .map(|entry| {
            let in_px = |convention| jitter_px(convention, entry.jitter, manifest.render_size);
            manifest.jitter.map_or([0.0; 2], in_px)
        })
        .collect()
}

/// Every frame's camera; none at all unless each frame has a usable one, which the manifest's check ensures where a
/// convention needs it.
pub(super) fn projectors(manifest: &Manifest) -> Vec<Projector> {
    let projector = |entry: &FrameEntry| Projector::new(entry.camera.as_ref()?, manifest.render_size);
    manifest
        .frames
        .iter()
        .map(projector)
        .collect::<Option<_>>()
        .unwrap_or_default()
}

/// The decoded files of one frame, by relative path, with the names of their planes.
struct Decoded(BTreeMap<String, (Vec<String>, Planes)>);

impl Decoded {
    fn plane(&self, entry: &FrameEntry, image: &ImageSource, channel: usize) -> (&Plane, SampleType) {
        let (names, planes) = &self.0[&Sequence::relative_path(entry, image)];
        let position = names
            .iter()
            .position(|name| *name == image.channels[channel])
            .expect("every wanted channel was read");
        (&planes.planes[position], planes.samples[position])
    }

    fn floats(&self, entry: &FrameEntry, image: &ImageSource, channel: usize) -> Cow<'_, [f32]> {
        match self.plane(entry, image, channel).0 {
            Plane::F32(values) => Cow::Borrowed(values),
            Plane::U32(values) => Cow::Owned(values.iter().map(|&value| value as f32).collect()),
        }
    }
}

impl Sequence {
    /// Loads one frame: colour, and of `channels` what the manifest declares. Reads each file once and decodes no
    /// other channels; may be called from several threads.
    pub fn load(&self, index: usize, channels: Channels) -> Result<Frame, SequenceError> {
        Ok(self.frame_files(index, channels)?.convert(channels))
    }

    /// A frame's reference alone, linear RGB; none where the manifest declares none.
    pub fn load_reference(&self, index: usize) -> Result<Option<Image<Rgb>>, SequenceError> {
        Ok(self.files(index, |section| section == Section::Reference)?.reference())
    }

    /// The decoded files of one frame's colour and `channels`.
    pub(super) fn frame_files(&self, index: usize, channels: Channels) -> Result<FrameFiles<'_>, SequenceError> {
        let derives_motion = self
            .manifest
            .motion
            .as_ref()
            .is_some_and(|motion| motion.invalid_value.is_some());
        let reads = Channels {
            depth: channels.depth || (channels.motion && derives_motion),
            ..channels
        };
        self.files(index, |section| wants(reads, section))
    }

    /// The decoded files of the sections that are wanted.
    fn files(&self, index: usize, wanted: impl Fn(Section) -> bool) -> Result<FrameFiles<'_>, SequenceError> {
        let entry = self.entry(index)?;
        let mut images = self.manifest.images();
        images.retain(|image| wanted(image.section));
        Ok(FrameFiles {
            sequence: self,
            entry,
            decoded: self.read(entry, &images)?,
            images,
        })
    }

    /// An image of another system's output. A float file is linear already; the codes of an integer file are decoded as the
    /// reference's are. Beside a linear reference they are what a display is sent, and left so.
    pub fn load_output(&self, index: usize, path: &Path) -> Result<Output, SequenceError> {
        let failed = |problem| SequenceError::Output { frame: index, problem };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let file = self.reader.read_rgb(path).map_err(|error| failed(error.into()))?;
        self.check_size(Section::Reference, &name, file.image.extent())
            .map_err(failed)?;
        if !matches!(file.sample, SampleType::U8 | SampleType::U16) {
            return Ok(Output::Linear(file.image));
        }
        let reference = self.manifest.reference.as_ref().map(|reference| reference.color());
        let Some(source) = reference.filter(|source| source.transfer != Transfer::Linear) else {
            return Ok(Output::Shown(file.image));
        };
        let decoder = ColorDecoder {
            transfer: source.transfer,
            nits_per_unit: source.nits_per_unit,
            exposure: 1.0,
        };
        Ok(Output::Linear(file.image.map(|pixel| decoder.decode(pixel))))
    }

    fn read(&self, entry: &FrameEntry, images: &[ImageSource]) -> Result<Decoded, SequenceError> {
        let mut files: BTreeMap<String, Vec<&ImageSource>> = BTreeMap::new();
        for image in images {
            files.entry(Self::relative_path(entry, image)).or_default().push(image);
        }
        let mut decoded = BTreeMap::new();
        for (path, images) in files {
            let mut names: Vec<String> = images.iter().flat_map(|image| image.channels.iter()).cloned().collect();
            names.sort();
            names.dedup();
            let failed = |section, problem| SequenceError::Image {
                frame: entry.index,
                section,
                problem,
            };
            let planes = self
                .resolve(&path)
                .and_then(|file| Ok(self.reader.read(&file, &names)?))
                .map_err(|problem| failed(images[0].section, problem))?;
            for image in images {
                self.check_size(image.section, &path, planes.extent)
                    .map_err(|problem| failed(image.section, problem))?;
            }
            decoded.insert(path, (names, planes));
        }
        Ok(Decoded(decoded))
    }

    /// Whether an image has the size that the manifest declares for its section.
    pub(super) fn check_size(&self, section: Section, path: &str, actual: Extent) -> Result<(), ImageProblem> {
        let (field, expected) = match section {
            Section::Reference => ("output_size", self.output_size()),
            _ => ("render_size", self.render_size()),
        };
        if actual == expected {
            return Ok(());
        }
        Err(ImageProblem::Size {
            path: path.to_owned(),
            actual,
            field,
            expected,
        })
    }
}

fn wants(channels: Channels, section: Section) -> bool {
    match section {
        Section::Color => true,
        Section::Depth => channels.depth,
        Section::Motion => channels.motion,
        Section::Albedo => channels.albedo,
        Section::ObjectId => channels.object_id,
        Section::Reactive => channels.reactive,
        Section::UnjitteredColor => channels.unjittered_color,
        Section::Reference => channels.reference,
        Section::Opacity => true,
        Section::Disoccluded => false,
    }
}

/// A frame's decoded files on their way to canonical form.
pub(super) struct FrameFiles<'a> {
    sequence: &'a Sequence,
    entry: &'a FrameEntry,
    images: Vec<ImageSource<'a>>,
    decoded: Decoded,
}

impl FrameFiles<'_> {
    pub(super) fn convert(&self, channels: Channels) -> Frame {
        let manifest = &self.sequence.manifest;
        let index = self.entry.index;
        let depth = self.depth(0);
        let parity = manifest.checkerboard.as_ref().map(|mask| mask.parity_of(index));
        let color = self.color(Section::Color, 0, Some(&manifest.color));
        let albedo = self.color(Section::Albedo, 0, manifest.albedo.as_ref());
        Frame {
            index,
            reset: self.entry.reset || index == 0,
            jitter_px: self.sequence.jitter_px[index],
            far: far_distance(self.entry, manifest.depth.as_ref()),
            display: manifest.display,
            output_size: manifest.output_size,
            parity,
            color: shaded(color, parity, [0.0; 3]).expect("colour is always read"),
            motion_px: shaded(self.motion(0, depth.as_ref()), parity, [f32::NAN; 2]),
            depth: shaded(depth.filter(|_| channels.depth), parity, SKY_DEPTH),
            object_id: self.object_id(),
            albedo: shaded(albedo, parity, [0.0; 3]),
            reactive: self.reactive(),
            unjittered_color: self.color(Section::UnjitteredColor, 0, manifest.unjittered_color.as_ref()),
            reference: self.reference(),
            others: manifest.several().map(|several| self.others(several, channels)),
        }
    }

    /// The values of a section's channels as they are stored, if the section was read: those of a sample or layer, or those
    /// that all share.
    pub(super) fn stored(&self, section: Section, item: usize) -> Option<Vec<Cow<'_, [f32]>>> {
        let image = self.image(section, item).or_else(|| self.image(section, 0))?;
        Some(
            (0..image.channels.len())
                .map(|channel| self.floats(image, channel))
                .collect(),
        )
    }

    /// The images of all samples but the first, or of the layers behind the nearest.
    fn others(&self, several: Several, channels: Channels) -> Others {
        let manifest = &self.sequence.manifest;
        let behind = 1..several.n_items as usize;
        let color = |item| {
            self.color(Section::Color, item, Some(&manifest.color))
                .expect("checked with the manifest")
        };
        let differs = |section| self.image(section, 1).is_some();
        let own_depth = |item| match differs(Section::Depth) {
            true => self.depth(item),
            false => None,
        };
        let own_motion = |item| {
            let depth = own_depth(item).or_else(|| self.depth(0));
            self.motion(item, depth.as_ref())
        };
        Others {
            merging: several.merging,
            color: behind.clone().map(color).collect(),
            opacity: (0..several.n_items as usize)
                .filter_map(|item| self.opacity(item))
                .collect(),
            motion_px: behind.clone().filter_map(own_motion).collect(),
            depth: behind.filter(|_| channels.depth).filter_map(own_depth).collect(),
        }
    }

    fn opacity(&self, item: usize) -> Option<Image<f32>> {
        let image = self.image(Section::Opacity, item)?;
        let meaning = self.sequence.manifest.layers.as_ref()?.alpha.meaning;
        let plane = self.floats(image, 0);
        Some(from_indices(self.sequence.render_size(), |i| match meaning {
            AlphaMeaning::Opacity => plane[i],
            AlphaMeaning::Transmittance => 1.0 - plane[i],
        }))
    }

    fn image(&self, section: Section, item: usize) -> Option<&ImageSource<'_>> {
        let mut images = self.images.iter();
        images.find(|image| image.section == section && image.item == item)
    }

    fn floats(&self, image: &ImageSource, channel: usize) -> Cow<'_, [f32]> {
        self.decoded.floats(self.entry, image, channel)
    }

    fn color(&self, section: Section, item: usize, source: Option<&ColorSource>) -> Option<Image<Rgb>> {
        let (image, source) = (self.image(section, item)?, source?);
        let planes = [0, 1, 2].map(|channel| self.floats(image, channel));
        let decoder = ColorDecoder {
            transfer: source.transfer,
            nits_per_unit: source.nits_per_unit,
            exposure: self.entry.exposure.filter(|_| source.pre_exposed).unwrap_or(1.0),
        };
        let extent = match section {
            Section::Reference => self.sequence.output_size(),
            _ => self.sequence.render_size(),
        };
        Some(from_indices(extent, |i| {
            decoder.decode([planes[0][i], planes[1][i], planes[2][i]])
        }))
    }

    fn reference(&self) -> Option<Image<Rgb>> {
        let source = self.sequence.manifest.reference.as_ref()?.color();
        self.color(Section::Reference, 0, Some(&source))
    }

    /// The position that pixel `i` samples, jitter included.
    fn sample_px(&self, i: usize) -> DVec2 {
        let width = self.sequence.render_size().width as usize;
        let jitter = self.sequence.jitter_px[self.entry.index];
        DVec2::new(
            (i % width) as f64 + 0.5 + jitter[0],
            (i / width) as f64 + 0.5 + jitter[1],
        )
    }

    fn depth(&self, item: usize) -> Option<Image<f32>> {
        let (image, source) = (
            self.image(Section::Depth, item)?,
            self.sequence.manifest.depth.as_ref()?,
        );
        let plane = self.floats(image, 0);
        let decoder = DepthDecoder {
            kind: source.kind,
            reversed: source.reversed,
            near: self.entry.near(source).unwrap_or(0.0),
            far: far_distance(self.entry, Some(source)),
            sky_value: source.sky_value,
            scale: source.scale,
            bias: source.bias,
            camera: self.sequence.projectors.get(self.entry.index),
        };
        Some(from_indices(self.sequence.render_size(), |i| {
            decoder.decode(plane[i], self.sample_px(i))
        }))
    }

    fn motion(&self, item: usize, depth: Option<&Image<f32>>) -> Option<Image<[f32; 2]>> {
        let (image, source) = (
            self.image(Section::Motion, item)?,
            self.sequence.manifest.motion.as_ref()?,
        );
        let (x, y) = (self.floats(image, 0), self.floats(image, 1));
        let index = self.entry.index;
        // The first frame has no predecessor; whatever its motion says, there is no history to fetch.
        let previous = index.saturating_sub(1);
        let jitters = &self.sequence.jitter_px;
        let (render, output) = (self.sequence.render_size(), self.sequence.output_size());
        let decoder = MotionDecoder::new(source, render, output, jitters[index], jitters[previous]);
        let projectors = &self.sequence.projectors;
        Some(from_indices(render, |i| {
            decoder.decode([x[i], y[i]]).unwrap_or_else(|| {
                let depth = depth.expect("read whenever motion is derived from it");
                let z = f64::from(depth.pixels()[i]);
                let motion = projectors[index].motion_px(&projectors[previous], self.sample_px(i), z);
                motion.as_vec2().to_array()
            })
        }))
    }

    pub(super) fn object_id(&self) -> Option<Image<u32>> {
        let image = self.image(Section::ObjectId, 0)?;
        let extent = self.sequence.render_size();
        let (plane, sample) = self.decoded.plane(self.entry, image, 0);
        // Blender writes ids as floats; small integers were read as fractions of their largest value.
        let id_of_one = match sample {
            SampleType::U8 => 255.0,
            SampleType::U16 => 65535.0,
            SampleType::U32 | SampleType::F16 | SampleType::F32 => 1.0,
        };
        Some(match plane {
            Plane::U32(ids) => Image::from_pixels(extent, ids.clone()),
            Plane::F32(ids) => from_indices(extent, |i| (ids[i] * id_of_one).round() as u32),
        })
    }

    fn reactive(&self) -> Option<Image<f32>> {
        let image = self.image(Section::Reactive, 0)?;
        let plane = self.floats(image, 0);
        Some(Image::from_pixels(self.sequence.render_size(), plane.into_owned()))
    }
}

/// With `nothing` in the pixels that a checkerboard leaves out: engines leave there what they like.
fn shaded<T: Copy + Send + Sync>(image: Option<Image<T>>, parity: Option<u32>, nothing: T) -> Option<Image<T>> {
    let Some(parity) = parity else { return image };
    let image = image?;
    let kept = |x: u32, y: u32| if (x + y) % 2 == parity { image.at(x, y) } else { nothing };
    Some(Image::from_fn(image.extent(), kept))
}

fn far_distance(entry: &FrameEntry, depth: Option<&DepthSource>) -> f64 {
    match entry.far(depth) {
        FarPlane::At(far) => far,
        FarPlane::Infinite | FarPlane::Undeclared => f64::INFINITY,
    }
}

fn from_indices<T: Copy + Send + Sync>(extent: Extent, f: impl Fn(usize) -> T + Sync) -> Image<T> {
    let width = extent.width as usize;
    Image::from_fn(extent, |x, y| f(y as usize * width + x as usize))
}
