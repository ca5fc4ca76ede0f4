//! What a recipe's parameters must be beside their ranges: whether a rule holds, the parameter that breaks it, and what would be right.

use super::{
    Algorithm, Dilation, Domain, HistoryFilter, InputFilter, Neighbourhood, Recipe, Rectify, Sharpen, Space, Spatial,
    Weight,
};

type Rule = (bool, &'static str, &'static str);

/// Of parameters together.
pub fn combinations(recipe: &Recipe) -> Vec<Rule> {
    let has_box = recipe.neighbourhood != Neighbourhood::None;
    vec![
        (
            recipe.motion_weight_to_px > recipe.motion_weight_from_px,
            "motion_weight_to_px",
            "must be above motion_weight_from_px",
        ),
        (
            !recipe.prefilter_moments
                || recipe.neighbourhood == Neighbourhood::Variance && !recipe.unjitter_neighbourhood,
            "prefilter_moments",
            "needs the neighbourhood `variance`, without `unjitter_neighbourhood`",
        ),
        (
            !recipe.unjitter_neighbourhood || recipe.neighbourhood != Neighbourhood::Shrunk,
            "unjitter_neighbourhood",
            "needs a neighbourhood other than `shrunk`, which knows where the samples lie",
        ),
        (
            !recipe.chroma_from_luma || recipe.space == Space::Ycocg,
            "chroma_from_luma",
            "needs the space `ycocg`",
        ),
        (
            recipe.sharpen != Sharpen::Rcas || recipe.domain != Domain::Linear,
            "sharpen",
            "`rcas` needs a domain other than `linear`",
        ),
        (
            recipe.reproject
                || !(recipe.motion_weight || recipe.motion_blur || recipe.reject_depth || recipe.reject_id),
            "reproject",
            "must be on for `motion_weight`, `motion_blur`, `reject_depth` and `reject_id`",
        ),
        (
            recipe.spatial == Spatial::None || recipe.domain != Domain::Linear,
            "spatial",
            "needs a domain other than `linear`: its thresholds are of values within 0 to 1",
        ),
        (
            recipe.rectify == Rectify::None || has_box,
            "rectify",
            "needs a neighbourhood other than `none`",
        ),
        (
            recipe.weight != Weight::Antiflicker || has_box,
            "weight",
            "`antiflicker` needs a neighbourhood other than `none`",
        ),
    ]
}

/// Of what an algorithm can do.
pub fn algorithms(recipe: &Recipe) -> Vec<Rule> {
    let is_temporal = recipe.algorithm == Algorithm::Temporal;
    vec![
        (
            is_temporal || !recipe.motion_blur && recipe.sharpen == Sharpen::None,
            "algorithm",
            "only `temporal` has `sharpen` and `motion_blur`",
        ),
        (
            is_temporal || recipe.reproject && recipe.history_filter != HistoryFilter::None,
            "algorithm",
            "only `temporal` can do without reprojected history",
        ),
        (
            recipe.spatial == Spatial::None || recipe.algorithm != Algorithm::Checkerboard,
            "spatial",
            "must be `none` for `checkerboard`, which leaves out the neighbours",
        ),
        (
            recipe.input_filter != InputFilter::Upsample
                || is_temporal && recipe.neighbourhood != Neighbourhood::Sobel && recipe.weight != Weight::Amortized,
            "input_filter",
            "`upsample` needs the algorithm `temporal`, a neighbourhood other than `sobel` and a weight other than \
             `amortized`",
        ),
        (
            recipe.algorithm != Algorithm::Checkerboard
                || recipe.dilation != Dilation::None
                    && !recipe.history_filter.has_prefilter()
                    && recipe.rectify != Rectify::Hull
                    && !(recipe.reject_depth || recipe.reject_id),
            "algorithm",
            "`checkerboard` needs dilation, for half of its pixels have no vector of their own, and has neither `bfecc`, \
             `quasi_cubic`, `hull`, `reject_depth` nor `reject_id`",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use crate::taa::Preset;

    /// A preset with one parameter changed; the field that the refusal names.
    fn refused(preset: &str, field: &str, value: serde_json::Value) -> String {
        let overrides = serde_json::Map::from_iter([(field.to_owned(), value)]);
        let recipe = &Preset::find(preset).unwrap().recipe;
        recipe.with(&overrides).unwrap_err().field
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        assert_eq!(refused("ema", "variance_window", 4.into()), "variance_window");
        assert_eq!(refused("ema", "sharpen", "rcas".into()), "sharpen");
        assert_eq!(refused("ema", "chroma_from_luma", true.into()), "chroma_from_luma");
        assert_eq!(refused("inside", "prefilter_moments", true.into()), "prefilter_moments");
        assert_eq!(refused("inside", "reproject", false.into()), "reproject");
        assert_eq!(
            refused("taau", "unjitter_neighbourhood", true.into()),
            "unjitter_neighbourhood"
        );
        assert_eq!(refused("taau", "neighbourhood", "sobel".into()), "input_filter");
        assert_eq!(refused("amortized", "input_filter", "upsample".into()), "input_filter");
        assert_eq!(refused("phlm2016", "input_filter", "upsample".into()), "input_filter");
        assert_eq!(refused("checkerboard", "dilation", "none".into()), "algorithm");
        assert_eq!(refused("checkerboard", "reject_id", true.into()), "algorithm");
        assert_eq!(refused("phlm2016", "motion_blur", true.into()), "algorithm");
        assert_eq!(refused("phlm2016", "history_filter", "none".into()), "algorithm");
        assert_eq!(refused("ema", "rectify", "hull".into()), "rectify");
        assert_eq!(refused("ema", "spatial", "fxaa".into()), "spatial");
        assert_eq!(refused("checkerboard", "spatial", "smaa".into()), "spatial");
        assert_eq!(
            refused("checkerboard", "history_filter", "quasi_cubic".into()),
            "algorithm"
        );
    }
}
