//! The published systems, as data over the same blocks. `docs/glossary.md` explains the terms.

use super::{
    Source,
    recipe::{
        Algorithm, Dilation, Domain, Guards, HdrWeight, HistoryFilter, InputFilter, Neighbourhood, Recipe, Rectify,
        Sharpen, Space, Spatial, Weight,
    },
};
use crate::sequence::jitter::JitterSequence;
use schemars::JsonSchema;
use serde::Serialize;

/// A published system.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Preset {
    /// Stored id; never changes.
    pub id: &'static str,
    /// What it is.
    pub description: &'static str,
    /// Where it was published.
    pub publication: &'static str,
    /// The jitter that it was tuned for, where nothing is upscaled.
    #[schemars(with = "String")]
    pub jitter: JitterSequence,
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
pub(super) const BASE: Recipe = Recipe {
    algorithm: Algorithm::Temporal,
    phlm_printed: false,
    source: Source::Color,
    domain: Domain::Linear,
    spatial: Spatial::None,
    spatial_decodes: true,
    dilation: Dilation::None,
    input_filter: InputFilter::Texel,
    history_filter: HistoryFilter::Bilinear,
    reproject: true,
    history_always_f32: false,
    deringing: false,
    space: Space::Rgb,
    neighbourhood: Neighbourhood::None,
    chroma_from_luma: false,
    unjitter_neighbourhood: false,
    variance_window: 3,
    variance_gamma: 1.0,
    prefilter_moments: false,
    intersect_minmax: true,
    rectify: Rectify::None,
    reject_depth: false,
    reject_depth_tolerance: 0.1,
    reject_id: false,
    weight: Weight::Fixed,
    current_weight: 0.1,
    luma_feedback_lo: 0.88,
    luma_feedback_hi: 0.97,
    count_weight_min: 0.0,
    reactive: false,
    motion_weight: false,
    motion_weight_from_px: 2.0,
    motion_weight_to_px: 20.0,
    hdr_weight: HdrWeight::None,
    sharpen: Sharpen::None,
    sharpen_strength: 1.0,
    motion_blur: false,
    guards: Guards::On,
};

/// What several systems vary.
const INSIDE: Recipe = Recipe {
    domain: Domain::Tonemapped,
    dilation: Dilation::Closest,
    input_filter: InputFilter::Unjitter,
    neighbourhood: Neighbourhood::Rounded,
    rectify: Rectify::ClipCentre,
    weight: Weight::LumaFeedback,
    motion_blur: true,
    ..BASE
};

const SALVI: Recipe = Recipe {
    domain: Domain::Tonemapped,
    dilation: Dilation::Longest,
    history_filter: HistoryFilter::CatmullRom,
    neighbourhood: Neighbourhood::Variance,
    rectify: Rectify::ClipCurrent,
    ..BASE
};

/// Edges are found in what is shown.
const SPATIAL: Recipe = Recipe {
    source: Source::UnjitteredIfPresent,
    domain: Domain::Display,
    history_filter: HistoryFilter::None,
    ..BASE
};

