//! Other ways to read depth.

use crate::{
    sequence::{
        check::Belief,
        manifest::{DepthKind, DepthSource, FarPlane},
    },
    statistics::median,
};
use serde_json::{Value, json};

/// Another reading of depth.
pub struct Reading {
    pub source: DepthSource,
    /// What is wrong, to go after "depth".
    pub says: String,
    pub suggestions: Vec<(&'static str, Value)>,
    /// Whether its number was found from the pixels.
    pub is_fitted: bool,
}

/// A pixel of which the vectors tell the depth.
pub struct Seen {
    /// Device depth; for other kinds the depth along the axis, as declared.
    pub read: f64,
    /// One over the depth that its vector asks for.
    pub inverse_depth: f64,
    /// The declared planes of its frame; the far one may be infinite.
    pub near: f64,
    pub far: f64,
}

impl Reading {
    fn new(
        declared: &DepthSource,
        says: String,
        suggestions: Vec<(&'static str, Value)>,
        edit: impl FnOnce(&mut DepthSource),
    ) -> Self {
        let mut source = declared.clone();
        edit(&mut source);
        Self {
            source,
            says,
            suggestions,
            is_fitted: false,
        }
    }
}

/// The one declared, then other kinds and orders.
pub fn kinds(belief: &Belief, declared: &DepthSource) -> Vec<Reading> {
    let mut all = vec![Reading::new(declared, String::new(), Vec::new(), |_| {})];
    for (kind, name) in [
        (DepthKind::LinearViewZ, "linear_view_z"),
        (DepthKind::RayDistance, "ray_distance"),
    ] {
        if declared.kind != kind {
            let suggestions = vec![("depth.kind", json!(name))];
            all.push(Reading::new(
                declared,
                format!("looks like {name}"),
                suggestions,
                |source| (source.kind, source.reversed) = (kind, false),
            ));
        }
    }
    let far = belief.manifest().frames[0].far(Some(declared));
    let planes = [far, FarPlane::Infinite];
    let n_planes = if far == FarPlane::Infinite { 1 } else { 2 };
    for reversed in [false, true] {
        for &plane in &planes[..n_planes] {
            if declared.kind == DepthKind::Device && declared.reversed == reversed && plane == far {
                continue;
            }
            let mut suggestions = Vec::new();
            if declared.kind != DepthKind::Device {
                suggestions.push(("depth.kind", json!("device")));
            }
            if declared.reversed != reversed {
                suggestions.push(("depth.reversed", json!(reversed)));
            }
            if plane != far {
                suggestions.push(("depth.far", json!("inf")));
            }
            let says = format!(
                "looks like {}device depth{}",
                if reversed { "reversed " } else { "" },
                if plane == far { "" } else { " without a far plane" }
            );
            all.push(Reading::new(declared, says, suggestions, |source| {
                (source.kind, source.reversed, source.far) = (DepthKind::Device, reversed, plane);
            }));
        }
    }
    all
}

/// Readings with other planes or units: the number is the median of what each pixel asks for by itself.
pub fn fitted(declared: &DepthSource, seen: &[Seen]) -> Vec<Reading> {
    let fit = |of: &dyn Fn(&Seen) -> f64| {
        let values: Vec<f64> = seen.iter().map(of).filter(|value| value.is_finite()).collect();
        Some(rounded(median(&values))).filter(|value| value.is_finite() && *value > 0.0)
    };
    let mut all = Vec::new();
    if declared.kind != DepthKind::Device {
        if let Some(factor) = fit(&|pixel| 1.0 / (pixel.inverse_depth * pixel.read)) {
            let [scale, bias] = [declared.scale, declared.bias].map(|value| rounded(value * factor));
            let mut suggestions = vec![("depth.scale", json!(scale))];
            if bias != 0.0 {
                suggestions.push(("depth.bias", json!(bias)));
            }
            let says = format!("looks {factor} times as far");
            all.push(Reading {
                is_fitted: true,
                ..Reading::new(declared, says, suggestions, |source| {
                    (source.scale, source.bias) = (scale, bias);
                })
            });
        }
        return all;
    }
    for reversed in [declared.reversed, !declared.reversed] {
        // 1 at the near plane, 0 at the far one; one over the depth is linear in it.
        let nearness = |pixel: &Seen| if reversed { pixel.read } else { 1.0 - pixel.read };
        let near = fit(&|pixel| nearness(pixel) / (pixel.inverse_depth - (1.0 - nearness(pixel)) / pixel.far));
        let far = fit(&|pixel| (1.0 - nearness(pixel)) / (pixel.inverse_depth - nearness(pixel) / pixel.near));
        let order = if reversed { "reversed " } else { "" };
        let mut add = |plane: &str, field: &'static str, value: f64, edit: &dyn Fn(&mut DepthSource)| {
            let mut suggestions = vec![(field, json!(value))];
            if reversed != declared.reversed {
                suggestions.insert(0, ("depth.reversed", json!(reversed)));
            }
            let says = format!("looks like {order}device depth with its {plane} plane at {value}");
            all.push(Reading {
                is_fitted: true,
                ..Reading::new(declared, says, suggestions, |source| {
                    source.reversed = reversed;
                    edit(source);
                })
            });
        };
        if let Some(near) = near {
            add("near", "depth.near", near, &|source| source.near = Some(near));
        }
        if let Some(far) = far {
            add("far", "depth.far", far, &|source| source.far = FarPlane::At(far));
        }
    }
    all
}

/// To four digits: more are noise.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let unit = libm::pow(10.0, libm::floor(libm::log10(value.abs())) - 3.0);
    // Divided where it is small: a power of ten below one is not exact.
    let digits = (value / unit).round();
    if unit < 1.0 {
        digits / (1.0 / unit).round()
    } else {
        digits * unit
    }
}

/// Readings in other units or with other near planes, where nothing tells which: a twentieth of a decade apart.
pub fn steps(belief: &Belief, declared: &DepthSource) -> Vec<Reading> {
    let mut all = Vec::new();
    for step in (-40..=40).filter(|step| *step != 0) {
        let factor = rounded(libm::pow(10.0, f64::from(step) / 20.0));
        let mut source = declared.clone();
        let suggestion = if declared.kind == DepthKind::Device {
            let Some(near) = belief.manifest().frames[0].near(declared) else {
                continue;
            };
            source.near = Some(near * factor);
            ("depth.near", json!(near * factor))
        } else {
            (source.scale, source.bias) = (declared.scale * factor, declared.bias * factor);
            ("depth.scale", json!(declared.scale * factor))
        };
        all.push(Reading {
            source,
            says: format!("looks {factor} times as far"),
            suggestions: vec![suggestion],
            is_fitted: false,
        });
    }
    all
}
