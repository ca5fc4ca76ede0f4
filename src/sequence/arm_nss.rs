//! Arm's neural super sampling data sets, read as they are: a folder with `<seq>.json`, `x{ratio}/color/<seq>`, `depth`,
//! `motion`, and `ground_truth/<seq>`, each with an OpenEXR file a frame. A manifest is made of the metadata, in memory;
//! nothing is written.
//!
//! The layout and its keys are those that Arm's model gym reads (version 1.0.1 of its data format).

use super::{ManifestError, SequenceError};
use crate::image::{Extent, files::FileReader};
use serde_json::{Value, json};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// A sequence of a data set.
pub struct Found {
    /// The data set's folder.
    pub root: PathBuf,
    /// The sequence's metadata.
    pub json: PathBuf,
    name: String,
    ratio: String,
}

/// Finds the sequence that `path` names: a data set with one sequence of one ratio, a sequence's JSON file, or its folder
/// under `x{ratio}/color`. None where `path` is no such data set at all.
pub fn find(path: &Path) -> Result<Option<Found>, SequenceError> {
    if path.is_file() {
        let Some(root) = path.parent().filter(|root| is_data_set(root)) else {
            return Ok(None);
        };
        let name = path
            .file_stem()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default();
        return match sequences(root).contains(&name) {
            true => choose_ratio(root, name, None).map(Some),
            false => Ok(None),
        };
    }
    if is_data_set(path) {
        return match sequences(path).as_slice() {
            [only] => choose_ratio(path, only.clone(), None).map(Some),
            [] => Err(refused(path, "has no <sequence>.json beside its image folders")),
            several => {
                let names: Vec<String> = several.iter().map(|name| format!("{name}.json")).collect();
                Err(refused(
                    path,
                    &format!("has several sequences; name the file of one: {}", names.join(", ")),
                ))
            }
        };
    }
    // DATASET/x2/color/<seq>
    let (Some(color), Some(name)) = (path.parent(), path.file_name()) else {
        return Ok(None);
    };
    let (Some(ratio), Some(root)) = (color.parent(), color.parent().and_then(Path::parent)) else {
        return Ok(None);
    };
    if color.file_name() != Some("color".as_ref()) || !is_data_set(root) {
        return Ok(None);
    }
    let ratio = ratio.file_name().map(|name| name.to_string_lossy().into_owned());
    choose_ratio(root, name.to_string_lossy().into_owned(), ratio).map(Some)
}

fn refused(path: &Path, problem: &str) -> SequenceError {
    SequenceError::Manifest {
        path: path.to_owned(),
        problem: ManifestError::Field {
            field: "Arm NSS data set".to_owned(),
            problem: problem.to_owned(),
        },
    }
}

fn is_data_set(folder: &Path) -> bool {
    !folder.join("manifest.json").exists() && folder.join("ground_truth").is_dir() && !ratios(folder).is_empty()
}

fn names(folder: &Path, keep: impl Fn(&Path) -> bool) -> Vec<String> {
    let entries = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let mut names: Vec<String> = entries
        .filter(|path| keep(path))
        .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    names
}

fn ratios(folder: &Path) -> Vec<String> {
    let is_ratio = |path: &Path| {
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default();
        name.starts_with('x') && name[1..].starts_with(|c: char| c.is_ascii_digit()) && path.join("color").is_dir()
    };
    names(folder, is_ratio)
}

fn sequences(folder: &Path) -> Vec<String> {
    let json = names(folder, |path| {
        path.extension().is_some_and(|extension| extension == "json")
    });
    let stems = json.iter().filter_map(|name| name.strip_suffix(".json"));
    stems
        .filter(|name| folder.join("ground_truth").join(name).is_dir())
        .map(str::to_owned)
        .collect()
}

