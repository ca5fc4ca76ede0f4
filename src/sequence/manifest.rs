//! `manifest.json`, schema `afterimage-sequence/1`: where a sequence's files are and which conventions its engine
//! used. [`Manifest::parse`] fills what the named preset knows, then checks everything a number or a path can get
//! wrong, so that the loader meets no surprise but a bad image file.

mod check;
mod path;
mod preset;
mod source;

pub use path::PathTemplate;
pub use preset::Preset;
pub use source::*;

use super::several::{Merging, Several};
use crate::{image::Extent, metrics::Display};
use serde::Deserialize;
use serde_json::Value;
use std::{borrow::Cow, fmt, slice};

/// The only schema there is.
pub const SCHEMA: &str = "afterimage-sequence/1";

/// Why a manifest was refused.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// Not JSON at all.
    #[error("not valid JSON: {0}")]
    Json(String),
    /// Readable, but a field is missing, unknown, of the wrong type or out of range.
    #[error("{field}: {problem}")]
    Field {
        /// Where, such as `frames[3].jitter`.
        field: String,
        /// What is wrong and what would be right.
        problem: String,
    },
}

impl ManifestError {
    fn field(field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Field {
            field: field.into(),
            problem: problem.into(),
        }
    }
}

/// A validated manifest with its preset's defaults filled in.
///
/// Matrices are given as rows and multiply column vectors, so that a translation stands in the last column.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`SCHEMA`].
    pub schema: String,
    /// Short name, shown everywhere; not unique.
    pub name: String,
    /// One line for people.
    pub description: Option<String>,
    /// Under what terms the images may be used.
    pub license: Option<String>,
    /// What wrote the sequence.
    pub source: Option<Source>,
    /// Frames per second.
    pub fps: f64,
    /// Size of colour, depth, motion and all other inputs.
    pub render_size: Extent,
    /// Size of the reference and of the resolved image.
    pub output_size: Extent,
    /// Whose conventions fill the fields that are not given.
    pub preset: Option<Preset>,
    /// Aliased, jittered colour.
    pub color: ColorSource,
    /// Depth.
    pub depth: Option<DepthSource>,
    /// Motion vectors.
    pub motion: Option<MotionSource>,
    /// What the frames' `jitter` means. Needed as soon as one frame has any.
    pub jitter: Option<JitterConvention>,
    /// Unlit colour. Linear unless its `transfer` says otherwise.
    pub albedo: Option<ColorSource>,
    /// Object ids, compared for equality only.
    pub object_id: Option<PlaneSource>,
    /// How little history may be trusted, 0 to 1.
    pub reactive: Option<PlaneSource>,
    /// Colour rendered without jitter. Encoded as `color` is where it does not say otherwise.
    pub unjittered_color: Option<ColorSource>,
    /// Which pixels the frames shade, where that is every other one.
    pub checkerboard: Option<Checkerboard>,
    /// Known answer: 1 where a pixel's surface was not seen in the frame before, 0 where it was, else undecided. Kept for
    /// whoever checks a rejection of history; no recipe reads it.
    pub disoccluded: Option<PlaneSource>,
    /// The settings that `afterimage bake` made the sequence from, for people.
    pub bake: Option<Value>,
    /// Several samples of each pixel.
    pub samples: Option<SamplesSource>,
    /// Several layers of each pixel, one behind the other.
    pub layers: Option<LayersSource>,
    /// Ground truth. Encoded as `color` is where it does not say otherwise.
    pub reference: Option<ReferenceSource>,
    /// How linear colour is shown, for every metric that compares shown images.
    #[serde(default)]
    pub display: Display,
    /// Frames after a reset that are left out of summaries.
    #[serde(default)]
    pub warmup_frames: usize,
    /// In order of time.
    pub frames: Vec<FrameEntry>,
}

/// What wrote the sequence.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Engine or renderer.
    pub engine: String,
    /// Its version.
    pub version: Option<String>,
}

/// One frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameEntry {
    /// Position in the sequence, from 0.
    pub index: usize,
    /// The engine's number, for `{file_frame}` in paths. Frames may share one.
    pub file_frame: Option<u64>,
    /// Sub-pixel offset, as `jitter` of the manifest explains it.
    #[serde(default)]
    pub jitter: [f64; 2],
    /// History is dropped before this frame.
    #[serde(default)]
    pub reset: bool,
    /// What pre-exposed colour was multiplied by.
    pub exposure: Option<f64>,
    /// The camera, without jitter.
    pub camera: Option<Camera>,
}

