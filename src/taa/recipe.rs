//! A recipe: the parameters of the temporal pipeline. Published systems are recipes ([`super::Preset`]); a job may
//! override any parameter by its name here, which is also the name of the override in
//! `shaders/taa/temporal/resolve.wgsl`.

use super::Source;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Which texel's motion vector a pixel uses, over the 3×3 around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dilation {
    /// Its own.
    None,
    /// That of the nearest surface.
    Closest,
    /// The longest.
    Longest,
}

/// How the current colour is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InputFilter {
    /// The texel as it is.
    Texel,
    /// Bilinear, at the place where the jitter put the pixel's centre.
    Unjitter,
    /// A Gaussian fit of the Blackman-Harris window over 3×3 samples, `exp(-2.29 d²)`.
    BlackmanHarris,
}

/// How history is read at the reprojected position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryFilter {
    /// No history: each frame stands alone.
    None,
    /// The texel that contains the position.
    Texel,
    /// 2×2 bilinear.
    Bilinear,
    /// 4×4 Catmull-Rom spline.
    CatmullRom,
    /// The spline without its corners, as five bilinear taps.
    #[serde(rename = "catmull_rom_5")]
    CatmullRom5,
}

/// The colour space of box and rectification.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Space {
    /// Red, green, blue.
    Rgb,
    /// Luma and two chroma axes.
    Ycocg,
}

/// The colour box of the current neighbourhood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Neighbourhood {
    /// No box.
    None,
    /// Minimum and maximum of 5 texels.
    Cross,
    /// Minimum and maximum of 3×3.
    Box3,
    /// Average of the two before.
    Rounded,
    /// Mean ± `variance_gamma` standard deviations of `variance_window`² texels.
    Variance,
}

/// What is done to history outside the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rectify {
    /// Nothing.
    None,
    /// Each channel clamped.
    Clamp,
    /// Pulled towards the box's centre.
    ClipCentre,
    /// Pulled towards the current colour.
    ClipCurrent,
}

/// How the weight of the current colour is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// `current_weight`.
    Fixed,
    /// By the luma difference of current colour and rectified history.
    LumaFeedback,
    /// Less where history is close to being clamped.
    Antiflicker,
}

/// Whether bright colours count less in the blend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HdrWeight {
    /// They do not.
    None,
    /// By `1 / (1 + luma)`.
    Karis,
}

/// The domain in which colours are compared, blended and stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Linear, as the engine wrote it.
    Linear,
    /// `c / (1 + max(r, g, b))`.
    Tonemapped,
}

/// Every parameter of the temporal pipeline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Which colour is resolved.
    pub source: Source,
    /// See [`Domain`].
    pub domain: Domain,
    /// See [`Dilation`].
    pub dilation: Dilation,
    /// See [`InputFilter`].
    pub input_filter: InputFilter,
    /// See [`HistoryFilter`].
    pub history_filter: HistoryFilter,
    /// Clamp filtered history to the 4 texels around the position.
    pub deringing: bool,
    /// See [`Space`].
    pub space: Space,
    /// See [`Neighbourhood`].
    pub neighbourhood: Neighbourhood,
    /// Read the box's texels at the jitter-free grid, bilinearly.
    pub unjitter_neighbourhood: bool,
    /// Side of the variance box's window, texels: odd, 3 to 31.
    pub variance_window: u32,
    /// Half extent of the variance box in standard deviations, above 0.
    pub variance_gamma: f64,
    /// Intersect the variance box with the 3×3 minimum and maximum.
    pub intersect_minmax: bool,
    /// See [`Rectify`].
    pub rectify: Rectify,
    /// See [`Weight`].
    pub weight: Weight,
    /// Weight of the current colour where `weight` is `fixed`, above 0, at most 1.
    pub current_weight: f64,
    /// Weight of history where its luma differs most, 0 to 1, for `luma_feedback`.
    pub luma_feedback_lo: f64,
    /// Weight of history where its luma agrees, 0 to 1, for `luma_feedback`.
    pub luma_feedback_hi: f64,
    /// Raise the weight with motion.
    pub motion_weight: bool,
    /// Motion at which the weight begins to rise, pixels.
    pub motion_weight_from_px: f64,
    /// Motion at which the weight reaches 1, pixels.
    pub motion_weight_to_px: f64,
    /// See [`HdrWeight`].
    pub hdr_weight: HdrWeight,
    /// Show fast pixels blurred along their motion instead of resolved.
    pub motion_blur: bool,
}

/// A parameter that is unknown, of another type or out of range.
#[derive(Debug, thiserror::Error)]
#[error("parameters.{field}: {message}")]
pub struct RecipeError {
    /// The parameter's name.
    pub field: String,
    /// What is wrong and what would be right.
    pub message: String,
}

