//! A tar, tar.gz or zip into a folder. Archives come from strangers: nothing may be written outside the folder, and
//! none may fill the disk, whatever its headers claim.

use flate2::read::MultiGzDecoder;
use std::{
    cell::Cell,
    collections::BTreeSet,
    fs::{self, File},
    io::{self, BufReader, Read, Seek as _, SeekFrom},
    path::{Path, PathBuf},
};
use tempfile::TempDir;

/// What an archive may at most unfold to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of all files together.
    pub max_bytes: u64,
    /// Files and folders.
    pub max_entries: usize,
    /// Bytes of all files over bytes of the archive. Images are compressed already; even flat ones stay far below.
    pub max_expansion: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_bytes: 16 << 30,
            max_entries: 100_000,
            max_expansion: 200,
        }
    }
}

/// Why an archive was refused.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// Not one of the known formats.
    #[error("{}: neither tar, tar.gz nor zip", .0.display())]
    Format(PathBuf),
    /// The archive as a whole cannot be read.
    #[error("{}: {problem}", archive.display())]
    Unreadable {
        /// The archive.
        archive: PathBuf,
        /// What the decoder or the system said.
        problem: String,
    },
    /// An entry that a sequence has no use for, or that would do harm.
    #[error("{}: entry `{entry}` {problem}", archive.display())]
    Entry {
        /// The archive.
        archive: PathBuf,
        /// The entry's name as far as it can be shown.
        entry: String,
        /// What is wrong with it.
        problem: String,
    },
    /// No manifest at the top or in the only top-level folder.
    #[error("{}: has no manifest.json at its top or in its only top-level folder", .0.display())]
    NoManifest(PathBuf),
}

#[derive(Clone, Copy)]
enum Format {
    Tar,
    TarGz,
    Zip,
}

/// By content, never by name.
fn sniff(path: &Path) -> io::Result<Option<Format>> {
    let mut head = [0; 512];
    let mut n = 0;
    let mut file = File::open(path)?;
    while n < head.len() {
        match file.read(&mut head[n..])? {
            0 => break,
            more => n += more,
        }
    }
    Ok(match &head[..n] {
        [0x1f, 0x8b, ..] => Some(Format::TarGz),
        [b'P', b'K', 3, 4, ..] | [b'P', b'K', 5, 6, ..] => Some(Format::Zip),
        head if head.get(257..262) == Some(b"ustar") => Some(Format::Tar),
        _ => None,
    })
}

/// Whether the file is an archive that [`extract`] would try.
pub fn is_archive(path: &Path) -> Result<bool, ArchiveError> {
    let format = sniff(path).map_err(|error| unreadable(path, error))?;
    Ok(format.is_some())
}

fn unreadable(archive: &Path, problem: impl ToString) -> ArchiveError {
    ArchiveError::Unreadable {
        archive: archive.to_owned(),
        problem: problem.to_string(),
    }
}

/// Extracts the sequence in `archive`; afterwards `into`, which must not exist yet, is the folder with its
/// `manifest.json`. On error nothing is left behind.
pub fn extract(archive: &Path, into: &Path, limits: Limits) -> Result<(), ArchiveError> {
    let failed = |error: io::Error| unreadable(archive, error);
    let format = sniff(archive).map_err(failed)?;
    let file = File::open(archive).map_err(failed)?;
    let n_archive_bytes = file.metadata().map_err(failed)?.len();
    let file = BufReader::new(file);
    // Beside `into`, so that the finished folder only needs renaming.
    let staging = match into.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        Some(parent) => TempDir::new_in(parent),
        None => TempDir::new_in("."),
    }
    .map_err(failed)?;
    let mut unpacker = Unpacker {
        archive,
        folder: staging.path(),
        limits,
        n_bytes_left: limits
            .max_bytes
            .min(n_archive_bytes.saturating_mul(limits.max_expansion)),
        n_entries: 0,
    };
    match format.ok_or_else(|| ArchiveError::Format(archive.to_owned()))? {
        Format::Tar => unpacker.tar(file),
        Format::TarGz => unpacker.tar_gz(MultiGzDecoder::new(file)),
        Format::Zip => unpacker.zip(file),
    }?;
    let sequence = find_manifest(staging.path()).ok_or_else(|| ArchiveError::NoManifest(archive.to_owned()))?;
    fs::rename(sequence, into).map_err(failed)
}