/// Every published system, in the order of their publication.
pub const PRESETS: [Preset; 19] = [
    Preset {
        id: "none",
        description: "The engine's colour as it is: what anti-aliasing has to improve on",
        publication: "",
        jitter: JitterSequence::None,
        recipe: Recipe {
            source: Source::UnjitteredIfPresent,
            history_filter: HistoryFilter::None,
            ..BASE
        },
    },
    Preset {
        id: "unjitter_only",
        description: "Each frame alone, resampled onto the jitter-free grid",
        publication: "",
        jitter: JitterSequence::Halton23(16),
        recipe: Recipe {
            input_filter: InputFilter::Unjitter,
            history_filter: HistoryFilter::None,
            ..BASE
        },
    },
    Preset {
        id: "accumulate",
        description: "The mean of all frames, pixel by pixel: for scenes that stand still",
        publication: "Haeberli and Akeley, The Accumulation Buffer, 1990",
        jitter: JitterSequence::Halton23(128),
        recipe: Recipe {
            history_filter: HistoryFilter::Texel,
            reproject: false,
            history_always_f32: true,
            weight: Weight::Count,
            ..BASE
        },
    },
    Preset {
        id: "ema",
        description: "Exponential moving average along the motion, without rectification",
        publication: "Yang et al., Amortized Supersampling, 2009",
        jitter: JitterSequence::Halton23(8),
        recipe: BASE,
    },
    Preset {
        id: "amortized",
        description: "Running mean along the motion, shortened where history differs or resampling would blur it",
        publication: "Yang et al., Amortized Supersampling, 2009",
        jitter: JitterSequence::Halton23(8),
        recipe: Recipe {
            weight: Weight::Amortized,
            ..BASE
        },
    },
    Preset {
        id: "smaa1tx",
        description: "Cross-shaped box, clamp, less history in motion",
        publication: "Sousa, CryENGINE 3 Graphics Gems, SIGGRAPH 2013",
        jitter: JitterSequence::Quincunx2,
        recipe: Recipe {
            domain: Domain::Tonemapped,
            neighbourhood: Neighbourhood::Cross,
            rectify: Rectify::Clamp,
            motion_weight: true,
            ..BASE
        },
    },
    Preset {
        id: "inside",
        description: "Closest-depth dilation, rounded box, clip to its centre, luma feedback, motion-blur fallback",
        publication: "Pedersen, Temporal Reprojection Anti-Aliasing in INSIDE, GDC 2016",
        jitter: JitterSequence::Halton23(16),
        recipe: INSIDE,
    },
    Preset {
        id: "inside_ycocg",
        description: "The same in YCoCg, with a chroma box as narrow as luma's range allows",
        publication: "Pedersen, Temporal Reprojection Anti-Aliasing in INSIDE, GDC 2016, bonus slides",
        jitter: JitterSequence::Halton23(16),
        recipe: Recipe {
            space: Space::Ycocg,
            chroma_from_luma: true,
            ..INSIDE
        },
    },
    Preset {
        id: "uncharted4",
        description: "As INSIDE, sharpened",
        publication: "Xu, Temporal Antialiasing in Uncharted 4, SIGGRAPH 2016",
        jitter: JitterSequence::Halton23(16),
        recipe: Recipe {
            sharpen: Sharpen::Xu,
            motion_blur: false,
            ..INSIDE
        },
    },
    Preset {
        id: "karis2014",
        description: "Filtered input, five-tap Catmull-Rom history, YCoCg clip, anti-flicker and luma weights",
        publication: "Karis, High-Quality Temporal Supersampling, SIGGRAPH 2014",
        jitter: JitterSequence::Halton23(8),
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
        jitter: JitterSequence::Halton23(16),
        recipe: SALVI,
    },
    Preset {
        id: "salvi2016_wide",
        description: "The same with 7×7 texels, their moments found by separable passes",
        publication: "Salvi, An Excursion in Temporal Supersampling, GDC 2016",
        jitter: JitterSequence::Halton23(16),
        recipe: Recipe {
            variance_window: 7,
            prefilter_moments: true,
            intersect_minmax: false,
            ..SALVI
        },
    },
    Preset {
        id: "phlm2016",
        description: "A linear model for each pixel, fitted recursively to its past; a running mean where all is still",
        publication: "Iglesias-Guitian et al., Pixel History Linear Models for Real-Time Temporal Filtering, 2016",
        jitter: JitterSequence::Halton23(16),
        recipe: Recipe {
            algorithm: Algorithm::Phlm2016,
            domain: Domain::Tonemapped,
            input_filter: InputFilter::Unjitter,
            ..BASE
        },
    },
    Preset {
        id: "sobel2018",
        description: "A box as wide as edges, depth and objects say that the pixel is aliased; sharpened",
        publication: "Oliveros Labrador, Improved Sampling for Temporal Anti-Aliasing, Lund 2018",
        jitter: JitterSequence::Halton23(16),
        recipe: Recipe {
            neighbourhood: Neighbourhood::Sobel,
            sharpen: Sharpen::Normalised,
            motion_blur: false,
            ..INSIDE
        },
    },
    Preset {
        id: "taau",
        description: "Temporal upsampling by 1 to 4 along each axis: samples count by how near they fall to a pixel",
        publication: "Yang et al., A Survey of Temporal Antialiasing Techniques, 2020, after Unreal Engine 4.19",
        jitter: JitterSequence::Halton23(8),
        recipe: Recipe {
            domain: Domain::Tonemapped,
            dilation: Dilation::Closest,
            input_filter: InputFilter::Upsample,
            history_filter: HistoryFilter::CatmullRom5,
            space: Space::Ycocg,
            neighbourhood: Neighbourhood::Shrunk,
            rectify: Rectify::ClipCentre,
            ..BASE
        },
    },
    Preset {
        id: "checkerboard",
        description: "Every other pixel from the frame, the rest from history rectified by its shaded neighbours",
        publication: "Yang et al., A Survey of Temporal Antialiasing Techniques, 2020, 5.3",
        jitter: JitterSequence::None,
        recipe: Recipe {
            algorithm: Algorithm::Checkerboard,
            domain: Domain::Tonemapped,
            dilation: Dilation::Closest,
            history_filter: HistoryFilter::CatmullRom5,
            space: Space::Ycocg,
            neighbourhood: Neighbourhood::Box3,
            rectify: Rectify::ClipCentre,
            ..BASE
        },
    },
    Preset {
        id: "fxaa",
        description: "Each frame alone: blurs along and across the edges that luma shows",
        publication: "Lottes, FXAA 3.11, NVIDIA 2011, quality preset 39",
        jitter: JitterSequence::None,
        recipe: Recipe {
            spatial: Spatial::Fxaa,
            ..SPATIAL
        },
    },
    Preset {
        id: "smaa",
        description: "Each frame alone: finds the lines that its edges stand for, and blends by the areas they cut off",
        publication: "Jimenez et al., SMAA: Enhanced Subpixel Morphological Antialiasing, 2012, preset ultra",
        jitter: JitterSequence::None,
        recipe: Recipe {
            spatial: Spatial::Smaa,
            ..SPATIAL
        },
    },
    Preset {
        id: "smaa_t2x",
        description: "SMAA of every frame, half and half with history",
        publication: "Jimenez et al., SMAA, 2012; Jimenez, Filmic SMAA, SIGGRAPH 2016",
        jitter: JitterSequence::Quincunx2,
        recipe: Recipe {
            spatial: Spatial::Smaa,
            source: Source::Color,
            history_filter: HistoryFilter::Bilinear,
            neighbourhood: Neighbourhood::Box3,
            rectify: Rectify::ClipCentre,
            current_weight: 0.5,
            ..SPATIAL
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
