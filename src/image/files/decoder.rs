//! The library's side of the decode worker: starting it, asking, and ending it when it hangs. See [`super::protocol`].
//!
//! One file is decoded at a time. Whatever goes wrong, the worker that did it is dropped and the next request starts
//! another, so that one bad file costs one error.

use super::protocol::{Format, Header, PlaneRequest, Reply, Request, Settings};
use super::{ImageError, Limits, Plane};
use rustix::fs::{FallocateFlags, fallocate, statvfs};
use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::{env, iter};
use tempfile::NamedTempFile;

const PROGRAM_NAME: &str = "afterimage-oiio-decoder";

/// What OpenImageIO and the libraries it brings map before any image is opened, with room for their threads' stacks.
const LIBRARIES_BYTES: u64 = 2 << 30;

/// The worker named by `AFTERIMAGE_DECODER`, or the one beside the running program or up to two folders above it
/// (tests and benchmarks lie in `target/*/deps`).
pub(super) fn find_program() -> Option<PathBuf> {
    if let Some(program) = env::var_os("AFTERIMAGE_DECODER") {
        return Some(program.into());
    }
    let executable = env::current_exe().ok()?;
    let folders = executable.ancestors().skip(1).take(3);
    folders
        .map(|folder| folder.join(PROGRAM_NAME))
        .find(|program| program.is_file())
}

/// A worker that is started when first asked.
#[derive(Debug)]
pub(super) struct Decoder {
    program: Option<PathBuf>,
    timeout: Duration,
    max_bytes: u64,
    worker: Mutex<Option<Worker>>,
}

impl Decoder {
    /// Starts nothing yet.
    pub fn new(program: Option<PathBuf>, limits: &Limits) -> Self {
        let (timeout, max_bytes) = (limits.decode_timeout, limits.max_bytes);
        Self {
            program,
            timeout,
            max_bytes,
            worker: Mutex::new(None),
        }
    }

    /// Of the worker, where one is running.
    pub fn process_id(&self) -> Option<u32> {
        self.lock().as_ref().map(|worker| worker.process.id())
    }

    /// What the file holds.
    pub fn describe(&self, path: &Path, format: Format) -> Result<Header, ImageError> {
        let request = Request::Describe {
            path: absolute(path)?,
            format,
        };
        self.with_worker(path, |worker| match worker.ask(path, &request, self.timeout)? {
            Reply::Header(header) if !header.parts.is_empty() => Ok(header),
            reply => Err(worker.unexpected(path, &reply)),
        })
    }

    /// The planes of the data windows. Their sizes must have passed the limits.
    pub fn read(&self, path: &Path, format: Format, wanted: &[PlaneRequest]) -> Result<Vec<Plane>, ImageError> {
        let request = Request::Read {
            path: absolute(path)?,
            format,
            planes: wanted.to_vec(),
        };
        self.with_worker(path, |worker| {
            let n_bytes = 4 * wanted.iter().map(|plane| plane.n_pixels as u64).sum::<u64>();
            // Reserved, not only sized: a worker that writes to a full memory file system dies of a bus error.
            fallocate(&worker.pixels, FallocateFlags::empty(), 0, n_bytes.max(1))
                .map_err(|error| ImageError::io(path)(error.into()))?;
            match worker.ask(path, &request, self.timeout)? {
                Reply::Pixels => worker.planes(wanted).map_err(ImageError::io(path)),
                reply => Err(worker.unexpected(path, &reply)),
            }
        })
    }

    /// Runs `ask` with a living worker, and keeps that only where it did its work or said properly why not.
    fn with_worker<T>(
        &self,
        path: &Path,
        ask: impl FnOnce(&mut Worker) -> Result<T, ImageError>,
    ) -> Result<T, ImageError> {
        let mut kept = self.lock();
        let living = kept.take().and_then(|mut worker| match worker.process.try_wait() {
            Ok(None) => Some(worker),
            _ => None,
        });
        let mut worker = living.map_or_else(|| self.start(path), Ok)?;
        let done = ask(&mut worker);
        if matches!(done, Ok(_) | Err(ImageError::Damaged { .. })) {
            *kept = Some(worker);
        }
        done
    }

