//! A recipe: the parameters of the temporal pipeline. Published systems are recipes ([`super::Preset`]); a job may
//! override any parameter by its name here, which is also the name of the override in
//! `shaders/taa/temporal/recipe.wgsl`. What a parameter means, its unit and its range stand beside it and nowhere else
//! ([`parameters()`]).

mod blocks;
mod parameters;
mod rules;

pub use blocks::{
    Algorithm, Dilation, Domain, Guards, HdrWeight, HistoryFilter, InputFilter, Neighbourhood, Rectify, Sharpen, Space,
    Spatial, Weight,
};

pub use parameters::{Choice, Kind, Parameter, Range, parameters};

use super::Source;
use crate::sequence::Sizes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Every parameter of the temporal pipeline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// What resolves a frame.
    pub algorithm: Algorithm,
    /// With `phlm2016`, refresh the feature by the formula as printed, a power too high and without a floor.
    pub phlm_printed: bool,
    /// Which colour is resolved.
    pub source: Source,
    /// The domain in which colours are compared, blended and stored.
    pub domain: Domain,
    /// Anti-aliasing of each frame by itself, before everything else.
    pub spatial: Spatial,
    /// Decode the sRGB of the domain `display` before a spatial filter mixes colours and encode after, as a sampler of an sRGB
    /// texture does.
    pub spatial_decodes: bool,
    /// Which texel's motion vector a pixel uses, over the 3×3 around it.
    pub dilation: Dilation,
    /// How the current colour is read.
    pub input_filter: InputFilter,
    /// How history is read at the reprojected position.
    pub history_filter: HistoryFilter,
    /// Look history up where the motion vector points; otherwise in the same pixel.
    pub reproject: bool,
    /// Store history as f32 whatever the job says, for averages longer than f16 can hold.
    pub history_always_f32: bool,
    /// Clamp filtered history to the 4 texels around the position.
    pub deringing: bool,
    /// The colour space of box and rectification.
    pub space: Space,
    /// The colour box of the current neighbourhood.
    pub neighbourhood: Neighbourhood,
    /// Make the chroma of a `ycocg` box an eighth of its luma range to either side of the current colour's.
    pub chroma_from_luma: bool,
    /// Read the box's texels at the jitter-free grid, bilinearly.
    pub unjitter_neighbourhood: bool,
    /// Side of the variance box's window.
    #[schemars(extend("unit" = "texels", "odd" = true), range(min = 3, max = 31))]
    pub variance_window: u32,
    /// Half extent of the variance box.
    #[schemars(extend("unit" = "standard deviations", "exclusiveMinimum" = 0.0), range(max = 100.0))]
    pub variance_gamma: f64,
    /// Find mean and deviation in two passes whose cost does not depend on the window.
    pub prefilter_moments: bool,
    /// Intersect the variance box with the 3×3 minimum and maximum.
    pub intersect_minmax: bool,
    /// What is done to history outside the box.
    pub rectify: Rectify,
    /// Treat history as absent where the previous depth does not fit.
    pub reject_depth: bool,
    /// The largest difference of depth that still fits, as a share of the depth expected.
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 1.0))]
    pub reject_depth_tolerance: f64,
    /// Treat history as absent where it is of another object.
    pub reject_id: bool,
    /// How the weight of the current colour is found.
    pub weight: Weight,
    /// Weight of the current colour where `weight` is `fixed`.
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 1.0))]
    pub current_weight: f64,
    /// Weight of history where its luma differs most, for `luma_feedback`.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub luma_feedback_lo: f64,
    /// Weight of history where its luma agrees, for `luma_feedback`.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub luma_feedback_hi: f64,
    /// The smallest weight of `count`.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub count_weight_min: f64,
    /// Raise the weight to the sequence's reactive mask.
    pub reactive: bool,
    /// Raise the weight with motion.
    pub motion_weight: bool,
    /// Motion at which the weight begins to rise.
    #[schemars(extend("unit" = "px"), range(min = 0.0, max = 1e6))]
    pub motion_weight_from_px: f64,
    /// Motion at which the weight reaches 1; above `motion_weight_from_px`.
    #[schemars(extend("unit" = "px", "exclusiveMinimum" = 0.0), range(max = 1e6))]
    pub motion_weight_to_px: f64,
    /// Whether bright colours count less in the blend.
    pub hdr_weight: HdrWeight,
    /// How the shown image is sharpened.
    pub sharpen: Sharpen,
    /// How much of the kernel's effect.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub sharpen_strength: f64,
    /// Show fast pixels blurred along their motion instead of resolved.
    pub motion_blur: bool,
    /// What keeps values finite and bounded; `off` shows what the literal formulas do.
    pub guards: Guards,
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

