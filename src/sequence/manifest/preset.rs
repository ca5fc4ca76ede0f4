//! What each engine is known to write. A preset is a JSON object laid under the user's: a field that the user gives
//! wins, a null included; and a section that names files is filled only where the user has it.
//!
//! A preset is a starting point, not proof: only Blender's has been held against frames that its engine wrote. Where an
//! engine leaves a matter to the application (such as whether depth is reversed) the preset is silent and the schema's
//! default holds.

use super::ManifestError;
use serde::Deserialize;
use serde_json::{Map, Value, json};

/// Whose conventions a sequence follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Blender's multi-layer files. `Vector` is previous minus current in pixels with y up; the jitter is keyed by hand.
    Blender,
    /// AMD FSR 2 and 3: projection offset `(+2jx/W, −2jy/H)`.
    Fsr,
    /// Intel XeSS.
    Xess,
    /// NVIDIA Streamline: motion times `mvecScale` (give it as `motion.scale`) is a fraction of the image.
    Streamline,
    /// Arm's neural super sampling data sets.
    ArmNss,
    /// Unity: motion of the graphics interfaces whose texture coordinates start at the top.
    Unity,
    /// Unreal: velocity as version 4's G-buffer encodes it in [0, 1], where x = 0 means "none written". Version 5 takes
    /// a square root first, which no scale and bias undo: decode it, and set scale, bias and `invalid_value`.
    Unreal,
    /// Godot 4: the jitter is added to normalised device coordinates, whose y points down there; velocity (−1, −1) is none.
    Godot,
}

impl Preset {
    /// The fields it fills.
    fn defaults(self) -> Value {
        let motion = |units, direction, y| json!({"units": units, "direction": direction, "y": y});
        let jitter = |units, meaning, y| json!({"units": units, "meaning": meaning, "y": y});
        let offset_px = || jitter("pixels_render", "projection_offset", "down");
        let (motion, depth, jitter) = match self {
            Self::Blender => (
                motion("pixels_render", "current_to_previous", "up"),
                json!({"kind": "linear_view_z", "sky_value": 1e10}),
                jitter("pixels_render", "sample_offset", "down"),
            ),
            Self::Fsr | Self::Xess => (
                motion("pixels_render", "current_to_previous", "down"),
                json!({"kind": "device"}),
                offset_px(),
            ),
            Self::Streamline => (
                motion("uv", "current_to_previous", "down"),
                json!({"kind": "device"}),
                offset_px(),
            ),
            Self::ArmNss => (
                motion("uv", "previous_to_current", "down"),
                json!({"kind": "device"}),
                offset_px(),
            ),
            Self::Unity => (
                motion("uv", "previous_to_current", "down"),
                json!({"kind": "device", "reversed": true}),
                jitter("pixels_render", "sample_offset", "up"),
            ),
            Self::Unreal => (
                unreal_velocity(),
                json!({"kind": "device", "reversed": true, "far": "inf"}),
                offset_px(),
            ),
            Self::Godot => (
                godot_velocity(),
                json!({"kind": "device", "reversed": true}),
                jitter("ndc", "projection_offset", "down"),
            ),
        };
        let color = json!({"transfer": "linear", "pre_exposed": self == Self::Unreal});
        json!({"color": color, "depth": depth, "motion": motion, "jitter": jitter})
    }
}

/// Velocity `v` is stored as `v · 0.499 / 2 + 32767 / 65535`; scale and bias undo that.
fn unreal_velocity() -> Value {
    let scale = 1.0 / (0.499 * 0.5);
    let bias = -32767.0 / 65535.0 * scale;
    json!({
        "units": "ndc", "direction": "previous_to_current", "y": "up",
        "scale": [scale, scale], "bias": [bias, bias], "invalid_value": 0,
    })
}

/// Godot clears its velocity buffer to (−1, −1), and only moving objects write to it.
fn godot_velocity() -> Value {
    json!({"units": "uv", "direction": "current_to_previous", "y": "down", "invalid_value": [-1, -1]})
}

/// The fields in which `reference` and `unjittered_color` follow `color`: one renderer wrote all three.
const ENCODING: [&str; 3] = ["transfer", "pre_exposed", "nits_per_unit"];

/// Lays the named preset under `manifest`, then lets the other images follow the colour's encoding. Albedo does not:
/// it is a property of surfaces, linear unless declared otherwise.
pub(super) fn fill_defaults(manifest: &mut Value) -> Result<(), ManifestError> {
    let Value::Object(manifest) = manifest else {
        return Err(ManifestError::field(".", "a manifest is a JSON object"));
    };
    if let Some(preset) = manifest.get("preset").filter(|preset| !preset.is_null()) {
        let preset: Preset =
            serde_path_to_error::deserialize(preset).map_err(|error| match super::describe(&error) {
                ManifestError::Field { problem, .. } => ManifestError::field("preset", problem),
                other => other,
            })?;
        if let Value::Object(sections) = preset.defaults() {
            for (name, defaults) in sections {
                if name == "jitter" && !manifest.contains_key("jitter") {
                    manifest.insert(name, defaults);
                } else if let (Some(Value::Object(section)), Value::Object(defaults)) =
                    (manifest.get_mut(&name), defaults)
                {
                    lay_under(section, defaults);
                }
            }
        }
    }
    let encoding: Map<String, Value> = match manifest.get("color") {
        Some(Value::Object(color)) => ENCODING
            .iter()
            .filter_map(|name| Some(((*name).to_owned(), color.get(*name)?.clone())))
            .collect(),
        _ => Map::new(),
    };
    for (name, defaults) in [
        ("reference", encoding.clone()),
        ("unjittered_color", encoding),
        ("albedo", Map::from_iter([("transfer".to_owned(), json!("linear"))])),
    ] {
        if let Some(Value::Object(section)) = manifest.get_mut(name) {
            lay_under(section, defaults);
        }
    }
    Ok(())
}

fn lay_under(section: &mut Map<String, Value>, defaults: Map<String, Value>) {
    for (name, value) in defaults {
        section.entry(name).or_insert(value);
    }
}
