//! `afterimage compare`: two images, or two folders of images matched by file name, without a sequence or a GPU.
//!
//! 8- and 16-bit files are taken as what a viewer sees (sRGB-encoded) and compared as exact integers; float files
//! (OpenEXR, Radiance HDR) as linear colour that still has to pass a display transform.

use crate::{
    image::{
        Image,
        files::{FileReader, ImageError, SampleType},
    },
    metrics::{Display, FrameScores, Metric, MetricError, Picture, Reference, Summary, Values, map::Map},
    sequence::frame::Rgb,
};
use serde::Serialize;
use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsString,
    fs::create_dir_all,
    path::{Path, PathBuf},
    str::FromStr,
};

/// What to compare by.
#[derive(Clone, Debug, PartialEq)]
pub struct Criteria {
    /// Which metrics.
    pub metrics: Vec<Metric>,
    /// How float files are shown. 8- and 16-bit files are shown as they are.
    pub display: Display,
}

/// A bound that every pair must keep, written `METRIC=VALUE`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Of which metric.
    pub metric: Metric,
    /// The last value that is still good.
    pub bound: f64,
}

impl FromStr for Limit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (metric, bound) = text.split_once('=').ok_or("needs the form METRIC=VALUE")?;
        let bound: f64 = bound.parse().map_err(|error| format!("`{bound}`: {error}"))?;
        if bound.is_nan() {
            return Err("nothing is above or below NaN".to_owned());
        }
        Ok(Self {
            metric: metric.parse().map_err(|error: MetricError| error.to_string())?,
            bound,
        })
    }
}

/// The outcome, in the form of the command's JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Comparison {
    /// Of two images.
    Images(Scores),
    /// Of two folders.
    Folders {
        /// One entry a file name, in the order of names.
        frames: Vec<Frame>,
        /// By metric id.
        summary: BTreeMap<&'static str, Summary>,
    },
}

/// The scores of one pair.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// By metric id.
    pub metrics: Values,
    /// Pixels of either image with a NaN or an infinity.
    pub non_finite_pixels: u64,
}

/// One pair of a folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Frame {
    /// File name in both folders.
    pub name: String,
    /// Its scores.
    #[serde(flatten)]
    pub scores: Scores,
}

/// Why two images cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A file cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Two files do not go together.
    #[error("{} against {}: {source}", test.display(), reference.display())]
    Pair {
        /// The reference.
        reference: PathBuf,
        /// What is compared with it.
        test: PathBuf,
        /// Why.
        source: MetricError,
    },
    /// One of the two is a folder, the other is not.
    #[error("{} and {} must be two images or two folders", .0.display(), .1.display())]
    Kinds(PathBuf, PathBuf),
    /// A folder cannot be listed.
    #[error("{}: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A folder has no files at all.
    #[error("{}: no images here", .0.display())]
    Empty(PathBuf),
    /// A file has no partner.
    #[error("{} has no counterpart in {}; folders are matched by file name", file.display(), other.display())]
    Unmatched {
        /// The file without a partner.
        file: PathBuf,
        /// Where it was looked for.
        other: PathBuf,
    },
}

/// Writes the maps of `metrics` for `test` against `reference`: `FOLDER/METRIC.png` and `.exr` of two images,
/// `FOLDER/METRIC/NAME.png` and `.exr` of two folders.
pub fn write_maps(
    reader: &FileReader,
    reference: &Path,
    test: &Path,
    criteria: &Criteria,
    folder: &Path,
) -> Result<(), CompareError> {
    let pairs = match (reference.is_dir(), test.is_dir()) {
        (false, false) => vec![(None, reference.to_owned(), test.to_owned())],
        (true, true) => matched(reference, test)?
            .into_iter()
            .map(|name| (Some(name.clone()), reference.join(&name), test.join(&name)))
            .collect(),
        _ => return Err(CompareError::Kinds(reference.to_owned(), test.to_owned())),
    };
    for (name, reference, test) in pairs {
        let [r, t] = [&reference, &test].map(|path| show(reader, path, criteria.display));
        let (r, t) = (r?, t?);
        for metric in &criteria.metrics {
            let map = Map::new(*metric, &r, &t).map_err(|source| CompareError::Pair {
                reference: reference.clone(),
                test: test.clone(),
                source,
            })?;
            let (folder, name) = match &name {
                None => (folder.to_owned(), metric.id().to_owned()),
                Some(name) => (folder.join(metric.id()), name.to_string_lossy().into_owned()),
            };
            create_dir_all(&folder).map_err(|source| CompareError::Folder {
                folder: folder.clone(),
                source,
            })?;
            map.write(&folder, &name)?;
        }
    }
    Ok(())
}

/// Compares `test` with `reference`: two image files or two folders.
pub fn compare(
    reader: &FileReader,
    reference: &Path,
    test: &Path,
    criteria: &Criteria,
) -> Result<Comparison, CompareError> {
    match (reference.is_dir(), test.is_dir()) {
        (false, false) => images(reader, reference, test, criteria, &mut None).map(Comparison::Images),
        (true, true) => folders(reader, reference, test, criteria),
        _ => Err(CompareError::Kinds(reference.to_owned(), test.to_owned())),
    }
}

