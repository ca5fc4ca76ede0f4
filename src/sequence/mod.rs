//! Frame sequences: the manifest declares an engine's conventions, the loader converts once into canonical [`Frame`]s.
//! Nothing after the loader may ask which engine it was. Names no wgpu, SQL or HTTP.

pub mod archive;
mod arm_nss;
pub mod check;
mod content;
pub mod convention;
pub mod frame;
pub mod jitter;
mod loader;
pub mod manifest;
mod several;

pub use frame::{Channels, Frame, Sizes};
pub use loader::Output;
pub use manifest::{Manifest, ManifestError, Section};
pub use several::{Merging, Others, Several, repaired_opacity};

use crate::{
    image::{
        Extent,
        files::{FileReader, ImageError},
    },
    metrics::Display,
};
use archive::ArchiveError;
use convention::Projector;
use manifest::{FrameEntry, ImageSource};
use serde_json::Value;
use std::{
    fs, io,
    io::Read,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

/// Large enough for a hundred thousand frames with cameras.
const MAX_MANIFEST_BYTES: u64 = 64 << 20;

/// Why a sequence cannot be used. Every message names the file, frame or field at fault.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// Neither a folder with a manifest, a manifest, nor an archive.
    #[error("{}: no manifest.json there; give a folder that has one, the manifest itself, or a tar, tar.gz or zip", .0.display())]
    NoManifest(PathBuf),
    /// The manifest was refused.
    #[error("{}: {problem}", path.display())]
    Manifest {
        /// The manifest's file.
        path: PathBuf,
        /// What is wrong with it.
        problem: ManifestError,
    },
    /// The archive was refused.
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    /// A frame beyond the end was asked for.
    #[error("there is no frame {index}: the sequence has {n_frames}")]
    NoFrame {
        /// The frame asked for.
        index: usize,
        /// How many there are.
        n_frames: usize,
    },
    /// A frame's image is at fault.
    #[error("frame {frame}, {section}: {problem}")]
    Image {
        /// Position in the sequence, from 0.
        frame: usize,
        /// Which of the frame's images.
        section: Section,
        /// What is wrong with it.
        problem: ImageProblem,
    },
    /// An image that another system made of a frame is at fault.
    #[error("frame {frame}, output: {problem}")]
    Output {
        /// Position in the sequence, from 0.
        frame: usize,
        /// What is wrong with it.
        problem: ImageProblem,
    },
    /// The machine's fault.
    #[error("{}: {error}", path.display())]
    Io {
        /// What was being read or written.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
}

/// What is wrong with one image of a frame. Paths are relative to the manifest's folder.
#[derive(Debug, thiserror::Error)]
pub enum ImageProblem {
    /// Not there.
    #[error("`{0}` is missing from the sequence's folder")]
    Missing(String),
    /// A symbolic link to somewhere else.
    #[error("`{0}` is a link that leaves the sequence's folder")]
    Outside(String),
    /// Of another size than declared.
    #[error("`{path}` is {actual} pixels, but {field} is {expected}")]
    Size {
        /// The file.
        path: String,
        /// Its size.
        actual: Extent,
        /// The manifest's field that disagrees.
        field: &'static str,
        /// Its value.
        expected: Extent,
    },
    /// Unreadable, or without the channels asked for.
    #[error(transparent)]
    File(#[from] ImageError),
}

/// An opened sequence: its manifest is valid, its files are read frame by frame. One that came as an archive owns the
/// temporary folder it was extracted to.
#[derive(Debug)]
pub struct Sequence {
    /// The manifest's folder, without symbolic links.
    root: PathBuf,
    manifest: Manifest,
    /// As given, before the preset's defaults.
    manifest_value: Value,
    jitter_px: Vec<[f64; 2]>,
    /// Empty where no convention needs cameras.
    projectors: Vec<Projector>,
    reader: FileReader,
    _extracted: Option<TempDir>,
}

impl Sequence {
    /// Opens a folder with a `manifest.json`, a manifest of any name, or a tar, tar.gz or zip of such a folder; or a sequence
    /// of one of Arm's NSS data sets, which has no manifest.
    pub fn open(path: &Path, reader: &FileReader) -> Result<Self, SequenceError> {
        if let Some(found) = arm_nss::find(path)? {
            let text = read_manifest(&found.json)?;
            let manifest = found.manifest(&text, reader)?;
            return Self::with_manifest(&found.json, &found.root, manifest, reader, None);
        }
        if path.is_dir() {
            return Self::open_manifest(&path.join("manifest.json"), reader, None);
        }
        if !path.is_file() {
            return Err(SequenceError::NoManifest(path.to_owned()));
        }
        if !archive::is_archive(path)? {
            return Self::open_manifest(path, reader, None);
        }
        let extracted = tempfile::tempdir().map_err(|error| SequenceError::Io {
            path: std::env::temp_dir(),
            error,
        })?;
        let folder = extracted.path().join("sequence");
        archive::extract(path, &folder, archive::Limits::default())?;
        Self::open_manifest(&folder.join("manifest.json"), reader, Some(extracted))
    }

    fn open_manifest(path: &Path, reader: &FileReader, extracted: Option<TempDir>) -> Result<Self, SequenceError> {
        let refused = |problem| SequenceError::Manifest {
            path: path.to_owned(),
            problem,
        };
        let text = read_manifest(path)?;
        let manifest_value: Value =
            serde_json::from_str(&text).map_err(|error| refused(ManifestError::Json(error.to_string())))?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        Self::with_manifest(
            path,
            folder.unwrap_or(Path::new(".")),
            manifest_value,
            reader,
            extracted,
        )
    }

    /// `path` is what to call the manifest in errors; its files lie in `folder`.
    fn with_manifest(
        path: &Path,
        folder: &Path,
        manifest_value: Value,
        reader: &FileReader,
        extracted: Option<TempDir>,
    ) -> Result<Self, SequenceError> {
        let manifest = Manifest::from_value(manifest_value.clone()).map_err(|problem| SequenceError::Manifest {
            path: path.to_owned(),
            problem,
        })?;
        let root = fs::canonicalize(folder).map_err(|error| SequenceError::Io {
            path: path.to_owned(),
            error,
        })?;
        Ok(Self {
            root,
            jitter_px: loader::jitters_px(&manifest),
            projectors: loader::projectors(&manifest),
            manifest,
            manifest_value,
            reader: reader.clone(),
            _extracted: extracted,
        })
    }

    /// The same files by other conventions. Nothing is checked, and the files of an archive live as long as `self`.
    fn redeclared(&self, change: impl FnOnce(&mut Manifest)) -> Self {
        let mut manifest = self.manifest.clone();
        change(&mut manifest);
        Self {
            root: self.root.clone(),
            jitter_px: loader::jitters_px(&manifest),
            projectors: loader::projectors(&manifest),
            manifest,
            manifest_value: self.manifest_value.clone(),
            reader: self.reader.clone(),
            _extracted: None,
        }
    }

    /// The manifest, with its preset's defaults filled in.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The manifest as given, in canonical JSON: sorted keys, no white space.
    pub fn manifest_json(&self) -> String {
        self.manifest_value.to_string()
    }

    /// Name from the manifest; not unique.
    pub fn name(&self) -> &str {
        &self.manifest.name
    }

    /// Number of frames, at least one.
    pub fn n_frames(&self) -> usize {
        self.manifest.frames.len()
    }

    /// Size of the engine's images.
    pub fn render_size(&self) -> Extent {
        self.manifest.render_size
    }

    /// Size of the reference and of the resolved image.
    pub fn output_size(&self) -> Extent {
        self.manifest.output_size
    }

    /// Both sizes.
    pub fn sizes(&self) -> Sizes {
        Sizes {
            render: self.render_size(),
            output: self.output_size(),
        }
    }

    /// How linear colour is shown.
    pub fn display(&self) -> Display {
        self.manifest.display
    }

    /// Frames after a reset that are left out of summaries.
    pub fn warmup_frames(&self) -> usize {
        self.manifest.warmup_frames
    }

    /// Whether its frames shade every other pixel only.
    pub fn is_checkerboard(&self) -> bool {
        self.manifest.checkerboard.is_some()
    }

    /// Whether any frame's samples lie off the pixel centres.
    pub fn is_jittered(&self) -> bool {
        self.jitter_px.iter().any(|jitter| *jitter != [0.0; 2])
    }

    /// Which images the manifest declares besides colour.
    pub fn available(&self) -> Channels {
        let manifest = &self.manifest;
        Channels {
            depth: manifest.depth.is_some(),
            motion: manifest.motion.is_some(),
            object_id: manifest.object_id.is_some(),
            albedo: manifest.albedo.is_some(),
            reactive: manifest.reactive.is_some(),
            unjittered_color: manifest.unjittered_color.is_some(),
            reference: manifest.reference.is_some(),
            several: manifest.several(),
        }
    }

    fn entry(&self, index: usize) -> Result<&FrameEntry, SequenceError> {
        self.manifest.frames.get(index).ok_or(SequenceError::NoFrame {
            index,
            n_frames: self.n_frames(),
        })
    }

    /// The path of an image relative to the manifest's folder.
    fn relative_path(entry: &FrameEntry, image: &ImageSource) -> String {
        image
            .path
            .for_frame(entry, image.item)
            .expect("checked with the manifest")
    }

    /// The file behind a relative path, after following links, if that is inside the manifest's folder.
    fn resolve(&self, relative: &str) -> Result<PathBuf, ImageProblem> {
        let path =
            fs::canonicalize(self.root.join(relative)).map_err(|_| ImageProblem::Missing(relative.to_owned()))?;
        match path.starts_with(&self.root) {
            true if path.is_file() => Ok(path),
            true => Err(ImageProblem::Missing(relative.to_owned())),
            false => Err(ImageProblem::Outside(relative.to_owned())),
        }
    }
}

fn read_manifest(path: &Path) -> Result<String, SequenceError> {
    let failed = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => SequenceError::NoManifest(path.parent().unwrap_or(path).to_owned()),
        _ => SequenceError::Io {
            path: path.to_owned(),
            error,
        },
    };
    let mut text = String::new();
    let file = fs::File::open(path).map_err(failed)?;
    file.take(MAX_MANIFEST_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(failed)?;
    if text.len() as u64 > MAX_MANIFEST_BYTES {
        return Err(failed(io::Error::other("longer than 64 MiB; this is no manifest")));
    }
    Ok(text)
}