/// The folder that holds the manifest: the top, or the only folder there.
fn find_manifest(top: &Path) -> Option<PathBuf> {
    let has_manifest = |folder: &Path| folder.join("manifest.json").is_file();
    if has_manifest(top) {
        return Some(top.to_owned());
    }
    let mut folders = fs::read_dir(top)
        .ok()?
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_dir());
    let only = folders.next().filter(|folder| has_manifest(folder))?;
    folders.next().is_none().then_some(only)
}

struct Unpacker<'a> {
    archive: &'a Path,
    folder: &'a Path,
    limits: Limits,
    n_bytes_left: u64,
    n_entries: usize,
}

/// A tar header, its long name and its extended attributes: a tar reader holds them in memory, so that they need a
/// bound of their own.
const MAX_TAR_HEADER_BYTES: u64 = 1 << 20;

/// What may follow a tar's end: it is padded to whole records.
const MAX_TAR_PADDING: u64 = 1 << 20;

/// Fails once more than `allowance` bytes were read. Stands between decompression and the tar reader, which would
/// otherwise unfold a long name or skip a body without end.
struct Metered<'a, R> {
    inner: R,
    allowance: &'a Cell<u64>,
}

impl<R: Read> Read for Metered<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.allowance.get() == 0 && !buffer.is_empty() {
            return Err(io::Error::other("expands too far"));
        }
        let n = buffer
            .len()
            .min(usize::try_from(self.allowance.get()).unwrap_or(usize::MAX));
        let n = self.inner.read(&mut buffer[..n])?;
        self.allowance.set(self.allowance.get() - n as u64);
        Ok(n)
    }
}