/// Why a recipe cannot make an output of a size from its input.
#[derive(Debug, thiserror::Error)]
pub enum SizesError {
    /// It makes one pixel of each texel.
    #[error("does not upscale, as {0} asks; the input filter `upsample` does")]
    Native(Sizes),
    /// No recipe goes that far.
    #[error("upscales by 1 to 4 along each axis, which {0} is not")]
    Scale(Sizes),
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

    /// Whether passes for it exist: an accuracy reference may have only a twin.
    pub fn check_gpu(&self) -> Result<(), RecipeError> {
        if self.rectify != Rectify::Hull {
            return Ok(());
        }
        Err(RecipeError {
            field: "rectify".to_owned(),
            message: "`hull` is computed by the CPU twin only; `clip_current` is nearest to it".to_owned(),
        })
    }

    /// Whether it can make an output of `sizes` from an input of `sizes`.
    pub fn check_sizes(&self, sizes: Sizes) -> Result<(), SizesError> {
        if sizes == Sizes::native(sizes.render) {
            return Ok(());
        }
        if self.input_filter != InputFilter::Upsample {
            return Err(SizesError::Native(sizes));
        }
        let in_range = sizes.scale().iter().all(|scale| (1.0..=4.0).contains(scale));
        in_range.then_some(()).ok_or(SizesError::Scale(sizes))
    }

    /// Whether what keeps values finite and bounded is on.
    pub(super) fn has_guards(&self) -> bool {
        self.guards == Guards::On
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
        let fields = self.to_fields();
        for parameter in parameters() {
            parameter
                .check(&fields[&parameter.name])
                .map_err(|message| RecipeError {
                    field: parameter.name.clone(),
                    message,
                })?;
        }
        let broken = rules::combinations(self)
            .into_iter()
            .chain(rules::algorithms(self))
            .find(|(holds, ..)| !holds);
        match broken {
            None => Ok(()),
            Some((_, field, message)) => Err(RecipeError {
                field: field.to_owned(),
                message: message.to_owned(),
            }),
        }
    }

    /// The overrides of `shaders/taa/temporal/recipe.wgsl`.
    pub(super) fn overrides(&self) -> Vec<(&'static str, f64)> {
        let number = f64::from;
        let flag = |set: bool| f64::from(u8::from(set));
        vec![
            ("phlm_printed", flag(self.phlm_printed)),
            ("domain", number(self.domain as u32)),
            ("spatial_decodes", flag(self.spatial_decodes)),
            ("space", number(self.space as u32)),
            ("dilation", number(self.dilation as u32)),
            ("input_filter", number(self.input_filter as u32)),
            ("history_filter", number(self.history_filter as u32)),
            ("reproject", flag(self.reproject)),
            ("deringing", flag(self.deringing)),
            ("neighbourhood", number(self.neighbourhood as u32)),
            ("chroma_from_luma", flag(self.chroma_from_luma)),
            ("unjitter_neighbourhood", flag(self.unjitter_neighbourhood)),
            ("variance_window", number(self.variance_window)),
            ("variance_gamma", self.variance_gamma),
            ("prefilter_moments", flag(self.prefilter_moments)),
            ("intersect_minmax", flag(self.intersect_minmax)),
            ("rectify", number(self.rectify as u32)),
            ("reject_depth", flag(self.reject_depth)),
            ("reject_depth_tolerance", self.reject_depth_tolerance),
            ("reject_id", flag(self.reject_id)),
            ("weight", number(self.weight as u32)),
            ("current_weight", self.current_weight),
            ("luma_feedback_lo", self.luma_feedback_lo),
            ("luma_feedback_hi", self.luma_feedback_hi),
            ("count_weight_min", self.count_weight_min),
            ("reactive", flag(self.reactive)),
            ("motion_weight", flag(self.motion_weight)),
            ("motion_weight_from_px", self.motion_weight_from_px),
            ("motion_weight_to_px", self.motion_weight_to_px),
            ("hdr_weight", number(self.hdr_weight as u32)),
            ("sharpen", number(self.sharpen as u32)),
            ("sharpen_strength", self.sharpen_strength),
            ("motion_blur", flag(self.motion_blur)),
            ("guards", flag(self.has_guards())),
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
