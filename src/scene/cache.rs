//! Baked sequences, kept under a key of all that decides their content: settings, scene, adapter, version.

use super::{BakeError, BakeObserver, BakeSettings, BakeSummary, bake};
use crate::{gpu::Gpu, hex::hex};
use sha2::{Digest, Sha256};
use std::{
    env, fs,
    path::{Path, PathBuf},
};

/// Raised whenever the same settings give other files, so that old bakes are not taken for new ones.
const VERSION: u32 = 5;

/// A folder of baked sequences.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
}

/// A sequence that is in the cache.
#[derive(Clone, Debug)]
pub struct Cached {
    /// Its folder.
    pub path: PathBuf,
    /// What its bake said; none where it was there already.
    pub summary: Option<BakeSummary>,
}

impl Cache {
    /// A cache in `folder`, which need not be there.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// `$AFTERIMAGE_CACHE`, else `afterimage` in `$XDG_CACHE_HOME` or `~/.cache`, else in the folder for temporary files.
    pub fn default_folder() -> PathBuf {
        let variable = |name| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        variable("AFTERIMAGE_CACHE").unwrap_or_else(|| {
            variable("XDG_CACHE_HOME")
                .or_else(|| Some(variable("HOME")?.join(".cache")))
                .unwrap_or_else(env::temp_dir)
                .join("afterimage")
        })
    }

    /// Where the sequence of these settings is kept.
    pub fn path(&self, gpu: &Gpu, settings: &BakeSettings) -> PathBuf {
        let adapter = gpu.info();
        let key = serde_json::json!({
            "version": VERSION,
            "package": env!("CARGO_PKG_VERSION"),
            "settings": settings,
            "adapter": [adapter.name, adapter.driver, adapter.driver_version],
        });
        let digest = Sha256::digest(key.to_string());
        let hash = hex(&digest[..8]);
        self.folder.join(format!("{}-{hash}", settings.scene))
    }

    /// The sequence of these settings, baked where it is not there, or anew where `force` says so.
    pub fn get(
        &self,
        gpu: &Gpu,
        settings: &BakeSettings,
        force: bool,
        observer: &dyn BakeObserver,
    ) -> Result<Cached, BakeError> {
        settings.validate()?;
        let path = self.path(gpu, settings);
        if force && path.exists() {
            fs::remove_dir_all(&path).map_err(BakeError::io(&path))?;
        }
        if path.join("manifest.json").is_file() {
            return Ok(Cached { path, summary: None });
        }
        let summary = match bake(gpu, settings, &path, observer) {
            // Another process was faster; its sequence is the same.
            Err(BakeError::NotEmpty(_)) if path.join("manifest.json").is_file() => None,
            baked => Some(baked?),
        };
        Ok(Cached { path, summary })
    }
}

/// Copies a sequence to `folder`, which must be missing or empty; renamed into place when whole.
pub fn copy_sequence(from: &Path, folder: &Path) -> Result<(), BakeError> {
    super::folder::into_place(folder, |place| copy_folder(from, place))
}

fn copy_folder(from: &Path, to: &Path) -> Result<(), BakeError> {
    fs::create_dir_all(to).map_err(BakeError::io(to))?;
    for entry in fs::read_dir(from).map_err(BakeError::io(from))? {
        let entry = entry.map_err(BakeError::io(from))?;
        let (path, target) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy_folder(&path, &target)?;
        } else {
            fs::copy(&path, &target).map_err(BakeError::io(target))?;
        }
    }
    Ok(())
}
