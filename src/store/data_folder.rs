//! Where everything lies under the data folder:
//!
//! ```text
//! lock                                   held while a service runs here
//! afterimage.sqlite                      the database
//! sequences/<content hash>/              a sequence as submitted
//! blobs/<sha256>, <sha256>.part          files put one by one, and what broke off of them
//! jobs/<job>/<preset index>/0000.exr     resolved images, by frame
//! jobs/<job>/<preset index>/0000.history.exr, 0000.skipped.exr   how they came about, where the recipe tells
//! spool/                                 unfinished uploads; emptied at start
//! ```

use crate::run::Trace;
use rustix::fs::{FlockOperation, flock};
use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Why the data folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// It cannot be made or written.
    #[error("cannot use the data folder {}: {source}", path.display())]
    Unusable {
        /// The file or folder in question.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another service runs on it.
    #[error("another service is using the data folder {}; stop it, or choose another folder with --data", .0.display())]
    InUse(PathBuf),
}

/// The data folder, locked for this process.
#[derive(Clone, Debug)]
pub struct DataFolder {
    root: PathBuf,
    _lock: Arc<File>,
}

impl DataFolder {
    /// Makes the folder where needed, locks it, and empties the spool. With the lock held, every job that the database
    /// calls running was left behind by a crash.
    pub fn open(root: &Path) -> Result<Self, FolderError> {
        let at = |path: &Path| {
            let path = path.to_owned();
            move |source| FolderError::Unusable { path, source }
        };
        fs::create_dir_all(root).map_err(at(root))?;
        let lock_path = root.join("lock");
        let lock = File::create(&lock_path).map_err(at(&lock_path))?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive).map_err(|_| FolderError::InUse(root.to_owned()))?;
        let folder = Self {
            root: root.to_owned(),
            _lock: Arc::new(lock),
        };
        remove(&folder.spool()).map_err(at(&folder.spool()))?;
        for path in [
            folder.spool(),
            root.join("sequences"),
            root.join("jobs"),
            root.join("blobs"),
        ] {
            fs::create_dir_all(&path).map_err(at(&path))?;
        }
        Ok(folder)
    }

    /// The database file.
    pub fn database(&self) -> PathBuf {
        self.root.join("afterimage.sqlite")
    }

    /// Where unfinished files are written; on the same file system as the rest, so that they can be renamed into place.
    pub fn spool(&self) -> PathBuf {
        self.root.join("spool")
    }

    /// A file by its content's hash.
    pub fn blob(&self, hash: &str) -> PathBuf {
        self.root.join("blobs").join(hash)
    }

    /// What has come of one so far.
    pub fn partial_blob(&self, hash: &str) -> PathBuf {
        self.root.join("blobs").join(format!("{hash}.part"))
    }

    /// Removes blobs that nobody has touched since `deadline`. Sequences have their own links to the files they use.
    pub fn forget_blobs(&self, deadline: std::time::SystemTime) -> io::Result<()> {
        for entry in fs::read_dir(self.root.join("blobs"))? {
            let entry = entry?;
            if entry.metadata()?.modified()? < deadline {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }

    /// A sequence's folder.
    pub fn sequence(&self, hash: &str) -> PathBuf {
        self.root.join("sequences").join(hash)
    }

    /// One resolved image.
    pub fn output(&self, job_id: i64, preset_index: usize, frame_index: usize) -> PathBuf {
        let folder = self.job(job_id).join(preset_index.to_string());
        folder.join(format!("{frame_index:04}.exr"))
    }

    /// How that image came about.
    pub fn trace(&self, job_id: i64, preset_index: usize, frame_index: usize, trace: Trace) -> PathBuf {
        let extension = format!("{}.exr", trace.id());
        self.output(job_id, preset_index, frame_index).with_extension(extension)
    }

    /// The picture of a cell of a stress run.
    pub fn stress_picture(&self, job_id: i64, cell_index: usize) -> PathBuf {
        self.job(job_id).join(format!("cell_{cell_index}.png"))
    }

    /// Moves a finished folder of the spool into place; an equal one that is there already stays.
    pub fn adopt_sequence(&self, finished: &Path, hash: &str) -> io::Result<()> {
        let place = self.sequence(hash);
        match fs::rename(finished, &place) {
            Err(_) if place.is_dir() => Ok(()),
            result => result,
        }
    }

    /// Removes whatever images a job has.
    pub fn remove_outputs(&self, job_id: i64) -> io::Result<()> {
        remove(&self.job(job_id))
    }

    fn job(&self, job_id: i64) -> PathBuf {
        self.root.join("jobs").join(job_id.to_string())
    }
}

/// Removes a folder that need not be there.
fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        result => result,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_service_a_folder() {
        let root = tempfile::tempdir().unwrap();
        let held = DataFolder::open(root.path()).unwrap();
        let error = DataFolder::open(root.path()).unwrap_err();
        assert!(matches!(error, FolderError::InUse(_)), "{error}");
        drop(held);
        assert!(DataFolder::open(root.path()).is_ok());
    }

    #[test]
    fn unfinished_uploads_go_and_known_content_stays() {
        let root = tempfile::tempdir().unwrap();
        let folder = DataFolder::open(root.path()).unwrap();
        for text in ["first", "second"] {
            let upload = folder.spool().join("upload");
            fs::create_dir_all(&upload).unwrap();
            fs::write(upload.join("manifest.json"), text).unwrap();
            folder.adopt_sequence(&upload, "hash").unwrap();
        }
        let kept = fs::read_to_string(folder.sequence("hash").join("manifest.json")).unwrap();
        assert_eq!(kept, "first");
        assert!(folder.spool().join("upload").exists());
        drop(folder);
        let folder = DataFolder::open(root.path()).unwrap();
        assert!(!folder.spool().join("upload").exists());
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = DataFolder::open(file.path()).unwrap_err().to_string();
        assert!(error.contains(&file.path().display().to_string()), "{error}");
    }
}