    fn start(&self, path: &Path) -> Result<Worker, ImageError> {
        let missing = || ImageError::DecoderMissing { path: path.to_owned() };
        let program = self.program.clone().ok_or_else(missing)?;
        let pixels = shared_file(self.max_bytes).map_err(ImageError::io(path))?;
        let settings = Settings {
            pixels: pixels.path().to_owned(),
            // The shared planes, the decoder's own image, and what it decompresses from.
            memory_bytes: LIBRARIES_BYTES + 8 * self.max_bytes,
            image_mib: u32::try_from(self.max_bytes >> 20).unwrap_or(u32::MAX).max(1),
        };
        let settings = serde_json::to_string(&settings).map_err(|error| ImageError::io(path)(error.into()))?;
        let spawned = Command::new(&program)
            .arg(settings)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn();
        let mut process = spawned.map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => missing(),
            _ => ImageError::io(&program)(error),
        })?;
        let stdin = process.stdin.take().expect("it was asked for");
        let replies = lines_of(process.stdout.take().expect("it was asked for"));
        let shared = pixels.as_file().try_clone().map_err(ImageError::io(path))?;
        let mut worker = Worker {
            program,
            process,
            stdin,
            replies,
            pixels: shared,
        };
        match worker.reply(path, self.timeout)? {
            Reply::Ready => Ok(worker),
            reply => Err(worker.unexpected(path, &reply)),
        }
        // `pixels` is unlinked here: the worker has it open, and nothing is left behind however both end.
    }

    fn lock(&self) -> MutexGuard<'_, Option<Worker>> {
        // A panic while it was held dropped the worker, so that what is left is sound.
        self.worker.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A running worker; killed when dropped.
#[derive(Debug)]
struct Worker {
    program: PathBuf,
    process: Child,
    stdin: ChildStdin,
    replies: Receiver<String>,
    pixels: File,
}

impl Worker {
    fn ask(&mut self, path: &Path, request: &Request, timeout: Duration) -> Result<Reply, ImageError> {
        let mut line = serde_json::to_string(request).map_err(|error| ImageError::io(path)(error.into()))?;
        line.push('\n');
        if self.stdin.write_all(line.as_bytes()).is_err() {
            return Err(self.crashed(path));
        }
        self.reply(path, timeout)
    }

    fn reply(&mut self, path: &Path, timeout: Duration) -> Result<Reply, ImageError> {
        match self.replies.recv_timeout(timeout) {
            Ok(line) => serde_json::from_str(&line).map_err(|error| self.version(path, error.to_string())),
            Err(RecvTimeoutError::Timeout) => Err(ImageError::DecoderTimeout {
                path: path.to_owned(),
                timeout,
            }),
            Err(RecvTimeoutError::Disconnected) => Err(self.crashed(path)),
        }
    }

    /// Its output has ended; so has it, or it soon will.
    fn crashed(&mut self, path: &Path) -> ImageError {
        match self.process.wait() {
            Ok(status) => ImageError::DecoderCrashed {
                path: path.to_owned(),
                status,
            },
            Err(error) => ImageError::io(path)(error),
        }
    }

    fn unexpected(&self, path: &Path, reply: &Reply) -> ImageError {
        match reply {
            Reply::Error(reason) => ImageError::damaged(path, reason),
            other => self.version(path, format!("it answered {other:?}")),
        }
    }

    fn version(&self, path: &Path, reason: String) -> ImageError {
        ImageError::DecoderVersion {
            path: path.to_owned(),
            program: self.program.clone(),
            reason,
        }
    }

    fn planes(&self, wanted: &[PlaneRequest]) -> std::io::Result<Vec<Plane>> {
        let mut offset = 0;
        wanted
            .iter()
            .map(|plane| {
                let at = offset;
                offset += 4 * plane.n_pixels as u64;
                Ok(if plane.integer {
                    let mut samples = vec![0_u32; plane.n_pixels];
                    self.pixels.read_exact_at(bytemuck::cast_slice_mut(&mut samples), at)?;
                    Plane::U32(samples)
                } else {
                    let mut samples = vec![0_f32; plane.n_pixels];
                    self.pixels.read_exact_at(bytemuck::cast_slice_mut(&mut samples), at)?;
                    Plane::F32(samples)
                })
            })
            .collect()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // It may hang in a decoder, so that closing its input is not enough. Both fail only where it has ended.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A thread, because a pipe cannot be read with a time-out. It ends with the worker.
fn lines_of(output: ChildStdout) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let lines = BufReader::new(output).lines();
        lines.map_while(Result::ok).try_for_each(|line| sender.send(line))
    });
    receiver
}

/// In memory where that has room (containers often give 64 MiB), else in the temporary folder.
fn shared_file(max_bytes: u64) -> std::io::Result<NamedTempFile> {
    let memory = Path::new("/dev/shm");
    let has_room = statvfs(memory).is_ok_and(|fs| fs.f_bavail.saturating_mul(fs.f_frsize) >= 4 * max_bytes);
    let in_memory = iter::once(memory)
        .filter(|_| has_room)
        .find_map(|folder| NamedTempFile::new_in(folder).ok());
    in_memory.map_or_else(NamedTempFile::new, Ok)
}

fn absolute(path: &Path) -> Result<PathBuf, ImageError> {
    std::path::absolute(path).map_err(ImageError::io(path))
}