/// A perspective camera without jitter. Clip space has y up; a projection made for Vulkan's flipped clip space needs
/// its second row negated.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// World to view.
    pub view: [[f64; 4]; 4],
    /// View to clip; clip w is the linear view depth.
    pub projection: [[f64; 4]; 4],
    /// Near plane, in depth units.
    pub near: Option<f64>,
    /// Far plane, in depth units.
    #[serde(default)]
    pub far: FarPlane,
}

impl FrameEntry {
    /// The near plane that holds for this frame's `depth`.
    pub fn near(&self, depth: &DepthSource) -> Option<f64> {
        depth.near.or_else(|| self.camera.as_ref()?.near)
    }

    /// The far plane that holds for this frame's `depth`.
    pub fn far(&self, depth: Option<&DepthSource>) -> FarPlane {
        [
            depth.map(|depth| depth.far),
            self.camera.as_ref().map(|camera| camera.far),
        ]
        .into_iter()
        .flatten()
        .find(|far| *far != FarPlane::Undeclared)
        .unwrap_or_default()
    }
}

/// The manifest's sections that name image files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Section {
    /// `color`.
    Color,
    /// `depth`.
    Depth,
    /// `motion`.
    Motion,
    /// `albedo`.
    Albedo,
    /// `object_id`.
    ObjectId,
    /// `reactive`.
    Reactive,
    /// `unjittered_color`.
    UnjitteredColor,
    /// `reference`.
    Reference,
    /// `layers.alpha`.
    Opacity,
    /// `disoccluded`.
    Disoccluded,
}

impl fmt::Display for Section {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Color => "color",
            Self::Depth => "depth",
            Self::Motion => "motion",
            Self::Albedo => "albedo",
            Self::ObjectId => "object_id",
            Self::Reactive => "reactive",
            Self::UnjitteredColor => "unjittered_color",
            Self::Reference => "reference",
            Self::Opacity => "layers.alpha",
            Self::Disoccluded => "disoccluded",
        })
    }
}

/// The files of one section and what to read from them.
#[derive(Clone, Debug)]
pub struct ImageSource<'a> {
    /// Whose files they are.
    pub section: Section,
    /// Of which sample or layer; 0 where all share them.
    pub item: usize,
    /// Where they are.
    pub path: &'a PathTemplate,
    /// Full channel names, in order.
    pub channels: Cow<'a, [String]>,
}

impl Manifest {
    /// Parses and checks `json`.
    pub fn parse(json: &str) -> Result<Self, ManifestError> {
        Self::from_value(serde_json::from_str(json).map_err(|error| ManifestError::Json(error.to_string()))?)
    }

    /// The same from a JSON value.
    pub fn from_value(mut value: Value) -> Result<Self, ManifestError> {
        preset::fill_defaults(&mut value)?;
        let manifest: Self = serde_path_to_error::deserialize(value).map_err(|error| describe(&error))?;
        check::check(&manifest)?;
        Ok(manifest)
    }

