//! `manifest.json`, schema `afterimage-sequence/1`: where a sequence's files are and which conventions its engine
//! used. [`Manifest::parse`] fills what the named preset knows, then checks everything a number or a path can get
//! wrong, so that the loader meets no surprise but a bad image file.

mod check;
mod path;
mod preset;

pub use path::PathTemplate;
pub use preset::Preset;

use crate::{image::Extent, metrics::Display};
use serde::{Deserialize, Deserializer, de};
use serde_json::Value;
use std::{fmt, slice};

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
    /// Reserved by the schema; must be null.
    pub checkerboard: Option<Value>,
    /// Reserved by the schema; must be null.
    pub layers: Option<Value>,
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

/// How stored colour values become linear light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Transfer {
    /// They are linear already.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// SMPTE ST 2084; absolute luminance.
    Pq,
}

/// Files of RGB pixels.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorSource {
    /// Where they are.
    pub path: PathTemplate,
    /// Full channel names of red, green and blue.
    pub channels: [String; 3],
    /// How the stored values are encoded.
    pub transfer: Transfer,
    /// The stored values were multiplied by the frame's exposure.
    #[serde(default)]
    pub pre_exposed: bool,
    /// With `pq`: the luminance of linear 1.0, in cd/m².
    #[serde(default = "default_nits_per_unit")]
    pub nits_per_unit: f64,
}

fn default_nits_per_unit() -> f64 {
    100.0
}

/// Ground truth: colour, and how it was sampled.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceSource {
    /// Where the files are.
    pub path: PathTemplate,
    /// Full channel names of red, green and blue.
    pub channels: [String; 3],
    /// How the stored values are encoded.
    pub transfer: Transfer,
    /// The stored values were multiplied by the frame's exposure.
    #[serde(default)]
    pub pre_exposed: bool,
    /// With `pq`: the luminance of linear 1.0, in cd/m².
    #[serde(default = "default_nits_per_unit")]
    pub nits_per_unit: f64,
    /// Name of the pixel filter, such as `box`.
    pub filter: Option<String>,
    /// Its radius in pixels.
    pub filter_radius_px: Option<f64>,
    /// Samples per pixel.
    pub spp: Option<u32>,
    /// The space in which samples were averaged.
    pub averaged_in: Option<AveragedIn>,
}

impl ReferenceSource {
    /// The part that says where the pixels are and how they are encoded.
    pub fn color(&self) -> ColorSource {
        ColorSource {
            path: self.path.clone(),
            channels: self.channels.clone(),
            transfer: self.transfer,
            pre_exposed: self.pre_exposed,
            nits_per_unit: self.nits_per_unit,
        }
    }
}

/// The space in which a reference's samples were averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AveragedIn {
    /// Linear light.
    Linear,
    /// After Karis's `c / (1 + luma)`, which tames bright samples.
    Karis,
}

/// Files of depth.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthSource {
    /// Where they are.
    pub path: PathTemplate,
    /// Full channel name.
    pub channel: String,
    /// What a value measures.
    pub kind: DepthKind,
    /// Device depth is 1 at the near plane and 0 at the far one.
    #[serde(default)]
    pub reversed: bool,
    /// Near plane, in depth units. Left out: the frame's camera's.
    pub near: Option<f64>,
    /// Far plane, in depth units. Left out: the frame's camera's.
    #[serde(default)]
    pub far: FarPlane,
    /// Depths at or beyond this are sky: the stored value after scale and bias, or for device depth the linear depth.
    #[serde(default = "default_sky_value")]
    pub sky_value: f64,
    /// Multiplies the stored value. Device depth in [−1, 1] has scale 0.5 and bias 0.5.
    #[serde(default = "default_scale")]
    pub scale: f64,
    /// Added after `scale`.
    #[serde(default)]
    pub bias: f64,
}

fn default_sky_value() -> f64 {
    f64::from(super::frame::SKY_DEPTH)
}

fn default_scale() -> f64 {
    1.0
}

/// What a depth value measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthKind {
    /// Distance along the view axis.
    LinearViewZ,
    /// What a depth buffer holds, in [0, 1].
    Device,
    /// Distance from the eye. Needs every frame's camera.
    RayDistance,
}

/// A far plane. JSON has no infinity: null, -1 (as Arm's data sets write it) and "inf" all stand for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FarPlane {
    /// Not given here.
    #[default]
    Undeclared,
    /// There is none.
    Infinite,
    /// At this distance, in depth units.
    At(f64),
}

impl<'de> Deserialize<'de> for FarPlane {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Json {
            Number(f64),
            Text(String),
        }
        match Option::<Json>::deserialize(deserializer)? {
            None => Ok(Self::Infinite),
            Some(Json::Number(-1.0)) => Ok(Self::Infinite),
            Some(Json::Number(far)) => Ok(Self::At(far)),
            Some(Json::Text(text)) if text == "inf" => Ok(Self::Infinite),
            Some(Json::Text(text)) => Err(de::Error::custom(format!(
                "`{text}` is no far plane; write a distance, or null, -1 or \"inf\" for none"
            ))),
        }
    }
}

