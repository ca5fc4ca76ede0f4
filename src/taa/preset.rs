//! The published systems, as data over the same blocks. `docs/glossary.md` explains the terms.

use super::{
    Source,
    recipe::{Dilation, Domain, HdrWeight, HistoryFilter, InputFilter, Neighbourhood, Recipe, Rectify, Space, Weight},
};
use serde::Serialize;

/// A published system.
#[derive(Clone, Debug, Serialize)]
pub struct Preset {
    /// Stored id; never changes.
    pub id: &'static str,
    /// What it is.
    pub description: &'static str,
    /// Where it was published.
    pub publication: &'static str,
    /// Its parameters.
    pub recipe: Recipe,
}

/// An unknown preset id.
#[derive(Debug, thiserror::Error)]
#[error("there is no preset `{wanted}`; did you mean `{nearest}`? `afterimage list presets` shows all")]
pub struct UnknownPreset {
    wanted: String,
    nearest: &'static str,
}

/// What the presets share unless they say otherwise.
const BASE: Recipe = Recipe {
    source: Source::Color,
    domain: Domain::Linear,
    dilation: Dilation::None,
    input_filter: InputFilter::Texel,
    history_filter: HistoryFilter::Bilinear,
    deringing: false,
    space: Space::Rgb,
    neighbourhood: Neighbourhood::None,
    unjitter_neighbourhood: false,
    variance_window: 3,
    variance_gamma: 1.0,
    intersect_minmax: true,
    rectify: Rectify::None,
    weight: Weight::Fixed,
    current_weight: 0.1,
    luma_feedback_lo: 0.88,
    luma_feedback_hi: 0.97,
    motion_weight: false,
    motion_weight_from_px: 2.0,
    motion_weight_to_px: 20.0,
    hdr_weight: HdrWeight::None,
    motion_blur: false,
};

/// Every published system, in the order of their publication.
pub const PRESETS: [Preset; 5] = [
    Preset {
        id: "none",
        description: "The engine's colour as it is: what anti-aliasing has to improve on",
        publication: "",
        recipe: Recipe {
            source: Source::UnjitteredIfPresent,
            history_filter: HistoryFilter::None,
            ..BASE
        },
    },
    Preset {
        id: "ema",
        description: "Exponential moving average along the motion, without rectification",
        publication: "Yang et al., Amortized Supersampling, 2009",
        recipe: BASE,
    },
    Preset {
        id: "inside",
        description: "Closest-depth dilation, rounded box, clip to its centre, luma feedback, motion-blur fallback",
        publication: "Pedersen, Temporal Reprojection Anti-Aliasing in INSIDE, GDC 2016",
        recipe: Recipe {
            domain: Domain::Tonemapped,
            dilation: Dilation::Closest,
            input_filter: InputFilter::Unjitter,
            neighbourhood: Neighbourhood::Rounded,
            rectify: Rectify::ClipCentre,
            weight: Weight::LumaFeedback,
            motion_blur: true,
            ..BASE
        },
    },
    Preset {
        id: "karis2014",
        description: "Filtered input, five-tap Catmull-Rom history, YCoCg clip, anti-flicker and luma weights",
        publication: "Karis, High-Quality Temporal Supersampling, SIGGRAPH 2014",
        recipe: Recipe {
            dilation: Dilation::Closest,
            input_filter: InputFilter::BlackmanHarris,
            history_filter: HistoryFilter::CatmullRom5,
            space: Space::Ycocg,
            neighbourhood: Neighbourhood::Rounded,
            rectify: Rectify::ClipCentre,
            weight: Weight::Antiflicker,
            hdr_weight: HdrWeight::Karis,
            ..BASE
        },
    },
    Preset {
        id: "salvi2016",
        description: "Longest-motion dilation, Catmull-Rom history, variance clipping towards the current colour",
        publication: "Salvi, An Excursion in Temporal Supersampling, GDC 2016",
        recipe: Recipe {
            domain: Domain::Tonemapped,
            dilation: Dilation::Longest,
            history_filter: HistoryFilter::CatmullRom,
            neighbourhood: Neighbourhood::Variance,
            rectify: Rectify::ClipCurrent,
            ..BASE
        },
    },
];

impl Preset {
    /// The preset with this id.
    pub fn find(id: &str) -> Result<&'static Self, UnknownPreset> {
        const ALL: &[Preset] = &PRESETS;
        ALL.iter().find(|preset| preset.id == id).ok_or_else(|| UnknownPreset {
            wanted: id.to_owned(),
            nearest: ALL
                .iter()
                .map(|preset| preset.id)
                .max_by(|a, b| strsim::jaro_winkler(id, a).total_cmp(&strsim::jaro_winkler(id, b)))
                .unwrap_or_default(),
        })
    }
}