fn choose_ratio(root: &Path, name: String, ratio: Option<String>) -> Result<Found, SequenceError> {
    let has = |ratio: &String| root.join(ratio).join("color").join(&name).is_dir();
    let ratios: Vec<String> = ratios(root).into_iter().filter(has).collect();
    let ratio = match (ratio, ratios.as_slice()) {
        (Some(ratio), _) => ratio,
        (None, [only]) => only.clone(),
        (None, []) => return Err(refused(root, &format!("has no x<ratio>/color/{name}"))),
        (None, several) => {
            let folders: Vec<String> = several.iter().map(|ratio| format!("{ratio}/color/{name}")).collect();
            return Err(refused(
                root,
                &format!("has several ratios; name the folder of one: {}", folders.join(", ")),
            ));
        }
    };
    Ok(Found {
        root: root.to_owned(),
        json: root.join(format!("{name}.json")),
        name,
        ratio,
    })
}

impl Found {
    /// The manifest that says what the data set's metadata says, as JSON.
    pub fn manifest(&self, metadata: &str, reader: &FileReader) -> Result<Value, SequenceError> {
        // Python writes numbers that JSON does not have.
        let metadata = ["-Infinity", "Infinity", "NaN"]
            .iter()
            .fold(metadata.to_owned(), |text, name| text.replace(name, "null"));
        let metadata: Value = serde_json::from_str(&metadata)
            .map_err(|error| refused(&self.json, &format!("is not valid JSON: {error}")))?;
        let frames = metadata["Frames"].as_array().filter(|frames| !frames.is_empty());
        let frames = frames.ok_or_else(|| {
            refused(
                &self.json,
                "has no list `Frames`: this is no sequence of such a data set",
            )
        })?;
        let folder = |kind: &str| format!("{}/{kind}/{}", self.ratio, self.name);
        let color = self.files(&folder("color"))?;
        let truth = self.files(&format!("ground_truth/{}", self.name))?;
        let [depth, motion] = [self.files(&folder("depth"))?, self.files(&folder("motion"))?];
        let rgb = ["R", "G", "B"].map(str::to_owned);
        let (render, output) = (self.extent(&color, reader, &rgb)?, self.extent(&truth, reader, &rgb)?);
        let ratio_index = metadata["UpscalingRatiosIndices"][format!("{}_index", self.ratio)]
            .as_u64()
            .unwrap_or(0);
        let n_frames = frames.len().min(color.numbers.len());
        let entries = (0..n_frames)
            .map(|index| self.entry(&metadata, &frames[index], index, ratio_index as usize, &color))
            .collect::<Result<Vec<Value>, SequenceError>>()?;
        Ok(json!({
            "schema": super::manifest::SCHEMA, "name": self.name, "preset": "arm-nss",
            "source": {"engine": "arm-nss"},
            "fps": metadata["EmulatedFramerate"].as_f64().unwrap_or(60.0),
            "render_size": render, "output_size": output,
            "color": {"path": color.template(), "channels": rgb},
            "depth": {"path": depth.template(), "channel": "R", "reversed": metadata["ReverseZ"].as_bool().unwrap_or(false)},
            "motion": {"path": motion.template(), "channels": ["R", "G"]},
            "jitter": {"units": "uv", "meaning": "projection_offset", "y": "down"},
            "reference": {"path": truth.template(), "channels": rgb, "spp": metadata["Samples"]["Count"].as_u64()},
            "frames": entries,
        }))
    }

    fn entry(
        &self,
        metadata: &Value,
        frame: &Value,
        index: usize,
        ratio: usize,
        files: &Files,
    ) -> Result<Value, SequenceError> {
        let missing = |field: &str| refused(&self.json, &format!("Frames[{index}].{field} is missing"));
        let number = ["FrameNumber", "Frame"].iter().find_map(|key| frame[*key].as_u64());
        // Numbers that name no file count from elsewhere; then files are taken in order.
        let number = number
            .filter(|number| files.numbers.contains(number))
            .unwrap_or(files.numbers[index]);
        let jitter = ["NormalizedPerRatioJitter", "QuantisedPerRatioJitter"]
            .iter()
            .map(|key| &frame[*key][ratio])
            .find(|jitter| jitter.is_object());
        let jitter = jitter.ok_or_else(|| missing("NormalizedPerRatioJitter"))?;
        let axis = |name: &str| jitter[name].as_f64().ok_or_else(|| missing("NormalizedPerRatioJitter"));
        let plane = |own: &str, shared: &str| frame[own].as_f64().or_else(|| metadata[shared].as_f64());
        let near = plane("CameraNearPlane", "NearPlane").ok_or_else(|| missing("CameraNearPlane"))?;
        let far = plane("CameraFarPlane", "FarPlane").ok_or_else(|| missing("CameraFarPlane"))?;
        let mut entry = json!({
            "index": index, "file_frame": number, "jitter": [axis("X")?, axis("Y")?],
            "reset": index == 0 || frame["CameraCut"].as_bool().unwrap_or(false),
        });
        if let Some(exposure) = frame["Exposure"].as_f64() {
            entry["exposure"] = json!(exposure);
        }
        entry["camera"] = camera(&frame["ViewProjection"], near, far);
        if entry["camera"].is_null() {
            return Err(missing("ViewProjection (a perspective matrix of 16 numbers)"));
        }
        Ok(entry)
    }