/// Files of motion vectors.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSource {
    /// Where they are.
    pub path: PathTemplate,
    /// Full channel names of x and y.
    pub channels: [String; 2],
    /// What 1.0 means, after scale and bias.
    pub units: MotionUnits,
    /// Which way a vector points.
    pub direction: MotionDirection,
    /// Which way positive y points.
    pub y: YAxis,
    /// Multiplies the stored value.
    #[serde(default = "default_motion_scale")]
    pub scale: [f64; 2],
    /// Added after `scale`.
    #[serde(default)]
    pub bias: [f64; 2],
    /// Vectors join jittered positions, so that they contain the change of jitter.
    #[serde(default)]
    pub jittered: bool,
    /// The engine spread each foreground vector over its silhouette already.
    #[serde(default)]
    pub dilated: bool,
    /// Stored value that stands for "derive this one from depth and the cameras".
    pub invalid_value: Option<InvalidMotion>,
}

fn default_motion_scale() -> [f64; 2] {
    [1.0, 1.0]
}

/// What 1.0 of motion means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionUnits {
    /// One pixel of the inputs.
    PixelsRender,
    /// One pixel of the output.
    PixelsOutput,
    /// The image's width or height.
    Uv,
    /// Half the image's width or height.
    Ndc,
}

/// Which way a motion vector points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionDirection {
    /// `previous = current + vector`.
    CurrentToPrevious,
    /// `previous = current − vector`.
    PreviousToCurrent,
}

/// Which way positive y points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum YAxis {
    /// Towards later rows.
    Down,
    /// Towards earlier rows.
    Up,
}

/// Stored motion that is none. A number speaks of x alone, as Unreal's zero does; a pair of both components.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum InvalidMotion {
    /// x has this value.
    X(f64),
    /// x and y have these values.
    Xy([f64; 2]),
}

/// What the frames' `jitter` means.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JitterConvention {
    /// What 1.0 means.
    pub units: JitterUnits,
    /// What was moved.
    pub meaning: JitterMeaning,
    /// Which way positive y points.
    pub y: YAxis,
}

/// What 1.0 of jitter means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JitterUnits {
    /// One pixel of the inputs.
    PixelsRender,
    /// The image's width or height.
    Uv,
    /// Half the image's width or height.
    Ndc,
}

/// What a jitter moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JitterMeaning {
    /// The sample's place within its pixel.
    SampleOffset,
    /// The projected image, hence the sample by the opposite.
    ProjectionOffset,
}

/// Files of one channel.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSource {
    /// Where they are.
    pub path: PathTemplate,
    /// Full channel name.
    pub channel: String,
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
        depth.near.or(self.camera.as_ref()?.near)
    }

    /// The far plane that holds for this frame's `depth`.
    pub fn far(&self, depth: Option<&DepthSource>) -> FarPlane {
        [depth.map(|depth| depth.far), self.camera.as_ref().map(|camera| camera.far)]
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
        })
    }
}

/// The files of one section and what to read from them.
#[derive(Clone, Copy, Debug)]
pub struct ImageSource<'a> {
    /// Whose files they are.
    pub section: Section,
    /// Where they are.
    pub path: &'a PathTemplate,
    /// Full channel names, in order.
    pub channels: &'a [String],
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

    /// Every section that names image files, as far as declared.
    pub fn images(&self) -> Vec<ImageSource<'_>> {
        fn color(section: Section, source: &ColorSource) -> (Section, &PathTemplate, &[String]) {
            (section, &source.path, &source.channels)
        }
        fn plane(section: Section, source: &PlaneSource) -> (Section, &PathTemplate, &[String]) {
            (section, &source.path, slice::from_ref(&source.channel))
        }
        let reference = self.reference.as_ref();
        [
            Some(color(Section::Color, &self.color)),
            self.depth.as_ref().map(|depth| (Section::Depth, &depth.path, slice::from_ref(&depth.channel))),
            self.motion.as_ref().map(|motion| (Section::Motion, &motion.path, motion.channels.as_slice())),
            self.albedo.as_ref().map(|source| color(Section::Albedo, source)),
            self.object_id.as_ref().map(|source| plane(Section::ObjectId, source)),
            self.reactive.as_ref().map(|source| plane(Section::Reactive, source)),
            self.unjittered_color.as_ref().map(|source| color(Section::UnjitteredColor, source)),
            reference.map(|source| (Section::Reference, &source.path, source.channels.as_slice())),
        ]
        .into_iter()
        .flatten()
        .map(|(section, path, channels)| ImageSource { section, path, channels })
        .collect()
    }
}

/// Names the field, and for an unknown one the nearest known. serde's message quotes the unknown name first and the
/// known ones after it; there is no other way to the list.
fn describe(error: &serde_path_to_error::Error<serde_json::Error>) -> ManifestError {
    let message = error.inner().to_string();
    let path = error.path().to_string();
    let mut quoted = message.split('`').skip(1).step_by(2);
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
