//! A sequence's files as content: their hash, a cheap check that all are there, and packing them for submission.

use super::{ImageProblem, Sequence, SequenceError, manifest::ImageSource};
use crate::hex::hex;
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeMap,
    fs, io,
    io::Write,
    path::{Path, PathBuf},
};

/// A file that some frames' images name, with one of those for error messages.
struct Reference<'a> {
    relative: String,
    images: Vec<(usize, ImageSource<'a>)>,
}

impl Reference<'_> {
    fn failed(&self, problem: ImageProblem) -> SequenceError {
        let (frame, image) = &self.images[0];
        SequenceError::Image {
            frame: *frame,
            section: image.section,
            problem,
        }
    }
}

impl Sequence {
    /// SHA-256 in hexadecimal over the canonical manifest and every referenced file's path and SHA-256: the same for
    /// folder and archive and however the manifest is laid out; different when a file's or the manifest's content is.
    pub fn hash(&self) -> Result<String, SequenceError> {
        let lines = self
            .references()
            .par_iter()
            .map(|reference| {
                let file = self
                    .resolve(&reference.relative)
                    .map_err(|problem| reference.failed(problem))?;
                let digest = hash_file(&file).map_err(|error| SequenceError::Io { path: file, error })?;
                Ok(format!("\n{} {digest}", reference.relative))
            })
            .collect::<Result<Vec<String>, SequenceError>>()?;
        let mut hash = Sha256::new();
        hash.update(self.manifest_json());
        lines.iter().for_each(|line| hash.update(line));
        Ok(hex(&hash.finalize()))
    }

    /// Checks that every referenced file is there, has a readable header, the declared size and channels. Reads no
    /// pixels.
    pub fn verify_files(&self) -> Result<(), SequenceError> {
        self.references().par_iter().try_for_each(|reference| {
            let file = self
                .resolve(&reference.relative)
                .map_err(|problem| reference.failed(problem))?;
            reference.images.iter().try_for_each(|(frame, image)| {
                let extent = self.reader.extent(&file, &image.channels);
                extent
                    .map_err(ImageProblem::from)
                    .and_then(|extent| self.check_size(image.section, &reference.relative, extent))
                    .map_err(|problem| SequenceError::Image {
                        frame: *frame,
                        section: image.section,
                        problem,
                    })
            })
        })
    }

    /// Writes a tar of the manifest and the referenced files, and nothing else that lies in the folder.
    pub fn pack(&self, out: impl Write) -> Result<(), SequenceError> {
        let mut tar = tar::Builder::new(out);
        let manifest = self.manifest_json();
        let mut header = file_header(manifest.len() as u64);
        tar.append_data(&mut header, "manifest.json", manifest.as_bytes())
            .map_err(|error| SequenceError::Io {
                path: PathBuf::from("manifest.json"),
                error,
            })?;
        for reference in self.references() {
            let file = self
                .resolve(&reference.relative)
                .map_err(|problem| reference.failed(problem))?;
            append(&mut tar, &reference.relative, &file)?;
        }
        let finished = tar.into_inner().and_then(|mut out| out.flush());
        finished.map_err(|error| SequenceError::Io {
            path: PathBuf::from("the packed sequence"),
            error,
        })
    }

    /// Every referenced file once, sorted by path.
    fn references(&self) -> Vec<Reference<'_>> {
        let mut files: BTreeMap<String, Vec<(usize, ImageSource)>> = BTreeMap::new();
        for entry in &self.manifest.frames {
            for image in self.manifest.images() {
                let path = Self::relative_path(entry, &image);
                files.entry(path).or_default().push((entry.index, image));
            }
        }
        files
            .into_iter()
            .map(|(relative, images)| Reference { relative, images })
            .collect()
    }
}

/// Carries no owner, time or mode of this machine, so that equal sequences pack into equal bytes.
fn file_header(n_bytes: u64) -> tar::Header {
    let mut header = tar::Header::new_gnu();
    header.set_size(n_bytes);
    header.set_mode(0o644);
    header
}

fn append(tar: &mut tar::Builder<impl Write>, name: &str, file: &Path) -> Result<(), SequenceError> {
    let failed = |error| SequenceError::Io {
        path: file.to_owned(),
        error,
    };
    let content = fs::File::open(file).map_err(failed)?;
    let mut header = file_header(content.metadata().map_err(failed)?.len());
    tar.append_data(&mut header, name, content).map_err(failed)
}

fn hash_file(path: &Path) -> io::Result<String> {
    let mut hash = Sha256::new();
    io::copy(&mut fs::File::open(path)?, &mut HashWriter(&mut hash))?;
    Ok(hex(&hash.finalize()))
}

/// Feeds a hash from [`io::copy`].
struct HashWriter<'a>(&'a mut Sha256);

impl Write for HashWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