impl Unpacker<'_> {
    fn refused(&self, entry: &str, problem: impl ToString) -> ArchiveError {
        ArchiveError::Entry {
            archive: self.archive.to_owned(),
            entry: entry.to_owned(),
            problem: problem.to_string(),
        }
    }

    fn name(&self, raw: &[u8]) -> Result<String, ArchiveError> {
        String::from_utf8(raw.to_vec())
            .map_err(|_| self.refused(&String::from_utf8_lossy(raw), "has a name that is not UTF-8"))
    }

    fn tar(&mut self, reader: impl Read) -> Result<(), ArchiveError> {
        let allowance = Cell::new(MAX_TAR_HEADER_BYTES);
        let mut tar = tar::Archive::new(Metered {
            inner: reader,
            allowance: &allowance,
        });
        let mut entries = tar.entries().map_err(|error| unreadable(self.archive, error))?;
        let mut last = String::new();
        loop {
            allowance.set(MAX_TAR_HEADER_BYTES);
            let Some(entry) = entries.next() else {
                return Ok(());
            };
            let mut entry = entry.map_err(|error| match last.as_str() {
                "" => unreadable(self.archive, error),
                last => self.refused(last, format!("is followed by what cannot be read: {error}")),
            })?;
            let name = self.name(&entry.path_bytes())?;
            let kind = entry.header().entry_type();
            // A body is padded to whole blocks.
            allowance.set(self.n_bytes_left.saturating_add(1024));
            match kind {
                tar::EntryType::Regular => self.file(&name, &mut entry)?,
                tar::EntryType::Directory => self.directory(&name)?,
                // Comments for the whole archive, as git writes them.
                tar::EntryType::XGlobalHeader => {}
                _ => {
                    return Err(self.refused(&name, "is a link or a device; only files and folders are allowed"));
                }
            }
            last = name;
        }
    }

    /// Behind everything comes a checksum of it, which a tar reader has no need to reach.
    fn tar_gz(&mut self, mut reader: impl Read) -> Result<(), ArchiveError> {
        self.tar(&mut reader)?;
        let n_rest = io::copy(&mut reader.take(MAX_TAR_PADDING), &mut io::sink());
        match n_rest.map_err(|error| unreadable(self.archive, error))? {
            MAX_TAR_PADDING => Err(unreadable(self.archive, io::Error::other("goes on behind its end"))),
            _ => Ok(()),
        }
    }

    fn zip(&mut self, reader: impl Read + io::Seek) -> Result<(), ArchiveError> {
        let mut zip = zip::ZipArchive::new(reader).map_err(|error| unreadable(self.archive, error))?;
        self.every_entry_once(zip.central_directory_start())?;
        for index in 0..zip.len() {
            let mut entry = zip.by_index(index).map_err(|error| unreadable(self.archive, error))?;
            let name = self.name(entry.name_raw())?;
            if entry.is_symlink() {
                return Err(self.refused(&name, "is a link or a device; only files and folders are allowed"));
            } else if entry.is_dir() {
                self.directory(&name)?;
            } else {
                self.file(&name, &mut entry)?;
            }
        }
        Ok(())
    }

    /// A zip reader keeps the last of the entries with one name and says nothing of the others, so the directory is read
    /// once more.
    fn every_entry_once(&self, directory_start: u64) -> Result<(), ArchiveError> {
        let first_twice = || -> io::Result<Option<Vec<u8>>> {
            let mut directory = BufReader::new(File::open(self.archive)?);
            directory.seek(SeekFrom::Start(directory_start))?;
            let mut names = BTreeSet::new();
            let mut header = [0; 46];
            loop {
                directory.read_exact(&mut header[..4])?;
                if header[..4] != *b"PK\x01\x02" {
                    return Ok(None);
                }
                directory.read_exact(&mut header[4..])?;
                let size = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
                let mut name = vec![0; size(28).into()];
                directory.read_exact(&mut name)?;
                let (extra, comment) = (size(30), size(32));
                directory.seek_relative(i64::from(extra) + i64::from(comment))?;
                if !names.insert(name.clone()) {
                    return Ok(Some(name));
                }
            }
        };
        match first_twice().map_err(|error| unreadable(self.archive, error))? {
            Some(name) => Err(self.refused(&String::from_utf8_lossy(&name), "appears twice")),
            None => Ok(()),
        }
    }

    /// Where an entry goes, if its name stays inside the folder.
    fn place(&mut self, name: &str) -> Result<PathBuf, ArchiveError> {
        self.n_entries += 1;
        if self.n_entries > self.limits.max_entries {
            let limit = self.limits.max_entries;
            return Err(self.refused(name, format!("is one too many: at most {limit} are allowed")));
        }
        let absolute = name.starts_with('/') || name.as_bytes().get(1) == Some(&b':');
        if absolute || name.contains(['\\', '\0']) || name.split('/').any(|part| part == "..") {
            return Err(self.refused(name, "leaves the archive's folder"));
        }
        // Empty and `.` components, as in `./manifest.json` and `folder/`, name nothing.
        let parts = name.split('/').filter(|part| !matches!(*part, "" | "."));
        Ok(parts.fold(self.folder.to_owned(), |path, part| path.join(part)))
    }

    fn directory(&mut self, name: &str) -> Result<(), ArchiveError> {
        let path = self.place(name)?;
        fs::create_dir_all(path).map_err(|error| self.refused(name, error))
    }

    fn file(&mut self, name: &str, content: &mut impl Read) -> Result<(), ArchiveError> {
        let path = self.place(name)?;
        let mut write = || {
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            // A second entry of the same name would replace what was checked first.
            let mut file = File::create_new(&path)?;
            io::copy(&mut content.take(self.n_bytes_left + 1), &mut file)
        };
        let n_bytes = write().map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => self.refused(name, "appears twice"),
            _ => self.refused(name, error),
        })?;
        self.n_bytes_left = self.n_bytes_left.checked_sub(n_bytes).ok_or_else(|| {
            let Limits {
                max_bytes,
                max_expansion,
                ..
            } = self.limits;
            self.refused(
                name,
                format!("expands too far: at most {max_bytes} bytes and {max_expansion} times the archive are allowed"),
            )
        })?;
        Ok(())
    }
}