    /// Every image that the manifest names: of each section declared, and of each sample or layer where they differ in it.
    pub fn images(&self) -> Vec<ImageSource<'_>> {
        let sections = self.sections().into_iter();
        sections
            .flat_map(|(section, path, channels)| self.items(section, path, channels))
            .collect()
    }

    /// Every section that names image files, as far as declared: its path and channels as given.
    fn sections(&self) -> Vec<(Section, &PathTemplate, &[String])> {
        fn color(section: Section, source: &ColorSource) -> (Section, &PathTemplate, &[String]) {
            (section, &source.path, &source.channels)
        }
        fn plane(section: Section, source: &PlaneSource) -> (Section, &PathTemplate, &[String]) {
            (section, &source.path, slice::from_ref(&source.channel))
        }
        let reference = self.reference.as_ref();
        [
            Some(color(Section::Color, &self.color)),
            self.depth
                .as_ref()
                .map(|depth| (Section::Depth, &depth.path, slice::from_ref(&depth.channel))),
            self.motion
                .as_ref()
                .map(|motion| (Section::Motion, &motion.path, motion.channels.as_slice())),
            self.albedo.as_ref().map(|source| color(Section::Albedo, source)),
            self.object_id.as_ref().map(|source| plane(Section::ObjectId, source)),
            self.reactive.as_ref().map(|source| plane(Section::Reactive, source)),
            self.unjittered_color
                .as_ref()
                .map(|source| color(Section::UnjitteredColor, source)),
            reference.map(|source| (Section::Reference, &source.path, source.channels.as_slice())),
            self.layers.as_ref().map(|layers| {
                (
                    Section::Opacity,
                    &layers.alpha.path,
                    slice::from_ref(&layers.alpha.channel),
                )
            }),
            self.disoccluded
                .as_ref()
                .map(|source| plane(Section::Disoccluded, source)),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// How many samples or layers each pixel has; none where it is one.
    pub fn several(&self) -> Option<Several> {
        let samples = self.samples.as_ref().map(|samples| (Merging::Samples, samples.count));
        let layers = self.layers.as_ref().map(|layers| {
            let premultiplied = layers.premultiplied;
            (Merging::Layers { premultiplied }, layers.count)
        });
        let (merging, n_items) = samples.or(layers)?;
        Some(Several { merging, n_items })
    }

    /// A section's images, one for each sample or layer where path or channels tell them apart.
    fn items<'a>(
        &'a self,
        section: Section,
        path: &'a PathTemplate,
        channels: &'a [String],
    ) -> impl Iterator<Item = ImageSource<'a>> {
        let differs = !item_names(path, channels).is_empty();
        let n_items = self
            .several()
            .filter(|_| differs)
            .map_or(1, |several| several.n_items as usize);
        (0..n_items).map(move |item| ImageSource {
            section,
            item,
            path,
            channels: match differs {
                true => channels.iter().map(|channel| with_item(channel, item)).collect(),
                false => Cow::Borrowed(channels),
            },
        })
    }
}

/// Which of `{sample}` and `{layer}` a section's path and channels hold.
fn item_names(path: &PathTemplate, channels: &[String]) -> Vec<&'static str> {
    let holds = |name: &&'static str| {
        let braced = format!("{{{name}}}");
        path.numbers_items_as(name) || channels.iter().any(|channel| channel.contains(&braced))
    };
    ["sample", "layer"].into_iter().filter(holds).collect()
}

/// A channel's name with the number of a sample or layer.
fn with_item(channel: &str, item: usize) -> String {
    let number = item.to_string();
    channel.replace("{sample}", &number).replace("{layer}", &number)
}

/// Names the field, and for an unknown one the nearest known. serde's message quotes the unknown name first and the
/// known ones after it; there is no other way to the list.
fn describe(error: &serde_path_to_error::Error<serde_json::Error>) -> ManifestError {
    let message = error.inner().to_string();
    let mut quoted = message.split('`').skip(1).step_by(2);
    // At the top level the path is ".", and a field that is missing there is named by the message alone.
    let path = match error.path().to_string() {
        path if path != "." => path,
        path => match message.strip_prefix("missing field `").and(quoted.clone().next()) {
            Some(field) => field.to_owned(),
            None => path,
        },
    };
    let unknown_field = message.starts_with("unknown field");
    if !unknown_field && !message.starts_with("unknown variant") {
        return ManifestError::field(path, message);
    }
    let unknown = quoted.next().unwrap_or_default().to_owned();
    let known: Vec<&str> = quoted.collect();
    let nearest = known
        .iter()
        .map(|name| (strsim::jaro_winkler(&unknown, name), name))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(similarity, _)| *similarity > 0.7);
    let advice = match nearest {
        Some((_, name)) => format!("did you mean `{name}`?"),
        None => format!("known are {}", known.join(", ")),
    };
    if unknown_field {
        let parent = path.strip_suffix(&unknown).unwrap_or(&path).trim_end_matches('.');
        let dot = if parent.is_empty() { "" } else { "." };
        ManifestError::field(format!("{parent}{dot}{unknown}"), format!("unknown field; {advice}"))
    } else {
        ManifestError::field(path, format!("unknown value `{unknown}`; {advice}"))
    }
}

#[cfg(test)]
mod tests;
