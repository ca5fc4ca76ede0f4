//! The manifest's sections that name image files, and the conventions of what is in them.

use super::PathTemplate;
use crate::sequence::frame::SKY_DEPTH;
use serde::{Deserialize, Deserializer, Serialize, de};

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
    /// How noisy it is.
    pub noise_floor: Option<NoiseFloor>,
}

/// How far a reference is expected to be from the mean of infinitely many samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseFloor {
    /// Root mean square over pixels, channels and frames, in linear light.
    pub rms_linear: f64,
    /// The same as shown, as PSNR in dB: no output can be told to be better than this. None without any noise.
    pub psnr_db: Option<f64>,
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
    f64::from(SKY_DEPTH)
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

/// Frames that shade every other pixel, two opposing ones of each 2×2.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkerboard {
    /// A number a frame, over and over: 0 where the frame shades the pixels whose x + y is even, 1 where odd.
    pub parity: Vec<u32>,
}

impl Checkerboard {
    /// The parity of the frame at `index`.
    pub fn parity_of(&self, index: usize) -> u32 {
        self.parity[index % self.parity.len()]
    }
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

/// Several samples of each pixel, `{sample}` in paths or channel names.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplesSource {
    /// How many, counted from 0.
    pub count: u32,
}

/// Several layers of each pixel, `{layer}` in paths or channel names, the nearest first.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayersSource {
    /// How many, counted from 0.
    pub count: u32,
    /// How much of the light each takes.
    pub alpha: AlphaSource,
    /// Colours are multiplied by their layer's opacity already.
    #[serde(default)]
    pub premultiplied: bool,
}

/// Files of a layer's opacity.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlphaSource {
    /// Where they are.
    pub path: PathTemplate,
    /// Full channel name.
    pub channel: String,
    /// What is stored.
    #[serde(default)]
    pub meaning: AlphaMeaning,
}

/// What a layer's alpha says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlphaMeaning {
    /// 1 hides what lies behind.
    #[default]
    Opacity,
    /// 1 hides nothing.
    Transmittance,
}