impl Recipe {
    /// This recipe with the parameters in `overrides` replaced.
    pub fn with(&self, overrides: &serde_json::Map<String, serde_json::Value>) -> Result<Self, RecipeError> {
        let mut fields = self.to_fields();
        for (name, value) in overrides {
            if !fields.contains_key(name) {
                return Err(unknown(name, fields.keys()));
            }
            fields.insert(name.clone(), value.clone());
        }
        let recipe: Self = parse(serde_json::Value::Object(fields))?;
        recipe.validate()?;
        Ok(recipe)
    }

    /// The parameters by name, as reports carry them.
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::Value::Object(self.to_fields())
    }

    fn to_fields(&self) -> serde_json::Map<String, serde_json::Value> {
        match serde_json::to_value(self) {
            Ok(serde_json::Value::Object(fields)) => fields,
            _ => unreachable!("a struct of enums, booleans and finite numbers is a JSON object"),
        }
    }

    fn validate(&self) -> Result<(), RecipeError> {
        let unit = 0.0..=1.0;
        let check = |ok: bool, field: &str, message: &str| {
            if ok {
                Ok(())
            } else {
                Err(RecipeError {
                    field: field.to_owned(),
                    message: message.to_owned(),
                })
            }
        };
        let window = self.variance_window;
        check(
            window % 2 == 1 && (3..=31).contains(&window),
            "variance_window",
            "must be odd, 3 to 31",
        )?;
        check(
            self.variance_gamma > 0.0 && self.variance_gamma <= 100.0,
            "variance_gamma",
            "must be above 0, at most 100",
        )?;
        check(
            self.current_weight > 0.0 && self.current_weight <= 1.0,
            "current_weight",
            "must be above 0, at most 1",
        )?;
        check(
            unit.contains(&self.luma_feedback_lo),
            "luma_feedback_lo",
            "must be 0 to 1",
        )?;
        check(
            unit.contains(&self.luma_feedback_hi),
            "luma_feedback_hi",
            "must be 0 to 1",
        )?;
        check(
            self.motion_weight_from_px >= 0.0,
            "motion_weight_from_px",
            "must be at least 0",
        )?;
        check(
            self.motion_weight_to_px > self.motion_weight_from_px && self.motion_weight_to_px <= 1e6,
            "motion_weight_to_px",
            "must be above motion_weight_from_px, at most 1e6",
        )?;
        check(
            self.rectify == Rectify::None || self.neighbourhood != Neighbourhood::None,
            "rectify",
            "needs a neighbourhood other than `none`",
        )?;
        check(
            self.weight != Weight::Antiflicker || self.neighbourhood != Neighbourhood::None,
            "weight",
            "`antiflicker` needs a neighbourhood other than `none`",
        )
    }

    /// The overrides of the resolve shader.
    pub(super) fn overrides(&self) -> Vec<(&'static str, f64)> {
        let number = f64::from;
        let flag = |set: bool| f64::from(u8::from(set));
        vec![
            ("domain", number(self.domain as u32)),
            ("space", number(self.space as u32)),
            ("dilation", number(self.dilation as u32)),
            ("input_filter", number(self.input_filter as u32)),
            ("history_filter", number(self.history_filter as u32)),
            ("deringing", flag(self.deringing)),
            ("neighbourhood", number(self.neighbourhood as u32)),
            ("unjitter_neighbourhood", flag(self.unjitter_neighbourhood)),
            ("variance_window", number(self.variance_window)),
            ("variance_gamma", self.variance_gamma),
            ("intersect_minmax", flag(self.intersect_minmax)),
            ("rectify", number(self.rectify as u32)),
            ("weight", number(self.weight as u32)),
            ("current_weight", self.current_weight),
            ("luma_feedback_lo", self.luma_feedback_lo),
            ("luma_feedback_hi", self.luma_feedback_hi),
            ("motion_weight", flag(self.motion_weight)),
            ("motion_weight_from_px", self.motion_weight_from_px),
            ("motion_weight_to_px", self.motion_weight_to_px),
            ("hdr_weight", number(self.hdr_weight as u32)),
            ("motion_blur", flag(self.motion_blur)),
        ]
    }
}

fn parse<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, RecipeError> {
    serde_path_to_error::deserialize(value).map_err(|error| RecipeError {
        field: error.path().to_string(),
        message: error.into_inner().to_string(),
    })
}

fn unknown<'a>(name: &str, known: impl Iterator<Item = &'a String>) -> RecipeError {
    let nearest = known.max_by(|a, b| strsim::jaro_winkler(name, a).total_cmp(&strsim::jaro_winkler(name, b)));
    RecipeError {
        field: name.to_owned(),
        message: match nearest {
            Some(nearest) => format!("unknown parameter; did you mean `{nearest}`?"),
            None => "unknown parameter".to_owned(),
        },
    }
}