    /// The files of one folder of images.
    fn files(&self, folder: &str) -> Result<Files, SequenceError> {
        let path = self.root.join(folder);
        let exr = names(&path, |path| {
            path.extension().is_some_and(|extension| extension == "exr")
        });
        let stems: Vec<&str> = exr
            .iter()
            .filter_map(|name| name.strip_suffix(".exr"))
            .filter(|stem| stem.parse::<u64>().is_ok())
            .collect();
        let Some(first) = stems.first() else {
            return Err(SequenceError::Io {
                path,
                error: io::Error::new(io::ErrorKind::NotFound, "no files NNNN.exr there"),
            });
        };
        let mut numbers: Vec<u64> = stems.iter().filter_map(|stem| stem.parse().ok()).collect();
        numbers.sort_unstable();
        Ok(Files {
            folder: folder.to_owned(),
            width: first.len(),
            first: format!("{first}.exr"),
            numbers,
        })
    }

    fn extent(&self, files: &Files, reader: &FileReader, channels: &[String]) -> Result<Extent, SequenceError> {
        let path = self.root.join(&files.folder).join(&files.first);
        reader.extent(&path, channels).map_err(|error| SequenceError::Io {
            path,
            error: io::Error::other(error.to_string()),
        })
    }
}

/// Numbered files of a folder.
struct Files {
    folder: String,
    first: String,
    width: usize,
    numbers: Vec<u64>,
}

impl Files {
    fn template(&self) -> String {
        format!("{}/{{file_frame:0{}}}.exr", self.folder, self.width)
    }
}

/// View and projection of a view projection matrix: clip w is the depth along the axis, and the rows of clip x and y are
/// the axes of view space, scaled. Null where it is no perspective one.
fn camera(matrix: &Value, near: f64, far: f64) -> Value {
    let flat: Vec<f64> = match matrix.as_array() {
        Some(rows) if rows.len() == 4 => rows
            .iter()
            .filter_map(Value::as_array)
            .flatten()
            .filter_map(Value::as_f64)
            .collect(),
        Some(flat) => flat.iter().filter_map(Value::as_f64).collect(),
        None => return Value::Null,
    };
    if flat.len() != 16 {
        return Value::Null;
    }
    let length = |row: [f64; 4]| (row[0] * row[0] + row[1] * row[1] + row[2] * row[2]).sqrt();
    let rows: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| flat[4 * i + j]));
    let columns: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| flat[4 * j + i]));
    // For column vectors the last row looks ahead, for row vectors the last column.
    let is_axis = |row: [f64; 4]| (length(row) - 1.0).abs() < 1e-3;
    let rows = match (is_axis(rows[3]), is_axis(columns[3])) {
        (true, _) => rows,
        (false, true) => columns,
        (false, false) => return Value::Null,
    };
    let (sx, sy) = (length(rows[0]), length(rows[1]));
    if !(sx > 0.0 && sy > 0.0) {
        return Value::Null;
    }
    json!({
        "view": [rows[0].map(|value| value / sx), rows[1].map(|value| value / sy), rows[3], [0.0, 0.0, 0.0, 1.0]],
        "projection": [[sx, 0.0, 0.0, 0.0], [0.0, sy, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        "near": near, "far": far,
    })
}