impl Comparison {
    /// A line for each pair and limit that it does not keep; NaN keeps none.
    ///
    /// # Panics
    /// When the comparison was not asked for one of these metrics: a caller's mistake, never a user's.
    pub fn beyond(&self, min: &[Limit], max: &[Limit]) -> Vec<String> {
        let pair = |name: &str, scores: &Scores| {
            let line = |limit: &Limit, side: &str| {
                let value = scores.metrics[limit.metric.id()].0;
                format!("{name}{} is {value}, {side} {}", limit.metric, limit.bound)
            };
            let value = |limit: &&Limit| scores.metrics[limit.metric.id()].0;
            let below = min
                .iter()
                .filter(|limit| value(limit) < limit.bound || value(limit).is_nan());
            let above = max
                .iter()
                .filter(|limit| value(limit) > limit.bound || value(limit).is_nan());
            let below = below.map(|limit| line(limit, "not at least"));
            below
                .chain(above.map(|limit| line(limit, "not at most")))
                .collect::<Vec<_>>()
        };
        match self {
            Self::Images(scores) => pair("", scores),
            Self::Folders { frames, .. } => {
                let all = frames.iter();
                all.flat_map(|frame| pair(&format!("{}: ", frame.name), &frame.scores))
                    .collect()
            }
        }
    }

    /// Pixels with a NaN or an infinity in all pairs together; any at all means that the comparison failed.
    pub fn non_finite_pixels(&self) -> u64 {
        match self {
            Self::Images(scores) => scores.non_finite_pixels,
            Self::Folders { frames, .. } => frames.iter().map(|frame| frame.scores.non_finite_pixels).sum(),
        }
    }
}

/// Scores a pair. The reference is left in place of the last one, whose memory it takes over.
fn images(
    reader: &FileReader,
    reference: &Path,
    test: &Path,
    criteria: &Criteria,
    last: &mut Option<Reference>,
) -> Result<Scores, CompareError> {
    let (r, t) = rayon::join(
        || show(reader, reference, criteria.display),
        || show(reader, test, criteria.display),
    );
    let (r, t) = (r?, t?);
    let mut prepared = match last {
        Some(last) => last.restart(r),
        None => Reference::new(r, &criteria.metrics),
    };
    let scores = prepared.evaluate(&t);
    prepared.retire();
    *last = Some(prepared);
    let FrameScores {
        values,
        non_finite_pixels,
    } = scores.map_err(|source| CompareError::Pair {
        reference: reference.to_owned(),
        test: test.to_owned(),
        source,
    })?;
    Ok(Scores {
        metrics: values,
        non_finite_pixels,
    })
}

fn show(reader: &FileReader, path: &Path, display: Display) -> Result<Picture, ImageError> {
    let file = reader.read_rgb(path)?;
    Ok(match file.sample {
        SampleType::U8 => codes(&file.image, u8::MAX.into()),
        SampleType::U16 => codes(&file.image, u16::MAX),
        _ => Picture::linear(file.image, display),
    })
}

/// The integers that samples were read from, each as the float nearest to its share of the largest.
fn codes(samples: &Image<Rgb>, max: u16) -> Picture {
    let code = |sample: f32| (sample * f32::from(max)).round() as u16;
    Picture::codes(samples.map(|pixel| pixel.map(code)), max)
}

fn folders(
    reader: &FileReader,
    reference: &Path,
    test: &Path,
    criteria: &Criteria,
) -> Result<Comparison, CompareError> {
    let names = matched(reference, test)?;
    let mut last = None;
    let frames = names
        .iter()
        .map(|name| {
            Ok(Frame {
                name: name.to_string_lossy().into_owned(),
                scores: images(reader, &reference.join(name), &test.join(name), criteria, &mut last)?,
            })
        })
        .collect::<Result<Vec<_>, CompareError>>()?;
    let summary = |metric: &Metric| {
        let values = frames.iter().map(|frame| frame.scores.metrics[metric.id()]);
        (metric.id(), Summary::new(*metric, values))
    };
    Ok(Comparison::Folders {
        summary: criteria.metrics.iter().map(summary).collect(),
        frames,
    })
}

/// The names of the files in both folders, which must be the same.
fn matched(reference: &Path, test: &Path) -> Result<BTreeSet<OsString>, CompareError> {
    let (names, test_names) = (file_names(reference)?, file_names(test)?);
    for (here, there, home, other) in [
        (&names, &test_names, reference, test),
        (&test_names, &names, test, reference),
    ] {
        if let Some(name) = here.difference(there).next() {
            return Err(CompareError::Unmatched {
                file: home.join(name),
                other: other.to_owned(),
            });
        }
    }
    Ok(names)
}

/// The files of a folder; hidden ones and folders inside it are not images.
fn file_names(folder: &Path) -> Result<BTreeSet<OsString>, CompareError> {
    let fail = |source| CompareError::Folder {
        folder: folder.to_owned(),
        source,
    };
    let mut names = BTreeSet::new();
    for entry in folder.read_dir().map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
        if !hidden && !entry.path().is_dir() {
            names.insert(entry.file_name());
        }
    }
    if names.is_empty() {
        return Err(CompareError::Empty(folder.to_owned()));
    }
    Ok(names)
}
